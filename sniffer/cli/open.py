"""``sniffer open``: a capture or a port looked into on the terminal, frame by frame."""

from __future__ import annotations

import datetime
from pathlib import Path

import click

from sniffer.cli.options import decoding, examples, files_here
from sniffer.cli.selecting import with_rows, with_start
from sniffer.cli.statuses import DONE
from sniffer.cli.streams import say
from sniffer.decoding.options import AUTO, Options
from sniffer.ground.limits import OF_BUS
from sniffer.selection.selection import Selection


@click.command(
    short_help="Look inside a capture or a port, frame by frame.",
    epilog=examples(
        "sniffer open recording.mcap",
        "sniffer open recording.mcap --servo 3 --kind request",
        "sniffer open recording.mcap --from @first-error",
        "sniffer open growing.log --follow",
        "sniffer open /dev/ttyUSB0=mightyzap@57600 -o run.mcap",
    ),
)
@click.argument("files", shell_complete=files_here, metavar="FILE...|PORT", nargs=-1, required=True)
@with_start
@with_rows
@decoding
@click.option("--follow", is_flag=True, help="FILE is being written: show what comes.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Where a PORT is recorded to. Without it: sniffer-DATE-TIME.mcap.",
)
def open(
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    follow: bool,
    output: Path | None,
    start: str | None,
    selection: Selection | None,
) -> int:
    """Look inside FILE on the terminal: frames, the fields of one, its bytes; ? has the keys.

    --servo, --where and the like are the filter that it begins with, f asks for another; --from is
    where the cursor begins, g goes elsewhere.

    Several FILEs are one capture, read in the order of their times: such as the files of a
    rotation; marks are kept of one.

    A PORT (as record takes it) is recorded into a file, and shown while it is.
    """
    from sniffer.inside.session import is_port, look_at_port, look_inside

    port = next(filter(is_port, files), None)
    if port is not None and len(files) > 1:
        raise click.UsageError(f"{port} is a port, which is looked at alone: name nothing else")
    if follow and len(files) > 1:
        raise click.UsageError("--follow shows what comes of one FILE: name one")
    if port is None:
        if output is not None:
            raise click.UsageError("-o is where a port is recorded to: FILE is there already")
        look_inside(
            files,
            options,
            input_format=input_format,
            follow=follow,
            selection=selection,
            start=start or "",
            tell=say,
        )
        return DONE
    if start is not None:
        raise click.UsageError("--from is a place in a capture: nothing of a port is there yet")
    if options.tables:
        raise click.UsageError("--registers is not for a port: record it, then open the recording")
    now = datetime.datetime.now()
    path = output or Path(f"sniffer-{now:%Y%m%d-%H%M%S}.mcap")
    try:
        look_at_port(_arguments(port, path, options), path, options, selection)
    finally:
        if path.exists():
            say(f"recorded in {path}")
    return DONE


def _arguments(port: str, path: Path, options: Options) -> list[str]:
    """Return what ``sniffer record`` is called with."""
    told: list[tuple[str, object]] = []
    if options.protocol != AUTO:
        told.append(("protocol", options.protocol))
    if options.baud is not None:
        told.append(("baud", options.baud))
    if options.latency_ns is not None:
        told.append(("latency", options.latency_ns / 1e6))
    for who, model in options.models.items():
        told.append(("model", model if who is None else f"{who}={model}"))
    for servo, name in options.names.items():
        called = servo if isinstance(servo, int) else OF_BUS.join(map(str, servo))
        told.append(("name", f"{called}={name}"))
    return [port, "--quiet", f"--output={path}", *(f"--{name}={value}" for name, value in told)]
