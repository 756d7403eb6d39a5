"""Where to go in a capture: a place as ``--from`` takes it, or a line."""

from __future__ import annotations

import itertools
import re
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.found import CODES, SEVERITY
from sniffer.ground.heard import SteadyTime, was_set
from sniffer.ground.model import NS, InputError
from sniffer.selection.places import END, FOUND, CapturePlace, ambiguous, place_in

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Mask
    from sniffer.inside.columns import Table
    from sniffer.inside.index import CaptureIndex
    from sniffer.inside.view import LineView


def line_of(
    text: str,
    index: CaptureIndex,
    bus: int | None = None,
    view: LineView | None = None,
    *,
    is_read: bool = True,
) -> int:
    """Return the line that a place means, the one behind it where none is exactly there.

    Args:
        text: a place (``selection.places``), ``@12175`` (a byte), or ``#300`` (a line).
        index: the capture.
        bus: whose bytes an offset counts where it names none; None: nobody looks at any.
        view: the lines that are shown: the first error is one of theirs; None: of all.
        is_read: whether there will be no more lines, so that the last one is the end.

    Raises:
        InputError: it is no place, or lies outside of the capture, or several buses have it.
    """
    text = text.strip()
    lines = index.lines
    if not len(lines):
        raise InputError("there is nothing yet")
    if found := re.fullmatch(r"#(\d{1,18})", text):
        return _within(int(found[1]) - 1, len(lines), text)
    byte = re.fullmatch(r"@(\d+)", text)
    place = place_in(f"@byte:{byte[1]}" if byte else text.removeprefix("+"))
    if place.sought == END and not is_read:
        raise InputError(f"{place.text}: the end was not read yet")
    if place.is_stamp:
        return _within(_stamped(place, index, lines), len(lines), text)
    times = _steady(lines)
    if place.sought == END:
        t_ns = int(times.max()) - place.number
    elif place.kind == FOUND:
        line = _sought(place, index, bus, view)
        if not place.shift_ns:
            return line
        t_ns = int(times[line]) + place.shift_ns
    else:
        t_ns = place.at(int(lines["t"][0]) if index.has_clock else None)
    line = _first(times >= t_ns)
    if line == len(lines):
        last_s = (int(times.max()) - int(lines["t"][0])) / NS
        raise InputError(
            f"{text} is behind the end: the last line so far is of second {last_s:.3f}"
        )
    return line


def _steady(lines: Table) -> I64:
    """Return when lines were told, by clocks of the buses that were never set."""
    t_ns: I64 = lines["t"].astype(np.int64)
    for bus in np.unique(lines["bus"]):
        mine = np.flatnonzero(lines["bus"] == bus)
        t_ns[mine] = SteadyTime().of(t_ns[mine])
    return t_ns


def _stamped(place: CapturePlace, index: CaptureIndex, lines: Table) -> int:
    """Return the line at which the clock came to a time, else the first one that is not before it.

    A time of day is that of the day on which the clock was, wherever it was set.
    """
    t_ns: I64 = lines["t"]
    if not index.has_clock:
        place.at(None)
    begins: list[int] = [0, *was_set(t_ns, int(t_ns[0])).tolist(), len(t_ns)]
    for begin, end in itertools.pairwise(begins):
        is_behind = t_ns[begin:end] >= place.at(int(t_ns[begin]))
        if is_behind.any() and not is_behind[0]:
            return begin + int(is_behind.argmax())
    return _first(t_ns >= place.at(int(t_ns[0])))


def _first(is_it: Mask) -> int:
    """Return the first row that is it, the one behind the last where none is."""
    return int(is_it.argmax()) if is_it.any() else len(is_it)


