"""What a protocol must say. Everything above this floor speaks to protocols through these names.

Three parts, for three askers: ``Framing`` (columns, for the decoder), ``Presentation`` (words, for
rows, gaps and ``explain``) and ``Oracle`` (one frame at a time, for the reference decoder).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple
from typing import Protocol as TypingProtocol

import numpy as np

from sniffer.ground.codes import PROFILE
from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from sniffer.ground.checksums import Sum
    from sniffer.ground.clues import Clue
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I16, I64, U8, Frames, Gap, Mask, Spans
    from sniffer.ground.registers import Register, RegisterMap
    from sniffer.protocols.listing import ListedServo


class Turn(NamedTuple):
    """From ``row`` on, what a servo says is read by another table, or on other grounds."""

    row: int
    servo: int
    model: int
    origin: int


class State(Remembering):
    """What was seen on the wire and changes what later bytes mean, by servo id (0..255).

    ``model`` is the row of each servo's table in ``protocol.models``, ``origin`` on what grounds
    (a provenance). ``chosen`` and ``choice`` are what the user said, ``named`` for which ids
    themselves. ``turns`` are the rows of the present pass from which another model holds.
    ``modes`` holds the registers that select a scale; ``seen`` tells whether the wire showed them.
    ``notes`` is a protocol's own small memory (for example a bit layout the bus has proved).
    """

    LASTING = ("model", "origin", "chosen", "choice", "named", "modes", "seen", "notes")

    def __init__(
        self, protocol: BusProtocol, models: Mapping[int | None, str] | None = None
    ) -> None:
        names = [m.model for m in protocol.models]
        self.model = np.zeros(256, np.int64)
        self.origin = np.zeros(256, np.uint8)
        self.chosen = np.zeros(256, bool)
        self.choice = np.zeros(256, np.int64)
        self.named = np.zeros(256, bool)
        self.turns: Sequence[Turn] = ()
        # the general one first, whatever the order in which they were given
        for servo_id, name in sorted((models or {}).items(), key=lambda m: m[0] is not None):
            where = slice(None) if servo_id is None else servo_id
            self.choice[where] = names.index(name)
            self.chosen[where] = True
            self.named[where] = servo_id is not None
        self.model[self.chosen] = self.choice[self.chosen]
        self.origin[self.chosen] = PROFILE
        self.modes: dict[str, I64] = {}
        self.seen: dict[str, Mask] = {}
        for register in protocol.registers:
            if register.scale_by is not None and register.scale_by[0] not in self.modes:
                self.modes[register.scale_by[0]] = np.full(256, -1, np.int64)
                self.seen[register.scale_by[0]] = np.zeros(256, bool)
        self.notes: dict[str, int] = {}

    def models_of(self, rows: I64, servos: I16) -> I64:
        """Return by which table (row in ``protocol.models``) each servo is read at its row."""
        return self._at(self.model, [t.model for t in self.turns], rows, servos)

    def origins_of(self, rows: I64, servos: I16) -> U8:
        """Return on what grounds each servo's table is taken at its row, as a provenance."""
        out = self._at(self.origin, [t.origin for t in self.turns], rows, servos)
        return out.astype(np.uint8)

    def _at(self, known: I64 | U8, turned: Sequence[int], rows: I64, servos: I16) -> I64:
        """Return what holds for each servo at its row: what is known, until it turns."""
        if not turned and not known.any():
            return np.zeros(len(servos), np.int64)
        who = servos & 255
        out: I64 = known[who].astype(np.int64)
        since = np.array([t.row for t in self.turns])
        of, value = np.array([t.servo for t in self.turns]), np.array(turned)
        for servo in dict.fromkeys(t.servo for t in self.turns):
            mine, own = np.flatnonzero(who == servo), of == servo
            last = np.searchsorted(since[own], rows[mine], "right") - 1
            after = last >= 0
            out[mine[after]] = value[own][last[after]]
        return out


@dataclass(frozen=True, slots=True)
class Sightings:
    """Clues to the models of servos, in order: a row of ``clues``, and where in the block it is."""

    row: I64
    servo_id: I16
    clue: I64
    at: I64
    clues: Sequence[Clue]

    def __len__(self) -> int:
        return len(self.row)


Extremes = tuple[int, int]
"""The least and the greatest of some numbers."""


