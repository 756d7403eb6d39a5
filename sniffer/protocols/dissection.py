"""Where each field of a packet lies, told by running its grammar: no second copy of the layout.

Used by ``sniffer explain``; slow and rare. Knows the construct classes that the wire grammars use.
"""

from __future__ import annotations

import io
from typing import Any, NamedTuple

import construct as c


class Leaf(NamedTuple):
    """One field: ``path`` is its dotted name, ``value`` what the grammar made of its bytes."""

    offset: int
    length: int
    path: str
    value: Any
    docs: str


def leaves(grammar: Any, data: bytes) -> list[Leaf]:
    """Parse ``data`` with ``grammar`` and return its fields in wire order.

    Raises:
        construct.ConstructError: the bytes do not fit; the fields before the misfit are lost.
    """
    out: list[Leaf] = []
    stream = io.BytesIO(data)
    root = c.Container(_=None, _parsing=True, _building=False, _sizing=False, _params=c.Container())
    root._root = root
    root._io = stream
    _walk(grammar, stream, root, "", "", out)
    return out


def _walk(con: Any, stream: io.BytesIO, context: Any, path: str, docs: str, out: list[Leaf]) -> Any:
    match con:
        case c.Renamed():
            named = con.name if not isinstance(con.subcon, c.Renamed) else ""  # docs rename again
            inner = f"{path}.{named}" if path and named else named or path
            return _walk(con.subcon, stream, context, inner, con.docs or docs, out)
        case c.Struct():
            own = c.Container(_=context, _root=context._root, _params=context._params, _io=stream)
            own._parsing, own._building, own._sizing = True, False, False
            result = c.Container()
            for sub in con.subcons:
                value = _walk(sub, stream, own, path, "", out)
                if sub.name:
                    own[sub.name] = result[sub.name] = value
            return result
        case c.RawCopy():
            start = stream.tell()
            value = _walk(con.subcon, stream, context, path, docs, out)
            end = stream.tell()
            stream.seek(start)
            raw = stream.read(end - start)
            return c.Container(
                data=raw, value=value, offset1=start, offset2=end, length=end - start
            )
        case c.Switch():
            key = con.keyfunc(context) if callable(con.keyfunc) else con.keyfunc
            return _walk(con.cases.get(key, con.default), stream, context, path, docs, out)
        case c.GreedyRange():
            return _repeat(con, stream, context, path, out)
        case _:
            start = stream.tell()
            value = con._parsereport(stream, context, path)
            length = stream.tell() - start
            if length:
                out.append(Leaf(start, length, path, value, docs))
            return value


def _repeat(con: Any, stream: io.BytesIO, context: Any, path: str, out: list[Leaf]) -> list[Any]:
    items: list[Any] = []
    while True:
        start, kept = stream.tell(), len(out)
        try:
            items.append(_walk(con.subcon, stream, context, f"{path}[{len(items)}]", "", out))
        except c.ConstructError:
            stream.seek(start)
            del out[kept:]
            return items
        if stream.tell() == start:
            return items
