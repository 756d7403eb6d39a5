"""``sniffer view``: any capture or recording in the Rerun viewer."""

from __future__ import annotations

from pathlib import Path

import click

from sniffer.cli.options import (
    Renamed,
    Whole,
    decoding,
    examples,
    with_files,
    with_force,
    with_quiet,
)
from sniffer.cli.selecting import say_selected, with_part, with_rows
from sniffer.cli.signals import patient
from sniffer.cli.statuses import status_of
from sniffer.decoding.options import Options
from sniffer.ground.needs import need_rerun
from sniffer.jobs.convert import convert
from sniffer.jobs.session import undecided_of
from sniffer.jobs.telling import Teller
from sniffer.jobs.view import view as shown
from sniffer.selection.places import Window
from sniffer.selection.selection import Selection
from sniffer.sources.several import name_of


@click.command(
    short_help="Show a recording or a capture in Rerun.",
    epilog=examples(
        "sniffer view recording.mcap",
        "sniffer view recording.mcap --servo 3-6 --from @first-error --around 10s",
        "sniffer view dump.hex --protocol rs30x --web",
        "sniffer view capture.bin -o capture.rrd",
    ),
)
@with_files
@with_part
@with_rows
@decoding
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Write the .rrd (layout inside) instead of opening a window.",
)
@with_force
@click.option("--web", is_flag=True, help="Serve it for a browser on this machine.")
@click.option(
    "--web-port",
    "port",
    cls=Renamed,
    former=("--port",),
    type=Whole(1, 65535),
    help="Port of the web page, on this machine.",
)
@with_quiet
def view(
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    output: Path | None,
    force: bool,
    web: bool,
    port: int | None,
    window: Window | None,
    selection: Selection | None,
    tell: Teller,
) -> int:
    """Open FILE (a recording, or any capture) in Rerun: position, load, voltage, alarms.

    Several are one capture, read in the order of their times: such as the files of a rotation.
    """
    if output is not None and web:
        raise click.UsageError("-o writes a file, --web serves one: choose one")
    if port is not None and not web:
        raise click.UsageError("--web-port goes with --web")
    need_rerun()
    with patient() as patience, undecided_of(name_of(files)):
        if output is None:
            done = shown(
                files,
                options,
                input_format=input_format,
                web=web,
                port=port,
                selection=selection,
                window=window,
                patience=patience,
                tell=tell,
            )
            say_selected(done.summary, tell)
            return status_of(done.ending)
        if output.suffix != ".rrd":
            raise click.UsageError(f"{output}: the viewer's files end in .rrd")
        done = convert(
            files,
            [output],
            options,
            input_format=input_format,
            overwrite=force,
            selection=selection,
            window=window,
            patience=patience,
            tell=tell,
        )
    say_selected(done.summary, tell)
    if not done.gone:
        tell.talk(f"wrote {output}: open it with `rerun {output}`")
    return status_of(done.ending, is_lost=bool(done.gone))
