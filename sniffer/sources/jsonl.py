"""This tool's own JSON lines read back: frames and gaps, joined in order, are the bus again.

Records of other types say nothing that decoding the bytes would not say again, so they are
skipped.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.limits import OFFSET_END, is_time
from sniffer.ground.model import NS, Chunk, Clock, Direction, InputError, Mark, MarkKind
from sniffer.ground.timing import LATENCY_NS
from sniffer.ground.wording import plain
from sniffer.sources.text import PAUSE, DamagedLine, Opened, arriving, quoted

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

CARRIERS: Final = frozenset({"frame", "gap"})
"""Record types that carry bytes."""

SELECTION: Final = "selection"
"""Type of the record in front of lines that have not all records of a capture."""

TYPES: Final = CARRIERS | {"transaction", "sample", "anomaly", "summary", SELECTION}
"""Record types that this tool writes."""

HELD_MOST_NS: Final = 3600 * NS
"""Nobody holds bytes for longer: what says so is no time."""

_CLOCKS: Final = {clock.name.lower(): clock for clock in Clock}
_DIRECTIONS: Final = {d.name: d for d in Direction}


class _Stream:
    """How far the byte stream of each bus has come."""

    def __init__(self, bus: str) -> None:
        self._bus = bus
        self._due: dict[str, int] = {}
        self.missing = 0
        self.cut_off = False

    def chunk(self, record: Mapping[str, Any], number: int) -> Chunk | None:
        text, offset, bus = record.get("hex"), record.get("offset"), record.get("bus", self._bus)
        try:
            data = bytes.fromhex(text) if isinstance(text, str) else None
        except ValueError:
            data = None
        if data is None:
            raise DamagedLine(
                number, f'a {record["type"]} needs "hex": an even number of hex digits'
            )
        if type(offset) is not int or not 0 <= offset < OFFSET_END:
            raise DamagedLine(number, f'a {record["type"]} needs "offset": a whole number')
        if not isinstance(bus, str):
            raise DamagedLine(number, '"bus" is a name')
        # half a surrogate is no character: no output could hold it
        bus = bus.encode("utf-8", "backslashreplace").decode()
        due = self._due.get(bus, offset)
        if 0 < offset < due:
            why = f"offset {offset} goes back, {due} is due: the records are not in wire order"
            raise DamagedLine(number, why, nonsense=False)
        self.missing += max(0, offset - due)
        self._due[bus] = offset + len(data)
        t_ns, clock = self._time(record, number)
        wire = _DIRECTIONS.get(str(record.get("direction")), Direction.UNKNOWN)
        marks = _unsure(record, clock, len(data))
        return Chunk(data, t_ns, clock, bus, wire, marks) if data else None

    def _time(self, record: Mapping[str, Any], number: int) -> tuple[int | None, Clock]:
        t_ns, name = record.get("t_ns"), record.get("clock")
        # times without a word about their clock are timestamps in a text file
        clock = (Clock.FILE if name is None else _CLOCKS.get(name)) if _plain(name) else None
        if clock is None:
            raise DamagedLine(number, f'"clock" is one of {", ".join(_CLOCKS)}')
        if clock is Clock.NONE or t_ns is None:
            return None, Clock.NONE
        if type(t_ns) is not int or not is_time(t_ns):
            raise DamagedLine(number, '"t_ns" is a whole number of nanoseconds, of 1969 to 2257')
        return t_ns, clock

    def notes(self) -> Iterator[str]:
        # offsets of several buses may count the input, not the bus: then holes are normal
        if self.missing and len(self._due) == 1:
            yield f"{self.missing} bytes are missing between the records: were gaps filtered out?"
        if self.cut_off:
            yield "the last line is cut off and left out"


def _unsure(record: Mapping[str, Any], clock: Clock, length: int) -> tuple[Mark, ...]:
    """Return what is said of a time that is less certain than those of its clock are.

    An adapter held the bytes for longer than adapters do, or somebody said so. Stamps of a logic
    capture are left out, and what is little more: so unsure is how long the bytes took.
    """
    told = record.get("uncertainty_ns")
    if type(told) is not int or clock not in (Clock.FILE, Clock.READ):
        return ()
    usual = LATENCY_NS[clock]
    more = min(told, HELD_MOST_NS) - usual
    return (Mark(MarkKind.COARSE, 0, length, more),) if more > usual else ()


def _plain(name: object) -> bool:
    return name is None or isinstance(name, str)


def record_in(line: bytes) -> Mapping[str, Any] | None:
    """Return the record that ``line`` holds, None where it holds none of this tool's."""
    try:
        record = json.loads(line)
    except (ValueError, RecursionError):
        return None
    if isinstance(record, dict) and isinstance(record.get("type"), str):
        return record
    return None


def _no_capture(record: Mapping[str, Any]) -> str:
    """Return why a selection is not read."""
    where = plain(str(record.get("where", ""))[:80])
    return (
        f"these lines are a selection ({where}): the bytes between its frames are left out, and "
        "decoded again they would say what nobody said: decode what it was made of"
    )


def _chunks(opened: Opened, stream: _Stream) -> Iterator[Chunk]:
    for block in arriving(opened.stream):
        if block is None:
            yield PAUSE
            continue
        for number, line in enumerate(block.lines(), block.number):
            if not line.strip():
                continue
            record = record_in(line)
            if record is None:
                if block.cut_off:
                    stream.cut_off = True
                    return
                raise DamagedLine(number, f'{quoted(line)} is no JSON object with a "type"')
            if record["type"] == SELECTION:
                raise InputError(_no_capture(record))
            if record["type"] in CARRIERS and (chunk := stream.chunk(record, number)):
                yield chunk


def read_jsonl(opened: Opened) -> Iterator[Chunk]:
    """Yield one chunk a frame or gap, in the order of the lines, with its time, clock and bus."""
    stream = _Stream(opened.bus)
    try:
        yield from _chunks(opened, stream)
    finally:
        opened.notes.extend(stream.notes())
