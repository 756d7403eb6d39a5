"""What a packet tells about the model it is for, weighed by the register tables of all siblings.

Models that speak the same packets have different maps: an address that only one of them names, a
number outside the range of one and inside that of another, a default, a model number. Nothing here
knows a model or a protocol: all of it follows from the tables.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.codes import WHOLE
from sniffer.ground.registers import TYPES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.ground.registers import Register, RegisterMap

WRITTEN, READ, RANGE, DEFAULT, NUMBER, WORD, TEXT = range(7)
"""What kind of clue: a span written, a register read, a value in one model's range only, a factory
default found, a number that names the model; where registers go by words, one that is answered, and
a text that names the model."""

UNNAMED, NAMED, FITTING = 0, 1, 2
"""Points of a written span under a table: a byte it does not name; all named, but a register in
part; whole registers. A controller writes what its manual has."""

_ASKED, _OUT_OF_RANGE_WRITTEN, _OUT_OF_RANGE_READ, _AT_DEFAULT, _TOLD = 1, 1, 2, 1, 16
"""Points of the other clues. A read asks for what may not exist, and blocks are read across holes:
only a single register counts. A controller may write nonsense, a servo measures none. A model
number, or its text, decides alone."""

_ANSWERED = 2
"""Points of all words together that a servo answers and only some tables have: they are told, and
never decide. Firmware learns words, and one release may bring a sibling a handful of them."""

NOWHERE: Final = -1
"""Address of what goes by a word: all of a kind are the same clue."""

SURE: Final = 4
"""Points a model must be ahead of every other before values are read by its table: two independent
writes of registers that only it has, or its number."""


_WIDEST: Final = 2
"""Bytes of the numbers looked at: no table with addresses has wider ones."""


class Clue(NamedTuple):
    """One observation that models explain unequally well, ``points`` for each.

    ``address`` and ``width`` are the bytes that make it, ``known`` the models' names for them.
    """

    kind: int
    address: int
    width: int
    points: tuple[int, ...]
    known: tuple[str, ...]

    @property
    def key(self) -> tuple[int, int, tuple[int, ...]]:
        """What makes it the same clue again: repeated, it tells nothing more."""
        return self.kind, self.address, self.points


class Found(NamedTuple):
    """A clue in a packet: ``at`` is the offset of its bytes among the packet's data bytes."""

    clue: Clue
    at: int


class Check(NamedTuple):
    """A number that may be a clue: where it stands, its type, and what each value of it tells."""

    at: int
    type: str
    low: int
    high: int  # all models accept low..high; a value outside, or one of ``others``, is looked at
    others: tuple[int, ...]
    address: int


class _Registers(NamedTuple):
    """What each model has for exactly some bytes, and the numbers by which it is named there."""

    same: tuple[Register | None, ...]
    numbers: tuple[tuple[int, ...], ...]


