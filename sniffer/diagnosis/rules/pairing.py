"""Who answers whom: servos never heard, gone silent, away for a while."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "never-answered",
        "pairing",
        "A servo was asked time and again, and never answered, while others did.",
        "At least five requests with an expected answer, no answer, another servo answered.",
    ),
    FindingCode(
        "silent-since",
        "pairing",
        "A servo answered until one moment, and not once since.",
        "Answers before, and at least five requests in a row without one until the end.",
    ),
    FindingCode(
        "away-for-a-while",
        "pairing",
        "A servo answered nothing for some requests in a row, and then again.",
        "At least three requests in a row without an answer, answers before and behind.",
    ),
)

ENOUGH: Final = 5
"""Requests in a row without an answer that are no accident."""


def never_answered(case: Case) -> Iterator[Finding]:
    """Servos that are asked and were never heard."""
    a = case.answers
    for servo in case.servos:
        rows = np.flatnonzero(a["servo_id"] == servo)
        asked, missing = int(a["asked"][rows].sum()), int(a["missing"][rows].sum())
        if missing < ENOUGH or missing < asked or not case.answering:
            continue
        if case.ledger.heard_from(servo):
            continue
        yield Finding(
            "never-answered",
            servo,
            int(a["t_first"][rows].min()),
            int(a["t_last"][rows].max()),
            missing,
            f"servo {servo} was asked {asked} times and never answered",
            (Place(int(a["at"][rows[0]]), 1, int(a["t_first"][rows[0]]), "the first request"),),
            brief=f"servo {servo} never answers ({missing} requests)",
        )


def silences(case: Case) -> Iterator[Finding]:
    """Servos that answered and stopped: for ever, or for a while."""
    for servo in case.answering:
        spells = case.ledger.silences.of(servo)
        for_ever = [s for s in spells if s.back_ns is None and s.missed >= ENOUGH]
        for s in for_ever:
            took = (case.last_ns - s.first_ns) / NS
            yield Finding(
                "silent-since",
                servo,
                s.first_ns,
                case.last_ns,
                s.missed,
                f"servo {servo} answered until {_ago(case, s.first_ns)} and not once since, "
                f"{s.missed} requests in {took:.3g} s",
                (Place(s.at, s.length, s.first_ns, "the first request without an answer"),),
                brief=f"servo {servo} silent to the end",
            )
        short = [s for s in spells if s.back_ns is not None]
        if short:
            longest = max(short, key=lambda s: (s.back_ns or 0) - s.first_ns)
            took_ms = ((longest.back_ns or 0) - longest.first_ns) / 1e6
            yield Finding(
                "away-for-a-while",
                servo,
                short[0].first_ns,
                short[-1].back_ns or 0,
                len(short),
                f"servo {servo} was away {len(short)} times, at most for {took_ms:.0f} ms "
                f"({longest.missed} requests in a row)",
                tuple(
                    Place(s.at, s.length, s.first_ns, "the first request without an answer")
                    for s in short[:3]
                ),
                strength=min(0.6 + 0.2 * len(short), 1.0),
                brief=f"servo {servo} silent for {took_ms:.0f} ms",
                episodes=tuple((s.first_ns, s.back_ns or 0) for s in short),
            )


def _ago(case: Case, t_ns: int) -> str:
    return f"{(t_ns - case.first_ns) / NS:.3f} s"


RULES: Final[tuple[Rule, ...]] = (never_answered, silences)
"""The rules of this area."""
