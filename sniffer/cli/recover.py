"""``sniffer recover``: a recording that was cut off, made whole again."""

from __future__ import annotations

from pathlib import Path

import click

from sniffer.cli.options import examples


@click.command(
    short_help="Repair a recording that was cut off.",
    epilog=examples("sniffer recover night.mcap", "sniffer recover night.mcap -o whole.mcap"),
)
@click.argument("file", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Default: FILE itself.")
def recover(file: Path, output: Path | None) -> int:
    """Repair the recording FILE (.mcap) that a killed recorder left behind."""
    from sniffer.recovery import recover as repair

    report = repair(file, output or file)
    click.echo(str(report))
    return 0
