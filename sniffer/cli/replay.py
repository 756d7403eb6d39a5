"""``sniffer replay``: a recording again, in real time, or decoded afresh and compared."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from sniffer.cli.options import decoding, pipeline_options
from sniffer.cli.session import Standard, run_source, say
from sniffer.model import DamagedInputError, InputError
from sniffer.protocols import PROTOCOLS
from sniffer.replaying import Window, paced, steps, timed, within
from sniffer.sinks.base import Sink
from sniffer.sources import open_source


@click.command()
@click.argument("file")
@decoding
@click.option(
    "--speed",
    type=click.FloatRange(0),
    default=1.0,
    show_default=True,
    help="Times real time; 0: as fast as it goes.",
)
@click.option(
    "--from",
    "start",
    type=click.FloatRange(0),
    default=0.0,
    metavar="S",
    help="Begin S seconds into the recording.",
)
@click.option("--to", "stop", type=click.FloatRange(0), metavar="S", help="Stop S seconds into it.")
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
    latency: float | None,
    speed: float,
    start: float,
    stop: float | None,
    loop: bool,
    in_rerun: bool,
    redecode: bool,
) -> int:
    """Play FILE (a recording, or any capture) again through the console or Rerun."""
    options = pipeline_options(protocol, baud, models, latency)
    if stop is not None and stop <= start:
        raise click.BadParameter("--to must lie behind --from")
    if redecode:
        from sniffer.comparing import compare

        report = compare(Path(file), options, say=say)
        click.echo(str(report))
        return 0 if report.equal else 1
    pace = baud or (PROTOCOLS[protocol].baud if protocol in PROTOCOLS else 115200)
    status, played = 0, False
    while True:
        source = open_source(file, input_format)
        groups = paced(steps(within(timed(source, pace), Window(start, stop))), speed)
        sink: Sink
        if in_rerun:
            from sniffer.viewing import live_sink

            sink = live_sink(Path(file).stem)
        else:
            from sniffer.sinks.text import TextSink

            sink = Standard(TextSink(sys.stdout), alone=True)
        try:
            _, status = run_source(groups, options, [sink], name=file, quiet=played)
        except InputError as error:
            if played or start == 0:
                raise
            raise InputError(f"{file}: nothing lies behind --from {start:g} ({error})") from None
        except DamagedInputError as error:
            say(str(error))
            status = 3
        played = True
        if not loop or status:
            return status
