"""Labelled talk of the protocols, for the conformance kit; labels come from manuals and tables.

One module a protocol, with ``TALK``. What a span of registers says is worked out here from the
table as it stands in its file, not by what the decoder makes of it.
"""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal, NamedTuple

from sniffer.ground.registers import schema_path
from sniffer.testing import Exchange, Label
from tests.vectors import vectors

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


ROOT: Final = Path(__file__).parents[2]


class Row(NamedTuple):
    """One register of a table with addresses."""

    name: str
    address: int
    width: int
    signed: bool
    order: Literal["little", "big"] = "little"


@cache
def table(model: str) -> tuple[Row, ...]:
    """Return a table's registers in the order of their addresses; of a plug-in by its path."""
    path = ROOT / model if "/" in model else schema_path("registers", f"{model}.toml")
    text = path.read_text(encoding="utf-8")
    out = []
    for entry in tomllib.loads(text)["register"]:
        kind: str = entry.get("type", "u8")
        width = {"8": 1, "1": 2, "3": 4, "6": 8}[kind[1]]
        order: Literal["little", "big"] = "big" if kind.endswith("be") else "little"
        out.append(Row(entry["name"], int(entry["address"]), width, kind[0] == "i", order))
    return tuple(sorted(out, key=lambda r: r.address))


def stated(model: str, address: int, data: bytes, servo: int | None = None) -> dict[Label, int]:
    """Return the raw values of a span of bytes; of half a register, the half."""
    out: dict[Label, int] = {}
    for r in table(model):
        first, last = max(r.address, address), min(r.address + r.width, address + len(data))
        if first < last:
            part = data[first - address : last - address]
            raw = int.from_bytes(part, r.order, signed=r.signed and len(part) == r.width)
            out[r.name if servo is None else (servo, r.name)] = raw
    return out


def halves(model: str) -> Iterator[tuple[int, int]]:
    """Yield spans (address, length) that begin and end inside registers, all of several bytes.

    Of those of two bytes from the second byte of one to the first byte of the next; of longer ones
    a byte inside.
    """
    wide = [r.address for r in table(model) if r.width == 2]
    for one, following in zip(wide, [*wide[1:], None], strict=True):
        yield one + 1, 1 if following is None else following - one
    if wide:
        yield wide[0], 1
    yield from ((r.address + 1, 1) for r in table(model) if r.width > 2)


def blocks(model: str) -> Iterator[tuple[int, int]]:
    """Yield spans that hold all registers whole, each as long as registers follow closely."""
    begin = end = table(model)[0].address
    for r in table(model):
        if r.address - end > 16:
            yield begin, end - begin
            begin = r.address
        end = r.address + r.width
    yield begin, end - begin


def of_vectors(protocol: str) -> list[Exchange]:
    """Return the manuals' example frames as exchanges: requests, and answers behind theirs."""
    out = []
    good = [v for v in vectors(protocol) if v.verdict == "good"]
    answered = {v.after for v in good if v.kind == "response"}
    for v in good:
        if v.kind == "response" and v.after:
            out.append(Exchange(v.op, v.after, (v.data,)))
        elif v.kind == "request" and v.data not in answered and not v.after:
            out.append(Exchange(v.op, v.data, None))
    return list({e.data: e for e in out}.values())


def of_package(path: str) -> list[Exchange]:
    """Return the examples of a package's manual: their values are held beside it, as numbers."""
    text = (ROOT / path / "vectors.json").read_text(encoding="utf-8")
    out = []
    for v in json.loads(text):
        request, *answers = map(bytes.fromhex, v["packets"])
        if v.get("requests", 1):
            out.append(Exchange(v["op"], request, tuple(answers)))
    return out


def due(exchanges: Iterable[Exchange], *names: str) -> list[Exchange]:
    """Say that servos always answer these commands (or patterns of them)."""
    return [replace(e, due=bool(e.answers) and _named(e, names)) for e in exchanges]


def unanswered(exchanges: Iterable[Exchange], *names: str) -> list[list[Exchange]]:
    """Return a scene for each of these commands: it need not be answered, and is not."""
    first: dict[str, Exchange] = {}
    for e in exchanges:
        if e.answers and not e.errors and _named(e, names):
            first.setdefault(e.name, replace(e, answers=(), errors=None, later=()))
    return [[e] for e in first.values()]


def _named(e: Exchange, names: Iterable[str]) -> bool:
    return any(fnmatchcase(e.name, name) for name in names)
