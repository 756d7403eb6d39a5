"""``sniffer recover``: a recording that was cut off, made whole again."""

from __future__ import annotations

from pathlib import Path

import click

from sniffer.cli.options import examples, files_here, with_force


@click.command(
    short_help="Repair a recording that was cut off.",
    epilog=examples("sniffer recover night.mcap", "sniffer recover night.mcap -o whole.mcap"),
)
@click.argument("file", shell_complete=files_here, type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Default: FILE itself.")
@with_force
def recover(file: Path, output: Path | None, force: bool) -> int:
    """Repair the recording FILE (.mcap) that a killed recorder left behind."""
    from sniffer.ground.files import refuse_occupied
    from sniffer.mcapfile.recover import recover as repair

    if output is not None and output.suffix.lower() != ".mcap":
        raise click.UsageError(f"{output}: a recording's name ends in .mcap")
    if output is not None and not force and output.resolve() != file.resolve():
        refuse_occupied([output])
    report = repair(file, output or file)
    click.echo(str(report))
    return 0
