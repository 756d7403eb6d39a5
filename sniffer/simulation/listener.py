"""Who hears a controller: frames are found in its bytes with the protocol's own grammar.

Pure: whoever owns the port tells the time, in nanoseconds since it was opened, and says what is
due.
"""

from __future__ import annotations

import abc
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sniffer.ground.framing import Block
from sniffer.simulation.hearing import NO_BARRIERS

if TYPE_CHECKING:
    from sniffer.protocols.base import BusProtocol
    from sniffer.simulation.talk import TrueFrame


class Uttered(NamedTuple):
    """A frame on the line, and whether it is one of ours: the others have been heard."""

    frame: TrueFrame
    ours: bool


class LineListener(abc.ABC):
    """Takes bytes and calls ``frame`` and ``noise`` for what they are, in order.

    ``begins``: first bytes of a frame, in protocols whose servos complain of broken ones.
    """

    def __init__(self, protocol: BusProtocol, begins: bytes = b"") -> None:
        self._protocol = protocol
        self._begins = begins
        self._held = bytearray()
        self._heard_ns = 0

    @abc.abstractmethod
    def frame(self, raw: bytes, kind: int, now_ns: int) -> list[Uttered]:
        """Take a frame; return it with what is said because of it."""

    @abc.abstractmethod
    def noise(self, data: bytes, now_ns: int) -> list[Uttered]:
        """Take bytes that are no frame, perhaps none; return them as what was on the line."""

    def pass_time(self, now_ns: int) -> None:
        """Let time pass."""
        del now_ns

    def broken(self, data: bytes, behind: int, at: int, now_ns: int) -> tuple[int, list[Uttered]]:
        """Return where a broken frame at ``at`` ends, and what is said because of it.

        What lies between ``behind`` and ``at`` was not told yet, and is then. An end at ``at``:
        nothing is there that is worth a complaint.
        """
        del data, behind, now_ns
        return at, []

    def hear(self, data: bytes, now_ns: int) -> list[Uttered]:
        """Take bytes that arrived just now; return all that is said because of them, in order.

        Times of what is said lie ahead; requests that are not complete yet are waited for.
        """
        out = self.idle(now_ns)
        self._held += data
        self._heard_ns = now_ns
        return out + self._take(now_ns, final=False)

    def idle(self, now_ns: int) -> list[Uttered]:
        """Let time pass; a beginning that is not continued for long is nobody's."""
        self.pass_time(now_ns)
        if self._held and now_ns - self._heard_ns > self._protocol.tail_ns:
            return self._take(now_ns, final=True)
        return []

    def _take(self, now_ns: int, *, final: bool) -> list[Uttered]:
        out: list[Uttered] = []
        data = bytes(self._held)
        at = behind = 0
        found: tuple[int, int, int] | None = (-1, -1, 0)  # the next frame from ``at`` on
        while at < len(data):
            if found is not None and found[0] < at:
                found = self._next(data, at)
            here = found is not None and found[0] == at
            if not here:
                end, complaint = self.broken(data, behind, at, now_ns)
                if end > at:
                    out += complaint
                    at = behind = end
                    continue
            if found is None or not here:
                skipped = 1 if final else self._hopeless(data, at)
                if self._begins and (begin := data.find(self._begins, at + 1)) >= 0:
                    skipped = min(skipped, begin - at)  # there may be what a servo complains of
                if not skipped:
                    break
                at += skipped
                continue
            # what may be its reply as well is judged on its own: servos answer here, not there
            start, end, kind = found
            out += self.noise(data[behind:start], now_ns)
            out += self.frame(data[start:end], kind, now_ns)
            at = behind = end
        out += self.noise(data[behind:at], now_ns)
        del self._held[:at]
        return out

    def _next(self, data: bytes, at: int) -> tuple[int, int, int] | None:
        """Return start, end and kind of the first frame from ``at`` on, as if no more came."""
        for stop in (at + 2 * self._protocol.longest, len(data)):
            block = Block(np.frombuffer(data[at:stop], np.uint8), NO_BARRIERS, stop >= len(data))
            spans, _ = self._protocol.frame(block)
            if len(spans):
                return at + int(spans.start[0]), at + int(spans.end[0]), int(spans.kind[0])
            if stop >= len(data):
                break
        return None

    def _hopeless(self, data: bytes, at: int) -> int:
        """Return how many bytes from ``at`` on can be no frame's, whatever follows."""
        block = Block(np.frombuffer(data, np.uint8)[at:], NO_BARRIERS, False)
        spans, decided = self._protocol.frame(block)
        return min(int(spans.start[0]), decided) if len(spans) else decided
