"""``sniffer merge``: several captures as one, by time."""

from __future__ import annotations

from pathlib import Path

import click

from sniffer.cli.options import (
    decoding,
    examples,
    files_here,
    with_anonymise,
    with_force,
    with_outputs,
    with_quiet,
)
from sniffer.cli.signals import patient
from sniffer.cli.statuses import status_of
from sniffer.cli.streams import wrote
from sniffer.decoding.options import Options
from sniffer.ground.amounts import time_in
from sniffer.jobs.merge import merge as merge_all
from sniffer.jobs.telling import Teller


def offsets_of(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> dict[str, int]:
    """Read ``--offset FILE=+1.25s``; in ns."""
    out: dict[str, int] = {}
    for text in given:
        file, equals, amount = text.rpartition("=")
        sign, size = (amount[:1], amount[1:]) if amount[:1] in ("+", "-") else ("", amount)
        ns = time_in(size, bare=True, least=0) if equals and file else None
        if ns is None:
            raise click.BadParameter(f"{text[:80]!r}: write FILE=+1.25s or FILE=-300ms")
        out[file] = -ns if sign == "-" else ns
    return out


@click.command(
    short_help="Make one capture of several, by time.",
    epilog=examples(
        "sniffer merge left.mcap right.mcap -o both.mcap",
        "sniffer merge a.log b.log --offset b.log=+1.25s -o both.mcap",
        "sniffer merge a.mcap b.mcap --align -o both.mcap",
        "sniffer merge part-1.log part-2.log --together -o whole.log",
        "sniffer merge controller.log servos.log --pair -o bus.mcap",
    ),
)
@click.argument("files", shell_complete=files_here, metavar="FILE FILE...", nargs=-1, required=True)
@decoding
@click.option(
    "--offset",
    "offsets",
    multiple=True,
    callback=offsets_of,
    metavar="FILE=TIME",
    help="Add this to the times of FILE (its path, or its name with or without the suffix), such "
    "as b.log=+1.25s; may be repeated.",
)
@click.option(
    "--align",
    is_flag=True,
    help="Find what to add from the traffic that taps of one bus both heard, with --pair from "
    "who answers what; the first FILE's clock counts.",
)
@click.option(
    "--pair",
    is_flag=True,
    help="The first FILE heard the controller's wire, the second the servos': make them one bus.",
)
@click.option(
    "--together",
    is_flag=True,
    help="The FILEs are one capture, such as a log in pieces: buses of one name are one bus.",
)
@with_outputs("The merged capture")
@with_anonymise
@with_force
@with_quiet
def merge(
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    offsets: dict[str, int],
    align: bool,
    pair: bool,
    together: bool,
    outputs: tuple[Path, ...],
    anonymise: bool,
    force: bool,
    tell: Teller,
) -> int:
    """Make one capture of all FILEs, in the order of time.

    A bus keeps its name; where several files have a bus of one name, each is called after its file.
    The files of one recording (record --rotate) are one bus again, and so are those --together.
    """
    if len(files) < 2:
        raise click.UsageError("merge takes two files or more")
    with patient() as patience:
        done = merge_all(
            files,
            outputs,
            options,
            offsets=offsets,
            align=align,
            pair=pair,
            together=together,
            input_format=input_format,
            anonymise=anonymise,
            overwrite=force,
            patience=patience,
            tell=tell,
        )
    status = status_of(done.ending, is_lost=bool(done.gone))
    if not status:
        tell.talk(wrote(outputs))
    return status
