"""Texts that are kept by what they depend on: most of what a bus says it has said before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, Generic, Self, TypeVar

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from sniffer.ground.model import I64, Batch
    from sniffer.protocols.base import BusProtocol

T = TypeVar("T")

MOST: Final = 3 << 22
"""Characters of one kind of text that are kept, about, and as many of those known before."""

PROTOCOLS_MOST: Final = 32
"""Protocols whose texts are kept: more than there are in one program."""


class Kept(Generic[T]):
    """Texts by what they depend on; those that are not asked for are forgotten in time.

    Who asks looks at ``known`` first, which stays the same object, then calls ``again``. ``weigh``
    tells how many characters something has, about.
    """

    def __init__(self, weigh: Callable[[T], int]) -> None:
        self._weigh = weigh
        self.known: dict[Hashable, T] = {}
        self._before: dict[Hashable, T] = {}
        self._room = MOST

    def again(self, key: Hashable) -> T | None:
        """Return what was known before the last time that room was made, and know it again."""
        found = self._before.pop(key, None)
        return None if found is None else self.keep(key, found)

    def keep(self, key: Hashable, told: T) -> T:
        """Keep something."""
        size = self._weigh(told) + OVERHEAD
        self._room -= size
        if self._room < 0:
            self._before = self.known.copy()
            self.known.clear()
            self._room = MOST - size
        self.known[key] = told
        return told


OVERHEAD: Final = 400
"""Bytes that a text, what it is found by, and its place take beside its characters, about."""


class OfProtocol:
    """The texts of a protocol; ``of`` keeps them from one batch to the next."""

    _of: dict[int, Self]

    def __init__(self, protocol: BusProtocol) -> None:
        self.protocol = protocol

    def __init_subclass__(cls) -> None:
        """Let each kind of texts have its own."""
        super().__init_subclass__()
        cls._of = {}

    @classmethod
    def of(cls, protocol: BusProtocol) -> Self:
        """Return the texts of a protocol."""
        found = cls._of.get(id(protocol))
        if found is None or found.protocol is not protocol:
            if len(cls._of) >= PROTOCOLS_MOST:
                cls._of.clear()
            found = cls._of[id(protocol)] = cls(protocol)
        return found


def packed(batch: Batch, telling: I64) -> tuple[bytes, int]:
    """Return what frames are called by, but for their bytes, row by row; and the bytes of a row.

    That is what presentation sees of the columns, with ``telling``: so many bytes of each frame
    it looks at.
    """
    f, v = batch.frames, batch.values
    others = np.zeros(len(f), np.uint8)
    others[v.row[v.servo_id != f.servo_id[v.row]]] = 1
    small = f.kind.astype(np.int64)
    for code in (f.flags, f.direction << 4 | int(batch.clock) << 1 | others):
        small = small << 8 | code
    for number in (f.status, f.servo_id):
        small = small << 16 | number.astype(np.int64) & 0xFFFF
    wide = (f.op, f.address, f.data_start - f.start, f.data_length, f.length << 32 | telling)
    rows = np.stack([small, *wide], axis=1)
    return rows.tobytes(), rows.shape[1] * rows.itemsize
