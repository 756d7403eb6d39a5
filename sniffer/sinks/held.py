"""What servos' registers held, as people read it: servos of which the same was said stand together.

So a setting that one servo has otherwise than its neighbours, or that changed more often there, is
a line of its own.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rich.text import Text

from sniffer.ground.codes import COMMANDED, CONFIG, MEASURED
from sniffer.ground.model import NS
from sniffer.ground.units import word_of
from sniffer.ground.wording import plain, short
from sniffer.protocols.ids import shared_ids
from sniffer.sinks.consoles import console_for, glued, tables_in, unpadded
from sniffer.sinks.tabulated import ServoCell, Tabulated, called, number

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.console import Console

    from sniffer.decoding.called import ServoNames
    from sniffer.statistics.held import HeldRegister, StatedValue

_HEADINGS: Final = {CONFIG: "settings", COMMANDED: "goals and commands", MEASURED: "measured"}


def print_held(
    registers: Sequence[HeldRegister],
    names: ServoNames,
    began_ns: Mapping[str, int],
) -> None:
    """Print registers bus by bus: settings, what was commanded, what was measured.

    ``names`` are what servos are called, ``began_ns`` when the capture began, of each
    bus with a clock.
    """
    console = console_for()
    width = tables_in(console)
    with unpadded(console):
        for nth, bus in enumerate(dict.fromkeys(held.bus for held in registers)):
            if nth:
                console.print()
            mine = [held for held in registers if held.bus == bus]
            _print_bus(mine, names, began_ns.get(bus), console, width)


def _print_bus(
    mine: Sequence[HeldRegister],
    names: ServoNames,
    began_ns: int | None,
    console: Console,
    width: int,
) -> None:
    title = f"{mine[0].bus}: {mine[0].protocol.name}, what registers held"
    console.print(Text(short(plain(title)), style="bold"))
    tables = {
        heading: _table(rows, names, began_ns)
        for role, heading in _HEADINGS.items()
        if (rows := [held for held in mine if held.register.role == role])
    }
    if any(table.lacks_names(None, width) for table in tables.values()):
        bus = mine[0].bus
        told = {held.servo_id: names.of(bus, held.servo_id) for held in mine}
        console.print(Text(called({servo: name for servo, name in told.items() if name})))
    for heading, table in tables.items():
        console.print()
        console.print(Text(f" {heading}", style="dim"))
        console.print(table.table(None, width))


def _table(rows: Sequence[HeldRegister], names: ServoNames, began_ns: int | None) -> Tabulated:
    place = "last at byte" if began_ns is None else "last at s"
    columns = ("register", "servos", "first", "last", "read+set", "changes", place)
    table = Tabulated(*columns, left=("servos", "first", "last"), whole=("register",))
    alike: dict[tuple[str, str, str, int], list[HeldRegister]] = {}
    for held in sorted(rows, key=lambda h: (h.register.address, h.register.name, h.servo_id)):
        first, last = _shown(held, held.first), _shown(held, held.last)
        alike.setdefault((held.register.name, first, last, held.changes), []).append(held)
    before = ""
    for (name, first, last, _), mine in alike.items():
        latest = max(mine, key=lambda h: (h.last.t_ns, h.last.offset))
        said = [sum(getattr(h, n) for h in mine) for n in ("reads", "writes", "changes")]
        at = latest.last.offset if began_ns is None else (latest.last.t_ns - began_ns) / NS
        table.add_row(
            name if name != before else "",
            _whose(mine, names),
            first,
            last if said[-1] else "",
            f"{said[0]}+{said[1]}",
            str(said[-1]),
            str(at) if isinstance(at, int) else f"{at:.3f}",
        )
        before = name
    return table


def _whose(mine: Sequence[HeldRegister], names: ServoNames) -> str | ServoCell:
    everyone = {who for held in mine for who in shared_ids(held.protocol)}
    alone = ["all" if held.servo_id in everyone else str(held.servo_id) for held in mine]
    named = [
        who if who == "all" else glued(names.label(held.bus, held.servo_id))
        for who, held in zip(alone, mine, strict=True)
    ]
    told, full = ", ".join(alone), ", ".join(named)
    return told if told == full else ServoCell(told, full)


def _shown(held: HeldRegister, said: StatedValue) -> str:
    named = held.register.names(said.raw)
    if named is not None:
        words = named if isinstance(named, list) else [named]
        return ", ".join(map(glued, words)) + f" ({said.raw})" if words else str(said.raw)
    if math.isnan(said.value):
        return str(said.raw)
    unit = word_of(held.register.unit)
    return glued(f"{number(said.value)} {unit}") if unit else number(said.value)
