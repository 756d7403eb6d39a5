"""What a code means: an anomaly's, a finding's or a cause's, from the catalogues of all three."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.diagnosis.causes import CAUSES
from sniffer.diagnosis.rules import AREA_OF, FINDINGS
from sniffer.diagnosis.weights import LINES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

ANOMALY, FINDING, CAUSE = "anomaly", "finding", "cause"

PAGES: Final = {
    ANOMALY: "docs/anomalies.md",
    FINDING: "docs/findings.md",
    CAUSE: "docs/causes.md",
}
"""Where all of a kind are listed."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """What one catalogue says of a name.

    ``kind`` is ``anomaly``, ``finding`` or ``cause``; ``level`` is empty where there is none.
    ``facts`` are named texts: what is usual behind it, how it is known, what to do.
    """

    name: str
    kind: str
    level: str
    title: str
    means: str
    facts: Mapping[str, str]


def known_names() -> list[str]:
    """Return all names that have a meaning, each once."""
    return [*dict.fromkeys((*CATALOGUE, *FINDINGS, *CAUSES))]


def speaking_of(word: str) -> list[str]:
    """Return the causes whose title or meaning has a word: a fault may be called otherwise."""
    whole = re.compile(rf"\b{re.escape(word)}\b", re.IGNORECASE)
    return [n for n, c in CAUSES.items() if whole.search(f"{c.title}. {c.means}")]


def meanings(name: str) -> list[Explanation]:
    """Return what a name means; none, one, or more where catalogues share it."""
    return [*_of(name)]


def _of(name: str) -> Iterator[Explanation]:
    if code := CATALOGUE.get(name):
        facts = {"usual causes": code.causes, "try": code.remedy, "speaks for": _spoken_for(name)}
        yield Explanation(name, ANOMALY, code.severity.name.lower(), code.group, code.means, facts)
    if found := FINDINGS.get(name):
        facts = {"known by": found.known_by, "speaks for": _spoken_for(name)}
        yield Explanation(name, FINDING, "", AREA_OF[name], found.means, facts)
    if cause := CAUSES.get(name):
        facts = {
            "known by": cause.shows,
            "looks like it": cause.alike,
            "what to do": cause.remedy,
            "what settles it": cause.settle,
            "evidence": ", ".join(w.finding for w in LINES if w.cause == name and w.is_key),
        }
        level = cause.severity.name.lower()
        yield Explanation(name, CAUSE, level, f"{cause.title}; {cause.of}", cause.means, facts)


def _spoken_for(finding: str) -> str:
    """Return the causes that this speaks for, the strongest first."""
    lines = sorted((w for w in LINES if w.finding == finding and w.is_key), key=lambda w: -w.weight)
    return ", ".join(w.cause for w in lines)
