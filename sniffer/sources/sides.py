"""Logs of one host that tell its two sides apart: which of them is the controller's.

A program between a controller and a port (socat), or the controller itself (pySerial), writes down
both directions in the order of cause and effect. What it calls its sides is its own affair: socat's
left side may be the port. So the frames of the first bytes decide, and where they do not agree, no
direction is told: a wrong one would accuse every frame of standing on the wrong wire.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.detect import UndecidedError, detect
from sniffer.decoding.names import protocols_named
from sniffer.ground.codes import REQUEST
from sniffer.ground.model import (
    ECHO,
    NS,
    Chunk,
    DamagedInputError,
    Direction,
    Mark,
    MarkKind,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

WINDOW: Final = 4096
"""Bytes after which it must be decided: some hundred exchanges."""

FIRST_LOOK: Final = 256
"""Bytes after which it is looked for the first time."""

ODD: Final = 0.1
"""Share of frames that may stand on the other side: what is damaged is not always told right."""

OPEN_NS: Final = NS
"""How long what was handed over last may take: nothing behind it says when it was over."""

TX, RX, UNKNOWN = Direction.TX, Direction.RX, Direction.UNKNOWN

_NAMELESS: Final = ("one side", "the other")

_AS_TOLD: Final[Mapping[Direction, Direction]] = {TX: TX, RX: RX, UNKNOWN: UNKNOWN}
_SWAPPED: Final[Mapping[Direction, Direction]] = {TX: RX, RX: TX, UNKNOWN: UNKNOWN}
_UNTOLD: Final[Mapping[Direction, Direction]] = dict.fromkeys(Direction, UNKNOWN)


class _Sides:
    """Holds back what has come until the frames in it tell which side is which."""

    def __init__(self, notes: list[str], names: Sequence[str]) -> None:
        self._notes = notes
        self._names = names
        self._held: list[Chunk] = []
        self._size = 0
        self._look_at = FIRST_LOOK
        self.told: Mapping[Direction, Direction] | None = None
        """What each side is, once that is decided."""

    def feed(self, chunk: Chunk) -> list[Chunk]:
        """Take a chunk; return what can be handed on."""
        self._held.append(chunk)
        self._size += len(chunk.data)
        if self._size < self._look_at:
            return []
        self._look_at *= 2
        return self._decided(final=self._size >= WINDOW)

    def close(self) -> list[Chunk]:
        """Return what is held back."""
        return self._decided(final=True) if self._held else []

    def _decided(self, *, final: bool) -> list[Chunk]:
        self.told = _sides(self._held, final=final)
        if self.told is None:
            return []
        first, second = (*self._names, *_NAMELESS)[:2]
        if self.told is _SWAPPED:
            told = f"what it marks {second} comes from the controller: that is TX here"
            self._notes.append(told)
        elif self.told is _UNTOLD and any(c.direction is not UNKNOWN for c in self._held):
            told = f"its frames do not tell whether {first} or {second} is the controller's side"
            self._notes.append(told)
        held, self._held = self._held, []
        return [_turned(chunk, self.told) for chunk in held]


def oriented(chunks: Iterable[Chunk], notes: list[str], names: Sequence[str]) -> Iterator[Chunk]:
    """Yield chunks with TX for what comes from the controller, whatever the log calls it.

    ``names`` are what the log calls its sides, that of TX first; they may become known while it is
    read. ``notes`` gets a sentence where they are swapped, or where it cannot be told which is
    which. What was read before damage or an interruption comes before that does.
    """
    sides = _Sides(notes, names)
    going = iter(chunks)
    try:
        while sides.told is None:
            chunk = next(going, None)
            if chunk is None:
                break
            yield from sides.feed(chunk)
        if sides.told is _AS_TOLD:
            yield from going
        elif sides.told is not None:
            wires = sides.told
            for chunk in going:
                yield _turned(chunk, wires)
    except (DamagedInputError, KeyboardInterrupt):
        yield from sides.close()
        raise
    yield from sides.close()


def _turned(chunk: Chunk, sides: Mapping[Direction, Direction]) -> Chunk:
    wire = sides[chunk.direction]
    if wire is chunk.direction:
        return chunk
    return Chunk(chunk.data, chunk.t_ns, chunk.clock, chunk.bus, wire, chunk.marks)


def _sides(chunks: Sequence[Chunk], *, final: bool) -> Mapping[Direction, Direction] | None:
    """Return what each side is, None where more bytes may tell."""
    try:
        protocols = protocols_named(detect(chunks).protocol)
    except UndecidedError:
        return _UNTOLD if final else None
    right = wrong = 0
    for protocol in protocols:
        decoder = Decoder(protocol)
        for batch in (decoder.feed(*chunks), decoder.close()):
            f = batch.frames
            asks, sends = f.kind == REQUEST, f.direction == TX
            counts = (f.direction != UNKNOWN) & (f.flags & ECHO == 0)
            right += int(((asks == sends) & counts).sum())
            wrong += int(((asks != sends) & counts).sum())
    if right > wrong and wrong <= ODD * right:
        return _AS_TOLD
    if wrong > right and right <= ODD * wrong:
        return _SWAPPED
    return _UNTOLD if final else None


def handed_over(chunks: Iterable[Chunk], wire: Direction) -> Iterator[Chunk]:
    """Yield chunks, those of a wire marked as stamped before they were sent, not behind.

    The log is in order of cause and effect: what stands behind them was heard later.
    """
    held: Chunk | None = None
    try:
        for chunk in chunks:
            if held is not None:
                yield _sent(held, wire, chunk.t_ns)
                held = None
            if chunk.direction is wire:
                held = chunk
            else:
                yield chunk
    except (DamagedInputError, KeyboardInterrupt):
        if held is not None:
            yield _sent(held, wire, None)
        raise
    if held is not None:
        yield _sent(held, wire, None)


def _sent(chunk: Chunk, wire: Direction, until_ns: int | None) -> Chunk:
    if chunk.t_ns is None:
        return chunk
    most = OPEN_NS if until_ns is None else min(max(until_ns - chunk.t_ns, 0), OPEN_NS)
    mark = Mark(MarkKind.SENT, 0, len(chunk.data), most)
    return Chunk(chunk.data, chunk.t_ns, chunk.clock, chunk.bus, wire, (*chunk.marks, mark))
