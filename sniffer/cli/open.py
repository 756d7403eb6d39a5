"""``sniffer open``: a capture looked into on the terminal, frame by frame."""

from __future__ import annotations

import click

from sniffer.cli.options import decoding, examples, pipeline_options
from sniffer.cli.statuses import DONE
from sniffer.ground.registers import RegisterMap


@click.command(
    short_help="Look inside a capture or a port, frame by frame.",
    epilog=examples(
        "sniffer open recording.mcap",
        "sniffer open growing.log --follow",
    ),
)
@click.argument("file")
@decoding
@click.option("--follow", is_flag=True, help="FILE is being written: show what comes.")
def open(
    file: str,
    protocol: str,
    input_format: str,
    baud: int | None,
    models: dict[int | None, str],
    tables: tuple[RegisterMap, ...],
    latency: float | None,
    follow: bool,
) -> int:
    """Look inside FILE on the terminal: frames, the fields of one, its bytes; ? has the keys."""
    from sniffer.inside.session import look_inside

    options = pipeline_options(protocol, baud, models, latency, tables)
    look_inside(file, options, input_format=input_format, follow=follow)
    return DONE
