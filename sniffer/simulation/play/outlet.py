"""Frames onto a port: whole ones or none, and an account of what became of every byte."""

from __future__ import annotations

import collections
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from sniffer.simulation.play.ports import PlayPort
    from sniffer.simulation.talk import TrueFrame

HOLD_MOST: Final = 1 << 20
"""Bytes kept for a reader that is slow, beside the few that the kernel keeps: 11 s at 921600 bit/s.
Who has the port open and is stopped for longer loses whole frames."""


PIECE: Final = 1 << 14
"""Bytes of those that are written at once: about as many as a pseudo-terminal takes."""


@dataclass(frozen=True, slots=True)
class Written:
    """What became of the bytes said on a port.

    ``size`` were written; nobody read ``lost`` more, and the reader was too slow for ``overrun``.
    """

    size: int
    lost: int
    overrun: int


def unnoted(frame: TrueFrame, offset: int | None) -> None:
    """Note nothing."""


class FrameWriter:
    """Writes frames to a port; ``note`` is told of each one, with its offset or None."""

    def __init__(
        self, port: PlayPort, note: Callable[[TrueFrame, int | None], None] = unnoted
    ) -> None:
        self.port = port
        self.size = 0
        """Bytes written."""
        self.lost = 0
        """Bytes said while nobody had the port open, and those that nobody took in the end."""
        self.overrun = 0
        """Bytes that somebody who had it open was too slow for."""
        self._note = note
        self._held: collections.deque[TrueFrame] = collections.deque()
        self._rest = bytearray()  # the bytes of those that are not written yet
        self._begun = 0  # bytes of the first of them that are written
        self._heard = False

    @property
    def written(self) -> Written:
        """What became of the bytes so far."""
        return Written(self.size, self.lost, self.overrun)

    @property
    def waits(self) -> bool:
        """Tell whether frames wait for the reader."""
        return bool(self._held)

    def say(self, frames: Sequence[TrueFrame]) -> None:
        """Write frames, in order; those that nobody can hear are only noted."""
        if not self._listened():
            for frame in frames:
                self.lost += len(frame.wire)
                self._note(frame, None)
        elif self._held:
            self._hold(frames)
            self.flush()
        else:
            data = b"".join([f.wire for f in frames])
            taken = self.port.write(data)
            if taken < len(data):
                self._held.extend(frames)
                self._rest += data[taken:]
                self._taken(taken)
                return
            for frame in frames:
                size = len(frame.wire)
                self._note(frame, self.size if size else None)
                self.size += size

    def flush(self) -> None:
        """Write of what waits as much as there is room for."""
        while self._held and self._listened():
            piece = bytes(self._rest[:PIECE])
            taken = self.port.write(piece)
            del self._rest[:taken]
            self._taken(taken)
            if taken < len(piece):
                return

    def finish(self) -> None:
        """Give a reader the time to take the rest."""
        self.flush()
        while self._listened():
            unread = self.port.drain()
            self.lost += unread
            if unread or not self._held:
                break
            self.flush()
        self._give_up()

    def _taken(self, size: int) -> None:
        """Note those of the frames that wait which so many more bytes complete."""
        self._begun += size
        while self._held and self._begun >= len(self._held[0].wire):
            frame = self._held.popleft()
            size = len(frame.wire)
            self._begun -= size
            self._note(frame, self.size if size else None)
            self.size += size

    def _hold(self, frames: Iterable[TrueFrame]) -> None:
        for frame in frames:
            if len(self._rest) + len(frame.wire) > HOLD_MOST:
                self.overrun += len(frame.wire)
                self._note(frame, None)
            else:
                self._held.append(frame)
                self._rest += frame.wire

    def _listened(self) -> bool:
        heard = self.port.listened()
        if self._heard and not heard:
            self._give_up()
            self.lost += self.port.forget()
        self._heard = heard
        return heard

    def _give_up(self) -> None:
        """Drop what waits; of a frame that is written in part, the part was on the line."""
        for frame in self._held:
            begun, self._begun = self._begun, 0
            self.lost += len(frame.wire) - begun
            if begun:
                self._note(frame._replace(wire=frame.wire[:begun]), self.size)
                self.size += begun
            else:
                self._note(frame, None)
        self._held.clear()
        self._rest.clear()
