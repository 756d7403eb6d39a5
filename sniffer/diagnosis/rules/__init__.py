"""All rules: each reads a case and says what is so. One small function a finding."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, Protocol, cast

from sniffer.diagnosis.case import Case
from sniffer.diagnosis.evidence.passing import without_passed
from sniffer.diagnosis.model import Finding
from sniffer.diagnosis.rules import symptoms

if TYPE_CHECKING:
    from sniffer.diagnosis.catalogue import FindingCode

Rule = Callable[[Case], Iterable[Finding]]


class Part(Protocol):
    """A file of rules: what they find, and the rules."""

    FINDINGS: Sequence[FindingCode]
    RULES: Sequence[Rule]


def _parts(area: str) -> tuple[Part, ...]:
    """Return the files in an area's folder, in order of their names."""
    package = importlib.import_module(f"{__name__}.{area}")
    names = sorted(file.name for file in pkgutil.iter_modules(package.__path__))
    return tuple(
        cast("Part", importlib.import_module(f"{package.__name__}.{name}")) for name in names
    )


AREAS: Final[Mapping[str, tuple[Part, ...]]] = MappingProxyType(
    {area: _parts(area) for area in ("tap", "line", "pairing", "timing", "device", "controller")}
)
"""What rules are about, each a folder, and the files in it."""

RULES: Final[tuple[Rule, ...]] = (
    *(rule for parts in AREAS.values() for part in parts for rule in part.RULES),
    symptoms.symptoms,
)
"""In no particular order: none asks what another one found."""

FINDINGS: Final[Mapping[str, FindingCode]] = MappingProxyType(
    {entry.code: entry for parts in AREAS.values() for part in parts for entry in part.FINDINGS}
)
"""What the rules find, beside the anomalies."""

AREA_OF: Final[Mapping[str, str]] = MappingProxyType(
    {entry.code: area for area, parts in AREAS.items() for part in parts for entry in part.FINDINGS}
)
"""What each finding is about."""


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
    for area in AREAS:
        lines += [f"## {area}", ""]
        for f in FINDINGS.values():
            if AREA_OF[f.code] == area:
                lines += [f"### `{f.code}`", "", f.means, "", f"- Known by: {f.known_by}"]
                lines += [f"- What to do: {f.remedy}"] if f.remedy else []
                lines += [f"- What settles it: {f.settle}"] if f.settle else []
                lines += [""]
    return "\n".join(lines).rstrip() + "\n"
