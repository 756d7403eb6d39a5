"""What the protocol says of each exchange by itself: whom it asks, who answers, how they fit.

The arrangements need it to choose what goes together; it is taken once, from the protocol as it is,
so that a planted fault is judged by the same cases.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sniffer.ground.codes import MANY, NEVER, REQUEST, RESPONSE
from sniffer.ground.framing import Block
from sniffer.ground.model import NO_ALT, Frames
from sniffer.protocols.listing import targets_of
from sniffer.testing.case import TalkCase
from sniffer.testing.truth import decoder_of, laid_out, wrong_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol
    from sniffer.testing.talk import Exchange


@dataclass(frozen=True, slots=True)
class Fact:
    """One frame as the columns have it."""

    kind: int
    servo_id: int
    op: int
    address: int
    data_start: int
    data_length: int
    status: int
    reply: int
    token: int
    alt_id: int
    flags: int
    parts: tuple[tuple[str, int], ...]
    """Registers that it states, by name, and how much of each."""
    targets: int
    """Servos of which it states any."""


@dataclass(frozen=True, slots=True)
class Known:
    """An exchange that is decoded as it is labelled, and what its frames are.

    ``later``: what its servo says unasked once it was told to;
    ``stands_alone``: its answers are frames of their own, whatever stands before them;
    ``reads_as_command``: one of them would be a request, were it not for the one before it;
    ``holds_another``: something that begins like a frame stands inside of one.
    """

    exchange: Exchange
    request: Fact
    answers: tuple[Fact, ...]
    later: tuple[Fact, ...]
    stands_alone: bool
    reads_as_command: bool
    holds_another: bool

    @property
    def is_plain(self) -> bool:
        """Whether nothing in it could be taken for something else: it goes with others."""
        return not self.reads_as_command and not self.holds_another

    @property
    def labelled(self) -> tuple[Fact, ...]:
        """The frames of which the talk says what they state."""
        told = () if self.exchange.values is None else (self.request, *self.answers)
        return told if self.exchange.later_values is None else (*told, *self.later)

    @property
    def servo_id(self) -> int:
        """Whom the request is for."""
        return self.request.servo_id

    @property
    def asks_one(self) -> bool:
        """Whether exactly the servo that is named answers, with a frame of its own."""
        q = self.request
        one = len(self.answers) == 1 and self.stands_alone
        return one and q.alt_id == NO_ALT and q.reply not in (NEVER, MANY)


def header_of(frames: Iterable[bytes]) -> bytes:
    """Return what all these frames begin with."""
    every = sorted(frames)
    if not every:
        return b""
    first, last = every[0], every[-1]  # what these share, all between them share too
    same = itertools.takewhile(lambda pair: pair[0] == pair[1], zip(first, last, strict=False))
    return first[: sum(1 for _ in same)]


def plain(e: Exchange) -> TalkCase:
    """Return the exchange as it is, request and answers."""
    case = TalkCase("answered", (e,), valued=True)
    case.exchange(e)
    return case


def alone(e: Exchange) -> TalkCase:
    """Return the answers without their request, each after a silence, and what is said later."""
    case = TalkCase("answer alone", (e,))
    for raw in (*e.replies, *e.later):
        case.silence()
        case.frame(raw, RESPONSE)
    return case


def listed(protocol: BusProtocol, exchanges: Sequence[Exchange]) -> list[Exchange]:
    """Return the exchanges with the servos that their requests list, as the protocol finds them."""
    return [
        e if e.listed is not None else replace(e, listed=_listed(protocol, e)) for e in exchanges
    ]


def _listed(protocol: BusProtocol, e: Exchange) -> tuple[int, ...]:
    block = Block(np.frombuffer(e.request, np.uint8), np.empty(0, np.int64), final=True)
    try:
        frames = protocol.describe(block, protocol.frame(block)[0])
        found = targets_of(protocol, block, frames)
    except Exception:  # what raises is told as a wrong case
        return ()
    return () if found is None else tuple(found.servo_id.tolist())


def facts_of(protocol: BusProtocol, cases: Sequence[TalkCase], model: str) -> list[list[Fact]]:
    """Return the frames that the protocol finds in each case, none where it raises."""
    try:
        return _facts_of(protocol, cases, model)
    except Exception:  # what raises is told as a wrong case; here it must not hide the others
        if len(cases) == 1:
            return [[]]
        return [facts for case in cases for facts in facts_of(protocol, [case], model)]


def _facts_of(protocol: BusProtocol, cases: Sequence[TalkCase], model: str) -> list[list[Fact]]:
    decoder = decoder_of(protocol, model)
    out: list[list[Fact]] = [[] for _ in cases]
    begins, at = [], 0
    for case in cases:
        begins.append(at)
        at += len(case.data)
    row = 0
    for batch in (decoder.feed(*laid_out(protocol, cases)), decoder.close()):
        told, servos = _parts(protocol, batch)
        for i, fact in enumerate(_facts(batch.frames, told, servos)):
            start = int(batch.frames.start[i]) + batch.base
            while row + 1 < len(begins) and begins[row + 1] <= start:
                row += 1
            out[row].append(fact)
    return out


Parts = dict[int, list[tuple[str, int]]]


def _parts(protocol: BusProtocol, batch: Batch) -> tuple[Parts, dict[int, set[int]]]:
    out: Parts = defaultdict(list)
    servos: dict[int, set[int]] = defaultdict(set)
    v = batch.values
    columns = (v.row, v.register, v.part, v.servo_id)
    for row, register, part, servo in zip(*(c.tolist() for c in columns), strict=True):
        out[row].append((protocol.registers[register].name, part))
        servos[row].add(servo)
    return out, servos


def _facts(f: Frames, told: Parts, servos: dict[int, set[int]]) -> list[Fact]:
    columns = (
        *(f.kind, f.servo_id, f.op, f.address, f.data_start - f.start, f.data_length, f.status),
        *(f.reply, f.token, f.alt_id, f.flags),
    )
    rows: list[tuple[Any, ...]] = [*zip(*(c.tolist() for c in columns), strict=True)]
    return [
        Fact(*[*row, tuple(told.get(i, ())), len(servos.get(i, ()))]) for i, row in enumerate(rows)
    ]


def known_of(protocol: BusProtocol, exchanges: Sequence[Exchange], model: str) -> list[Known]:
    """Return the exchanges that are decoded as they are labelled; the others are told elsewhere."""
    cases = [plain(e) for e in exchanges]
    frames = facts_of(protocol, cases, model)
    wrong = wrong_of(protocol, cases, model)
    lone = [alone(e) for e in exchanges]
    lonely = facts_of(protocol, lone, model)
    head = header_of(e.request for e in exchanges)
    out = []
    for k, e in enumerate(exchanges):
        fits = len(frames[k]) == 1 + len(e.replies) and frames[k][0].kind == REQUEST
        if k in wrong or not fits:
            continue
        # An answer that looks like a command by itself is told by its request, but stands alone.
        n = max(len(lonely[k]) - len(e.later), 0)
        stands = n == len(e.replies) > 0
        nested = bool(head) and any(head in raw[1:] for raw in (e.request, *e.replies))
        command = any(f.kind == REQUEST for f in lonely[k][:n])
        asked, *answers = frames[k]
        out.append(Known(e, asked, tuple(answers), tuple(lonely[k][n:]), stands, command, nested))
    return out
