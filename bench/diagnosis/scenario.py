"""What a scenario is: traffic as a tap hears it, and the faults that were built into it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


class Heard(NamedTuple):
    """Bytes in a row as a tap hears them; ``line_errors`` are offsets without a stop bit.

    Times are those of the first byte's beginning and of the last one's end. ``tx``: sent by the
    controller.
    """

    t_start_ns: int
    t_end_ns: int
    wire: bytes
    tx: bool
    line_errors: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Truth:
    """One fault that was built in; times are seconds since the capture's first byte.

    ``servo_ids`` is empty where the line or the controller is at fault. ``findings`` are codes
    that must be there.
    """

    cause: str
    servo_ids: tuple[int, ...]
    first_s: float
    last_s: float
    findings: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Scenario:
    """Traffic with its truth; none where it is sound.

    ``make`` returns for a seed what a tap with an exact clock hears; ``baud`` is the tap's.
    """

    name: str
    protocol: str
    truths: tuple[Truth, ...]
    baud: int
    make: Callable[[int], Sequence[Heard]]
