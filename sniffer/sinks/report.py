"""The summary as people read it: bytes, frames per servo and command, times, anomalies."""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import TYPE_CHECKING, Final

from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.decoding.called import ServoNames
from sniffer.decoding.durations import FIGURES
from sniffer.decoding.pacing import ASSUMED, ESTIMATED
from sniffer.decoding.summary import UNTIMED
from sniffer.diagnosis.causes import CAUSES
from sniffer.ground.codes import OBSERVED
from sniffer.ground.streams import UNFOLDED
from sniffer.ground.wording import counted, plain, servos, short
from sniffer.protocols import PROTOCOLS
from sniffer.sinks.consoles import GLUE, NARROWEST, glued, unpadded
from sniffer.sinks.tabulated import called

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from rich.console import Console, JustifyMethod

    from sniffer.decoding.pacing import Pace
    from sniffer.decoding.summary import BusTotals, Summary
    from sniffer.diagnosis import Incident

SERVOS: Final = 3
"""How many servos are named beside an anomaly."""

LISTED: Final = 200
"""Characters that names which might be meant may take; of more, as registers are, none is told."""

_COLOUR = {"error": "red", "warn": "yellow", "note": "cyan"}

_OUTCOMES: Final[Mapping[str, str]] = {"not_expected": "need no reply"}
"""Outcomes in other words than their own."""


def selected(summary: Summary) -> str:
    """Return what was asked for, and what a selection showed of how much."""
    told = summary.narrowed
    part = f"a part of the capture, {told['part']}" if "part" in told else ""
    if "where" not in told:
        return plain(part)
    totals = summary.as_dict()
    counts = [f"{summary.shown[table]} of {totals[table]} {table}" for table in told["tables"]]
    of = f"; {part}" if part else ""
    if not any(summary.shown[table] for table in told["tables"]):
        of += "".join(f"; {line}" for line in _unheard(summary, told["where"]))
    return plain(f"selection, {told['where']}: {', '.join(counts)}{of}")


def _unheard(summary: Summary, where: str) -> Iterator[str]:
    """Yield what is named in a selection that shows nothing, and is not in the capture."""
    from sniffer.selection.expression import near

    every = [each for b in summary.buses.values() for each in (b, *b.parts.values())]
    ops = {op for each in every for _, op, _ in each.by_command}
    registers = [r for each in every if each.protocol in PROTOCOLS
                 for r in PROTOCOLS[each.protocol].registers]  # fmt: skip
    columns = {
        "op": ops,
        "bus": set(summary.buses),
        "register": {r.name for r in registers},
        "quantity": {r.quantity for r in registers if r.quantity},
        "unit": {r.unit for r in registers if r.unit},
    }
    for column, known in columns.items():
        listed = re.search(rf"\b{column}\s*(?:=\s*|IN\s*\()((?:'[^']*'(?:,\s*)?)+)", where, re.I)
        for name in re.findall(r"'([^']*)'", listed[1]) if listed else ():
            if name not in known and known:
                of_another = [other for other, names in columns.items() if name in names]
                if of_another:
                    told = f"did you mean {of_another[0]} = {name!r}?"
                else:
                    told = near(name, sorted(known))
                advice = f": {told}" if len(told) < LISTED else ""
                yield f"{column} {name[:40]!r} is not in it{advice}"
    who = {servo for each in every for servo, _, _ in each.by_command if servo >= 0}
    listed = re.search(r"\bservo_id\s*(?:=\s*|IN\s*\()((?:\d+(?:,\s*)?)+)", where, re.I)
    for servo in re.findall(r"\d+", listed[1]) if listed else ():
        if int(servo) not in who and who:
            shown = ", ".join(map(str, sorted(who)))
            yield f"servo {servo} is not in it: {'one of ' * (len(who) > 1)}{shown}"


def print_summary(summary: Summary, console: Console, incidents: Sequence[Incident] = ()) -> None:
    """Print the totals of every bus; anomalies that incidents explain are told with these."""
    console.width = max(console.width, NARROWEST)
    with unpadded(console):
        for nth, (name, bus) in enumerate(summary.buses.items()):
            if nth:
                console.print()
            if bus.parts:
                _print_shared(name, bus, console)
            for part, each in enumerate(bus.parts.values() or (bus,)):
                if part:
                    console.print()
                mine = [i for i in incidents if i.bus == name]
                _print_bus(name, each, summary, console, mine)