@dataclass(frozen=True, slots=True)
class Values:
    """Register values as they stand in the frames, sorted by ``row``; raw is not yet scaled.

    ``loose`` (None: nowhere) marks values that select a scale and stand in a span of bytes that
    the table does not name wholly. ``sightings`` (None: there are none) tell models apart.
    ``extremes`` are the least and the greatest number of each register, in whole or in part; None:
    nobody looked.
    """

    row: I64
    servo_id: I16
    register: I16
    raw: I64
    part: U8
    loose: Mask | None = None
    sightings: Sightings | None = None
    extremes: Mapping[int, Extremes] | None = None

    def __len__(self) -> int:
        return len(self.row)


@dataclass(slots=True)
class SlowFrame:
    """One frame as the reference decoder sees it: the columns of Frames, with the bytes."""

    start: int
    end: int
    kind: int
    servo_id: int
    op: int
    raw: bytes
    address: int = -1
    data_start: int = 0
    data: bytes = b""
    status: int = -1
    reply: int = 0
    token: int = -1
    alt_id: int = -1
    flags: int = 0
    values: list[tuple[int, int, int, int]] = field(default_factory=list)
    """(servo_id, register, raw, part) of each value, in order."""
    asked: SlowFrame | None = None
    """Of a response the last request before it, where what it says depends on that."""
    targets: tuple[ListedServo, ...] = ()
    """Of a request whom it lists, in the order in which they are to answer."""


class FieldSpan(NamedTuple):
    """One field of a frame for ``sniffer explain``: bytes, name, value in words, remark."""

    offset: int
    length: int
    name: str
    value: str
    note: str = ""


class Framing(TypingProtocol):
    """Bytes to columns: what decoding needs. Plain attributes are constants, their source there."""

    name: str
    bauds: tuple[int, ...]
    baud: int  # the default one
    longest: int  # bytes of the longest frame
    reach: int  # bytes behind a request after which it is closed
    tail_ns: int  # a longer silence is a barrier that no frame, reply or pair crosses
    everyone: tuple[int, ...]  # ids that address all servos
    blank: bytes  # byte values that mean nothing between frames
    ordered: bool  # answers name nobody: they come in the order of their requests
    models: tuple[RegisterMap, ...]  # the default first
    registers: tuple[Register, ...]  # of all models, numbered through

    def frame(self, block: Block) -> tuple[Spans, int]:
        """Return the frames that hold, and the offset before which every byte has its fate."""
        ...

    def describe(self, block: Block, spans: Spans) -> Frames:
        """Return the columns of the frames; times are left at zero."""
        ...

    def refused(self, status: I16) -> Mask:
        """Tell for which status bytes of responses the servo did not do what it was told."""
        ...

    def states_itself(self, frames: Frames) -> Mask:
        """Tell which responses say themselves what their values are, whatever was asked."""
        ...

    def values(self, block: Block, frames: Frames, rows: I64, state: State) -> Values:
        """Return the register values that the frames ``rows`` state."""
        ...

    def window_ns(self, frames: Frames) -> I64:
        """Return for each request the time within which the reply is expected."""
        ...


