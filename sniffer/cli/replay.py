"""``sniffer replay``: a recording again, in real time, or decoded afresh and compared."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import click

from sniffer.cli.options import Finite, decoding, examples, pipeline_options
from sniffer.jobs.session import Standard, merged, run_source
from sniffer.cli.streams import say
from sniffer.decoding.detect import ENOUGH, UndecidedError, detect
from sniffer.decoding.pipeline import AUTO, Options
from sniffer.decoding.sink import Sink
from sniffer.ground.limits import FALLBACK_BAUD
from sniffer.ground.model import Chunk
from sniffer.ground.needs import need_rerun
from sniffer.ground.registers import RegisterMap
from sniffer.jobs.replay import Window, paced, peek, steps, timed, within
from sniffer.protocols.base import BusProtocol
from sniffer.sources import open_source


@click.command(
    short_help="Play a recording or a capture again.",
    epilog=examples(
        "sniffer replay recording.mcap --speed 2 --from 10 --to 20",
        "sniffer replay dump.hex --protocol mightyzap --baud 57600 --loop",
        "sniffer replay recording.mcap --redecode",
    ),
)
@click.argument("file")
@decoding
@click.option(
    "--speed",
    type=Finite(0),
    default=1.0,
    show_default=True,
    help="Times real time; 0: as fast as it goes.",
)
@click.option(
    "--from",
    "start",
    type=Finite(0),
    default=0.0,
    metavar="S",
    help="Begin S seconds into the recording.",
)
@click.option("--to", "stop", type=Finite(0), metavar="S", help="Stop S seconds into it.")
@click.option("--loop", is_flag=True, help="Begin again at the end, until Ctrl-C.")
@click.option("--rerun", "in_rerun", is_flag=True, help="Show it in the Rerun viewer, not here.")
@click.option(
    "--redecode",
    is_flag=True,
    help="Decode the raw bytes with today's decoder and compare with what was recorded.",
)
def replay(
    file: str,
    protocol: str,
    input_format: str,
    baud: int | None,
    models: dict[int | None, str],
    tables: tuple[RegisterMap, ...],
    latency: float | None,
    speed: float,
    start: float,
    stop: float | None,
    loop: bool,
    in_rerun: bool,
    redecode: bool,
) -> int:
    """Play FILE (a recording, or any capture) again through the console or Rerun.

    An input without times is played at the pace of its baud rate.
    """
    options = pipeline_options(protocol, baud, models, latency, tables)
    if stop is not None and stop <= start:
        raise click.UsageError("--to must lie behind --from")
    if file == "-" and loop:
        raise click.UsageError("--loop needs a file: standard input can be read only once")
    if redecode and in_rerun:
        raise click.UsageError("--redecode compares, --rerun shows: choose one")
    if in_rerun:
        need_rerun()
    if redecode:
        from sniffer.jobs.compare import compare

        report = compare(Path(file), options, say=say)
        click.echo(str(report))
        return 0 if report.equal else 1
    status, played = 0, False
    while not status and (loop or not played):
        source = open_source(file, input_format)
        options = options.with_facts(source.facts(), source.tables)
        heard = merged(source, source, options, quiet=played)
        chunks: Iterable[Chunk] = (chunk for group in heard for chunk in group)
        # looked at beforehand: what is to be played in real time cannot wait for it
        head, chunks = peek(chunks, ENOUGH)
        if options.protocol == AUTO and not played:
            told = {**_told(head, options), **options.protocols}
            options = dataclasses.replace(options, protocols=told)
        part = within(timed(chunks, _baud(options)), Window(start, stop), ends=True)
        groups: Iterable[Sequence[Chunk]] = paced(steps(part), speed)
        if not played and (start or stop is not None):
            groups = _as_part(groups, start, stop)
        sink: Sink
        if in_rerun:
            from sniffer.viewers.viewer import live_sink

            sink = live_sink(Path(file).stem)
        else:
            from sniffer.sinks.text import TextSink

            sink = Standard(TextSink(sys.stdout), alone=True)
        name = "standard input" if file == "-" else file
        _, status = run_source(
            source, options, [sink], name=name, quiet=played, groups=groups, ahead=head
        )
        played = True
    return status


def _as_part(
    groups: Iterable[Sequence[Chunk]], start: float, stop: float | None
) -> Iterator[Sequence[Chunk]]:
    """Pass groups on; that they are a part is said once there is one."""
    until = "its end" if stop is None else f"second {stop:g}"
    for number, group in enumerate(groups):
        if not number:
            say(f"a part of it: from second {start:g} to {until}; what is open at its edges is cut")
        yield group


def _told(head: Iterable[Chunk], options: Options) -> dict[str, str | BusProtocol]:
    """Return the protocol of each bus, and say so; what cannot be told yet is left out.

    What a recording says of itself is known: the bytes are not asked against it.
    """
    by_bus: dict[str, list[Chunk]] = {}
    for chunk in head:
        by_bus.setdefault(chunk.bus, []).append(chunk)
    out: dict[str, str | BusProtocol] = {}
    for bus, chunks in by_bus.items():
        with contextlib.suppress(UndecidedError):
            found = detect(chunks, options.bauds.get(bus, options.baud))
            if options.protocols.get(bus, found.protocol) == found.protocol:
                say(f"{bus}: {found}")
            out[bus] = found.protocol
    return out


def _baud(options: Options) -> int:
    named = next(iter(options.protocols.values()), options.protocol)
    return options.baud or (FALLBACK_BAUD if named == AUTO else options.all_spoken(named)[0].baud)
