"""What can be asked of a grammar: its fields by name, what these name, and what it reads."""

from __future__ import annotations

import io
from typing import Any

import construct as c


def bare(con: Any) -> Any:
    """Return a construct without its name and remarks."""
    while isinstance(con, c.Renamed):
        con = con.subcon
    return con


def named(grammar: Any) -> list[tuple[str, Any]]:
    """Return the fields of a grammar by name, in order, also those inside what is only checked."""
    inner = bare(grammar)
    if isinstance(inner, c.RawCopy):
        inner = bare(inner.subcon)
    out = []
    for con in inner.subcons if isinstance(inner, c.Struct) else ():
        if isinstance(bare(con), c.Struct | c.RawCopy):
            out += named(con)
        elif con.name:
            out.append((con.name, bare(con)))
    return out


def field_named(grammar: Any, name: str) -> Any:
    """Return the construct of a field, None where there is none of that name."""
    return dict(named(grammar)).get(name)


def unnamed(con: Any) -> Any:
    """Return the field of a number without the names of its values or bits."""
    return bare(con.subcon) if isinstance(con, c.Enum | c.FlagsEnum) else con


def flag_bits(con: Any) -> dict[int, str]:
    """Return bit number -> name of a field of flags; of any other none."""
    if not isinstance(con, c.FlagsEnum):
        return {}
    return {int(v).bit_length() - 1: str(k) for k, v in con.flags.items()}


def numbers(con: Any) -> dict[int, str]:
    """Return number -> name of an enumerated field; of any other none."""
    if not isinstance(con, c.Enum):
        return {}
    return {int(k): str(v) for k, v in con.decmapping.items()}


def parsed(grammar: Any, data: bytes) -> Any:
    """Return what the grammar reads in all of the bytes, None where they do not fit it."""
    stream = io.BytesIO(data)
    try:
        out = grammar.parse_stream(stream)
    except c.ConstructError:
        return None
    return out if stream.tell() == len(data) else None


def number_in(grammar: Any, name: str, params: bytes) -> int:
    """Return the number in a field of parameters that fit, also where the grammar names its bits.

    Raises:
        KeyError: the grammar has no such field.
    """
    at = 0
    for field_name, con in named(grammar):
        if field_name == name:
            return int.from_bytes(params[at : at + con.sizeof()], "little")
        at += con.sizeof()
    raise KeyError(name)
