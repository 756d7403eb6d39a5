r"""Logs whose fields have names: tables with a head, and objects in JSON, one a line.

    time,dir,data                                   time;direction;length;hex
    0.004000,RX,00 A4                               22:55:06.001;TX;4;ffa00020
    {"t": 1732694400.123456, "dir": "TX", "data": "ffa00020"}
    {"time_ms": 12, "direction": "rx", "bytes": [0, 164]}   {"time_ms": 12, "rx": [0, 164]}

Their names tell which is the time (and of which unit), which the direction and which the bytes;
others are left alone. A table without directions is one of a decoder's, whose times mean anything.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol

from sniffer.ground.model import Direction
from sniffer.ground.patterns import later
from sniffer.sources.loglines import SaidLine, in_ascii, way_of
from sniffer.sources.logstamps import STAMP
from sniffer.sources.plain import BadLineError
from sniffer.sources.text import cells_of, quoted

if TYPE_CHECKING:
    import re
    from collections.abc import Mapping, Sequence

_TIME: Final = later(
    r"(?:time|timestamp|ts|t|stamp|datetime|elapsed)(?:[ _]?[(\[]?(?P<unit>s|ms|us|ns)[)\]]?)?"
    r"|(?P<long>seconds|millis|milliseconds|micros|microseconds|nanoseconds)"
)
_LONG: Final = {"seco": "s", "mill": "ms", "micr": "us", "nano": "ns"}
_WAYS: Final = frozenset({"dir", "direction", "way", "rxtx", "rx/tx", "tx/rx"})
_SIDES: Final = frozenset({"tx", "rx", "sent", "received", "send", "recv", "write", "read"})
"""Fields with the bytes of a direction; ``in`` and ``out`` may be of anything."""

_DATA: Final = ("data", "hex", "payload", "frame", "packet", "raw", "message", "msg", "bytes")
_OF_HEX: Final = later(r"[ _]?[(\[]?hex[)\]]?$|^hex[ _]")
_SEPARATORS: Final = (b",", b";", b"\t", b"|")
_RULE: Final = later(rb"[ |:-]+")
_SECONDS: Final = later(rb"\d{1,10}\.\d{1,9}|[1-9]\d{9}")
"""Seconds without a unit: with a fraction, or ten digits, as since 1970."""

_NUMBER: Final = later(rb"\d+(?:\.\d+)?")


class LogFields(Protocol):
    """How the lines of a log have their fields."""

    def is_head(self, line: bytes) -> bool:
        """Tell whether a line only tells what the fields are."""

    def said(self, line: bytes) -> SaidLine | None:
        """Take a line apart; None where it is none of them.

        Raises:
            BadLineError: a field is not what its name says.
        """


class _Roles(NamedTuple):
    """Which field is what: nothing where there is none."""

    time: str
    unit: bytes
    way: str
    data: str


def fields_of(line: bytes) -> LogFields | None:
    """Return how a log has its fields that begins with this line, None where they have no names."""
    line = in_ascii(line.strip())
    if line[:1] == b"{":
        return _Objects() if _object_in(line) else None
    tables = (_HeadedRows(line, separator) for separator in _SEPARATORS if separator in line)
    return next((table for table in tables if table.roles.way and table.roles.data), None)


def _roles(names: Sequence[str]) -> _Roles:
    """Return what fields of these names are."""
    known = {name.strip().strip("\"'").lower(): name for name in reversed(names)}
    times = ((name, _TIME.fullmatch(name)) for name in known)
    time, found = next(((name, m) for name, m in times if m), ("", None))
    unit = (found["unit"] or _LONG.get((found["long"] or "")[:4], "")) if found else ""
    bare = {_OF_HEX.sub("", name) or "hex": name for name in known}
    data = next((bare[name] for name in _DATA if name in bare), "")
    way = next((name for name in known if name in _WAYS), "")
    return _Roles(known.get(time, ""), unit.encode(), known.get(way, ""), known.get(data, ""))


class _HeadedRows(LogFields):
    """Rows of cells below a head."""

    def __init__(self, head: bytes, separator: bytes) -> None:
        self._head, self._separator = head, separator
        self._names = [cell.decode("utf-8", "replace") for cell in self._split(head)]
        self.roles = _roles(self._names)

    def is_head(self, line: bytes) -> bool:
        """Tell whether it is the head, or the rule below it in Markdown."""
        line = in_ascii(line.strip())
        return line == self._head or (self._separator == b"|" and bool(_RULE.fullmatch(line)))

    def said(self, line: bytes) -> SaidLine | None:
        """Take a row apart; None of a head or a line without cells.

        Raises:
            BadLineError: it has not the cells that the head names.
        """
        line = in_ascii(line.strip())
        if self.is_head(line) or self._separator not in line or line[:1] == b"#":
            return None
        cells, count = self._split(line), len(self._names)
        if self.roles.data == self._names[-1] and len(cells) > count:  # commas between bytes
            cells[count - 1 :] = [self._separator.join(cells[count - 1 :])]
        if len(cells) != count:
            told = f"it has {len(cells)} cells, and the head {count}: put bytes in quotes"
            raise BadLineError(0, told)
        return _said(dict(zip(self._names, cells, strict=True)), self.roles)

    def _split(self, line: bytes) -> list[bytes]:
        if self._separator == b"," and b'"' in line:
            text = line.decode("utf-8", "surrogateescape")
            return [cell.encode("utf-8", "surrogateescape") for cell in cells_of(text)]
        line = line.strip(b"|") if self._separator == b"|" else line
        return [cell.strip().strip(b'"') for cell in line.split(self._separator)]


class _Objects(LogFields):
    """Objects in JSON, one a line; each tells its own names."""

    def is_head(self, line: bytes) -> bool:
        """Tell whether it only names fields: none does."""
        return False

    def said(self, line: bytes) -> SaidLine | None:
        """Take an object apart; None of what is none, or has no bytes.

        Raises:
            BadLineError: it breaks off.
        """
        record = _object_in(line)
        if not record and line.lstrip()[:1] == b"{":
            raise BadLineError(0, "this is no whole object in JSON")
        roles = _roles([*record])
        if not (roles.data and (roles.way or roles.time)):
            return _by_way(record, roles)
        wanted = (roles.time, roles.way, roles.data)
        return _said({name: _text_of(record[name]) for name in wanted if name}, roles)


def _by_way(record: Mapping[str, Any], roles: _Roles) -> SaidLine | None:
    """Return what an object says whose fields are called as directions; None: it has none such.

    Numbers alone are none: an input may be anything.
    """
    told = {name: value for name, value in record.items() if name.strip().lower() in _SIDES}
    parts = [
        (way_of(n.encode()), _text_of(v)) for n, v in told.items() if isinstance(v, list | str)
    ]
    if not parts:
        return None
    fields = {roles.time: _text_of(record[roles.time])} if roles.time else {}
    return SaidLine(_time(fields, roles), parts)


def _object_in(line: bytes) -> dict[str, Any]:
    """Return the object that a line is, an empty one where it is none; its fractions as text."""
    try:
        record = json.loads(line, parse_float=str)
    except (ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _text_of(value: object) -> bytes:
    """Return a value as the text that stands for it, bytes in hex."""
    if isinstance(value, dict):  # {"type": "Buffer", "data": [255, 160]}, as node.js has it
        value = value.get("data")
    if isinstance(value, list) and all(type(one) is int and 0 <= one < 256 for one in value):
        return bytes(value).hex().encode()
    return b"" if value is None else str(value).encode("utf-8", "replace")


def _said(fields: Mapping[str, bytes], roles: _Roles) -> SaidLine:
    """Return what a line with these fields says.

    Raises:
        BadLineError: its time or its direction is none.
    """
    way = Direction.UNKNOWN
    if roles.way and (way := way_of(fields[roles.way])) is Direction.UNKNOWN:
        raise BadLineError(0, f"{quoted(fields[roles.way])} is no direction: write TX or RX")
    return SaidLine(_time(fields, roles), [(way, fields[roles.data])])


def _time(fields: Mapping[str, bytes], roles: _Roles) -> re.Match[bytes] | None:
    """Return the time that a line has, None where it has none.

    Raises:
        BadLineError: it is none.
    """
    if not roles.time:
        return None
    stamp = _stamp(fields[roles.time], roles.unit)
    if stamp is None:
        why = "is no time: write seconds with a fraction, a date, or the unit in the field's name"
        raise BadLineError(0, f"{quoted(fields[roles.time])} {why} (`time_ms`)")
    return stamp


def _stamp(text: bytes, unit: bytes) -> re.Match[bytes] | None:
    """Return the time that a field is, None where it is none or its unit is not said."""
    text = text.strip(b" \t\"'")
    if unit and _NUMBER.fullmatch(text):
        text += b" " + unit
    elif _SECONDS.fullmatch(text):
        text += b" s"
    return STAMP.fullmatch(text)
