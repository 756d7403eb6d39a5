"""``sniffer explain``: one frame drawn byte by byte."""

from __future__ import annotations

import click

from sniffer.cli.options import ProtocolName, examples, with_registers
from sniffer.decoding.options import AUTO, Options
from sniffer.ground.registers import RegisterMap
from sniffer.jobs.explain import explain_bytes, read_hex


@click.command(
    short_help="Draw one frame byte by byte.",
    epilog=examples(
        "sniffer explain FF FF FF 00 02 F1 0C",
        "sniffer explain FFFFFF010400D0078F --after 'FF FF FF 01 04 F2 8C 02 7A'",
        "sniffer explain '#5D1800'",
        "sniffer explain run.mcap@12175",
    ),
)
@click.argument("hex_bytes", metavar="HEX|FILE@BYTE", nargs=-1, required=True)
@click.option("--after", metavar="HEX", help="The request this answers: replies need it.")
@click.option("--protocol", type=ProtocolName(AUTO), default=AUTO, show_default=True)
@click.option("--model", metavar="MODEL", help="Register table to read by.")
@with_registers
def explain(
    hex_bytes: tuple[str, ...],
    after: str | None,
    protocol: str,
    model: str | None,
    tables: tuple[RegisterMap, ...],
) -> int:
    """Draw the frame HEX byte by byte: offsets, fields, values, units, checksum arithmetic.

    FILE@12175 draws the frame of a capture that has this byte, behind the request that it answers;
    FILE@arm:12175 where there are several buses.

    Exit status 1: not every byte belongs to a frame that holds; what is wrong with it is shown.
    LSS lines may be given as text.
    """
    if len(hex_bytes) == 1 and "@" in hex_bytes[0]:
        from sniffer.jobs.explain_at import explain_at, place_of

        if after:
            raise click.UsageError("--after goes with HEX: a capture has what came before")
        models: dict[int | None, str] = {None: model} if model else {}
        options = Options(protocol, models=models, tables=tables)
        held, lines = explain_at(*place_of(hex_bytes[0]), options)
        for line in lines:
            click.echo(line)
        return 0 if held else 1
    data = read_hex(" ".join(hex_bytes))
    before = read_hex(after) if after else b""
    held, lines = explain_bytes(data, before, protocol=protocol, model=model, tables=tables)
    for line in lines:
        click.echo(line)
    return 0 if held else 1
