"""What stands on the board's screen: all buses, all that is known of one servo, or the keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS
from sniffer.ground.wording import plain
from sniffer.viewers.board.cells import TITLES, age_style, fitted, told_value
from sniffer.viewers.board.controls import HELP
from sniffer.viewers.board.findings import FindingLines
from sniffer.viewers.board.picture import Picture, shown
from sniffer.viewers.board.state import RECENT_NS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.register import Register
    from sniffer.tap.status import Status
    from sniffer.viewers.board.cells import ServoCells
    from sniffer.viewers.board.controls import Controls
    from sniffer.viewers.board.findings import Line
    from sniffer.viewers.board.registers import HeardRegister
    from sniffer.viewers.board.remembered import Remembered
    from sniffer.viewers.board.state import BusTally

KEYS_HINT: Final = "? keys  Ctrl-C stops"

FOUND_MOST: Final = 6
"""Lines of a servo's page that what was wrong has, where registers want the rest."""

_WIDE: Final = 30, 20, 10, 9, 9
_NARROW: Final = 30, 18, 10, 8, 9
"""Columns of a servo's page, two or one apart: name, value, raw, how long ago heard, changed."""


def picture(
    board: Remembered, status: Status, width: int, height: int, controls: Controls | None
) -> Sequence[Line]:
    """Return what is shown, at most ``height`` lines."""
    if controls is None:
        return Picture(board, status, width, height).lines()
    all_of_it = Picture(board, status, width, height, KEYS_HINT, controls)
    body: list[Line]
    if controls.asking is None and controls.helps:
        body = [[("keys", "bus")], *([(f"{key:>8}  ", "id"), (what, "")] for key, what in HELP)]
    elif controls.asking is None and controls.opened is not None:
        body = _servo(board, status, width, height - 1, controls.opened)
    else:
        return all_of_it.lines()
    room = max(height - 1, 0)
    blank: list[Line] = [[]] * (room - len(body))
    return [*body[:room], *blank, all_of_it.footer()] if height > 0 else []


def _servo(
    board: Remembered, status: Status, width: int, height: int, who: tuple[str, int]
) -> list[Line]:
    """Return the page of one servo: its row, every register heard, and what was wrong with it."""
    bus, servo = who
    called = plain(board.names.servo(bus, servo))
    rows = board.rows(bus, status)
    row = None if rows is None else next((r for r in rows.order if rows.id(r) == servo), None)
    if rows is None or row is None:
        return [[(f"{called} was not heard on {plain(bus)}", "doubt")]]
    head = _head(f"{called} of {plain(bus)}", rows, row, width)
    found = _found(board, status, width, who)
    room = height - len(head) - 2 - min(len(found), FOUND_MOST)
    heard = _registers(board.buses[bus], row, status.now_ns, width, room)
    out = [*head, [(_titles(width), "title")], *heard, []]
    return [*out, *found[: max(height - len(out), 0)]]


def _head(title: str, rows: ServoCells, row: int, width: int) -> list[Line]:
    """Return what the board says of a servo in its row, as lines."""
    keys = [key for key in TITLES if key not in ("id", "damaged")]
    *cells, alarms = rows.cells(row, keys)
    told: Line = [(title, "bus")]
    for key, (text, style) in zip(keys, cells, strict=True):
        if text != "-":
            told += [(f"  {TITLES[key]} ", "dim"), (" ".join(text.split()), style)]
    return [*_folded(told, width), *([[alarms]] if alarms[0] else [])]


def _registers(tally: BusTally, row: int, now_ns: int, width: int, room: int) -> list[Line]:
    """Return lines on the registers of a servo, the last of which says what has no room."""
    heard = sorted(  # what moves and what is asked for stands in front, each in the table's order
        tally.memory.of(row),
        key=lambda one: (not one.changed_ns, now_ns - one.seen_ns > RECENT_NS),
    )
    kept = heard if len(heard) <= room else heard[: max(room - 1, 0)]
    out = [_register(tally.protocol.registers[one.register], one, now_ns, width) for one in kept]
    if len(kept) < len(heard):
        out.append([(f"... and {len(heard) - len(kept)} more registers", "dim")])
    return out


def _register(register: Register, one: HeardRegister, now_ns: int, width: int) -> Line:
    style = age_style(now_ns, one.seen_ns, one.changed_ns)
    changed = "-" if not one.changed_ns else _ago(now_ns - one.changed_ns)
    value = told_value(register, one.raw, one.value)
    (name, says, raw, heard, since), apart = _columns(width)
    rest = (f"{one.raw:>{raw}}", f"{_ago(now_ns - one.seen_ns):>{heard}}", f"{changed:>{since}}")
    return [
        (fitted(plain(register.name), name) + apart, "dim" if style == "dim" else ""),
        (fitted(value, says, right=True) + apart, style),
        (apart.join(rest), "dim"),
    ]


def _titles(width: int) -> str:
    (name, *others), apart = _columns(width)
    titles = zip(("value", "raw", "heard s", "changed s"), others, strict=True)
    told = (f"{'register':{name}}", *(f"{title:>{room}}" for title, room in titles))
    return fitted(apart.join(told), width)


def _columns(width: int) -> tuple[tuple[int, ...], str]:
    """Return how wide the columns are, and what stands between them."""
    is_wide = width >= sum(_WIDE) + 2 * (len(_WIDE) - 1)
    return (_WIDE, "  ") if is_wide else (_NARROW, " ")


def _found(board: Remembered, status: Status, width: int, who: tuple[str, int]) -> list[Line]:
    """Return lines on the incidents and anomalies of a servo, those of the whole bus not."""
    bus, servo = who
    incidents = [
        one
        for one in shown(board.incidents)
        if one.incident.bus == bus and servo in one.incident.servo_ids
    ]
    troubles = [e for e in board.troubles if e.bus == bus and e.last.servo_id == servo]
    lines = FindingLines(status.now_ns, width, names=board.names)
    told = [lines.incident(one) for one in incidents]
    return [*told, *lines.anomalies(troubles, incidents, len(troubles))]


def _folded(told: Line, width: int) -> list[Line]:
    """Return cells in as many lines as they need; a title stays beside its value."""
    out: list[Line] = [[told[0]]]
    room = width - len(told[0][0])
    for title, value in zip(told[1::2], told[2::2], strict=True):
        taken = len(title[0]) + len(value[0])
        if taken > room:
            out.append([])
            room = width
        out[-1] += [title, value]
        room -= taken
    return out


def _ago(ns: int) -> str:
    return f"{max(ns, 0) / NS:.1f}"
