"""A case: bytes as a bus may show them, and which frames and pairs they truly are."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.codes import (
    DAMAGED,
    NO_RESPONSE,
    NOT_EXPECTED,
    OK,
    REQUEST,
    RESPONSE,
    UNSOLICITED,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.testing.talk import Exchange

NOTHING: Final = frozenset({NO_RESPONSE, NOT_EXPECTED})
"""No answer: whether one was expected depends on what the servo was told before."""

DUE: Final = frozenset({NO_RESPONSE})
"""No answer, where there is always one."""

TORN: Final = frozenset({DAMAGED, NOT_EXPECTED})
"""Broken bytes where the answer should be: no silent servo."""


class Stated(NamedTuple):
    """A frame that is truly there; an empty name or no errors (None): not labelled."""

    start: int
    length: int
    kind: int
    name: str = ""


class Pair(NamedTuple):
    """A request and its answer by where they start, -1 for none, and what may be said of them.

    ``servo_id``: who owed the answer, where the request lists several; -1 for anybody.
    """

    request: int
    response: int
    outcomes: frozenset[int]
    servo_id: int = -1


@dataclass(slots=True)
class TalkCase:
    """Bytes, silences between them, and the truth. ``exchanges`` are those it is made of."""

    arrangement: str
    exchanges: tuple[Exchange, ...]
    data: bytes = b""
    silences: list[int] = field(default_factory=list)
    frames: list[Stated] = field(default_factory=list)
    pairs: list[Pair] = field(default_factory=list)
    valued: bool = False
    """Whether the values of the exchanges are what this case says, no more and no less."""

    @property
    def key(self) -> str:
        """What ambiguities are counted by."""
        return f"{self.arrangement}: {self.exchanges[0].name}"

    def silence(self) -> None:
        """Let the line be silent for longer than anything waits."""
        self.silences.append(len(self.data))

    def noise(self, raw: bytes) -> None:
        """Say bytes that no frame claims."""
        self.data += raw

    def frame(self, raw: bytes, kind: int, name: str = "") -> int:
        """Say a frame; return where it starts."""
        at = len(self.data)
        self.data += raw
        self.frames.append(Stated(at, len(raw), kind, name))
        return at

    def ask(self, e: Exchange) -> int:
        """Say a request; return where it starts."""
        return self.frame(e.request, REQUEST, e.name)

    def pair(self, request: int, response: int, *outcomes: int) -> None:
        """Note what request and response are to each other."""
        self.pairs.append(Pair(request, response, frozenset(outcomes)))

    def unanswered(self, e: Exchange, at: int) -> None:
        """Note that a request stays without an answer."""
        silent = DUE if e.due else NOTHING
        self.missing(at, e.owing, frozenset({NOT_EXPECTED}) if e.answers == () else silent)

    def missing(self, at: int, servos: Sequence[int], outcomes: frozenset[int]) -> None:
        """Note that these servos did not answer the request at ``at``."""
        self.pairs += [Pair(at, -1, outcomes, servo_id) for servo_id in servos]

    def torn(self, e: Exchange, at: int, n: int = 0) -> None:
        """Note that there are broken bytes where the n-th answer should be, and none behind it.

        What should be behind it may have been in these bytes.
        """
        self.missing(at, e.owing[n : n + 1], TORN)
        self.missing(at, e.owing[n + 1 :], TORN | NOTHING)

    def answer(self, e: Exchange, at: int, first: int = 0) -> None:
        """Say the answers to the request at ``at``, from the first that comes."""
        if not e.replies:
            self.unanswered(e, at)
            return
        for raw in e.replies[first:]:
            start = self.frame(raw, RESPONSE, e.name)
            for servo_id in e.owing if e.is_joint else (-1,):
                self.pairs.append(Pair(at, start, frozenset({OK}), servo_id))
        if not e.is_joint:
            self.missing(at, e.owing[len(e.replies) :], NOTHING)

    def exchange(self, e: Exchange) -> int:
        """Say a request and its answers; return where it starts."""
        at = self.ask(e)
        self.answer(e, at)
        return at

    def stray(self, raw: bytes, *, stands_alone: bool) -> None:
        """Say an answer that nobody asked for, as far as the line tells."""
        if stands_alone:
            self.pair(-1, self.frame(raw, RESPONSE), UNSOLICITED)
        else:
            self.noise(raw)

    def __str__(self) -> str:
        names = dict.fromkeys(e.name for e in self.exchanges)
        return f"{self.arrangement} ({', '.join(names)}): {shown(self.data, self.silences)}"


def shown(data: bytes, silences: list[int] | tuple[int, ...] = ()) -> str:
    """Return bytes in hexadecimal; a silence, or a cut, is a bar."""
    edges = [0, *silences, len(data)]
    parts = [data[a:b].hex(" ").upper() for a, b in itertools.pairwise(edges)]
    return " | ".join(p for p in parts if p)