class Clues:
    """Weighs packets by the tables of one protocol's models."""

    def __init__(self, models: Sequence[RegisterMap]) -> None:
        self._models = models
        self._checks: dict[tuple[int, int, bool], tuple[Check, ...]] = {}
        self._check_at: dict[tuple[int, str, bool], Check | None] = {}
        self._spans: dict[tuple[int, int, bool], Found | None] = {}
        self._registers_at: dict[tuple[int, str], _Registers] = {}

    def of(self, address: int, data: bytes, *, written: bool) -> list[Found]:
        """Return the clues in ``data``, which a request writes or an answer returns."""
        found = self.span(address, len(data), written=written)
        out = [found] if found else []
        for check in self.checks(address, len(data), written=written):
            size = TYPES[check.type].itemsize
            raw = int(np.frombuffer(data[check.at : check.at + size], TYPES[check.type])[0])
            out += [Found(c, check.at) for c in self.value(check, raw, written=written)]
        return out

    def span(self, address: int, length: int, *, written: bool) -> Found | None:
        """Return what the mere place of the bytes tells: which tables name them; cached."""
        key = (address, length, written)
        if key not in self._spans:
            self._spans[key] = self._find_span(address, length, written=written)
        return self._spans[key]

    def _find_span(self, address: int, length: int, *, written: bool) -> Found | None:
        fits = [self._fit(m, address, length) for m in self._models]
        if not written:
            points = tuple(
                _ASKED * (fit == FITTING and _whole(m, address, length) is not None)
                for m, fit in zip(self._models, fits, strict=True)
            )
        else:
            points = tuple(fits)
        if len(set(points)) < 2:
            return None
        first = next(
            a
            for a in range(address, address + length)
            if len({self._place(m, a) for m in self._models}) > 1
        )
        width = address + length - first
        kind = WRITTEN if written else READ
        return Found(Clue(kind, first, width, points, self._known(first)), first - address)

    def checks(self, address: int, length: int, *, written: bool) -> tuple[Check, ...]:
        """Return the numbers in a span whose value may tell models apart, cached."""
        key = (address, length, written)
        known = self._checks.get(key)
        if known is None:
            known = self._checks[key] = tuple(self._find_checks(address, length, written=written))
        return known

    def value(self, check: Check, raw: int, *, written: bool) -> Iterator[Clue]:
        """Yield what one number tells."""
        same, numbers = self._registers(check)
        states = [None if r is None else _accepts(r, raw) for r in same]
        if True in states and False in states:
            weight = _OUT_OF_RANGE_WRITTEN if written else _OUT_OF_RANGE_READ
            unbound = [r is not None and s is None for r, s in zip(same, states, strict=True)]
            points = [weight * (s is True or u) for s, u in zip(states, unbound, strict=True)]
            yield self._clue(RANGE, check, points)
        if written:
            return
        named = [raw in of for of in numbers]
        if any(named):
            yield self._clue(NUMBER, check, [_TOLD * own for own in named])
            return
        if raw and any(r is not None and _settled(r) and r.default == raw for r in same):
            # a model whose default is not known has no part in this: it is not held against it
            points = [
                _AT_DEFAULT * (r is not None and (not _settled(r) or r.default == raw))
                for r in same
            ]
            if len(set(points)) > 1:
                yield self._clue(DEFAULT, check, points)

    def _clue(self, kind: int, check: Check, points: Sequence[int]) -> Clue:
        width = TYPES[check.type].itemsize
        return Clue(kind, check.address, width, tuple(points), self._known(check.address))

    def _known(self, address: int) -> tuple[str, ...]:
        owners = [m.at(address) for m in self._models]
        return tuple("" if r is None else r.name for r in owners)

    @staticmethod
    def _fit(table: RegisterMap, address: int, length: int) -> int:
        if any(table.at(a) is None for a in range(address, address + length)):
            return UNNAMED
        whole = all(e.part == WHOLE for e in table.span(address, length))
        return FITTING if whole else NAMED

    @staticmethod
    def _place(table: RegisterMap, address: int) -> tuple[int, int] | None:
        r = table.at(address)
        return None if r is None else (r.address, r.width)

    def _registers(self, check: Check) -> _Registers:
        """Return what the models have at a check's bytes, cached: each value there asks for it."""
        key = check.address, check.type
        found = self._registers_at.get(key)
        if found is None:
            same = tuple(self._same(m, check) for m in self._models)
            numbers = tuple(self._numbers(m, check) for m in self._models)
            found = self._registers_at[key] = _Registers(same, numbers)
        return found

    def _same(self, table: RegisterMap, check: Check) -> Register | None:
        """Return the register a table has for exactly these bytes."""
        r = table.at(check.address)
        fits = r is not None and r.address == check.address and r.type == check.type
        return r if fits else None

    def _numbers(self, table: RegisterMap, check: Check) -> tuple[int, ...]:
        """Return the numbers by which a servo of the model names itself there."""
        told, r = table.identity, self._same(table, check)
        return told.values if told is not None and r is not None and r.name == told.register else ()

    def _find_checks(self, address: int, length: int, *, written: bool) -> Iterator[Check]:
        """Yield the registers, of any model, that lie whole in the span and can tell something."""
        places: Mapping[tuple[int, str], None] = dict.fromkeys(
            (r.address, r.type)
            for m in self._models
            for r in m.registers
            if r.width <= _WIDEST and address <= r.address
            if r.address + r.width <= address + length
        )
        for where, kind in sorted(places):
            key = where, kind, written  # the same in whatever span it stands
            if key not in self._check_at:
                self._check_at[key] = self._find_check(where, kind, written=written)
            check = self._check_at[key]
            if check is not None:
                yield check._replace(at=where - address)

    def _find_check(self, address: int, kind: str, *, written: bool) -> Check | None:
        """Return what the numbers at one place tell, None where none tells anything."""
        check = Check(0, kind, 0, 0, (), address)
        registers = self._registers(check)
        same = [r for r in registers.same if r is not None]
        bounds = [r.range for r in same if r.range is not None]
        single = {x for b in bounds for x in (b[0] - 1, b[0], b[1], b[1] + 1)}
        single |= {raw for r in same for raw in (*r.special, *r.values)}
        single |= {r.default for r in same if r.default is not None}
        single |= {raw for of in registers.numbers for raw in of}

        def tells(raw: int) -> bool:
            return any(True for _ in self.value(check, raw, written=written))

        if TYPES[kind].itemsize == 1:
            # Nothing changes between two numbers that any table mentions, so one of each stretch
            # between them speaks for all: a tenth of asking for all 256.
            low, high = -(2**62), 2**62
            least = -128 if kind == "i8" else 0
            edges = sorted({least - 1, *(x for x in single if least <= x < least + 256)})
            telling = [raw for raw in edges[1:] if tells(raw)]
            for before, behind in itertools.pairwise([*edges, least + 256]):
                if before + 1 < behind and tells(before + 1):
                    telling += range(before + 1, behind)
        else:
            low = max((b[0] for b in bounds), default=-(2**62))
            high = min((b[1] for b in bounds), default=2**62)
            telling = [raw for raw in single if tells(raw)]
        if not telling:
            return None
        others = tuple(sorted(raw for raw in telling if low <= raw <= high))
        return check._replace(low=low, high=high, others=others)


