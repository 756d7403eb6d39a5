"""What stands on the board's screen: all buses, all that is known of one servo, or the keys."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS
from sniffer.ground.wording import plain
from sniffer.viewers.board.cells import COLUMNS, age_style, fitted, told_value
from sniffer.viewers.board.controls import HELP
from sniffer.viewers.board.findings import FindingLines
from sniffer.viewers.board.picture import Picture, shown
from sniffer.viewers.board.state import RECENT_NS
from sniffer.viewers.board.troubles import Troubles

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.tap.status import Status
    from sniffer.viewers.board.controls import Controls
    from sniffer.viewers.board.findings import Line
    from sniffer.viewers.board.remembered import Remembered

KEYS_HINT: Final = "? keys  Ctrl-C stops"

FOUND_MOST: Final = 6
"""Lines of a servo's page that what was wrong has, where registers want the rest."""

_REGISTER: Final = 30
_VALUE: Final = 20


def picture(
    board: Remembered, status: Status, width: int, height: int, controls: Controls | None
) -> Sequence[Line]:
    """Return what is shown, at most ``height`` lines."""
    if controls is None:
        return Picture(board, status, width, height).lines()
    all_of_it = Picture(board, status, width, height, KEYS_HINT, controls)
    body: list[Line]
    if controls.asking is not None:
        return all_of_it.lines()
    if controls.helps:
        body = [[("keys", "bus")], *([(f"{key:>8}  ", "id"), (what, "")] for key, what in HELP)]
    elif controls.opened is not None and controls.opened[0] in board.buses:
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
    tally, rows = board.buses[bus], board.rows(bus, status)
    row = next((r for r in rows.order if rows.id(r) == servo), None) if rows is not None else None
    if rows is None or row is None:
        return [[(f"servo {servo} was not heard on {plain(bus)}", "doubt")]]
    keys = [c.key for c in COLUMNS if c.key not in ("id", "damaged")]
    told: Line = [(f"servo {servo} of {plain(bus)}", "bus")]
    for key, (text, style) in zip(keys, rows.cells(row, keys), strict=False):
        if text != "-":
            title = next(c.titles[1] for c in COLUMNS if c.key == key)
            told += [(f"  {title} ", "dim"), (" ".join(text.split()), style)]
    text, style = rows.cells(row, keys)[-1]
    head = [*_folded(told, width), *([[(text, style)]] if text else [])]
    found = _found(board, status, width, who)
    heard = sorted(  # what moves and what is asked for stands in front, each in the table's order
        tally.memory.of(row),
        key=lambda one: (not one.changed_ns, status.now_ns - one.seen_ns > RECENT_NS),
    )
    room = height - len(head) - 2 - min(len(found), FOUND_MOST)
    out = [*head, [(_titles(width), "title")]]
    if len(heard) > room:
        heard, left = heard[: max(room - 1, 0)], len(heard) - max(room - 1, 0)
    else:
        left = 0
    for one in heard:
        register = tally.protocol.registers[one.register]
        style = age_style(status.now_ns, one.seen_ns, one.changed_ns)
        changed = "-" if not one.changed_ns else _ago(status.now_ns - one.changed_ns)
        value = told_value(register, one.raw, one.value)
        out.append(
            [
                (fitted(plain(register.name), _REGISTER) + "  ", "dim" if style == "dim" else ""),
                (fitted(value, _VALUE, right=True) + "  ", style),
                (f"{one.raw:>10}  {_ago(status.now_ns - one.seen_ns):>9}  {changed:>9}", "dim"),
            ]
        )
    if left:
        out.append([(f"... and {left} more registers", "dim")])
    return [*out, [], *found[: max(height - len(out) - 1, 0)]]


def _titles(width: int) -> str:
    title = f"{'register':{_REGISTER}}  {'value':>{_VALUE}}  {'raw':>10}  {'heard s':>9}"
    return fitted(f"{title}  {'changed s':>9}", width)


def _found(board: Remembered, status: Status, width: int, who: tuple[str, int]) -> list[Line]:
    """Return lines on the incidents and anomalies of a servo, those of the whole bus not."""
    bus, servo = who
    incidents = [
        one
        for one in shown(board.incidents)
        if one.incident.bus == bus and servo in one.incident.servo_ids
    ]
    troubles = Troubles()
    for one in board.troubles.latest(len(board.troubles)):
        if one.bus == bus and one.last.servo_id == servo:
            troubles.keep(one)
    lines = FindingLines(status.now_ns, width)
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
