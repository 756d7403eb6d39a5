"""``sniffer layout``: the layout of a recording for Foxglove."""

from __future__ import annotations

import json
from pathlib import Path

import click

from sniffer.cli.options import examples, files_here


@click.command(
    short_help="Print the Foxglove layout of a recording.",
    epilog=examples("sniffer layout run.mcap > layout.json"),
)
@click.argument("file", shell_complete=files_here, type=click.Path(path_type=Path))
def layout(file: Path) -> int:
    """Print a layout for Foxglove or Lichtblick that shows what the recording FILE (.mcap) has.

    Import it there: Layouts, Import from file. A recording has it attached, too.
    """
    from sniffer.mcapfile.shown import layout_of

    click.echo(json.dumps(layout_of(file), indent=1, ensure_ascii=False))
    return 0
