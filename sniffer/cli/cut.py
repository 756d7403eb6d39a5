"""``sniffer cut``: a part of a capture as a capture of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import click

from sniffer.cli.options import (
    decoding,
    examples,
    with_anonymise,
    with_files,
    with_force,
    with_outputs,
    with_quiet,
)
from sniffer.cli.selecting import with_buses, with_part
from sniffer.cli.signals import patient
from sniffer.cli.statuses import status_of
from sniffer.cli.streams import wrote
from sniffer.decoding.options import Options
from sniffer.ground.amounts import time_in
from sniffer.ground.files import files_of
from sniffer.jobs.cut import cut as cut_out
from sniffer.jobs.split import split
from sniffer.jobs.telling import Teller
from sniffer.selection.places import Window

BY_BUS: Final = "bus"
"""How ``--split`` makes a piece a bus; else it is a time."""


def _split_by(
    context: click.Context, parameter: click.Parameter, given: str | None
) -> int | str | None:
    """Read how a capture is split: a time in ns, or by bus."""
    if given is None or given == BY_BUS:
        return given
    ns = time_in(given, bare=True, least=1)
    if ns is None:
        raise click.BadParameter(f"{given!r}: write a time such as 10min, or {BY_BUS}")
    return ns


@click.command(
    short_help="Cut a part out of a capture.",
    epilog=examples(
        "sniffer cut run.mcap --from 10 --to 20 -o part.mcap",
        "sniffer cut run.mcap --from @first-error --around 200ms -o error.mcap",
        "sniffer cut run.mcap --from @first-error:servo=3 --around 200ms -o three.mcap",
        "sniffer cut capture.log --to 1.5 -o begin.log",
        "sniffer cut robot.mcap --bus arm -o arm.mcap",
        "sniffer cut day.mcap --split 1h -o hour.mcap",
        "sniffer cut robot.mcap --split bus -o limb.mcap",
        "sniffer cut run.mcap --from @first-error --around 2s --anonymise -o shared.mcap",
    ),
)
@with_files
@decoding
@with_part
@with_buses
@click.option(
    "--split",
    "split_by",
    callback=_split_by,
    metavar="TIME|bus",
    help="Not one part but all of them side by side: one each 10min, 1h (part-0001.mcap and on), "
    "or one a bus (part-arm.mcap).",
)
@with_outputs("The part")
@with_anonymise
@with_force
@with_quiet
def cut(
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    window: Window | None,
    buses: tuple[str, ...],
    split_by: int | str | None,
    outputs: tuple[Path, ...],
    anonymise: bool,
    force: bool,
    tell: Teller,
) -> int:
    """Cut a part out of FILE (- is standard input).

    Several are one capture, read in the order of their times: such as the files of a rotation.

    It is cut between frames and tears no exchange, so it says what the whole says there; it may
    begin and end a little outside of what was asked for. A part has every byte of its buses: those
    of some servos or commands alone are made by `sniffer convert run.mcap three.log --servo 3`.
    With --bus it has those buses alone. With --split it makes many: no byte is in two of them.
    """
    window = window or Window()
    if split_by is None and not (window.is_part or buses):
        raise click.UsageError("say which part: --from, --to or both, --bus, or --split")
    with patient() as patience:
        how: dict[str, Any] = {
            "buses": buses,
            "input_format": input_format,
            "anonymise": anonymise,
            "overwrite": force,
            "patience": patience,
            "tell": tell,
        }
        if split_by is None:
            done, made = [cut_out(files, outputs, window, options, **how)], [*outputs]
        else:
            every_ns = None if isinstance(split_by, str) else split_by
            pieces = split(files, outputs, every_ns, window, options, **how)
            done = [piece.done for piece in pieces]
            made = [file for piece in pieces for path in piece.files for file in files_of(path)]
    status = max(status_of(one.ending, is_lost=bool(one.gone)) for one in done)
    if not status:
        tell.talk(wrote(made))
    return status
