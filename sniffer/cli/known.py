"""``sniffer protocols`` and ``sniffer registers``: what the tool knows."""

from __future__ import annotations

import json
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from sniffer.model import ROLES
from sniffer.protocols import PROTOCOLS
from sniffer.registers import Register, RegisterMap


@click.command()
def protocols() -> None:
    """List the protocols with their models and baud rates."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column("protocol")
    table.add_column("what it is", overflow="fold")
    table.add_column("models", overflow="fold")
    table.add_column("baud rates (default first)", overflow="fold")
    for p in PROTOCOLS.values():
        rates = [p.baud, *(b for b in p.bauds if b != p.baud)]
        table.add_row(
            p.name, p.title, "\n".join(m.model for m in p.models), " ".join(map(str, rates))
        )
    Console(highlight=False).print(table)


def _models() -> dict[str, RegisterMap]:
    return {m.model: m for p in PROTOCOLS.values() for m in p.models}


@click.command()
@click.argument("model", required=False)
@click.option("--format", "output_format", type=click.Choice(["text", "jsonl"]), default="text")
def registers(model: str | None, output_format: str) -> None:
    """Show the register table of MODEL, or which models there are."""
    known = _models()
    if model is None:
        for m in known.values():
            click.echo(f"{m.model:16} {len(m.registers):4} registers  {m.title}")
        return
    if model not in known:
        raise click.BadParameter(f"no model {model!r}: one of {', '.join(known)}")
    table = known[model]
    if output_format == "jsonl":
        for r in table.registers:
            click.echo(json.dumps(_as_dict(r), ensure_ascii=False))
        return
    _print(table)


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
    console = Console(highlight=False)
    console.print(f"{table.model}: {table.title}", style="bold")
    if table.source:
        console.print(table.source)
    addressed = any(r.address >= 0 for r in table.registers)
    out = Table(box=None, padding=(0, 2, 0, 0))
    out.add_column("address" if addressed else "word", no_wrap=True)
    out.add_column("name", overflow="fold")
    out.add_column("type", no_wrap=True)
    out.add_column("unit", no_wrap=True)
    out.add_column("range", no_wrap=True)
    out.add_column("acc", no_wrap=True)
    out.add_column("meaning", overflow="fold")
    for r in table.registers:
        where = f"0x{r.address:02X}" if r.address >= 0 else "/".join((r.word, *r.aliases))
        named = r.values or r.bits or r.special
        meaning = ", ".join(f"{k} {v}" for k, v in named.items())
        scale = f"{r.scale:.4g} {r.unit}" if r.unit and r.scale != 1 else r.unit
        limits = f"{r.range[0]}..{r.range[1]}" if r.range else ""
        out.add_row(where, r.name, r.type, scale, limits, r.access, meaning)
    console.print(out)
