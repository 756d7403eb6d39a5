"""Levels over time, as edges; samples are turned into them."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, overload

import numpy as np

from sniffer.ground.model import I64

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import U8


class Stretch(NamedTuple):
    """A part of a capture: what happened on each channel up to a time, in ticks.

    ``levels`` are those before the first edge, ``edges`` the ticks of the first samples on a new
    level, ascending; ``until`` is the last tick at which the levels are known. ``active`` are the
    channels that have edges, None where that is to be seen from ``edges``.
    """

    levels: Sequence[int]
    edges: Sequence[I64]
    until: int
    active: Sequence[int] | None = None


class EdgesByWire(Sequence[I64]):
    """The edges of a few of many wires, laid out wire by wire: a chip has sixty thousand.

    Args:
        wires: whose each edge is, ascending.
        at: when it is; ascending within a wire.
        size: how many wires there are.
    """

    def __init__(self, wires: I64, at: I64, size: int) -> None:
        first = np.flatnonzero(np.diff(wires, prepend=-1) != 0)  # they ascend: nothing is sorted
        self.active = wires[first]
        self._spans = dict(
            zip(self.active.tolist(), itertools.pairwise([*first.tolist(), len(at)]), strict=True)
        )
        self._at = at
        self._size = size

    def __len__(self) -> int:
        return self._size

    @overload
    def __getitem__(self, wire: int) -> I64: ...

    @overload
    def __getitem__(self, wire: slice) -> Sequence[I64]: ...

    def __getitem__(self, wire: int | slice) -> I64 | Sequence[I64]:
        if isinstance(wire, slice):
            return [self[one] for one in range(*wire.indices(self._size))]
        begin, end = self._spans.get(range(self._size)[wire], (0, 0))
        return self._at[begin:end]


class LogicInput(NamedTuple):
    """A logic capture as its reader hands it over.

    ``tick_ns`` is the unit of its times, ``zero_ns`` what tick 0 stands for; ``sample`` how many
    ticks a sample lasts, 0 where the file does not say. ``is_dated``: times are Unix times.
    ``is_open_ended``: a level goes on behind the last edge. ``stretches`` may be iterated once.
    """

    names: Sequence[str]
    tick_ns: float
    sample: float
    stretches: Iterator[Stretch]
    is_dated: bool = False
    is_open_ended: bool = False
    zero_ns: int = 0


class Sampler:
    """Packed samples, block by block, as edges.

    Args:
        bits: which bit of a sample each channel is.
        size: bytes of a sample, the low bits in the first one.
    """

    def __init__(self, bits: Sequence[int], size: int) -> None:
        self._bits = tuple(bits)
        self._size = size
        self._last: U8 | None = None
        self._at = 0

    def take(self, data: bytes) -> Stretch | None:
        """Return what whole samples hold; None where there is none."""
        rows = np.frombuffer(data, np.uint8).reshape(-1, self._size)
        if not len(rows):
            return None
        before = rows[0] if self._last is None else self._last
        at = np.flatnonzero(_changed(rows)) + 1
        if not np.array_equal(before, rows[0]):
            at = np.concatenate([[0], at])
        flips = rows[at] ^ np.where((at > 0)[:, None], rows[at - 1], before)
        edges = [at[(flips[:, b >> 3] >> (b & 7) & 1).astype(bool)] + self._at for b in self._bits]
        levels = [int(before[b >> 3] >> (b & 7) & 1) for b in self._bits]
        self._last = rows[-1].copy()
        self._at += len(rows)
        return Stretch(levels, edges, self._at - 1)


def _changed(rows: U8) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Tell which samples but the first differ from the one before."""
    kind = {1: "u1", 2: "<u2", 4: "<u4", 8: "<u8"}.get(rows.shape[1])
    if kind is None:
        return np.asarray((rows[1:] != rows[:-1]).any(axis=1))
    samples = rows.view(kind)[:, 0]
    return np.asarray(samples[1:] != samples[:-1])