class Presentation(TypingProtocol):
    """Frames to words, one at a time: names, fields, and why bytes are no frame."""

    title: str

    def op_name(self, op: int) -> str:
        """Return the manual's own command name in snake_case (LSS: the word)."""
        ...

    def status_names(self, status: int) -> tuple[str, ...]:
        """Name the errors and alarms a status byte reports."""
        ...

    def fields(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        """Return what a frame states apart from register values: addresses, lengths, options."""
        ...

    def explain(self, run: bytes, start: int, *, awaited: bool = False) -> list[Gap]:
        """Say why no frame claims these bytes, in pieces that join to the whole of them.

        ``awaited``: they stand right behind a request that has an answer.
        """
        ...

    def dissect(self, raw: bytes, row: FrameView) -> list[FieldSpan]:
        """Return the frame's fields byte by byte, from the grammar, in order."""
        ...

    def checksum_of(self, raw: bytes) -> tuple[Sum, bytes, int] | None:
        """Return a frame's checksum, the bytes it covers, and what was sent; None: it has none."""
        ...


class Oracle(TypingProtocol):
    """The slow way, one frame at a time, by parsing the grammars: it defines what is right.

    The reference decoder asks it and nothing else does. It takes nothing from the block decoder,
    or the two would share the faults that comparing them is to find.
    """

    def slow_parse(self, data: bytes, at: int, limit: int) -> list[tuple[int, int, int]] | None:
        """Parse ``data[at:limit]`` with the grammar: (start, end, kind) of a frame that holds.

        A request whose bare reply follows (no header of its own) gives two. None: no frame here.
        """
        ...

    def slow_describe(self, raw: bytes, kind: int, before: SlowFrame | None) -> SlowFrame:
        """Describe one frame; ``before`` is the frame before it in the same stretch."""
        ...

    def slow_states_itself(self, frame: SlowFrame) -> bool:
        """Tell whether a response says itself what its values are, whatever was asked."""
        ...

    def slow_parts(self, frame: SlowFrame) -> list[tuple[int, int, bytes]]:
        """Return (servo_id, address, bytes) of each servo's registers; none without addresses."""
        ...

    def slow_clues(self, frame: SlowFrame) -> list[Clue]:
        """Return what an answer tells of its servo's model by a word; none with addresses."""
        ...

    def slow_values(self, frame: SlowFrame, state: State) -> list[tuple[int, int, int, int]]:
        """Return (servo_id, register, raw, part) of each value a frame states."""
        ...


class BusProtocol(Framing, Presentation, Oracle, TypingProtocol):
    """A protocol: all that the floors above ask of one."""


@dataclass(frozen=True, slots=True)
class FrameView:
    """One row of Frames as plain numbers; ``data_start`` counts from the frame's first byte.

    ``registers`` are those that the frame's values were read as, in order: the model told.
    """

    kind: int
    servo_id: int
    op: int
    address: int
    data_start: int
    data_length: int
    status: int
    flags: int
    registers: tuple[int, ...] = ()


def view(frames: Frames, i: int, registers: Iterable[int] = ()) -> FrameView:
    """Return row ``i`` as plain numbers, with the registers of its values."""
    return FrameView(
        int(frames.kind[i]),
        int(frames.servo_id[i]),
        int(frames.op[i]),
        int(frames.address[i]),
        int(frames.data_start[i] - frames.start[i]),
        int(frames.data_length[i]),
        int(frames.status[i]),
        int(frames.flags[i]),
        tuple(registers),
    )


LETS_GO, RESTARTS, TURNS_ELSEWHERE = range(3)
"""Commands after which a joint does not seek its last goal any more: its motor is off; it begins
anew; it holds, turns or moves in another way."""

_NONE: Final[Mapping[int, int]] = MappingProxyType({})


def ends_goal(protocol: Framing) -> Mapping[int, int]:
    """Return the commands that end a goal without stating another, and how.

    A protocol may have them as ``ends_goal``, by ``Frames.op``. It is no part of the interface: one
    that says nothing has none, and a joint that was let go on purpose looks as if it hung limp.
    """
    told: Mapping[int, int] = getattr(protocol, "ends_goal", _NONE)
    return told


def reply_delay_ns(protocol: Framing, register: Register, raw: int) -> int | None:
    """Return what a servo's delay register makes it wait, in ns; None: this register is none.

    A protocol may say it as ``reply_delay_ns``, by the register's name and its value; else it is
    one whose name has ``delay`` and whose unit is that of a time.
    """
    told = getattr(protocol, "reply_delay_ns", None)
    if told is not None:
        known: int | None = told(register.name, raw)
        return known
    if "delay" not in register.name or register.unit != "us":
        return None
    return int(raw * register.scale * 1000)


def answer_begins(protocol: Framing, request: bytes) -> bytes:
    """Return with which bytes a sound answer to a request begins; empty: nobody knows.

    A protocol may say it as ``answer_begins``, of a servo that has nothing to complain of. It is
    what torn answers are compared with where none of that servo's was ever sound.
    """
    told: Callable[[bytes], bytes] | None = getattr(protocol, "answer_begins", None)
    return b"" if told is None else told(request)


def telling_bytes(protocol: Framing, frames: Frames, data: U8) -> I64:
    """Return how many of its first bytes tell what is presented of each frame.

    That is ``fields``, and whether ``checksum_of`` gives one: two frames of the same columns whose
    first bytes are alike so far, and whose values are read as the same registers, have both alike.
    ``data`` is what the frames stand in. A protocol may say it as ``telling_bytes``; of one that
    does not, all bytes of a frame tell. Who writes many frames asks, to make the same but once.
    """
    told = getattr(protocol, "telling_bytes", None)
    if told is None:
        return frames.length
    known: I64 = np.minimum(told(frames, data), frames.length)
    return known


def no_clues(frame: SlowFrame) -> list[Clue]:
    """Return nothing: registers have addresses here, and ``slow_parts`` tells them."""
    del frame
    return []


def joined(models: Sequence[RegisterMap]) -> tuple[Register, ...]:
    """Return the registers of all models in one row, as ``Entry.register`` counts them."""
    return tuple(r for m in models for r in m.registers)
