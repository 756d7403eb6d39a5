"""The figures of many scores: how often the first cause is right, how sure one may be."""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from bench.diagnosis.evidence import findings

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from bench.diagnosis.judging import Case, Held, Score, Told

BINS: Final = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0001)
"""Confidence is looked at in these steps."""

SURE: Final = 0.8
"""From this confidence on the next step is the remedy (``sniffer.diagnosis.incidents.SURE``)."""

MILLION: Final = 1_000_000


def share(part: float, whole: float) -> float:
    """Return a share, 1 where there is nothing to have a share of."""
    return part / whole if whole else 1.0


@dataclass(slots=True)
class Figures:
    """All scores of a run."""

    scores: list[Score] = field(default_factory=list)

    @property
    def faulty(self) -> list[Score]:
        """Those with a fault."""
        return [s for s in self.scores if s.case.truths]

    @property
    def sound(self) -> list[Score]:
        """Those without."""
        return [s for s in self.scores if not s.case.truths]

    @property
    def hosts(self) -> list[str]:
        """The hosts, in their order."""
        return list(dict.fromkeys(s.case.host for s in self.scores))

    @property
    def failures(self) -> list[Case]:
        """Those that raised an error."""
        return [s.case for s in self.scores if s.case.failure]

    def held(self, host: str | None = None) -> list[Held]:
        """Return the faults that could be seen."""
        return [
            h for s in self.faulty if host in (None, s.case.host) for h in s.held if not h.excused
        ]

    def named(self, host: str | None = None) -> float:
        """Return the share of faults whose first cause is right."""
        held = self.held(host)
        return share(sum(h.named for h in held), len(held))

    def listed(self, host: str | None = None) -> float:
        """Return the share of faults that are among the causes."""
        held = self.held(host)
        return share(sum(h.listed for h in held), len(held))

    def right_servo(self, host: str | None = None) -> float:
        """Return the share of servos' faults, named rightly, that just these servos have."""
        held = [h for h in self.held(host) if h.named and h.truth.servo_ids]
        return share(sum(h.right_servo for h in held), len(held))

    def nobody(self, host: str | None = None) -> float:
        """Return the share of faults that are nobody's, named rightly, that name no servo."""
        held = [h for h in self.held(host) if h.named and not h.truth.servo_ids]
        return share(sum(h.right_servo for h in held), len(held))

    def incidents_a_fault(self, host: str | None = None) -> float:
        """Return how many incidents there are for a fault: alarms, and notes that are right."""
        scores = [s for s in self.faulty if host in (None, s.case.host)]
        told = sum(len(s.right) + sum(t.alarms for t in s.wrong) for s in scores)
        return share(told, sum(len(s.held) for s in scores))

    def false_alarms(self, host: str) -> tuple[int, int]:
        """Return alarms about sound traffic, and of how many frames."""
        scores = [s for s in self.sound if s.case.host == host]
        return (
            sum(t.alarms for s in scores for t in (*s.right, *s.wrong)),
            sum(s.case.frames for s in scores),
        )

    def brier(self) -> float:
        """Return the mean square of confidence less what came true, of the first causes."""
        sure = list(self._sure())
        return share(sum((p - right) ** 2 for p, right in sure), len(sure)) if sure else 0.0

    def right_of_sure(self, least: float = SURE) -> float:
        """Return the share that is right of the first causes that are so sure and more."""
        sure = [right for p, right in self._sure() if p >= least]
        return share(sum(sure), len(sure))

    def reliability(self) -> Iterator[tuple[float, float, int, float, float]]:
        """Yield the steps of confidence: from, to, how many, their mean, how many were right."""
        sure = list(self._sure())
        for low, high in itertools.pairwise(BINS):
            mine = [(p, right) for p, right in sure if low <= p < high]
            if mine:
                mean = sum(p for p, _ in mine) / len(mine)
                yield low, high, len(mine), mean, sum(r for _, r in mine) / len(mine)

    def _sure(self) -> Iterator[tuple[float, bool]]:
        for s in self.scores:
            for told in s.right:
                yield told.causes[0][1], True
            for told in s.wrong:
                if told.alarms:
                    yield told.causes[0][1], False

    def causes(self) -> Iterator[tuple[str, list[Held], int, int]]:
        """Yield each cause: its faults that could be seen, incidents that name it, right ones."""
        of: dict[str, list[Held]] = defaultdict(list)
        for h in self.held():
            of[h.truth.cause].append(h)
        said, right = Counter[str](), Counter[str]()
        for s in self.scores:
            for t in s.right:
                said[t.cause] += 1
                right[t.cause] += 1
            for t in s.wrong:
                said[t.cause] += t.alarms
        for cause in sorted({*of, *(c for c in said if said[c])}):
            yield cause, of[cause], said[cause], right[cause]

    def findings(self) -> Iterator[tuple[str, int, int, int, int]]:
        """Yield each code: in right incidents, in wrong ones, where it must be, where it is."""
        right, wrong = Counter[str](), Counter[str]()
        must, there = Counter[str](), Counter[str]()
        for s in self.scores:
            for t in s.right:
                right.update(t.codes)
            for t in s.wrong:
                if t.alarms:
                    wrong.update(t.codes)
            for h in s.held:
                if h.excused:
                    continue
                known = findings(h.truth, s.case.name, s.case.host)
                near = {code for t in s.case.told for code in t.codes}
                must.update(known)
                there.update(code for code in known if code in near)
        for code in sorted({*right, *wrong, *must}):
            yield code, right[code], wrong[code], must[code], there[code]

    def confusions(self) -> list[tuple[tuple[str, str], int]]:
        """Return (what it is, what was said) of faults that are not named, the frequent first."""
        pairs = Counter[tuple[str, str]]()
        for h in self.held():
            if not h.named:
                pairs[h.truth.cause, h.told.cause if h.told else "nothing"] += 1
        return pairs.most_common()

    def misses(self) -> list[Held]:
        """Return the faults that are not named, or not as the right servos'."""
        return [h for h in self.held() if not h.named or (h.truth.servo_ids and not h.right_servo)]

    def extras(self) -> Iterator[tuple[Score, Told]]:
        """Yield alarms that are about nothing that was built in."""
        for s in self.scores:
            for t in s.wrong:
                if t.alarms:
                    yield s, t


def gathered(scores: Iterable[Score]) -> Figures:
    """Return the figures of scores."""
    return Figures(list(scores))


def percent(value: float) -> str:
    """Return a share in words."""
    return f"{100 * value:.1f} %"


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> list[str]:
    """Return a table in Markdown."""
    lines = [" | ".join(head), " | ".join("---" for _ in head)]
    lines += (" | ".join(str(cell) for cell in row) for row in rows)
    return [f"| {line} |" for line in lines]
