"""The report as Markdown: for a terminal, a ticket or a mail."""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.durations import FIGURES
from sniffer.ground.amounts import lasting, number
from sniffer.ground.units import sign_of
from sniffer.ground.wording import counted, plain
from sniffer.reports import tables, words
from sniffer.reports.content import SOUND, found_of, tale
from sniffer.reports.shapes import SIGNS
from sniffer.statistics.figures import DRAWN, ERROR, LONGEST

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.model import Incident
    from sniffer.reports.content import Content
    from sniffer.statistics.figures import ServoFigures
    from sniffer.statistics.grid import Grid, Trace

COLUMNS: Final = 48
"""Characters of a curve."""

SAME: Final = 1e-9
"""By what part of them numbers may differ that are one, but for how a sum is rounded."""

LEVELS: Final = "▁▂▃▄▅▆▇█"

SERVOS: Final = 32
"""Servos that have curves, the first ones."""

_MARKDOWN: Final = re.compile(
    r"[\\`*<\[\]|&]|(?<![^\W_])_|_(?![^\W_])|~(?=~)|(?<=~)~|^(?:[#>+-]|\d+[.)](?=\s|$))"
)
"""What would be markup; an underscore within a word is none."""

_BLANKS: Final = re.compile(r"\s+")


def markdown(content: Content) -> str:
    """Return the report as a text in Markdown."""
    return "\n".join(_lines(content)).rstrip() + "\n"


def told(value: str) -> str:
    """Return a text from outside so that it is one line and no markup."""
    return _MARKDOWN.sub(_escaped, plain(_BLANKS.sub(" ", value)))


def _escaped(mark: re.Match[str]) -> str:
    found = mark[0]
    return f"{found[:-1]}\\{found[-1]}" if found[0].isdigit() else f"\\{found}"


def _lines(content: Content) -> Iterator[str]:
    yield from (f"# {told(content.name)}", "")
    yield from _verdict(content)
    for incident in content.incidents:
        yield from _incident(content, incident)
    yield from ("## The servos", "")
    yield from _table(tables.servos(content))
    if silent := tables.silent(content):
        yield from (told(silent), "")
    yield from (f"- {told(line)}" for line in tables.outcomes(content))
    yield ""
    yield from _curves(content)
    yield from _times(content)
    yield from ("## All anomalies", "")
    yield from _anomalies(content)
    yield from ("## Where the bytes are", "")
    yield from _table(tables.accounted(content))
    yield from ("## How it was recorded", "")
    yield from (f"- {told(key)}: {told(value)}" for key, value in tables.recorded(content))
    yield from ("", f"Made by {told(content.tool)} on {content.made}. Times are UTC.")


def _verdict(content: Content) -> Iterator[str]:
    worst = content.worst
    if worst is None:
        yield "**No incident.**" + ("" if content.rest.told else f" {SOUND}")
    else:
        sign, level = SIGNS[worst.severity], worst.severity.name.lower()
        yield f"**{sign} {level}: {told(content.titled(worst))}**"
        yield from ("", told(tale(worst)), "", f"Do next: {told(worst.next)}")
        for each in content.shared:
            yield from ("", told(each.told))
    if content.rest.told:
        yield from ("", f"No cause can be told of {told(content.rest.told)}.")
        yield from ("", f"Do next: {told(content.rest.next)}")
    if content.damage:
        yield from ("", f"The input broke off: {told(content.damage)}")
    yield from ("", f"Judged on {told(content.judged)}.", "")


def _incident(content: Content, incident: Incident) -> Iterator[str]:
    clock = content.clock_of(incident.bus)
    first, last = words.period(incident.first_ns, incident.last_ns, clock)
    when = first if first == last else f"{first} to {last}"
    sign = SIGNS[incident.severity]
    yield f"## {sign} {incident.number}. {told(content.titled(incident))}"
    yield from ("", f"{told(incident.bus)}, {when}, {counted(incident.count, 'time')}", "")
    yield from (told(tale(incident)), "", f"Do next: {told(incident.next)}", "")
    yield from (f"- {c.percent} % {told(c.cause)}: {told(c.why)}" for c in incident.causes[:3])
    if incident.against:
        yield f"- {told(incident.against)}"
    yield from ("", "What was found:", "")
    shown, more = found_of(incident, content.names)
    yield from (f"- {told(f.code)} ×{f.count}: {told(f.what)}" for f in shown)
    if more:
        yield f"- and {counted(more, 'further finding')}"
    yield ""
    for exhibit in content.exhibits.get(incident.number, ()):
        place = exhibit.place
        at = words.moment(place.t_ns, clock)
        yield from (f"{at}, byte {place.offset}: {told(place.what)}", "")
        yield from (f"- before it: {told(piece.title)}" for piece in exhibit.before)
        yield from (f"- behind it: {told(piece.title)}" for piece in exhibit.behind)
        yield from [""] if exhibit.before or exhibit.behind else []
        yield from _drawn([line for piece in exhibit.pieces for line in [*piece.lines, ""]])


