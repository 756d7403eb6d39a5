"""DIAGNOSIS.md: the figures, what is confused with what, and every miss."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.diagnosis.evidence import ALSO_RIGHT, NO_CHECKSUM, UNSHOWN
from bench.diagnosis.figures import MILLION, percent, share, table

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bench.diagnosis.figures import Figures
    from bench.diagnosis.judging import Told

RESULTS: Final = Path(__file__).parents[1] / "DIAGNOSIS.md"

GUIDE: Final = RESULTS.parents[1] / "docs" / "diagnosing.md"
"""The page that states how often a sure cause is right."""

OF_SURE: Final = "right, of the first causes that are 80 % sure and more"

STATED: Final = re.compile(
    r"\d+\.\d %(?=\s+of\s+the\s+first\s+causes\s+that\s+were\s+80\s%\s+sure)"
)
MEASURED: Final = re.compile(rf"^\| {OF_SURE} \| (\d+\.\d %) \|", re.MULTILINE)
"""Where the figure stands on that page, and on this one."""

HEAD: Final = """# What the diagnosis says of faults that were built in

`make bench-diagnosis`. Each scenario is traffic of a bus with known faults, or none, as four hosts
hand it on: with an exact clock, through an adapter with a 16 ms timer, as a text log, as bare
bytes. Servos and controllers are simulated; where senders overlap, rates differ or noise
strikes, the bits on the line decide (`bench/diagnosis/uart.py`). An incident names a fault if its
first cause is the fault's and their times overlap. Each scenario goes through the first two hosts,
and through one of the others in turn. Notes that are wrong count nowhere; warnings and errors do.
"""


def report(figures: Figures) -> str:
    """Return the whole page."""
    parts = [HEAD, _summary(figures), _hosts(figures), _causes(figures), _findings(figures)]
    parts += [_calibration(figures), _confusions(figures), _misses(figures), _extras(figures)]
    return "\n".join([*parts, _failures(figures), _excused()])


def restate(page: str) -> None:
    """Write what was measured of sure causes into the page that states it."""
    measured = MEASURED.search(page)
    if measured is not None:
        text = GUIDE.read_text(encoding="utf-8")
        GUIDE.write_text(STATED.sub(measured[1], text), encoding="utf-8")


def _summary(figures: Figures) -> str:
    names = {s.case.name for s in figures.faulty}
    sound = {s.case.name for s in figures.sound}
    rows = [
        ("right first cause", percent(figures.named()), ">= 95 %"),
        ("the cause is among those listed", percent(figures.listed()), ""),
        ("right servo, where it is a servo's and named", percent(figures.right_servo()), ">= 97 %"),
        ("no servo, where it is nobody's and named", percent(figures.nobody()), ""),
        ("incidents a fault", f"{figures.incidents_a_fault():.2f}", "<= 1.2"),
        (OF_SURE, percent(figures.right_of_sure()), ">= 80 %"),
        ("Brier score of the first cause's confidence", f"{figures.brier():.3f}", ""),
    ]
    for host in figures.hosts:
        alarms, frames = figures.false_alarms(host)
        aim = {"exact": "0", "usb16": "<= 1"}.get(host, "")
        rate = alarms * MILLION / max(frames, 1)
        said = f"{rate:.1f} ({alarms} in {frames})"
        rows.append((f"false alarms a million sound frames, {host}", said, aim))
    lines = table(("", "measured", "aim"), rows)
    told = f"{len(names)} scenarios with faults, {len(sound)} of sound traffic."
    return "\n".join([told, "", *lines, ""])


def _hosts(figures: Figures) -> str:
    rows = [
        (
            host,
            len(figures.held(host)),
            percent(figures.named(host)),
            percent(figures.listed(host)),
            percent(figures.right_servo(host)),
            f"{figures.incidents_a_fault(host):.2f}",
        )
        for host in figures.hosts
    ]
    head = ("host", "faults", "right first cause", "listed", "right servo", "incidents a fault")
    return "\n".join(["## By host", "", *table(head, rows), ""])


def _causes(figures: Figures) -> str:
    rows = []
    for cause, held, said, right in figures.causes():
        named = sum(h.named for h in held)
        whose = [h for h in held if h.named and h.truth.servo_ids]
        servos = sum(h.right_servo for h in whose)
        rows.append(
            (
                f"`{cause}`",
                len(held),
                percent(share(named, len(held))) if held else "",
                percent(share(right, said)) if said else "",
                percent(share(servos, len(whose))) if whose else "",
                said - right or "",
            )
        )
    head = ("cause", "faults", "recall", "precision", "right servo", "said wrongly")
    return "\n".join(["## By cause", "", *table(head, rows), ""])


def _findings(figures: Figures) -> str:
    rows = []
    for code, right, wrong, must, there in figures.findings():
        recall = percent(share(there, must)) if must else ""
        precision = percent(share(right, right + wrong))
        rows.append((f"`{code}`", right + wrong, precision, must or "", recall))
    head = ("finding", "in incidents", "of these right", "must be there", "recall")
    return "\n".join(["## By finding", "", *table(head, rows), ""])


def _calibration(figures: Figures) -> str:
    rows = [
        (f"{low:.2f} to {min(high, 1):.2f}", count, f"{mean:.2f}", f"{right:.2f}")
        for low, high, count, mean, right in figures.reliability()
    ]
    lines = table(("confidence", "incidents", "mean of it", "were right"), rows)
    return "\n".join(["## How sure one may be", "", *lines, ""])


def _confusions(figures: Figures) -> str:
    rows = [(f"`{a}`", f"`{b}`", count) for (a, b), count in figures.confusions()]
    return "\n".join(
        ["## What is taken for what", "", *table(("it is", "said", "times"), rows), ""]
    )


def _ids(ids: tuple[int, ...]) -> str:
    return ", ".join(map(str, ids)) or "none"


def _said(told: Told | None) -> str:
    if told is None:
        return "nothing"
    causes = ", ".join(f"{cause} {sure:.1f}" for cause, sure in told.causes[:3])
    return f"{causes} (servos: {_ids(told.servo_ids)})"


def _together(rows: Iterable[tuple[tuple[str, ...], str]]) -> list[tuple[str, ...]]:
    """Return rows that only differ by their host as one, with all of these hosts."""
    hosts: dict[tuple[str, ...], list[str]] = {}
    for row, host in rows:
        hosts.setdefault(row, []).append(host)
    return [(*row, ", ".join(of)) for row, of in hosts.items()]


def _misses(figures: Figures) -> str:
    held = figures.misses()
    rows = [
        (
            (
                h.case.name,
                str(h.case.seed),
                f"{h.truth.cause} (servos: {_ids(h.truth.servo_ids)})",
                _said(h.told),
            ),
            h.case.host,
        )
        for h in held
    ]
    lines = table(("scenario", "seed", "it is", "said", "hosts"), _together(rows))
    return "\n".join([f"## Every miss ({len(held)})", "", *lines, ""])


def _extras(figures: Figures) -> str:
    extras = list(figures.extras())
    rows = [
        ((s.case.name, str(s.case.seed), _said(told), ", ".join(told.codes)), s.case.host)
        for s, told in extras
    ]
    lines = table(("scenario", "seed", "said", "findings", "hosts"), _together(rows))
    title = f"## Every alarm about what was not built in ({len(extras)})"
    return "\n".join([title, "", *lines, ""])


def _failures(figures: Figures) -> str:
    rows = [((c.name, str(c.seed), c.failure), c.host) for c in figures.failures]
    if not rows:
        return ""
    lines = table(("scenario", "seed", "raised", "hosts"), _together(rows))
    return "\n".join([f"## Every error ({len(rows)})", "", *lines, ""])


def _excused() -> str:
    rows = [(host, f"`{cause}`", why) for (host, cause), why in UNSHOWN.items()]
    rows += [(host, f"`{cause}` of {of}", why) for (host, cause, of), why in NO_CHECKSUM.items()]
    lines = table(("host", "cause", "why"), rows)
    also = [
        f"In `{name}` {' and '.join(more)} is as right in the first place, if the truth is listed: "
        "the wire shows both alike."
        for name, more in ALSO_RIGHT.items()
    ]
    return "\n".join(["## What a host cannot show", "", *lines, "", *also, ""])
