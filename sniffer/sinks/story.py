"""Incidents as people read them: the story first, then the causes with their evidence."""

from __future__ import annotations

import datetime
from typing import TYPE_CHECKING, Final

from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from sniffer.decoding.called import ServoNames
from sniffer.diagnosis.causes import CAUSES
from sniffer.ground.model import NS, Severity, SnifferError
from sniffer.ground.wording import and_

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis import Finding, Incident
    from sniffer.diagnosis.rest import Rest

_COLOUR: Final = {"error": "red", "warn": "yellow", "note": "cyan"}

SINCE: Final = 1_000_000_000 * NS
"""Times after that (the year 2001) are those of a clock on the wall."""

FINDINGS_SHOWN: Final = 6

NAMED: Final = 3
"""Of more servos than that only the number is told where incidents are told in short."""


def print_incidents(
    incidents: Sequence[Incident],
    judged: str,
    *,
    clock: bool,
    rest: Rest,
    console: Console | None = None,
    names: ServoNames | None = None,
) -> None:
    """Print incidents: what happened, why, what speaks against the second cause, what to do.

    What is to be mended comes first, what is only worth knowing behind it, each by its beginning.
    ``rest`` are anomalies of which no cause can be told: with them, not nothing is wrong.
    """
    console = console or Console(highlight=False)
    names = names or ServoNames()
    rest, incidents = rest.named(names), [i.named(names) for i in incidents]
    incidents = sorted(incidents, key=lambda i: i.severity == Severity.NOTE)  # the others first
    if len(incidents) > 1:  # whoever reads the first screen alone knows what stands below it
        _hang(console, f"{len(incidents)} incidents: ", [Text(_in_short(incidents, names))])
        console.print()
    for nth, incident in enumerate(incidents):
        if nth:
            console.print()
        _print(incident, console, clock=clock)
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


def _print(i: Incident, console: Console, *, clock: bool) -> None:
    """Print one incident; what does not fit in a line goes on below where it began."""
    level = i.severity.name.lower()
    head = Text(f"{moment(i.first_ns)} " if clock else "")
    head.append(level, style=_COLOUR[level])
    head.append(f"  {i.story}", style="bold")
    often = _how_often(i, clock=clock)
    _hang(console, f"{i.number}  ", [head, *([Text(often)] if often else [])])
    _hang(console, "   next: ", [Text(i.next)])
    for rank, cause in enumerate(i.causes):
        line = Text(cause.cause)
        if not rank:
            line.append(f": {cause.brief or cause.why}")
        _hang(console, f"{f'{cause.percent} %':>7}  ", [line])
    found = [f.what for f in _by_weight(i)[:FINDINGS_SHOWN]]
    if i.against:
        _hang(console, "   ", [Text(i.against)])
    left = len(i.findings) - FINDINGS_SHOWN
    if left > 0:
        found.append(f"and {left} more finding{'s' if left > 1 else ''}")
    for what in found:
        _hang(console, "   - ", [Text(what)])
    offsets = dict.fromkeys(p.offset for f in i.findings for p in f.places)
    if offsets:
        told = ", ".join(f"byte {offset}" for offset in list(offsets)[:3])
        _hang(console, "   see ", [Text(told)])


def _by_weight(i: Incident) -> Sequence[Finding]:
    """Return the findings, those first that its first cause is known by."""
    reasons = i.causes[0].reasons
    counts = {r.finding: r.weight for r in reasons}
    return sorted(i.findings, key=lambda f: -counts.get(f.code, 0.0))


def _in_short(incidents: Sequence[Incident], names: ServoNames) -> str:
    """Return the first cause of each incident, with whose it is and how sure that is."""
    told = []
    for i in incidents:
        each = [names.servo(i.bus, servo) for servo in i.servo_ids]
        who = f" of {and_(each) if len(each) <= NAMED else f'{len(each)} servos'}" if each else ""
        told.append(f"{i.number} {i.cause}{who} ({i.causes[0].percent} %)")
    return ", ".join(told)


def _how_often(i: Incident, *, clock: bool) -> str:
    """Return how often something happened and until when, where that is more than once."""
    times = f"{i.count} times" if i.count > 1 else ""
    first, last = moment(i.first_ns), moment(i.last_ns)
    until = f"until {last}" if clock and last != first else ""
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
) -> None:
    """Print how the causes of one incident were weighed: every finding with what it counts.

    Raises:
        SnifferError: there is no incident of that number.
    """
    console = console or Console(highlight=False)
    incident = next((i for i in incidents if str(i.number) == number), None)
    if incident is None:
        known = f"1 to {len(incidents)}" if incidents else "none: nothing is wrong"
        raise SnifferError(f"there is no incident {number}: {known}")
    incident = incident.named(names or ServoNames())
    console.print(Text(incident.story, style="bold"))
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


def moment(t_ns: int) -> str:
    """Return a time as people write it: of the clock where it is one, else in seconds."""
    if t_ns >= SINCE:
        at = datetime.datetime.fromtimestamp(t_ns // NS, datetime.UTC)
        return f"{at:%H:%M:%S}.{t_ns % NS // 100_000_000}"
    return f"{t_ns / NS:.1f} s"
