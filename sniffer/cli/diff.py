"""``sniffer diff``: in what two runs differ."""

from __future__ import annotations

import json
from pathlib import Path

import click

from sniffer.cli.options import decoding, examples, files_here, with_force, with_format, with_quiet
from sniffer.cli.selecting import with_both_parts, with_rows
from sniffer.cli.signals import patient
from sniffer.cli.statuses import status_of
from sniffer.decoding.options import Options
from sniffer.jobs.diff import diff as compared
from sniffer.jobs.telling import Teller
from sniffer.selection.places import Window
from sniffer.selection.selection import Selection


@click.command(
    short_help="Compare two runs, servo by servo.",
    epilog=examples(
        "sniffer diff before.mcap after.mcap",
        "sniffer diff before.mcap after.mcap --format json",
        "sniffer diff before.mcap after.mcap --servo 3 --from 10 --to 20",
        "sniffer diff before.mcap after.mcap --from 10 --to 20 --from-b 14.5",
        "sniffer diff before.mcap after.mcap -o both.rrd",
    ),
)
@click.argument("a", shell_complete=files_here, metavar="A")
@click.argument("b", shell_complete=files_here, metavar="B")
@with_both_parts
@with_rows
@decoding
@with_format("text", "json")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Also plot both, one over the other, in a .rrd.",
)
@with_force
@with_quiet
def diff(
    a: str,
    b: str,
    options: Options,
    input_format: str,
    output_format: str,
    output: Path | None,
    force: bool,
    windows: tuple[Window | None, Window | None],
    selection: Selection | None,
    tell: Teller,
) -> int:
    """Say in what the runs A and B differ: answers, values, goals, errors, settings, commands.

    Each difference has its test and its n, the surest comes first; chances are corrected for all
    that was compared. Exit status: 0 the same as far as can be told; 1 they differ; 2 a mistake of
    yours; 3 an input breaks off (what could be read is compared).
    """
    with patient() as patience:
        done = compared(
            a,
            b,
            output,
            options,
            input_format=input_format,
            overwrite=force,
            window=windows[0],
            window_b=windows[1],
            selection=selection,
            patience=patience,
            tell=tell,
        )
    if output_format == "json":
        click.echo(json.dumps(done.as_dict()))
    else:
        from sniffer.sinks.consoles import console_for, folded

        console = console_for()
        room = console.width if console.file.isatty() else None
        click.echo("\n".join(folded(done.lines(), room)))
    if status := status_of(done.ending, is_lost=bool(done.gone)):
        return status
    return 0 if done.equal else 1
