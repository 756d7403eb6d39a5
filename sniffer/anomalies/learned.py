"""What is learned from values on the way, for the rules and for what comes after."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.anomalies.evidence import Verdict
    from sniffer.ground.clues import Clue
    from sniffer.ground.model import Samples
    from sniffer.protocols.base import Extremes


class Change(NamedTuple):
    """One change: it holds for values from ``at`` on, and for what follows ``row``."""

    at: int
    row: int
    what: int
    servo: int
    value: int
    named: int  # the id that the frame names
    name: str = ""


class FeedbackWrite(NamedTuple):
    """A servo's return mode became known (-1: unknown) at a row; ``servo_id`` -1: every servo's.

    With a ``new_id`` the servo took that one, and its return mode goes along.
    """

    row: int
    servo_id: int
    mode: int
    new_id: int = -1


class ScaleMisfit(NamedTuple):
    """A value that cannot be under the scale that was in force, by row of the frames."""

    row: int
    servo_id: int
    register: int
    raw: int
    mode: int


class MetClue(NamedTuple):
    """A clue as it was met: its bytes, the command that carried it, and the frame's span."""

    clue: Clue
    data: bytes
    op: int
    span: tuple[int, int]


class Told(NamedTuple):
    """A verdict at a row, with what was weighed for it."""

    row: int
    verdict: Verdict
    weighed: tuple[MetClue, ...]


class Meaning(NamedTuple):
    """What frames state, and what was learned from it on the way."""

    samples: Samples
    feedback: Sequence[FeedbackWrite]
    told: Sequence[Told]
    misfits: Sequence[ScaleMisfit]
    resets: Sequence[Change]
    """Resets that were obeyed and give an id."""
    extremes: Mapping[int, Extremes] | None = None
    """The least and the greatest raw number of each register in ``samples``; None: not known."""
