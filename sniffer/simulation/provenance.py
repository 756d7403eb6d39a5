"""Where the values come from that servos answer which are to be like those of a recording."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sniffer.simulation.talk import REQUEST, RESPONSE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from sniffer.simulation.likeness import ServoLikeness
    from sniffer.simulation.talk import TrueFrame

NAMED: Final = 6
"""So many registers are named in a line; the truth has them all."""


@dataclass(frozen=True, slots=True)
class Answered:
    """How many values were answered.

    ``recorded`` are as the recording had them last, ``told`` as the controller has written them
    since, ``moved`` were recorded and are others now: a joint moved, a servo restarted. ``made_up``
    are those of registers that the recording never showed, by servo and register.
    """

    recorded: int
    told: int
    moved: int
    made_up: Mapping[tuple[int, str], int]

    def __str__(self) -> str:
        """Say it in a line for people."""
        made_up = sum(self.made_up.values())
        line = (
            f"values answered: {self.recorded} as recorded, {self.told} as written since, "
            f"{self.moved} that moved since, {made_up} made up"
        )
        if not made_up:
            return line
        most = sorted(self.made_up.items(), key=lambda item: (-item[1], item[0]))
        named = [f"servo {who} {name} {count}x" for (who, name), count in most[:NAMED]]
        if len(most) > NAMED:
            named.append(f"{len(most) - NAMED} more")
        return f"{line} ({', '.join(named)})"

    def facts(self) -> dict[str, Any]:
        """Return it for the truth."""
        made_up = [
            {"servo_id": who, "register": name, "count": count}
            for (who, name), count in sorted(self.made_up.items())
        ]
        counts = {"recorded": self.recorded, "told": self.told, "moved": self.moved}
        return {**counts, "made_up": made_up}


class AnswerTally:
    """Counts what servos answer; ``like`` is what was seen of them."""

    def __init__(self, like: Mapping[int, ServoLikeness]) -> None:
        self._like = like
        self._written: dict[tuple[int, str], int] = {}
        self._counts: Counter[str] = Counter()
        self._made_up: Counter[tuple[int, str]] = Counter()

    def add(self, frames: Iterable[TrueFrame]) -> None:
        """Take what was said, in order; answers that never came are none."""
        for frame in frames:
            if frame.kind == REQUEST:
                self._hear(frame)
            elif frame.kind == RESPONSE and frame.wire:
                self._count(frame)

    def _hear(self, request: TrueFrame) -> None:
        for who, name, raw in request.values:
            to = (who,) if who in self._like else self._like  # an id of everybody
            self._written.update(((servo, name), raw) for servo in to)

    def _count(self, answer: TrueFrame) -> None:
        for who, name, raw in answer.values:
            seen = self._like[who].values if who in self._like else {}
            if seen.get(name) == raw:
                self._counts["recorded"] += 1
            elif self._written.get((who, name)) == raw:
                self._counts["told"] += 1
            elif name in seen:
                self._counts["moved"] += 1
            else:
                self._made_up[who, name] += 1

    @property
    def answered(self) -> Answered:
        """What was answered so far."""
        counts = self._counts
        return Answered(counts["recorded"], counts["told"], counts["moved"], dict(self._made_up))


def known_registers(like: Mapping[int, ServoLikeness]) -> str:
    """Say which registers are answered as recorded, and that the others are made up."""
    alike: dict[tuple[str, ...], list[int]] = {}
    for who, seen in like.items():
        alike.setdefault(tuple(sorted(seen.values)), []).append(who)
    told = [
        f"servo{'s' if len(who) > 1 else ''} {', '.join(map(str, who))}: {', '.join(names)}"
        for names, who in alike.items()
        if names
    ]
    if not told:
        return "no register was read or written in it: the values of all of them are made up"
    return f"registers as recorded: {'; '.join(told)}. The values of all others are made up"