def _print_shared(name: str, b: BusTotals, console: Console) -> None:
    """Say what those who share a wire have in common."""
    console.print(Text(short(plain(f"{name}: {b.protocol}, {counted(b.bytes, 'byte')}"))))
    if b.looks_like:
        console.print(f"  this looks like {b.looks_like}: decode it as {b.looks_like}")
    console.print()


def _untimed(b: BusTotals) -> str:
    if b.clock != "none" and not b.kinds.total():
        return "no frame in it: nothing was timed"
    return f"{UNTIMED}: times are nominal"


def _print_bus(
    name: str,
    b: BusTotals,
    summary: Summary,
    console: Console,
    incidents: Sequence[Incident],
) -> None:
    told, names = summary.paces.get(name), summary.names
    frames, gaps = counted(sum(b.kinds.values()), "frame"), counted(sum(b.gaps.values()), "gap")
    share = 100 * b.bytes_in_frames / b.bytes if b.bytes else 0.0
    length = b.seconds
    title = f"{name}: {b.protocol}"
    held = math.floor(100 * share) / 100  # 100 % is said of nothing less
    lines = [
        f"{counted(b.bytes, 'byte')} = {b.bytes_in_frames} in {frames} ({held:.2f} %)",
        f"over {length:.3f} s" if length else _untimed(b),
    ]
    if told is not None and length:
        lines += _timing(told)
    lines[0] += f" + {b.bytes_in_gaps} in {gaps}"
    outcomes = [f"{n} {_OUTCOMES.get(k, k.replace('_', ' '))}" for k, n in b.outcomes.items() if n]
    if outcomes:
        lines.append("exchanges: " + ", ".join(outcomes))
    shown = ", ".join(
        f"{names.label(name, servo)} {model}"
        for servo, (model, how) in sorted(b.models.items())
        if how == OBSERVED and model != b.usual_model
    )
    if shown:
        lines.append(f"models told by the wire: {shown}")
    if b.looks_like:
        lines.append(f"this looks like {b.looks_like}: decode it as {b.looks_like}")
    table = _commands(name, b, names)
    anyhow = console.options.update(max_width=UNFOLDED)  # a width is never more than this
    if names and Measurement.get(console, anyhow, table).minimum > console.width:
        met = {servo for servo, _, _ in b.by_command}
        lines.append(called({s: n for s, n in names.on_bus(name).items() if s in met}))
        table = _commands(name, b, ServoNames())
    console.print(Text(short(plain(title)), style="bold"))
    for line in lines:
        console.print(Padding(Text(line), (0, 0, 0, 2)))
    if b.by_command:
        console.print()
        console.print(table)
    console.print()
    left = _unexplained(b, incidents)
    if incidents:
        console.print(_incidents(incidents, names))
        console.print("  `sniffer diagnose` says why, and what to do")
        if left:
            console.print()
    if left:
        console.print(_anomalies(name, b, left, names))
    elif not incidents:
        console.print("  no anomalies")


def _unexplained(b: BusTotals, incidents: Sequence[Incident]) -> Counter[str]:
    """Return how many anomalies of each code no incident explains."""
    left = Counter(b.codes)
    for incident in incidents:
        for finding in incident.findings:
            if finding.code in left:
                left[finding.code] -= finding.count
    return +left


def _incidents(incidents: Sequence[Incident], names: ServoNames) -> Table:
    table = _table()
    table.add_column("level", no_wrap=True)
    table.add_column("incident", overflow="fold")
    table.add_column("sure", justify="right", no_wrap=True)
    table.add_column("explains", overflow="fold")
    for incident in incidents:
        level = incident.severity.name.lower()
        codes: Counter[str] = Counter()
        for finding in incident.findings:
            if finding.code in CATALOGUE:
                codes[finding.code] += finding.count
        explains = ", ".join(f"{code}{GLUE}{n}" for code, n in codes.most_common())
        table.add_row(
            Text(level, style=_COLOUR[level]),
            Text(_headline(incident, names)),
            f"{incident.causes[0].percent}{GLUE}%",
            explains or names.sentence(incident.bus, incident.findings[0].what),
        )
    return table


