"""Faults planted into a protocol: a talk that lets one live says nothing about what it broke.

Each is put between the protocol and the decoder, in columns; the slow forms are left alone, since
labels are the truth here. A fault is bound to one command, register or rule, so that each must be
reached by itself.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from sniffer.ground.codes import MANY, MUST, NEVER, ON_ITS_OWN, REQUEST, RESPONSE
from sniffer.ground.framing import Block
from sniffer.ground.model import ANY_ID, I64, NO_ALT, RELEASES, RESETS, STAGED, Frames, Mask, Spans

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Sequence

    from sniffer.ground.registers import RegisterMap
    from sniffer.protocols.base import BusProtocol, State, Values
    from sniffer.testing.case import TalkCase
    from sniffer.testing.facts import Fact, Known


@dataclass(frozen=True, slots=True)
class PlantedFault:
    """What is broken; ``command`` and ``register`` tell which cases could show it, all if none.

    ``without``: a method that the protocol does not have.
    """

    name: str
    command: str = ""
    register: str = ""
    describe: Callable[[Block, Frames], Frames] | None = None
    frame: Callable[[Block, Spans, int], tuple[Spans, int]] | None = None
    values: Callable[[Frames, Values], Values] | None = None
    blocks: Callable[[Block], Block] | None = None
    without: str = ""


class Faulty:
    """A protocol with a fault in it."""

    def __init__(self, protocol: BusProtocol, fault: PlantedFault) -> None:
        self._protocol, self._fault = protocol, fault

    def __getattr__(self, name: str) -> Any:
        """Return what the fault leaves alone.

        Raises:
            AttributeError: it takes that away.
        """
        if name == self._fault.without:
            raise AttributeError(name)
        return getattr(self._protocol, name)

    def frame(self, block: Block) -> tuple[Spans, int]:
        """Frame as the protocol does, but for the fault."""
        if self._fault.blocks is not None:
            block = self._fault.blocks(block)
        spans, decided = self._protocol.frame(block)
        return self._fault.frame(block, spans, decided) if self._fault.frame else (spans, decided)

    def describe(self, block: Block, spans: Spans) -> Frames:
        """Describe as the protocol does, but for the fault."""
        frames = self._protocol.describe(block, spans)
        return self._fault.describe(block, frames) if self._fault.describe else frames

    def values(self, block: Block, frames: Frames, rows: I64, state: State) -> Values:
        """Read values as the protocol does, but for the fault."""
        values = self._protocol.values(block, frames, rows, state)
        return self._fault.values(frames, values) if self._fault.values else values


def planted(protocol: BusProtocol, fault: PlantedFault) -> BusProtocol:
    """Return the protocol with the fault in it."""
    return cast("BusProtocol", Faulty(protocol, fault))


def faults_of(
    protocol: BusProtocol,
    table: RegisterMap,
    known: Sequence[Known],
    scenes: Sequence[Sequence[Fact]],
    header: bytes,
) -> Iterator[PlantedFault]:
    """Yield each fault that would be one in this protocol."""
    every = [k.request for k in known] + [f for s in scenes for f in s if f.kind == REQUEST]
    answered = {k.request.op for k in known if k.answers}
    silent = {k.request.op for k in known if k.exchange.answers == ()}
    for op in dict.fromkeys(f.op for f in every):
        mine = [f for f in every if f.op == op]
        yield from _of_command(protocol, op, mine, op in answered, op in silent)
    valued = {name for k in known for f in k.labelled for name, _ in f.parts}
    for number, register in enumerate(table.registers, table.first):
        if register.name in valued:
            yield _off_by_one(number, register.name)
    yield from _of_framing(protocol, known, header)
    for name in dict.fromkeys(k.exchange.name for k in known if k.exchange.listed):
        yield PlantedFault(f"{name}: nobody who is listed is missed", name, without="targets")
    if any(k.exchange.later for k in known):
        yield PlantedFault("an answer done later fits any request", describe=_fits_any)
    if any(protocol.refused(np.array([f.status], np.int16))[0] for k in known for f in k.answers):
        yield PlantedFault("no answer refuses", describe=_without_status)


def _of_command(
    protocol: BusProtocol, op: int, mine: Sequence[Fact], answered: bool, silent: bool
) -> Iterator[PlantedFault]:
    name = protocol.op_name(op)

    def of(what: str, describe: Callable[[Block, Frames], Frames]) -> PlantedFault:
        return PlantedFault(f"{name}: {what}", name, describe=describe)

    def asked(f: Frames) -> Mask:
        return np.asarray((f.kind == REQUEST) & (f.op == op))

    def put(column: str, value: Any, where: Callable[[Frames], Mask] = asked) -> Any:
        def change(block: Block, f: Frames) -> Frames:
            del block
            old = getattr(f, column)
            new = np.where(where(f), value(f) if callable(value) else value, old)
            return replace(f, **{column: new.astype(old.dtype)})

        return change

    def behind(f: Frames) -> Mask:
        q = asked(f)
        return np.asarray((f.kind == RESPONSE) & np.append(False, q[:-1]))

    yield of("read as an answer", lambda b, f: _as_answer(f, asked(f)))
    if answered:
        yield of("never answered", put("reply", NEVER))
        yield of("said again, read as its answer", lambda b, f: _as_answer(f, _again(b, f, op)))
        yield of("its answer read as a request", put("kind", REQUEST, behind))
    if silent:
        yield of("always answered", put("reply", MUST))
    for flag, what in ((STAGED, "staged"), (RELEASES, "released"), (RESETS, "reset")):
        if any(f.flags & flag for f in mine):
            yield of(f"nothing is {what}", put("flags", lambda f, flag=flag: f.flags & ~flag))
    if any(f.address >= 0 and f.parts for f in mine):
        wrong = put("address", lambda f: f.address + 1, lambda f: asked(f) & (f.address >= 0))
        yield of("one address on", wrong)
    if any(f.targets > 1 for f in mine):
        yield PlantedFault(
            f"{name}: targets one step less", name, values=lambda f, v: _shifted(f, v, op)
        )
    if protocol.ordered or not answered:
        return  # answers come in their order there: neither token nor id is asked for
    yield of("token + 1", put("token", lambda f: f.token + 1))
    if any(f.alt_id != NO_ALT and f.reply != NEVER for f in mine):
        yield of("no other id may answer", put("alt_id", NO_ALT))
    if any(f.alt_id == NO_ALT and f.reply not in (NEVER, MANY) for f in mine):
        alt = put("alt_id", ANY_ID, lambda f: asked(f) & (f.alt_id == NO_ALT))
        yield of("any id may answer", alt)
        yield of("any answer fits", put("token", -1, behind))


def _as_answer(f: Frames, where: Mask) -> Frames:
    return replace(
        f,
        kind=np.where(where, RESPONSE, f.kind).astype(np.uint8),
        op=np.where(where, -1, f.op),
        reply=np.where(where, NEVER, f.reply).astype(np.uint8),
        token=np.where(where, -1, f.token),
    )


def _again(block: Block, f: Frames, op: int) -> Mask:
    """Tell which requests of a command say the same bytes as the request right before them."""
    out = np.zeros(len(f), bool)
    for i in np.flatnonzero((f.kind == REQUEST) & (f.op == op)).tolist():
        if i and f.kind[i - 1] == REQUEST and not out[i - 1]:
            a, b = (block.data[f.start[k] : f.end[k]].tobytes() for k in (i - 1, i))
            out[i] = a == b
    return out


def _fits_any(block: Block, f: Frames) -> Frames:
    del block
    return replace(f, token=np.where(f.token == ON_ITS_OWN, -1, f.token))


def _without_status(block: Block, f: Frames) -> Frames:
    del block
    return replace(f, status=np.full(len(f), -1, np.int16))


def _off_by_one(number: int, name: str) -> PlantedFault:
    def change(frames: Frames, v: Values) -> Values:
        del frames
        return replace(v, raw=v.raw + (v.register == number))

    return PlantedFault(f"{name}: raw + 1", register=name, values=change)


def _shifted(f: Frames, v: Values, op: int) -> Values:
    """Read every servo but the first of a frame from one byte too early."""
    first = np.append(True, v.row[1:] != v.row[:-1])
    begin = np.maximum.accumulate(np.where(first, np.arange(len(v)), 0))
    later = (v.servo_id != v.servo_id[begin]) & (f.op[v.row] == op) & (f.kind[v.row] == REQUEST)
    return replace(v, servo_id=np.where(later, v.servo_id[begin], v.servo_id).astype(np.int16))


def _of_framing(
    protocol: BusProtocol, known: Sequence[Known], header: bytes
) -> Iterator[PlantedFault]:
    def without(lost: Callable[[Block, Spans], Mask]) -> Any:
        def change(block: Block, spans: Spans, decided: int) -> tuple[Spans, int]:
            return spans.take(~lost(block, spans)), decided

        return change

    def longest(block: Block, spans: Spans) -> Mask:
        del block
        return np.asarray(spans.end - spans.start >= protocol.longest)

    def holds_header(block: Block, spans: Spans) -> Mask:
        data, n = block.data.tobytes(), len(header)
        rows = zip(spans.start.tolist(), spans.end.tolist(), strict=True)
        return np.array([data.find(header, a + n, b) >= 0 for a, b in rows], bool)

    frames = [raw for k in known for raw in (k.exchange.request, *k.exchange.replies)]
    if any(len(raw) >= protocol.longest for raw in frames):
        yield PlantedFault("the longest frames are lost", frame=without(longest))
    if header and any(header in raw[len(header) :] for raw in frames):
        yield PlantedFault("a header inside a frame begins another", frame=without(holds_header))
    yield PlantedFault("silences are ignored", blocks=_without_silences)


def _without_silences(block: Block) -> Block:
    return Block(block.data, np.empty(0, np.int64), block.final)


class Suspects:
    """Which cases could show a fault; of each arrangement some first, rather than all of one."""

    def __init__(self, cases: Sequence[TalkCase], without: Collection[int]) -> None:
        self.every: list[int] = []
        self.by_command: dict[str, list[int]] = defaultdict(list)
        self.by_register: dict[str, list[int]] = defaultdict(list)
        turn: dict[tuple[str, str], int] = defaultdict(int)
        order = []
        for k, case in enumerate(cases):
            if k not in without:
                key = case.arrangement, case.exchanges[0].name
                turn[key] += 1
                order.append((turn[key], k))
        for _, k in sorted(order):
            self.every.append(k)
            for name in {e.name for e in cases[k].exchanges}:
                self.by_command[name].append(k)
            labels = (label for e in cases[k].exchanges for label in e.values or ())
            if cases[k].valued:
                for name in {x if isinstance(x, str) else x[1] for x in labels}:
                    self.by_register[name].append(k)

    def of(self, fault: PlantedFault) -> list[int]:
        """Return the numbers of the cases."""
        if fault.command:
            return self.by_command[fault.command]
        return self.by_register[fault.register] if fault.register else self.every