def told_by_word(
    models: Sequence[RegisterMap], names: tuple[str, ...], text: bytes
) -> Iterator[Clue]:
    """Yield what an answer tells that goes by a word; ``text`` is what stands behind it.

    ``names`` are those of the register that the word states, by model: "" where a table has none.
    """
    has = [_ANSWERED * bool(name) for name in names]
    if len(set(has)) > 1:
        yield Clue(WORD, NOWHERE, 0, tuple(has), names)
    said = text.decode("ascii", "replace")
    points = tuple(
        _TOLD
        * (m.identity is not None and m.identity.register == name and m.identity.is_text(said))
        for m, name in zip(models, names, strict=True)
    )
    if any(points):
        yield Clue(TEXT, NOWHERE, len(text), points, names)


def _whole(table: RegisterMap, address: int, length: int) -> Register | None:
    """Return the register that is exactly this span."""
    r = table.at(address)
    return r if r is not None and r.address == address and r.width == length else None


def _enumerates(register: Register) -> bool:
    """Whether the values that are named are all there are: a code, not a quantity or a number."""
    return bool(register.values) and register.width == 1


def _accepts(register: Register, raw: int) -> bool | None:
    """Whether a raw value is one the manual has; None: the manual sets no bounds."""
    if register.range is None:
        return raw in register.values or raw in register.special if _enumerates(register) else None
    return register.range[0] <= raw <= register.range[1] or raw in register.special


def _settled(register: Register) -> bool:
    """Whether its default is found in most servos: a setting that outlives the power."""
    return register.default is not None and not register.volatile
