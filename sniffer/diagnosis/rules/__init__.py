"""All rules: each reads a case and says what is so. One small function a finding."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.case import Case
from sniffer.diagnosis.model import Finding
from sniffer.diagnosis.passing import without_passed
from sniffer.diagnosis.rules import (
    absences,
    alike,
    bare,
    bits,
    breaking,
    collisions,
    complaints,
    controller,
    crossings,
    ends,
    everybody,
    foreign,
    forms,
    goals,
    heads,
    held,
    identity,
    interruptions,
    joints,
    jumps,
    limited,
    line,
    losses,
    masters,
    motors,
    ordered,
    outages,
    pairing,
    patience,
    rates,
    refusing,
    remains,
    restarts,
    rhythms,
    scans,
    scatter,
    slowness,
    soonest,
    splices,
    streams,
    sums,
    supply,
    symptoms,
    tap,
    texts,
    timing,
    translated,
    unanswered,
    unasked,
    unknown,
    waits,
    warmth,
)

if TYPE_CHECKING:
    from sniffer.diagnosis.catalogue import FindingCode

Rule = Callable[[Case], Iterable[Finding]]

_AREAS: Final = (
    tap,
    losses,
    limited,
    line,
    bits,
    ends,
    pairing,
    timing,
    joints,
    interruptions,
    patience,
    remains,
    controller,
    goals,
    absences,
    alike,
    bare,
    breaking,
    collisions,
    complaints,
    crossings,
    everybody,
    foreign,
    rates,
    forms,
    heads,
    held,
    identity,
    jumps,
    masters,
    motors,
    ordered,
    outages,
    refusing,
    restarts,
    rhythms,
    scans,
    scatter,
    slowness,
    soonest,
    splices,
    streams,
    sums,
    supply,
    texts,
    translated,
    unanswered,
    unasked,
    unknown,
    waits,
    warmth,
)

RULES: Final[tuple[Rule, ...]] = (
    *(rule for area in _AREAS for rule in area.RULES),
    symptoms.symptoms,
)
"""In no particular order: none asks what another one found."""

FINDINGS: Final[Mapping[str, FindingCode]] = MappingProxyType(
    {entry.code: entry for area in _AREAS for entry in area.FINDINGS}
)
"""What the rules find, beside the anomalies."""


def findings(case: Case) -> list[Finding]:
    """Return all that the rules find, in order of time."""
    found = [finding for rule in RULES for finding in rule(case)]
    return sorted(without_passed(case, found), key=lambda f: (f.first_ns, f.code, f.servo_id or -1))


def markdown() -> str:
    """Return the findings as the page ``docs/findings.md``."""
    lines = [
        "# Findings",
        "",
        "What the rules of `sniffer diagnose` find in a capture, beside the [anomalies](anomalies.md):",
        "each says what is so, not why. [Causes](causes.md) are weighed from them.",
        "",
    ]
    for area in dict.fromkeys(f.area for f in FINDINGS.values()):
        lines += [f"## {area}", ""]
        for f in FINDINGS.values():
            if f.area == area:
                lines += [f"### `{f.code}`", "", f.means, "", f"- Known by: {f.known_by}"]
                lines += [f"- What to do: {f.remedy}"] if f.remedy else []
                lines += [f"- What settles it: {f.settle}"] if f.settle else []
                lines += [""]
    return "\n".join(lines).rstrip() + "\n"