def _sought(
    place: CapturePlace, index: CaptureIndex, bus: int | None, view: LineView | None
) -> int:
    if place.sought == "byte":
        known = dict(zip([*index.wires, *index.buses], index.wires * 2, strict=True))
        if place.bus and place.bus not in known:
            told = f"there is no bus {place.bus}, only {', '.join(dict.fromkeys(index.wires))}"
            raise InputError(f"{place.text}: {told}")
        if place.bus:
            return _at_byte(place.number, index, known[place.bus])
        wire = _one_having(place, index) if bus is None else index.wires[bus]
        return _at_byte(place.number, index, wire)
    found = index.found
    if place.sought == "anomaly":
        if place.number > len(found):
            raise InputError(f"{place.text}: {len(found)} anomalies were found so far")
        return _line_of(found[place.number - 1], index)
    named = [n for n, code in enumerate(CODES) if place.sought in (code, SEVERITY[n].name.lower())]
    mine = np.flatnonzero(np.isin(found["code"], named))
    if place.servo is not None:
        place.known_by(index.names)
        who, on = found["servo"][mine], index.lines["bus"][np.maximum(found["line"][mine], 0)]
        met = np.zeros(len(mine), bool)
        for number, name in enumerate(index.buses):
            met |= (on == number) & np.isin(who, place.about(name, index.names))
        mine = mine[met]
    where = ""
    if view is not None and not view.is_whole:
        mine = mine[view.shows(found["line"][mine])]
        where = " in the lines shown"
    if len(mine) < place.number:
        there = f"{len(mine)} were" if len(mine) else "none was"
        raise InputError(f"{place.text}: {there} found so far{where}")
    return _line_of(found[int(mine[place.number - 1])], index)


def _line_of(one: np.void, index: CaptureIndex) -> int:
    """Return the line of an anomaly; where its evidence is long past, that of its time."""
    line = int(one["line"])
    last = len(index.lines) - 1
    return line if line >= 0 else min(int(np.searchsorted(index.lines["t"], one["t"])), last)


def _one_having(place: CapturePlace, index: CaptureIndex) -> str:
    """Return the one bus that has a byte, the first one where none has.

    Raises:
        InputError: several have it.
    """
    lines = index.lines
    reach = lines["at"] + lines["length"] > place.number
    having = list(
        dict.fromkeys(index.wires[bus] for bus in np.unique(lines["bus"][reach]).tolist())
    )
    if len(having) > 1:
        raise InputError(ambiguous(place, having))
    return having[0] if having else index.wires[0]


def _at_byte(offset: int, index: CaptureIndex, wire: str) -> int:
    """Return the line that holds a byte of a wire, whichever of its protocols claims it."""
    lines = index.lines
    lanes = [bus for bus, name in enumerate(index.wires) if name == wire]
    mine = np.flatnonzero(np.isin(lines["bus"], lanes))
    at = lines["at"][mine]
    end = at + lines["length"][mine]
    holding = np.flatnonzero((at <= offset) & (offset < end))
    if not len(holding):
        last = int(end.max(initial=0))
        raise InputError(f"byte {offset} is not there: {wire} has {last} so far")
    return int(mine[holding[0]])


def _within(line: int, count: int, text: str) -> int:
    # of the lines that were searched: meanwhile there may be more
    if not 0 <= line < count:
        raise InputError(f"{text} is behind the end: there are {count} lines so far")
    return line


LIKE_MOST: Final = 1 << 17
"""How far back a like frame is looked for, in lines."""

_STEP: Final = 1 << 12


def like_before(index: CaptureIndex, line: int) -> int:
    """Return the last line before one that is of the same servo, command, kind and length; or -1.

    Only as far back as ``LIKE_MOST`` lines.
    """
    lines = index.lines
    one = lines[line]
    end = line
    first = max(line - LIKE_MOST, 0)
    while end > first:
        begin = max(end - _STEP, first)
        some = lines[begin:end]
        alike = np.ones(len(some), bool)
        for name in ("servo", "op", "kind", "length", "bus", "address"):
            alike &= some[name] == one[name]
        found = np.flatnonzero(alike)
        if len(found):
            return begin + int(found[-1])
        end = begin
    return -1
