"""Gaps in columns: where they are and of what kind is known at once, their objects when asked for.

On a bad line an object with its explanation is made for every thousandth byte, and most are never
looked at: a sink that writes tables counts them, and no more.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, TypeVar, overload

import numpy as np

from sniffer.ground.model import Gap

if TYPE_CHECKING:
    from sniffer.ground.model import I64, U8, Mask

T = TypeVar("T")

NOISE, BLANK, CHECKSUM, DAMAGED, TRUNCATED, IDLE_TAIL = range(6)
"""Kinds of gaps: what reason and detail say together. ``CHECKSUM`` is damaged, the sums known."""

REASONS: Final = ("noise", "noise", "damaged", "damaged", "truncated", "idle_tail")
"""The reason of each kind."""


UNTOLD: Final = -1
"""A number that is not told."""

ERRORS_HERE: Final = "line_errors"
"""What the tap remarked about a gap, beside why no frame claims it."""


class Lazy(Sequence[T]):
    """A tuple whose items are made when somebody looks at them."""

    __slots__ = ("_count", "_made")

    def __init__(self, count: int, made: tuple[T, ...] | None = None) -> None:
        self._count = count
        self._made = made

    @abstractmethod
    def _all(self) -> Iterable[T]:
        """Make the items."""

    def _one(self, i: int) -> T:
        """Make one item; it is not kept."""
        return self.made()[i]

    def made(self) -> tuple[T, ...]:
        """Return the items, which are made once."""
        if self._made is None:
            self._made = tuple(self._all())
        return self._made

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, at: int) -> T: ...
    @overload
    def __getitem__(self, at: slice) -> tuple[T, ...]: ...
    def __getitem__(self, at: int | slice) -> T | tuple[T, ...]:
        if isinstance(at, slice) or self._made is not None:
            return self.made()[at]
        if not -self._count <= at < self._count:
            raise IndexError(at)
        return self._one(at % self._count)

    def __iter__(self) -> Iterator[T]:
        return iter(self.made())

    def __eq__(self, other: object) -> bool:
        if isinstance(other, tuple | Lazy):
            return len(self) == len(other) and self.made() == tuple(other)
        return NotImplemented

    def __hash__(self) -> int:
        return hash(self.made())

    def __add__(self, other: Sequence[T]) -> tuple[T, ...]:
        return (*self.made(), *other)

    def __radd__(self, other: Sequence[T]) -> tuple[T, ...]:
        return (*other, *self.made())

    def __repr__(self) -> str:
        return repr(self.made())

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (self.made(),)


class Gaps(Lazy[Gap]):
    """The gaps of a batch, in order; offsets and lengths in bytes of its data.

    ``servo_id`` is whose frame it may have been, -1 where nothing tells. ``expected`` and ``got``
    are numbers: what a checksum should be and is, or how many bytes a frame should have and has
    that is cut off; -1: not told. ``is_told``: kind and numbers are all there is to say of it.
    """

    __slots__ = (
        *("_explain", "_known", "_run"),
        *("expected", "got", "is_told", "kind", "length", "servo_id", "start", "t_ns"),
    )

    def __init__(
        self,
        start: I64,
        length: I64,
        kind: U8,
        servo_id: I64,
        numbers: tuple[I64, I64],
        t_ns: I64,
        run: I64,
        explain: Callable[[int], Sequence[Gap]],
    ) -> None:
        """Take the columns, and how the gaps are made: ``explain`` gives those of one run of bytes.

        ``run`` is the number of the run that each gap is of.
        """
        super().__init__(len(start))
        self.start, self.length, self.kind = start, length, kind
        self.servo_id, self.t_ns = servo_id, t_ns
        self.expected, self.got = numbers
        self.is_told: Mask = kind != DAMAGED
        self._run, self._explain = run, explain
        self._known: dict[int, Sequence[Gap]] = {}

    @classmethod
    def of(cls, gaps: Sequence[Gap]) -> Gaps:
        """Return gaps that are objects already with their columns."""
        if isinstance(gaps, cls):
            return gaps
        expected, got, is_told = zip(*map(_numbers, gaps), strict=True) if gaps else ((), (), ())
        out = cls(
            np.array([g.start for g in gaps], np.int64),
            np.array([g.length for g in gaps], np.int64),
            np.array([_kind(g) for g in gaps], np.uint8),
            np.array([_servo(g) for g in gaps], np.int64),
            (np.array(expected, np.int64), np.array(got, np.int64)),
            np.array([g.t_ns for g in gaps], np.int64),
            np.arange(len(gaps)),
            lambda i: gaps[i : i + 1],
        )
        out.is_told &= np.array(is_told, bool)
        out._made = tuple(gaps)
        return out

    @classmethod
    def joined(cls, parts: Sequence[tuple[Gaps, int]]) -> Sequence[Gap]:
        """Return the gaps of batches in a row as those of one: each with what it is moved by."""
        if not parts:
            return ()
        begins = np.cumsum([0, *(int(part._run.max(initial=-1)) + 1 for part, _ in parts)])

        def explain(run: int) -> list[Gap]:
            nth = int(np.searchsorted(begins, run, "right")) - 1
            part, shift = parts[nth]
            return [Gap(gap.start + shift, *gap[1:]) for gap in part._of(run - int(begins[nth]))]

        columns = [
            np.concatenate([getattr(part, name) for part, _ in parts])
            for name in ("length", "kind", "servo_id", "expected", "got", "t_ns", "is_told")
        ]
        start = np.concatenate([part.start + shift for part, shift in parts])
        run = np.concatenate([part._run + b for (part, _), b in zip(parts, begins, strict=False)])
        length, kind, servo_id, expected, got, t_ns, is_told = columns
        out = cls(start, length, kind, servo_id, (expected, got), t_ns, run, explain)
        out.is_told = is_told
        return out

    def _all(self) -> Iterator[Gap]:
        times = iter(self.t_ns.tolist())
        tails = iter((self.kind == IDLE_TAIL).tolist())
        for run in dict.fromkeys(self._run.tolist()):
            for gap in self._of(run):
                yield _told(gap, next(times), is_tail=next(tails))
        self._known.clear()

    def _one(self, i: int) -> Gap:
        run = self._run.item(i)
        is_first = not i or self._run.item(i - 1) != run
        gap = self._of(run)[0 if is_first else i - int(self._run.searchsorted(run))]
        return _told(gap, self.t_ns.item(i), is_tail=self.kind.item(i) == IDLE_TAIL)

    def _of(self, run: int) -> Sequence[Gap]:
        """Explain a run, once."""
        found = self._known.get(run)
        if found is None:
            found = self._known[run] = self._explain(run)
        return found


def _told(gap: Gap, t_ns: int, *, is_tail: bool) -> Gap:
    reason = REASONS[IDLE_TAIL] if is_tail else gap.reason
    return Gap(gap.start, gap.length, reason, gap.detail, t_ns)


def _kind(gap: Gap) -> int:
    match gap.reason:
        case "noise":
            return BLANK if gap.detail.get("blank") else NOISE
        case "damaged":
            return CHECKSUM if "checksum_expected" in gap.detail else DAMAGED
        case "truncated":
            return TRUNCATED
        case _:
            return IDLE_TAIL


def _servo(gap: Gap) -> int:
    fields = gap.detail.get("fields", {})
    who = fields.get("servo_id", -1) if isinstance(fields, dict) else -1
    return who if isinstance(who, int) else -1


def _numbers(gap: Gap) -> tuple[int, int, bool]:
    """Return what is expected and got, and whether there is nothing beside."""
    expected, got = numbers_in(gap.detail, _kind(gap))
    if not (isinstance(expected, int) and isinstance(got, int)):
        return UNTOLD, UNTOLD, False  # a plug-in may tell them as it likes
    return expected, got, ERRORS_HERE not in gap.detail


def numbers_in(detail: Mapping[str, Any], kind: int) -> tuple[Any, Any]:
    """Return what a gap's detail says is expected and got."""
    names = ("checksum_expected", "checksum_got") if kind == CHECKSUM else ("need", "have")
    expected, got = (detail.get(name, UNTOLD) for name in names)
    return expected, got
