"""Measured values that mechanics forbid: positions and temperatures that jump, and come back."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import TORN
from sniffer.diagnosis.evidence.jumping import altered, comes_back, jumping
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.milli import MILLI

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case, Series
    from sniffer.diagnosis.ledger.steps import Leap
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "position-jumps",
        "A measured position jumps as no joint moves.",
        "A step that would be faster than 1500 degrees (400 mm) a second even if the stamps are as wrong as they can be, and four times the greatest step of most of the time; or such a step and one back with the next value, without a goal there; or a step and one back within a quarter second, whatever the goals, both faster than 500 degrees (133 mm) a second. Where no clock tells: away and back within eight values, four times beyond all other steps, and no goal there. All beyond 4 degrees (0.8 mm) and 4 % of the range.",
        remedy="Look at the servo's position sensor (a worn potentiometer jumps) and at its gear; let the controller not act on a single position.",
        settle="Turn the joint slowly by hand with torque off: a worn sensor jumps at the same places.",
    ),
    FindingCode(
        "values-altered",
        "Values of a servo are one bit off, and back with the next one, in a protocol whose answers have no checksum.",
        "A position that jumps and comes back, by as much as one bit of the number is worth: of several jumps so many that chance has it once in a thousand times.",
    ),
    FindingCode(
        "doubtful-value",
        "A single value stands far from those before and behind it, in a protocol whose answers have no checksum.",
        "Once, or with damage on the line: a position that jumps and comes back with the next value, or a temperature that does so by ten degrees.",
    ),
)


LESS: Final = 0.7
"""How much it counts without a checksum."""


WARMER_DEGC: Final = 10.0


def positions(case: Case) -> Iterator[Finding]:
    """Positions that jump."""
    for servo, (register, jumps) in jumping(case).items():
        yield _jumped(case, servo, register, jumps)


def _jumped(case: Case, servo: int, p: Series, jumps: Sequence[Leap]) -> Finding:
    first = jumps[0]
    # damage that passes for a value comes with damage that does not
    by_a_bit = servo in altered(case)
    guarded = case.has_checksum or (len(jumps) > 1 and not case.count(*TORN))
    to = f"{p.told(first.before / MILLI)} to {p.told(first.after / MILLI)}"
    took = f" within {first.took_ns / 1e6:.0f} ms" if case.has_clock else ""
    often = "" if len(jumps) == 1 else f", {len(jumps)} times"
    often += f", {len(altered(case)[servo])} times as far as one bit is worth" if by_a_bit else ""
    return Finding(
        "values-altered" if by_a_bit else "position-jumps" if guarded else "doubtful-value",
        servo,
        first.t_ns,
        jumps[-1].t_ns,
        len(jumps),
        f"the position of servo {servo} jumps from {to}{took}{often}",
        tuple(Place(s.at, 1, s.t_ns, f"position {p.told(s.after / MILLI)}") for s in jumps[:3]),
        strength=min(0.8 + 0.1 * len(jumps), 1.0) * (1.0 if case.has_checksum else LESS),
        brief=f"position of servo {servo} jumps from {to}",
        episodes=tuple((s.t_ns - s.took_ns, s.t_ns) for s in jumps),
    )


def temperatures(case: Case) -> Iterator[Finding]:
    """Temperatures that jump and come back: no motor does that."""
    for servo in case.measured_by("temperature"):
        t = case.series(servo, "temperature")
        if t is None:
            continue
        steps = case.ledger.steps.of(servo, t.index)
        jumps = [
            s
            for s, follows in itertools.pairwise(steps)
            if s.size / MILLI >= WARMER_DEGC and comes_back(s, follows)
        ]
        if not jumps:
            continue
        first = jumps[0]
        to = f"{t.told(first.before / MILLI)} to {t.told(first.after / MILLI)}"
        yield Finding(
            "doubtful-value",
            servo,
            first.t_ns,
            jumps[-1].t_ns,
            len(jumps),
            f"the temperature of servo {servo} jumps from {to} and back",
            tuple(Place(s.at, 1, s.t_ns, f"temperature {t.told(s.after / MILLI)}") for s in jumps),
            strength=0.8,
        )


RULES: Final[tuple[Rule, ...]] = (positions, temperatures)
"""The rules of this file."""