def _drawn(lines: Sequence[str]) -> Iterator[str]:
    """Yield lines as a block of code; none of them can end it."""
    if not lines:
        return
    shown = [plain(line) for line in lines]
    fence = max([3, *(len(m[0]) + 1 for line in shown for m in re.finditer(r"`{3,}", line))]) * "`"
    yield from (f"{fence}text", *shown[:-1], fence, "")


def _table(table: tables.Table) -> Iterator[str]:
    if not table.rows:
        yield from ("None.", "")
        return
    yield f"| {' | '.join(map(told, table.head))} |"
    rule = ["--:" if k in table.numbers else "---" for k in range(len(table.head))]
    yield f"| {' | '.join(rule)} |"
    yield from (f"| {' | '.join(map(told, row))} |" for row in table.rows)
    yield ""


def _curves(content: Content) -> Iterator[str]:
    grid = content.collector.grid
    curves = grid.curves()
    servos = list(tables.present(content))
    if not servos or grid.size < 2:
        return
    length = lasting(grid.width_ns * grid.size)
    yield from ("## Over time", "")
    yield from (f"A line is {length}, drawn from its least mean to its greatest one.", "")
    yield "```text"
    for lane, servo, mine in servos[:SERVOS]:
        rows = list(_servo_curves(mine, curves, grid))
        if rows:
            yield from (plain(tables.servo_name(content, lane, servo)), *rows)
    yield from ("```", "")


def _servo_curves(mine: ServoFigures, curves: dict[int, Trace], grid: Grid) -> Iterator[str]:
    named = {}
    for quantity in DRAWN:
        unit = mine.unit_of(quantity)
        if unit is not None:
            named[quantity] = (mine.values[quantity, unit].curve, unit)
    for (name, unit), which in mine.curves.items():
        if name in (ERROR, LONGEST):
            named["reply, at most" if name == LONGEST else "goal - position"] = (which, unit)
    for title, (which, unit) in named.items():
        curve = curves.get(which)
        if curve is not None and len(curve):
            low, high = float(curve.low.min()), float(curve.high.max())
            ends = f"{number(low)} … {number(high)} {sign_of(unit)}"
            yield f"  {title:16} {sparkline(curve, grid.size)} {ends}"


def sparkline(curve: Trace, size: int) -> str:
    """Return a curve as characters: the mean of each of ``COLUMNS`` stretches, none left blank."""
    at = curve.at * COLUMNS // max(size, 1)
    total = np.bincount(at, curve.mean * curve.n, COLUMNS)
    n = np.bincount(at, curve.n, COLUMNS)
    mean = total / np.maximum(n, 1)
    low, high = float(mean[n > 0].min()), float(mean[n > 0].max())
    is_level = math.isclose(low, high, rel_tol=SAME)  # means of equal numbers may differ
    scale = 0.0 if is_level else (len(LEVELS) - 1) / (high - low)
    levels = np.rint((mean - low) * scale).astype(np.int64)
    return "".join(
        LEVELS[k] if some else " "
        for k, some in zip(levels.tolist(), (n > 0).tolist(), strict=True)
    )


def _times(content: Content) -> Iterator[str]:
    rows = []
    for lane, servo, _ in tables.present(content):
        times = content.totals_of(lane).times.get(servo)
        if times is not None and times.count:
            bounds = [times.figure(share) for share in FIGURES.values()]
            shown = [b.ms() if b is not None else "" for b in bounds]
            rows.append((tables.servo_name(content, lane, servo), str(times.count), *shown))
    if rows:
        head = ("servo", "answers", *(f"{name} ms" for name in FIGURES))
        yield from ("## Response times", "")
        yield from _table(tables.Table(head, rows, frozenset(range(1, len(head)))))


def _anomalies(content: Content) -> Iterator[str]:
    found = tables.anomalies(content)
    rows = [
        (
            *((bus,) if len(content.summary.buses) > 1 else ()),
            f"{SIGNS[k.severity]} {k.severity.name.lower()}",
            k.code,
            str(k.times),
            k.servos,
            k.first,
        )
        for bus, kinds in found
        for k in kinds
    ]
    bus = ("bus",) if len(content.summary.buses) > 1 else ()
    head = (*bus, "level", "code", "count", "servos", "the first one")
    yield from _table(tables.Table(head, rows))
