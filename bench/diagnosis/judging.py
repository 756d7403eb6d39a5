"""What was said of a scenario, held against what was built in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from bench.diagnosis.evidence import accepted, excuse
from bench.diagnosis.hosts import HOSTS
from sniffer.decoding.pipeline import Pipeline
from sniffer.diagnosis import Diagnosis
from sniffer.ground.model import NS
from sniffer.merging.wires import in_order

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from bench.diagnosis.hosts import Capture
    from bench.diagnosis.scenario import Heard, Scenario, Truth

SPARE_NS: Final = NS // 10
"""An incident that ends so shortly before a fault begins, by a late stamp, is of the same time."""

NOTE: Final = "note"


@dataclass(frozen=True, slots=True)
class Told:
    """An incident as its JSON has it; ``causes`` with their confidence, the likeliest first."""

    severity: str
    servo_ids: tuple[int, ...]
    first_ns: int
    last_ns: int
    causes: tuple[tuple[str, float], ...]
    codes: tuple[str, ...]
    story: str = ""

    @classmethod
    def of(cls, incident: Mapping[str, Any]) -> Told:
        """Read an incident."""
        return cls(
            incident["severity"],
            tuple(incident["servo_ids"]),
            incident["first_t_ns"],
            incident["last_t_ns"],
            tuple((c["cause"], c["confidence"]) for c in incident["causes"]),
            tuple(dict.fromkeys(f["code"] for f in incident["findings"])),
            incident.get("story", ""),
        )

    @property
    def cause(self) -> str:
        """The verdict."""
        return self.causes[0][0]

    @property
    def alarms(self) -> bool:
        """Whether it is more than a note."""
        return self.severity != NOTE


@dataclass(frozen=True, slots=True)
class Case:
    """A scenario through a host, and what was said of it.

    ``spans`` are the truths' times in the capture's own.
    """

    name: str
    protocol: str
    host: str
    seed: int
    truths: tuple[Truth, ...]
    spans: tuple[tuple[int, int], ...]
    told: tuple[Told, ...]
    frames: int
    failure: str = ""
    """What it raised, where nothing may be raised."""


@dataclass(frozen=True, slots=True)
class Held:
    """One fault: the incident that names it, or the one that comes nearest to it.

    ``excused``: why this host cannot show it. ``named``: the first cause is right; ``listed``: it
    is among the causes; ``right_servo``: of those that name it, one names just these servos.
    """

    case: Case
    truth: Truth
    told: Told | None
    named: bool
    listed: bool
    right_servo: bool
    excused: str


@dataclass(frozen=True, slots=True)
class Score:
    """One case: its faults, and the incidents that are right and that are not."""

    case: Case
    held: tuple[Held, ...]
    right: tuple[Told, ...]
    wrong: tuple[Told, ...]


def score(case: Case) -> Score:
    """Hold what was said against what was built in."""
    right: list[Told] = []
    held = []
    for truth, span in zip(case.truths, case.spans, strict=True):
        near = [t for t in case.told if _overlaps(t, span)]
        causes = accepted(truth, case.name)
        listing = [t for t in near if truth.cause in dict(t.causes)]
        naming = [t for t in near if t.cause in causes and t in listing]
        right += (t for t in naming if t not in right)
        sure = [t for t in naming if set(t.servo_ids) == set(truth.servo_ids)]
        best = next(iter((*sure, *naming, *listing, *_sorted(near, truth))), None)
        held.append(
            Held(
                case,
                truth,
                best,
                bool(naming),
                bool(listing),
                bool(sure),
                excuse(truth, case.host, case.protocol),
            )
        )
    wrong = tuple(t for t in case.told if t not in right)
    return Score(case, tuple(held), tuple(right), wrong)


def _overlaps(told: Told, span: tuple[int, int]) -> bool:
    return told.first_ns <= span[1] + SPARE_NS and told.last_ns >= span[0] - SPARE_NS


def _sorted(near: Sequence[Told], truth: Truth) -> list[Told]:
    """Return incidents, those first that are about the same servos and are alarms."""

    def strangeness(told: Told) -> tuple[bool, bool]:
        return set(told.servo_ids) != set(truth.servo_ids), not told.alarms

    return sorted(near, key=strangeness)


def diagnosed(capture: Capture) -> tuple[tuple[Told, ...], int]:
    """Return what the diagnosis says of a capture, and how many frames there were."""
    diagnosis = Diagnosis()
    pipeline = Pipeline(capture.options, [diagnosis])
    for group in in_order([capture.chunks], capture.options, lambda message: None):
        pipeline.feed(group)
    pipeline.close()
    pipeline.finish()
    told = tuple(Told.of(incident.as_dict()) for incident in diagnosis.incidents())
    return told, sum(judged["frames"] for judged in diagnosis.judged())


def case_of(
    scenario: Scenario,
    heard: Sequence[Heard],
    host: str,
    seed: int,
    *,
    diagnose: Callable[[Capture], tuple[tuple[Told, ...], int]] = diagnosed,
) -> Case:
    """Let a host record what a tap heard, and have it diagnosed."""
    capture = HOSTS[host](scenario, heard, seed)
    told: tuple[Told, ...] = ()
    frames, failure = 0, ""
    try:
        told, frames = diagnose(capture)
    except Exception as error:  # whatever it is, it is what a user would meet
        failure = f"{type(error).__name__}: {error}"[:120]
    spans = tuple((capture.moments(t.first_s), capture.moments(t.last_s)) for t in scenario.truths)
    return Case(
        scenario.name,
        scenario.protocol,
        host,
        seed,
        scenario.truths,
        spans,
        told,
        frames,
        failure,
    )
