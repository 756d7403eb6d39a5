"""``sniffer replay``: a recording again, in real time, or decoded afresh and compared."""

from __future__ import annotations

import functools
import sys
from pathlib import Path
from typing import Any

import click

from sniffer.cli.options import (
    Finite,
    decoding,
    examples,
    with_color,
    with_files,
    with_force,
    with_quiet,
    with_times,
)
from sniffer.cli.playback import play_on, refuse_with_port, refuse_without_port, with_playback
from sniffer.cli.selecting import with_part_and_ports, with_rows
from sniffer.cli.signals import patient
from sniffer.cli.statuses import status_of
from sniffer.cli.streams import say
from sniffer.decoding.options import Options
from sniffer.decoding.sink import Sink
from sniffer.ground.needs import need_rerun
from sniffer.jobs.replay import replay as played
from sniffer.jobs.telling import Teller
from sniffer.selection.places import Window
from sniffer.selection.selection import Selection
from sniffer.sinks.standard import Standard


@click.command(
    short_help="Play a recording or a capture again.",
    epilog=examples(
        "sniffer replay recording.mcap --speed 2 --from 10 --to 20",
        "sniffer replay dump.hex --protocol mightyzap --baud 57600 --loop",
        "sniffer replay recording.mcap --redecode",
        "sniffer replay recording.mcap --from 10 --to 20 --to pty --link bus",
        "sniffer replay recording.mcap --to pty --as servos",
    ),
)
@with_files
@with_part_and_ports
@with_rows
@decoding
@click.option(
    "--speed",
    type=Finite(0),
    default=1.0,
    show_default=True,
    help="Times real time; 0: as fast as it goes.",
)
@with_times
@with_color
@click.option("--loop", is_flag=True, help="Begin again at the end, until Ctrl-C.")
@click.option("--rerun", "in_rerun", is_flag=True, help="Show it in the Rerun viewer, not here.")
@click.option(
    "--redecode",
    is_flag=True,
    help="Decode the raw bytes with today's decoder and compare with what was recorded.",
)
@click.option(
    "-o",
    "--output",
    "outputs",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Also write what is played; the suffix says what (see sniffer convert). May be repeated.",
)
@with_force
@with_playback
@with_quiet
def replay(
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    speed: float,
    times: str,
    color: bool | None,
    loop: bool,
    in_rerun: bool,
    redecode: bool,
    outputs: tuple[Path, ...],
    force: bool,
    window: Window | None,
    selection: Selection | None,
    to: tuple[str, ...],
    playback: dict[str, Any],
    tell: Teller,
) -> int:
    """Play FILE (a recording, or any capture) again through the console or Rerun, or on a port.

    Several are one capture, read in the order of their times: such as the files of a rotation. An
    input without times is played at the pace of its baud rate.
    """
    if not to:
        refuse_without_port(playback)
    else:
        given = click.get_current_context().params
        refuse_with_port(given)
        return play_on(
            files,
            to,
            options,
            playback,
            input_format=input_format,
            window=window,
            buses=given["buses"],
            speed=speed,
            loop=loop,
            outputs=outputs,
            force=force,
            tell=tell,
        )
    if redecode and in_rerun:
        raise click.UsageError("--redecode compares, --rerun shows: choose one")
    if redecode and (window is not None or selection is not None):
        raise click.UsageError("--redecode compares all that was recorded: take no part of it")
    if redecode and len(files) > 1:
        raise click.UsageError("--redecode compares one recording: name one FILE")
    if redecode and outputs:
        raise click.UsageError("--redecode compares, -o writes: choose one")
    if redecode:
        from sniffer.jobs.compare import compare

        report = compare(Path(files[0]), options, say=say)
        click.echo(str(report))
        return 0 if report.equal else 1
    if in_rerun:
        need_rerun()
        shown = functools.partial(_rerun, Path(files[0]).stem)
    else:
        shown = functools.partial(_console, times, color)
    with patient() as patience:
        ending = played(
            files,
            shown,
            options,
            input_format=input_format,
            window=window,
            selection=selection,
            speed=speed,
            loop=loop,
            outputs=outputs,
            overwrite=force,
            patience=patience,
            tell=tell,
        )
    return status_of(ending)


def _rerun(name: str) -> Sink:
    from sniffer.viewers.viewer import live_sink

    return live_sink(name)


def _console(times: str, color: bool | None) -> Sink:
    from sniffer.sinks.intime import PLAYED
    from sniffer.sinks.text import TextSink

    sink = TextSink(sys.stdout, color=color, times=times, waits=PLAYED)
    return Standard(sink, sys.stdout, alone=True)
