"""``sniffer compact``: the tables of a data set in few large files."""

from __future__ import annotations

import click

from sniffer.cli.fleet import Progress
from sniffer.cli.options import examples
from sniffer.cli.statuses import DAMAGED, DONE
from sniffer.cli.streams import say
from sniffer.fleet.compact import CompactedFleet, compact_fleet
from sniffer.fleet.rows import UndoneError
from sniffer.ground.wording import counted


@click.command(
    short_help="Copy a data set into few large files.",
    epilog=examples(
        "sniffer compact dataset -o compact",
        "sniffer compact s3://robots/dataset -o s3://robots/compact",
    ),
)
@click.argument("dataset", type=click.Path())
@click.option(
    "-o", "--output", required=True, metavar="FOLDER",
    help="The folder of the copy; it may be there already.",
)  # fmt: skip
@click.option("-q", "--quiet", is_flag=True, help="Say only what goes wrong.")
def compact(dataset: str, output: str, quiet: bool) -> int:
    """Copy the tables of DATASET, made by `sniffer fleet`, into files of up to 512 MB.

    Questions to many captures take long to open their files; of the copy they open one a table,
    robot and day. DATASET stays as it is. The same command brings the copy up to date: what has not
    changed is skipped without being read.

    Exit status: 0 the copy is as DATASET; 2 a mistake of yours; 3 it could not be made: run it
    again.
    """
    shown = Progress(quiet=quiet, of="files")
    try:
        done = compact_fleet(dataset, output, progress=shown.progress)
    except UndoneError as error:
        shown.end()
        say(str(error))
        return DAMAGED
    shown.end()
    if not quiet:
        click.echo(_told(done))
    return DONE


def _told(done: CompactedFleet) -> str:
    """Return what was done, in a line."""
    what = f"{counted(done.captures, 'capture')}, {counted(done.sources, 'file')}"
    how = f"{done.written} written, {done.files - done.written} there already"
    return f"{what} in {done.files} ({how})"
