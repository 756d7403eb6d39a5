"""Incidents as people read them: the story first, then the causes with their evidence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rich.table import Column, Table
from rich.text import Text

from sniffer.decoding.called import ServoNames
from sniffer.diagnosis.causes import CAUSES
from sniffer.diagnosis.gathering import gathered, likewise
from sniffer.diagnosis.shared import numbered
from sniffer.ground.model import Severity, SnifferError
from sniffer.ground.moments import of_day, with_day
from sniffer.ground.wording import and_, counted
from sniffer.sinks.consoles import console_for

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from sniffer.diagnosis import Finding, Incident
    from sniffer.diagnosis.rest import Rest
    from sniffer.diagnosis.shared import Shared

_COLOUR: Final = {"error": "red", "warn": "yellow", "note": "cyan"}

FINDINGS_SHOWN: Final = 6

NAMED: Final = 3
"""Of more servos than that only the number is told where incidents are told in short."""


def print_incidents(
    incidents: Sequence[Incident],
    judged: str,
    *,
    clock: bool,
    began_ns: int,
    rest: Rest,
    console: Console | None = None,
    names: ServoNames | None = None,
    shared: Sequence[Shared] = (),
    is_one_bus: bool = True,
) -> None:
    """Print incidents: what happened, why, what speaks against the second cause, what to do.

    What is to be mended comes first, what is only worth knowing behind it, bus by bus, each by its
    beginning; of several buses each incident has the name of its own.
    Times of another day than that of ``began_ns``, the capture's begin, have their date.
    ``rest`` are anomalies of which no cause can be told: with them, not nothing is wrong.
    ``shared`` are incidents of several buses that are likely one fault: the surest of one cause is
    told at length, the others by their heads.
    """
    console = console or console_for()
    names = names or ServoNames()
    rest, incidents = rest.named(names), [i.named(names) for i in incidents]
    incidents = sorted(incidents, key=lambda i: i.severity == Severity.NOTE)  # the others first
    if len(incidents) > 1:  # whoever reads the first screen alone knows what stands below it
        told = [_in_short(incidents, names, shared, is_one_bus=is_one_bus)]
        told += [group.told for group in shared]
        _hang(console, f"{len(incidents)} incidents: ", [Text(each) for each in told])
        console.print()
    leading = _leading(incidents, shared)
    for nth, incident in enumerate(incidents):
        if nth:
            console.print()
        when = f"{with_day(incident.first_ns, began_ns, 1)} " if clock else ""
        _print_head(incident, when, console, clock=clock, is_one_bus=is_one_bus)
        as_which = leading.get(incident.number, incident.number)
        if as_which == incident.number:
            _print_evidence(incident, console, names, is_one_bus=is_one_bus)
        else:
            _hang(console, "   next: ", [Text(f"as {as_which}")])
            _print_causes(incident, console)
            _print_places(incident, console, is_one_bus=is_one_bus)
    if incidents and rest.told:
        console.print()
    if rest.told:
        console.print(Text(f"no cause can be told of {rest.told}"))
        _hang(console, "   next: ", [Text(rest.next)])
    if incidents and not rest.told:
        console.print()
    if incidents or rest.told:
        console.print(Text(f"judged on {judged}", style="dim"))
    else:
        console.print(Text(f"nothing is wrong, judged on {judged}"))


def _leading(incidents: Sequence[Incident], shared: Sequence[Shared]) -> dict[int, int]:
    """Return for incidents of one fault and cause the number of the surest, told at length."""
    out = {}
    for group in shared:
        mine = [i for i in incidents if i.number in group.numbers]
        for cause in {i.cause for i in mine}:
            alike = [i for i in mine if i.cause == cause]
            surest = max(alike, key=lambda i: i.causes[0].percent)
            out.update({i.number: surest.number for i in alike})
    return out


def _print_head(i: Incident, when: str, console: Console, *, clock: bool, is_one_bus: bool) -> None:
    """Print when an incident was, and its story; what does not fit goes on below its beginning."""
    level = i.severity.name.lower()
    head = Text(when)
    head.append(level, style=_COLOUR[level])
    head.append(f"  {_on(i, is_one_bus=is_one_bus)}{i.story}", style="bold")
    often = _how_often(i, clock=clock)
    _hang(console, f"{i.number}  ", [head, *([Text(often)] if often else [])])


def _on(i: Incident, *, is_one_bus: bool) -> str:
    """Return the name of the bus before what happened there, where there are several."""
    return "" if is_one_bus else f"{i.bus}: "


def _print_evidence(i: Incident, console: Console, names: ServoNames, *, is_one_bus: bool) -> None:
    """Print what to do, why, and where it is seen."""
    _hang(console, "   next: ", [Text(i.next)])
    _print_causes(i, console)
    each = gathered(_by_weight(i))
    found = [likewise(f.what, others, names, i.bus) for f, others in each[:FINDINGS_SHOWN]]
    if i.against:
        _hang(console, "   ", [Text(i.against)])
    left = len(each) - FINDINGS_SHOWN
    if left > 0:
        found.append(f"and {left} more finding{'s' if left > 1 else ''}")
    for what in found:
        _hang(console, "   - ", [Text(what)])
    _print_places(i, console, is_one_bus=is_one_bus)


def _print_causes(i: Incident, console: Console) -> None:
    for rank, cause in enumerate(i.likely):
        line = Text(cause.cause)
        if not rank:
            line.append(f": {cause.brief or cause.why}")
        _hang(console, f"{f'{cause.percent} %':>7}  ", [line])


def _print_places(i: Incident, console: Console, *, is_one_bus: bool) -> None:
    """Print where it is seen, as ``--from @byte:`` takes it."""
    of_bus = "" if is_one_bus else f"{i.bus}:"
    offsets = dict.fromkeys(p.offset for f in i.findings for p in f.places)
    if offsets:
        told = ", ".join(f"byte {of_bus}{offset}" for offset in list(offsets)[:3])
        _hang(console, "   see ", [Text(told)])


def _by_weight(i: Incident) -> Sequence[Finding]:
    """Return the findings, those first that its first cause is known by."""
    reasons = i.causes[0].reasons
    counts = {r.finding: r.weight for r in reasons}
    return sorted(i.findings, key=lambda f: -counts.get(f.code, 0.0))


def _in_short(
    incidents: Sequence[Incident],
    names: ServoNames,
    shared: Sequence[Shared],
    *,
    is_one_bus: bool,
) -> str:
    """Return the first cause of each incident, with whose it is and how sure that is.

    Those of one cause that begin on several buses at one moment are told at once.
    """
    leading = _leading(incidents, shared)
    rows: dict[int, list[Incident]] = {}
    for i in incidents:
        rows.setdefault(leading.get(i.number, i.number), []).append(i)
    told = []
    for row in rows.values():
        each = [names.servo(i.bus, servo) for i in row for servo in i.servo_ids]
        is_few = len(each) <= NAMED and len(row) == 1
        who = f" of {and_(each) if is_few else counted(len(each), 'servo')}" if each else ""
        on = "" if is_one_bus else f" on {and_([i.bus for i in row])}"
        sure = sorted({i.causes[0].percent for i in row})
        told.append(
            f"{numbered([i.number for i in row])} {row[0].cause}{who}{on} "
            f"({' to '.join(str(s) for s in dict.fromkeys((sure[0], sure[-1])))} %)"
        )
    return ", ".join(told)


def _how_often(i: Incident, *, clock: bool) -> str:
    """Return how often something happened and until when, where that is more than once."""
    times = f"{i.count} times" if i.count > 1 else ""
    last = with_day(i.last_ns, i.first_ns, 1)
    until = f"until {last}" if clock and last != of_day(i.first_ns, 1) else ""
    return " ".join(filter(None, (times, until)))


def _hang(console: Console, label: str, lines: Sequence[Text]) -> None:
    """Print lines behind a label, indented by its width."""
    grid = Table.grid(Column(no_wrap=True, min_width=len(label)), Column(overflow="fold"))
    for nth, line in enumerate(lines):
        grid.add_row(Text("" if nth else label), line)
    console.print(grid)


def print_weighing(
    incidents: Sequence[Incident],
    number: str,
    console: Console | None = None,
    names: ServoNames | None = None,
    *,
    is_one_bus: bool = True,
) -> None:
    """Print how the causes of one incident were weighed: every finding with what it counts.

    Raises:
        SnifferError: there is no incident of that number.
    """
    console = console or console_for()
    incident = next((i for i in incidents if str(i.number) == number), None)
    if incident is None:
        known = f"1 to {len(incidents)}" if incidents else "none: nothing is wrong"
        raise SnifferError(f"there is no incident {number}: {known}")
    incident = incident.named(names or ServoNames())
    console.print(Text(_on(incident, is_one_bus=is_one_bus) + incident.story, style="bold"))
    for cause in incident.causes:
        known_cause = CAUSES[cause.cause]
        table = Table(box=None, padding=(0, 0, 0, 2))
        table.add_column("counts", justify="right")
        table.add_column("finding", no_wrap=True)
        table.add_column("because", overflow="fold")
        table.add_row(f"{known_cause.prior:+.1f}", "(before)", known_cause.title)
        for reason in cause.reasons:
            table.add_row(f"{reason.weight:+.1f}", reason.finding, reason.reason)
        console.print()
        console.print(Text(f"{cause.cause}: {cause.percent} %", style="bold"))
        console.print(table)
