"""``sniffer protocols`` and ``sniffer registers``: what the tool knows."""

from __future__ import annotations

import json
import textwrap
from pathlib import Path
from typing import Any

import click

from sniffer.cli.options import completing, examples, with_format
from sniffer.cli.streams import say, width_of_terminal
from sniffer.ground.codes import ROLES
from sniffer.ground.entries import doubtful
from sniffer.ground.registers import Register, RegisterMap
from sniffer.ground.units import word_of
from sniffer.ground.wording import offered
from sniffer.protocols import PROTOCOLS, is_file, protocol_named


@click.command()
def protocols() -> None:
    """List the protocols with their models and baud rates."""
    width = width_of_terminal()
    for p in PROTOCOLS.values():
        rates = [f"{p.baud} (default)", *(str(b) for b in p.bauds if b != p.baud)]
        facts = {"models": ", ".join(m.model for m in p.models), "baud": ", ".join(rates)}
        if package := PROTOCOLS.origin(p.name):
            facts["plug-in"] = package
        click.echo(f"{p.name:11}{p.title}")
        for title, text in facts.items():
            indent = " " * 11
            head = f"{indent}{title:8}"
            click.echo(
                textwrap.fill(text, width, initial_indent=head, subsequent_indent=" " * len(head))
            )


def _models() -> dict[str, RegisterMap]:
    out: dict[str, RegisterMap] = {}
    for protocol in PROTOCOLS.values():
        for table in protocol.models:
            out.setdefault(table.model, table)
    return out


@click.command(
    short_help="Show the register table of a model.",
    epilog=examples(
        "sniffer registers",
        "sniffer registers mightyzap-12lf",
        "sniffer registers rs305cr --format jsonl",
        "sniffer registers my_servo.toml",
    ),
)
@click.argument("model", required=False, shell_complete=completing(_models))
@with_format("text", "jsonl")
def registers(model: str | None, output_format: str) -> None:
    """Show the register table of MODEL (or those of a protocol), or which models there are.

    MODEL may be a table of your own, FILE.toml, or the protocol of a plug-in, FILE.py.
    """
    known = _models()
    if model is None:
        for m in known.values():
            click.echo(f"{m.model:16} {len(m.registers):4} registers  {m.title}")
        return
    # a protocol stands for its models, unless one of them is called like it
    tables = [known[model]] if model in known else _spoken(model)
    if model.endswith(".toml"):
        tables = [RegisterMap.from_toml(model)]
    if not tables:
        if Path(model).is_file():
            told = "is no register table: `sniffer state` tells what registers held in a capture"
            raise click.UsageError(f"{model} {told}")
        raise click.UsageError(f"no model {model!r}: {offered(model, {**known, **PROTOCOLS})}")
    for nth, table in enumerate(tables):
        if output_format == "jsonl":
            for r in table.registers:
                click.echo(json.dumps({**_as_dict(r), "model": table.model}, ensure_ascii=False))
            continue
        if nth:
            click.echo()
        _print(table)
        for what in doubtful(table.registers):
            say(f"{table.model}: {what}")


def _spoken(protocol: str) -> list[RegisterMap]:
    """Return the tables of a protocol, none where there is no such one."""
    if not is_file(protocol) and protocol not in PROTOCOLS:
        return []
    return list(protocol_named(protocol).models)


def _as_dict(r: Register) -> dict[str, Any]:
    out: dict[str, Any] = {"name": r.name, "address": r.address if r.address >= 0 else None}
    if r.word:
        out |= {"word": r.word, "aliases": list(r.aliases)}
    out |= {
        "type": r.type,
        "unit": r.unit,
        "scale": r.scale,
        "quantity": r.quantity,
        "role": ROLES[r.role],
        "access": r.access,
        "volatile": r.volatile,
        "range": r.range,
        "default": r.default,
        "values": dict(r.values),
        "bits": dict(r.bits),
        "special": dict(r.special),
        "source": r.source,
        "doubt": r.doubt,
    }
    if r.scale_by is not None:
        out["scale_by"] = {"register": r.scale_by[0], "scale": dict(r.scale_by[1])}
    return out


def _print(table: RegisterMap) -> None:
    width = width_of_terminal()
    click.echo(textwrap.fill(f"{table.model}: {table.title}", width))
    if table.source:
        click.echo(textwrap.fill(table.source, width))
    click.echo()
    addressed = any(r.address >= 0 for r in table.registers)
    rows = [("addr" if addressed else "word", "name", "type", "unit", "range", "access", "memory")]
    for r in table.registers:
        where = f"0x{r.address:02X}" if r.address >= 0 else "/".join((r.word, *r.aliases))
        unit = word_of(r.unit)
        scale = f"{r.scale:.4g} {unit}" if unit and r.scale != 1 else unit
        limits = f"{r.range[0]}..{r.range[1]}" if r.range else ""
        memory = "" if r.volatile else r.memory
        rows.append((where, r.name, r.type, scale, limits, r.access, memory))
    columns = [c for c in zip(*rows, strict=True) if any(c[1:])]
    widths = [max(map(len, column)) for column in columns]
    meanings = ["", *(_meaning(r) for r in table.registers)]
    for row, meaning in zip(zip(*columns, strict=True), meanings, strict=True):
        click.echo("  ".join(map(str.ljust, row, widths)).rstrip())
        if meaning:
            indent = " " * 6
            click.echo(
                textwrap.fill(meaning, width, initial_indent=indent, subsequent_indent=indent)
            )


def _meaning(r: Register) -> str:
    """Return what the register's values, its bits and its special values mean."""
    named = [f"{k} {v}" for k, v in {**r.values, **r.special}.items()]
    named += [f"bit {k} {v}" for k, v in r.bits.items()]
    return ", ".join(named)
