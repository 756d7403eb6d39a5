"""``sniffer open``: a capture or a port looked into on the terminal, frame by frame."""

from __future__ import annotations

import datetime
from pathlib import Path

import click

from sniffer.cli.options import decoding, examples, pipeline_options
from sniffer.cli.statuses import DONE
from sniffer.cli.streams import say
from sniffer.ground.registers import RegisterMap


@click.command(
    short_help="Look inside a capture or a port, frame by frame.",
    epilog=examples(
        "sniffer open recording.mcap",
        "sniffer open growing.log --follow",
        "sniffer open /dev/ttyUSB0=mightyzap@57600 -o run.mcap",
    ),
)
@click.argument("file", metavar="FILE|PORT")
@decoding
@click.option("--follow", is_flag=True, help="FILE is being written: show what comes.")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    help="Where a PORT is recorded to. Without it: sniffer-DATE-TIME.mcap.",
)
def open(
    file: str,
    protocol: str,
    input_format: str,
    baud: int | None,
    models: dict[int | None, str],
    tables: tuple[RegisterMap, ...],
    latency: float | None,
    follow: bool,
    output: Path | None,
) -> int:
    """Look inside FILE on the terminal: frames, the fields of one, its bytes; ? has the keys.

    A PORT (as record takes it) is recorded into a file, and shown while it is.
    """
    from sniffer.inside.session import is_port, look_at_port, look_inside

    options = pipeline_options(protocol, baud, models, latency, tables)
    if not is_port(file):
        if output is not None:
            raise click.UsageError("-o is where a port is recorded to: FILE is there already")
        look_inside(file, options, input_format=input_format, follow=follow)
        return DONE
    if tables:
        raise click.UsageError("--registers is not for a port: record it, then open the recording")
    now = datetime.datetime.now()
    path = output or Path(f"sniffer-{now:%Y%m%d-%H%M%S}.mcap")
    told = {"--protocol": None if protocol == "auto" else protocol, "--baud": baud}
    more = [file, "--quiet", f"--output={path}"]
    more += [f"{option}={value}" for option, value in told.items() if value is not None]
    more += [f"--latency={latency}"] if latency is not None else []
    more += [
        f"--model={model if who is None else f'{who}={model}'}" for who, model in models.items()
    ]
    try:
        look_at_port(more, path, options)
    finally:
        if path.exists():
            say(f"recorded in {path}")
    return DONE
