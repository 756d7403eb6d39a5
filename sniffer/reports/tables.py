"""The tables of a report, as texts: pages and plain text show the same."""

from __future__ import annotations

from collections import Counter
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.decoding.durations import FIGURES
from sniffer.decoding.pacing import ASSUMED, ESTIMATED
from sniffer.ground.amounts import lasting, number
from sniffer.ground.codes import OBSERVED
from sniffer.ground.model import Clock, Severity
from sniffer.ground.wording import counted, one_line
from sniffer.reports import words
from sniffer.statistics.figures import POSITION

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.decoding.summary import BusTotals
    from sniffer.reports.content import Content
    from sniffer.statistics.figures import ServoFigures, WireFigures

CLOCKS: Final[Mapping[Clock, str]] = MappingProxyType(
    {
        Clock.NONE: "none in the input: times are counted from the bytes at the nominal rate",
        Clock.FILE: "time stamps of a text file",
        Clock.READ: "stamped by the recorder as it read the port",
        Clock.SAMPLE: "samples of a logic analyser",
    }
)

MEASURED: Final = ("voltage", "temperature", "load", "current")

REPLY: Final = f"reply {' / '.join(FIGURES)} ms"

STARTS: Final = "first motion ms p50 / max"

FACTS: Final = 200
VALUE: Final = 500
NAME: Final = 80
"""Facts of a recording that are told, and characters of each: a header may hold 4 MiB of them."""

SILENT: Final = 24
"""Ids that never answered are named up to so many."""


class Table(NamedTuple):
    """A table of texts; ``numbers`` are the columns that are numbers."""

    head: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    numbers: frozenset[int] = frozenset()


class Bad(NamedTuple):
    """One kind of anomaly of a bus."""

    severity: Severity
    code: str
    times: int
    servos: str
    first: str
    remedy: str


def servo_name(content: Content, lane: str, servo: int) -> str:
    """Return how a servo is called: with its bus where there are several."""
    several = len(content.collector.lanes) > 1
    told = content.names.servo(lane, servo)
    return f"{lane} {told}" if several else told


def present(content: Content) -> Iterator[tuple[str, int, ServoFigures]]:
    """Yield the servos that have said something."""
    return (told for told in content.collector.servos() if told[2].responses or told[2].values)


def silent(content: Content) -> str:
    """Return which ids were asked and never answered, in words; empty where all have."""
    named: dict[str, list[str]] = {}
    for lane, servo, mine in content.collector.servos():
        if mine.wanted and not mine.responses:
            named.setdefault(lane, []).append(content.names.label(lane, servo))
    several = len(content.collector.lanes) > 1
    parts = [
        f"{f'{lane}: ' if several else ''}{words.listed(ids, SILENT)}"
        for lane, ids in named.items()
    ]
    return f"Asked, and never heard to answer: {'; '.join(parts)}." if parts else ""


def servos(content: Content) -> Table:
    """Return the table of the servos, with the columns that have anything to tell."""
    rows: list[dict[str, str]] = []
    for lane, servo, mine in present(content):
        totals = content.totals_of(lane)
        row = {"servo": servo_name(content, lane, servo), "model": _model(totals, servo)}
        row |= {
            "asked": str(mine.wanted or ""),
            "missing": _share(mine.missing, mine.wanted),
            "damaged": _share(mine.damaged, mine.wanted),
            "unasked": str(mine.outcomes["unsolicited"] or ""),
        }
        times = totals.times.get(servo)
        bounds = [times.figure(share) if times is not None else None for share in FIGURES.values()]
        row[REPLY] = " / ".join(b.ms() for b in bounds if b is not None)
        for quantity in (POSITION, *MEASURED):
            row[quantity] = words.spread(mine.range_of(quantity), mine.unit_of(quantity) or "")
        wanted = sum(mine.goals.values()) - mine.goals["unanswered"]
        motion, own = content.collector.lanes[lane].motion, (servo, mine.unit_of(POSITION) or "")
        lag, starts = motion.lags.of(*own), motion.starts.figures().get(own)
        row["behind goals ms"] = "" if lag is None else lag.ms()
        begun = [starts.times.figure(share) for share in (0.5, 1.0)] if starts is not None else []
        row[STARTS] = " / ".join(b.ms() for b in begun if b is not None)
        steps = motion.steps.figures().get(own)
        row["goals not reached"] = str(steps.unreached_count or "") if steps is not None else ""
        row["acknowledged"] = f"{mine.goals['acknowledged']} of {wanted}" if wanted else ""
        rows.append(row)
    head = tuple(name for name in (rows[0] if rows else ()) if any(row[name] for row in rows))
    return Table(
        head, [tuple(row[name] for name in head) for row in rows], frozenset(range(2, len(head)))
    )