def _headline(incident: Incident, names: ServoNames) -> str:
    """Return an incident's cause, and whose it is."""
    cause = CAUSES[incident.cause].title
    who = names.sentence(incident.bus, servos(incident.servo_ids))
    return f"{incident.cause}: {cause}" + (f" ({who})" if who else "")


def _timing(told: Pace) -> list[str]:
    """Say by what times were reckoned, where nobody stated it."""
    out = []
    if told.rate == ASSUMED:
        slower = f"; the line may be as slow as {told.slowest}" if told.doubtful else ""
        unlike = slower if told.slowest < told.baud else ""
        out.append(f"assumed to run at {told.baud} baud{unlike}")
    elif told.rate == ESTIMATED and told.baud == told.usual:
        out.append(f"runs at {told.baud} baud, as usual, by its stamps")
    out += told.remarks
    return out


def _table() -> Table:
    return Table(box=None, pad_edge=True, padding=(0, 0, 0, 2))


def _commands(bus: str, b: BusTotals, names: ServoNames) -> Table:
    failed = any(b.bad_by_servo.values())
    table = _table()
    who = [k[0] for k in b.by_command]
    named = any(names.of(bus, servo) for servo in who)
    side: JustifyMethod = "left" if named else "right"
    table.add_column("servo", justify=side, no_wrap=not named, overflow="fold")
    for title in (
        "frames",
        *(("reply p50 ms", "p99", "max") if b.times else ()),
        *(("failed",) if failed else ()),
    ):
        table.add_column(title, justify="right", no_wrap=True)
    table.add_column("commands sent/answered", overflow="fold")
    for servo in sorted(set(who)):
        mine = {(op, kind): n for (who, op, kind), n in b.by_command.items() if who == servo}
        ops: dict[str, list[int]] = {}
        for (op, kind), n in mine.items():
            ops.setdefault(op, [0, 0])[kind == "response"] += n
        told = ", ".join(
            f"{op}{GLUE}{asked}" + (f"/{got}" if got else "")
            for op, (asked, got) in sorted(ops.items(), key=lambda e: (-sum(e[1]), e[0]))
        )
        row = [glued(names.label(bus, servo)) if servo >= 0 else "-", str(sum(mine.values()))]
        if b.times:
            q = b.times.get(servo)
            times = [q.figure(share) if q else None for share in FIGURES.values()]
            row += [bounds.ms() if bounds is not None else "" for bounds in times]
        if failed:
            row.append(str(b.bad_by_servo.get(servo) or ""))
        table.add_row(*row, told)
    return table


def _anomalies(bus: str, b: BusTotals, left: Counter[str], names: ServoNames) -> Table:
    table = _table()
    table.add_column("level", no_wrap=True)
    table.add_column("anomaly", no_wrap=True)
    table.add_column("count", justify="right", no_wrap=True)
    if b.by_servo:
        table.add_column("servos", overflow="fold")
    table.add_column("at byte", justify="right", no_wrap=True)
    table.add_column("the first one", overflow="fold")
    for code, n in sorted(left.items(), key=lambda e: (-CATALOGUE[e[0]].severity, -e[1])):
        level = CATALOGUE[code].severity.name.lower()
        first = b.first[code]
        table.add_row(
            Text(level, style=_COLOUR[level]),
            Text(code, style=_COLOUR[level]),
            str(n),
            *((_servos(bus, b.by_servo.get(code, Counter()), names),) if b.by_servo else ()),
            str(first.evidence[0][0]),
            Text(names.sentence(bus, first.detail)),
        )
    return table


def _servos(bus: str, counts: Counter[int], names: ServoNames) -> str:
    """Return which servos, those with most first, each with its count where there are several."""
    if len(counts) < 2:
        return "".join(glued(names.label(bus, servo)) for servo in counts)
    shown = [f"{glued(names.label(bus, servo))}×{n}" for servo, n in counts.most_common(SERVOS)]
    left = len(counts) - len(shown)
    return " ".join([*shown, f"+{left}"] if left else shown)
