"""``sniffer report``: a page on a capture, to hand on."""

from __future__ import annotations

from pathlib import Path

import click

from sniffer.cli.options import decoding, examples, with_files, with_force, with_quiet
from sniffer.cli.selecting import with_part
from sniffer.cli.signals import patient
from sniffer.cli.statuses import MISTAKE, status_of
from sniffer.decoding.options import Options
from sniffer.ground.wording import counted
from sniffer.jobs.report import report as write_report
from sniffer.jobs.telling import Teller
from sniffer.selection.places import Window


@click.command(
    short_help="Write a page on a capture: what was wrong, and the bytes.",
    epilog=examples(
        "sniffer report run.mcap -o report.html",
        "sniffer report capture.log -o report.md",
        "sniffer report capture.log | less",
    ),
)
@with_files
@with_part
@decoding
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="A page (.html) or Markdown (.md); without it Markdown is printed.",
)
@with_force
@with_quiet
def report(
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    output: Path | None,
    force: bool,
    window: Window | None,
    tell: Teller,
) -> int:
    """Write a report on FILE (- is standard input): one page, to attach to a bug report.

    Several are one capture, read in the order of their times: such as the files of a rotation.

    The verdict comes first; then incidents with their bytes, curves, response times, where each
    byte is, and what the input says of itself: its clock, the metadata of a recording. The page is
    one file: it fetches nothing. Exit status: 0 written; 2 a mistake of yours; 3 the input breaks
    off (the report is on what could be read).
    """
    with patient() as patience:
        done = write_report(
            files,
            output,
            options,
            input_format=input_format,
            overwrite=force,
            window=window,
            patience=patience,
            tell=tell,
        )
    status = status_of(done.ending, is_lost=bool(done.gone))
    if output is None and status != MISTAKE:
        click.echo(done.as_text(), nl=False)
    elif status != MISTAKE:
        found = len(done.content.incidents)
        tell.talk(f"wrote {output}: {counted(found, 'incident') if found else 'no incident'}")
    return status
