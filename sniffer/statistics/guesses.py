"""What bytes that no table names may be: constants, counters, words, flags, what goes with what.

Every guess is a statement about what was heard, with its numbers, and none about what a servo is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.model import NS
from sniffer.ground.register import TYPES
from sniffer.statistics.bytewise import numbers

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.ground.model import F64, I64, Mask
    from sniffer.ground.registers import RegisterMap
    from sniffer.statistics.bytewise import ByteSpan, LaneBytes, SpanBytes
    from sniffer.statistics.thinned import Thinned

ENOUGH: Final = 16
"""Fewer readings tell nothing: two ramps of a dozen points go together by chance."""

ALIKE: Final = 0.9
"""Correlations that are told: with 16 independent readings none is that far from 0 by chance
(one in 10^5)."""

STEADY: Final = 0.9
"""Share of changes by one and the same amount that make a counter."""

SMOOTHER: Final = 0.5
"""A number of two bytes is so much smoother than its high byte: by half, where one that has nothing
to do with its neighbour is not at all."""

BY_CHANCE: Final = 10**5
"""Two bytes that have nothing to do with each other are told to be a number once in so many."""

TURNS: Final = 3
"""Changes of a high byte from which on that can be told."""

FLAGS: Final = 8
"""Values that a byte of flags has at most: a quantity has more, once it moves."""


@dataclass(slots=True)
class Likeness:
    """What a field goes with: ``r`` is the correlation of ``n`` readings.

    Readings are ``slope`` times the raw number plus ``offset``.
    """

    name: str
    r: float
    n: int
    slope: float
    offset: float


@dataclass(slots=True)
class FieldGuess:
    """One or two bytes that no table names."""

    servo_id: int
    address: int
    type: str
    is_write: bool
    count: int
    low: int
    high: int
    what: str = "changes"
    likenesses: list[Likeness] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def is_constant(self) -> bool:
        """Whether it was always the same."""
        return self.low == self.high

    @property
    def width(self) -> int:
        """How many bytes it has."""
        return TYPES[self.type].itemsize

    def sentence(self) -> str:
        """Return what is said of it, in words."""
        alike = [
            f"goes with {x.name} (r = {x.r:.3f}, n = {x.n}, {x.slope:.6g} a count"
            + (f" {x.offset:+.6g})" if abs(x.offset) > 1e-9 else ")")
            for x in self.likenesses
        ]
        return "; ".join([self.what, *alike, *self.notes])


def model_of(lane: LaneBytes, servo_id: int) -> RegisterMap:
    """Return the table by which a servo is read."""
    name = lane.models.get(servo_id)
    models = lane.protocol.models
    return next((model for model in models if model.model == name), models[0])


def guesses(lane: LaneBytes) -> list[FieldGuess]:
    """Return what may be said of all bytes that no table names, by servo and address."""
    found: list[tuple[FieldGuess, I64, F64]] = []
    taken: set[tuple[int, bool, int]] = set()
    by_count = sorted(lane.spans.items(), key=lambda e: (-e[1].series.count, e[0]))
    for span, heard in by_count:
        named = {
            r.address + k
            for r in model_of(lane, span.servo_id).registers
            if r.address >= 0
            for k in range(r.width)
        }
        free = [
            span.address + k not in named
            and (span.servo_id, span.is_write, span.address + k) not in taken
            for k in range(span.length)
        ]
        for guess, t_ns, raw in _fields(span, heard, free):
            taken |= {(span.servo_id, span.is_write, guess.address + k) for k in range(guess.width)}
            found.append((guess, t_ns, raw))
    found.sort(key=lambda e: (e[0].servo_id, e[0].is_write, e[0].address))
    for k, (guess, t_ns, raw) in enumerate(found):
        if guess.is_constant or len(t_ns) < ENOUGH:
            continue
        _compare(guess, t_ns, raw, lane)
        for other, t_other, raw_other in found[:k]:
            if (other.servo_id, other.is_write) == (guess.servo_id, guess.is_write):
                like = _likeness(f"0x{other.address:02X}", t_ns, raw, t_other, raw_other)
                if like is not None:
                    guess.likenesses.append(like)
    return [guess for guess, _, _ in found]


def _fields(
    span: ByteSpan, heard: SpanBytes, free: Sequence[bool]
) -> Iterator[tuple[FieldGuess, I64, F64]]:
    """Yield the fields of a span: words where two bytes are one number, else single bytes."""
    t_ns, said = heard.series.columns()
    wide = said.astype(np.int64)
    k = 0
    while k < span.length:
        if not free[k]:
            k += 1
            continue
        kind = "u8"
        if k + 1 < span.length and free[k + 1]:
            kind = _word(wide[:, k], wide[:, k + 1])
        raw = numbers(said[:, k : k + TYPES[kind].itemsize], kind)[:, 0]
        low, high = (int(ends[k]) for ends in heard.ends[kind])
        guess = FieldGuess(
            span.servo_id, span.address + k, kind, span.is_write, heard.series.count, low, high
        )
        _describe(guess, t_ns, raw, heard, k)
        yield guess, t_ns, raw.astype(np.float64)
        k += guess.width


def _word(first: I64, second: I64) -> str:
    """Return the type of two bytes that are one number, ``u8`` where nothing tells.

    A number moves more smoothly than its high byte alone, which jumps where the low one wraps; with
    a low byte that is none of it, it would be as rough. One that moves little has a high byte that
    moves with each wrap, and only then. What is rougher than that is left as bytes.
    """
    best, kind = SMOOTHER, "u8"
    for low, high, name in ((first, second, "16le"), (second, first, "16be")):
        if _carries(low, high):
            return f"{'i' if (np.abs(np.diff(high)) > 128).any() else 'u'}{name}"
        if int((np.diff(high) != 0).sum()) < TURNS:
            continue
        rough = np.abs(np.diff(high * 256, n=2)).mean()
        for sign, turned in (("u", high), ("i", (high + 128) % 256 - 128)):
            whole = np.abs(np.diff(turned * 256 + low, n=2)).mean()
            if whole < best * rough:
                best, kind = float(whole / rough), f"{sign}{name}"
    return kind


def _carries(low: I64, high: I64) -> bool:
    """Tell whether a high byte goes one up or down where the low one wraps, and nowhere else.

    Each step of the number is taken to be less than half of what the low byte holds.
    """
    step = np.diff(low)
    wraps = np.where(step < -128, 1, 0) - np.where(step > 128, 1, 0)
    carried = (np.diff(high) + 128) % 256 - 128
    hits = int(((wraps != 0) & (wraps == carried)).sum())
    most = max(int((wraps != 0).sum()), int((carried != 0).sum()))
    if not most or hits < STEADY * most:
        return False
    return math.comb(len(step), hits) << hits > BY_CHANCE


def _describe(guess: FieldGuess, t_ns: I64, raw: I64, heard: SpanBytes, k: int) -> None:
    """Say what a field, from byte ``k`` on, does by itself."""
    if guess.is_constant:
        guess.what = f"always {guess.low}"
        return
    guess.what = f"{guess.low}..{guess.high}"
    if guess.count < ENOUGH:
        return
    counts = _counts(heard.deltas[k + guess.type.endswith("be")])
    if guess.type == "u8":
        if counts is not None:
            guess.what = counts
            return
        values = np.flatnonzero(heard.seen[k])
        if len(values) <= FLAGS:
            guess.what = f"one of {', '.join(map(str, values.tolist()))}"
            _flags(guess, heard.flips[k])
    elif counts is not None:
        guess.notes.append(counts)
    steady = None if heard.falls[guess.type][k] else _with_time(t_ns, raw)
    if steady is not None:
        guess.notes.append(f"counts with the time, {steady:.4g} a second")


def _counts(deltas: I64) -> str | None:
    """Return that a byte, or a number by its low byte, counts, if nearly all its steps are one."""
    step = int(deltas.argmax())
    if not step or deltas[step] < STEADY * deltas.sum():
        return None
    return f"a counter: {step if step < 128 else step - 256:+d} each time"


def _flags(guess: FieldGuess, flips: I64) -> None:
    """Say which bits change, and which of them always do so together."""
    how = np.flatnonzero(flips)
    bits_of = how[:, None] >> np.arange(8) & 1
    moving = [k for k in range(8) if bits_of[:, k].any()]
    groups: dict[bytes, list[int]] = {}
    for k in moving:
        groups.setdefault(bits_of[:, k].tobytes(), []).append(k)
    for bits in groups.values():
        if len(bits) > 1 and int(flips[how] @ bits_of[:, bits[0]]) > 1:
            guess.notes.append(f"bits {', '.join(map(str, bits))} flip together")
    if len(groups) > 1 or (moving and len(moving) == 1):
        guess.notes.append(f"bits that change: {', '.join(map(str, moving))}")


def _with_time(t_ns: I64, raw: I64) -> float | None:
    """Return by how much a number that never falls grows in a second, if it does so steadily."""
    seconds = (t_ns - t_ns[0]) / NS
    if seconds[-1] <= 0:
        return None
    r, slope, _ = _fit(seconds, raw.astype(np.float64))
    return slope if r is not None and r > 0.999 else None


def _compare(guess: FieldGuess, t_ns: I64, raw: F64, lane: LaneBytes) -> None:
    """Find which known values a field goes with: the three most alike."""
    out = []
    for (servo, register), series in lane.values.items():
        if servo == guess.servo_id:
            t_known, known = _series(series)
            name = lane.protocol.registers[register].name
            like = _likeness(name, t_ns, raw, t_known, known)
            if like is not None:
                out.append(like)
    out.sort(key=lambda x: (-abs(x.r), x.name))
    guess.likenesses += out[:3]


def _series(series: Thinned) -> tuple[Any, Any]:
    t_ns, value = series.columns()
    return t_ns, value


def _likeness(name: str, t_ns: I64, raw: F64, t_known: I64, known: F64) -> Likeness | None:
    """Return how a field goes with what was known at each of its times; None: it does not."""
    last = np.searchsorted(t_known, t_ns, "right") - 1
    held: Mask = last >= 0
    if int(held.sum()) < ENOUGH:
        return None
    mine, other = raw[held], known[last[held]]
    # a value that stands still for long is one reading, however often it was read
    turns = np.flatnonzero((np.diff(mine) != 0) | (np.diff(other) != 0))
    if len(turns) + 1 < ENOUGH // 2:
        return None
    r, slope, offset = _fit(mine, other)
    return None if r is None or abs(r) < ALIKE else Likeness(name, r, len(mine), slope, offset)


def _fit(x: F64, y: F64) -> tuple[float | None, float, float]:
    """Return the correlation of two series (None: one stands still), slope and offset."""
    dx, dy = x - x.mean(), y - y.mean()
    xx, yy, xy = float(dx @ dx), float(dy @ dy), float(dx @ dy)
    if xx <= 0 or yy <= 0:
        return None, 0.0, 0.0
    slope = xy / xx
    return xy / float(np.sqrt(xx * yy)), slope, float(y.mean() - slope * x.mean())


def runs(found: Sequence[FieldGuess]) -> list[list[FieldGuess]]:
    """Return fields of one servo in runs: constants that follow each other and are one number."""
    out: list[list[FieldGuess]] = []
    for guess in found:
        last = out[-1][-1] if out else None
        if (
            last is not None
            and last.is_constant
            and guess.is_constant
            and (last.low, last.count, last.is_write) == (guess.low, guess.count, guess.is_write)
            and last.address + last.width == guess.address
        ):
            out[-1].append(guess)
        else:
            out.append([guess])
    return out


def place(run: Sequence[FieldGuess]) -> str:
    """Return the address of a run."""
    first, last = run[0], run[-1]
    return f"0x{first.address:02X}" + (f"..0x{last.address:02X}" if last is not first else "")