def accounted(content: Content) -> Table:
    """Return where the bytes of each bus are."""
    rows = []
    for name, b in content.summary.buses.items():
        share = 100 * b.bytes_in_frames / b.bytes if b.bytes else 0.0
        why = ", ".join(f"{n} {reason.replace('_', ' ')}" for reason, n in b.gaps.most_common())
        rows.append(
            (
                name,
                str(b.bytes),
                f"{b.bytes_in_frames} in {counted(sum(b.kinds.values()), 'frame')}",
                f"{int(share * 100) / 100:.2f} %",  # 100 % is said of nothing less
                f"{b.bytes_in_gaps} in {counted(sum(b.gaps.values()), 'gap')}",
                why or "none",
            )
        )
    head = ("bus", "bytes", "in frames", "share", "in no frame", "gaps by reason")
    return Table(head, rows, frozenset((1, 2, 3, 4)))


def anomalies(content: Content) -> list[tuple[str, list[Bad]]]:
    """Return the kinds of anomalies of each bus, the worst first."""
    out = []
    for name, b in content.summary.buses.items():
        found = []
        for code, n in sorted(b.codes.items(), key=lambda e: (-CATALOGUE[e[0]].severity, -e[1])):
            known, first = CATALOGUE[code], b.first[code]
            blamed = b.by_servo.get(code, Counter())
            first = content.names.on(name, first)
            who = [
                f"{content.names.label(name, servo)}{f'×{k}' * (len(blamed) > 1)}"
                for servo, k in blamed.items()
            ]
            remedy = first.remedy or known.remedy
            told = f"{first.detail} (byte {first.evidence[0][0]})"
            found.append(Bad(known.severity, code, n, words.listed(who, 4), told, remedy))
        if found:
            out.append((name, found))
    return out


def outcomes(content: Content) -> list[str]:
    """Return what became of the exchanges of each bus, in words."""
    out = []
    for name, b in content.summary.buses.items():
        told = [f"{n} {key.replace('_', ' ')}" for key, n in b.outcomes.items() if n]
        if told:
            out.append(f"{name}: {', '.join(told)}")
    return out


def recorded(content: Content) -> list[tuple[str, str]]:
    """Return how the capture came about: what it is, by which clock and rate, what was remarked."""
    out = [("input", f"{content.name}: {content.described}" if content.described else content.name)]
    if content.size is not None:
        out.append(("size", counted(content.size, "byte")))
    if content.damage:
        out.append(("broken off", content.damage))
    if (span := content.span_ns) is not None:
        clock = content.clock
        if clock != Clock.NONE:
            out += zip(("from", "to"), map(words.dated, span), strict=True)
        length = lasting(content.lasted_ns)
        out.append(("length", f"{length}, nominal" if clock == Clock.NONE else length))
    for name, wire in content.collector.wires.items():
        out += ((f"{name}: {key}", value) for key, value in _wire(wire))
    out += (("note", note) for note in content.notes)
    out += sorted(content.facts.items())[:FACTS]
    if len(content.facts) > FACTS:
        out.append(("...", f"and {len(content.facts) - FACTS} more facts"))
    return [(one_line(key)[:NAME], clipped(value)) for key, value in out]


def clipped(value: str) -> str:
    """Return a text of bounded length."""
    line = one_line(value)
    return line if len(line) <= VALUE else f"{line[: VALUE - 1]}…"


def _wire(wire: WireFigures) -> Iterator[tuple[str, str]]:
    clock = CLOCKS[wire.clock]
    if wire.doubt_ns >= 0 and wire.clock != Clock.NONE:
        clock += f"; a frame may be up to {lasting(wire.doubt_ns)} earlier than told"
    yield "clock", clock
    if wire.pace is not None:
        how = {ASSUMED: "assumed: nobody stated it", ESTIMATED: "estimated from the stamps"}
        yield "rate", f"{wire.pace.baud} baud, {how.get(wire.pace.rate, 'stated')}"
        for remark in wire.pace.remarks:
            yield "times", remark
    if wire.remarks:
        told = [f"{n} {kind.replace('_', ' ')}" for kind, n in wire.remarks.most_common()]
        yield "remarks of the tap", ", ".join(told)


def _model(totals: BusTotals, servo: int) -> str:
    model, how = totals.models.get(servo, (totals.usual_model, -1))
    return f"{model} (seen)" if how == OBSERVED else model if how >= 0 else f"{model} (assumed)"


def _share(n: int, of: int) -> str:
    return f"{n} ({number(100 * n / of, 2)} %)" if n else ""
