"""What a diagnosis is made of: findings with their places, causes in their order, incidents."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    from sniffer.decoding.called import ServoNames
    from sniffer.ground.model import Severity


class Place(NamedTuple):
    """Bytes that show something: absolute offset and length in the stream of the bus."""

    offset: int
    length: int
    t_ns: int
    what: str


LINE: Final = -1
"""Stands among servos for all that is nobody's: what is found of the line."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What one rule found; it says what is so, not why.

    ``servo_id`` is None where it is the line's, the controller's or the tap's. ``strength`` is how
    much of the weight that the table gives the code counts here, 0..1: a rule that saw three cases
    is less sure than one that saw three hundred. ``what`` is a sentence with the numbers, ``brief``
    the few words that it has in a story. ``episodes`` are the moments it is about, (first, last) in
    ns, where there are several. ``values`` are its numbers by name. ``is_own``: it tells of its
    servo and of nobody else, so no cause that is not a servo's explains it. ``may_be``: servos of
    which it may tell as well, and nothing says of which. ``befell``: servos to which the same has
    happened (or ``LINE``): what is found of them from then on follows from it.
    """

    code: str
    servo_id: int | None
    first_ns: int
    last_ns: int
    count: int
    what: str
    places: tuple[Place, ...] = ()
    strength: float = 1.0
    brief: str = ""
    episodes: tuple[tuple[int, int], ...] = ()
    values: tuple[tuple[str, float], ...] = ()
    is_own: bool = False
    may_be: tuple[int, ...] = ()
    befell: tuple[int, ...] = ()

    def value(self, name: str, otherwise: float = 0.0) -> float:
        """Return one of its numbers."""
        return dict(self.values).get(name, otherwise)


SAID: Final = 2
"""Reasons that are said of a cause."""

PERCENT_MOST: Final = 99
"""So sure people are told that a cause is, in percent, however much speaks for it."""


def percent_sure(confidence: float) -> int:
    """Return a confidence as people are told it: what is weighed is never certain."""
    return min(round(100 * confidence), PERCENT_MOST)


def _in_digits(confidence: float) -> float:
    """Return a confidence as scripts are told it: with three digits, and never 1."""
    return min(round(confidence, 3), 0.999)


class Reason(NamedTuple):
    """One line of the weighing: what a finding counts for a cause, and why.

    ``because`` is why it counts, ``reason`` that with what was found.
    """

    cause: str
    finding: str
    weight: float
    reason: str
    because: str


@dataclass(frozen=True, slots=True)
class Ranked:
    """A cause of an incident: how sure it is (0..1), why, and the weighing behind it.

    ``brief`` says why without what was found, for whoever lists the findings beside it.
    """

    cause: str
    confidence: float
    why: str
    reasons: tuple[Reason, ...] = ()

    @property
    def brief(self) -> str:
        """Why, in the words of the weighing alone."""
        return "; ".join([r.because for r in self.reasons if r.weight > 0][:SAID])

    @property
    def percent(self) -> int:
        """How sure it is as people are told."""
        return percent_sure(self.confidence)


@dataclass(frozen=True, slots=True)
class Incident:
    """Findings that one fault explains, with the causes that were weighed, the likeliest first.

    Times are in ns. ``count`` is how often it happened, ``against`` what speaks against the second
    cause, ``next`` what to do: a measurement or a change that would tell the first two apart.
    """

    number: int
    severity: Severity
    bus: str
    servo_ids: tuple[int, ...]
    first_ns: int
    last_ns: int
    count: int
    causes: tuple[Ranked, ...]
    findings: tuple[Finding, ...]
    story: str
    against: str
    next: str

    @property
    def cause(self) -> str:
        """The likeliest cause."""
        return self.causes[0].cause

    @property
    def likely(self) -> tuple[Ranked, ...]:
        """The causes that people are told of: the first one, and those that may be."""
        return (*self.causes[:1], *(c for c in self.causes[1:] if c.percent))

    def named(self, names: ServoNames) -> Incident:
        """Return it with the names of servos in its sentences, as people are told of it."""
        if not names:
            return self
        said = functools.partial(names.sentence, self.bus)
        return replace(
            self,
            causes=tuple(replace(c, why=said(c.why)) for c in self.causes),
            findings=tuple(
                replace(
                    f,
                    what=said(f.what),
                    brief=said(f.brief),
                    places=tuple(p._replace(what=said(p.what)) for p in f.places),
                )
                for f in self.findings
            ),
            story=said(self.story),
            against=said(self.against),
            next=said(self.next),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return it as ``schemas/diagnosis.schema.json`` has it."""
        places = sorted({p for f in self.findings for p in f.places})
        return {
            "id": str(self.number),
            "severity": self.severity.name.lower(),
            "bus": self.bus,
            "servo_ids": list(self.servo_ids),
            "first_t_ns": self.first_ns,
            "last_t_ns": self.last_ns,
            "count": self.count,
            "story": self.story,
            "causes": [
                {"cause": c.cause, "confidence": _in_digits(c.confidence), "why": c.why}
                for c in self.causes
            ],
            "findings": [
                {
                    "code": f.code,
                    "count": f.count,
                    "servo_id": f.servo_id,
                    "first_t_ns": f.first_ns,
                    "last_t_ns": f.last_ns,
                    "what": f.what,
                }
                for f in self.findings
            ],
            "evidence": [
                {"offset": p.offset, "length": p.length, "t_ns": p.t_ns, "what": p.what}
                for p in places
            ],
            "against": self.against,
            "next": self.next,
        }
