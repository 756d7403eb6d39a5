"""What is remembered from pass to pass: stated, taken up elsewhere, and compared.

Whatever remembers something beside its arguments names it in its own file:

- ``LASTING`` is what is true wherever the stream goes on (of a servo, of the wire),
- ``PASSING`` what is true at one place only,
- ``PARTS`` are attributes that remember something themselves.

Two of a kind with equal ``observable`` at one place say the same of all bytes that follow it.
"""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

Observed = Mapping[str, Any]
"""What can still be told of a memory from outside: plain values, which are compared."""


class Memorised(NamedTuple):
    """What one part of a decoder remembers, by its own names for it; ``parts`` are those of its.

    It can be pickled, and shares nothing with whom it is of.
    """

    lasting: Mapping[str, Any]
    passing: Mapping[str, Any]
    parts: Mapping[str, tuple[Memorised, ...]]

    def elsewhere(self) -> Memorised:
        """Return what of it holds at any other place of the stream, too."""
        parts = {name: tuple(m.elsewhere() for m in told) for name, told in self.parts.items()}
        return Memorised(self.lasting, {}, parts)

    def instead(self, before: Memorised, guess: Memorised) -> Memorised:
        """Return what this would probably be, had it begun with ``guess`` instead of ``before``.

        What became otherwise since ``before`` is laid over the guess. It is a guess itself.
        """
        lasting = _laid(guess.lasting, before.lasting, self.lasting)
        parts = {
            name: tuple(
                now.instead(then, better)
                for now, then, better in zip(
                    told, before.parts[name], guess.parts[name], strict=True
                )
            )
            for name, told in self.parts.items()
        }
        return Memorised(lasting, self.passing, parts)


class Remembering:
    """Something that remembers, beside its arguments, what it names here and nothing else."""

    LASTING: ClassVar[tuple[str, ...]] = ()
    PASSING: ClassVar[tuple[str, ...]] = ()
    PARTS: ClassVar[tuple[str, ...]] = ()

    def memory(self) -> Memorised:
        """Return a copy of all that is remembered."""
        parts = {name: tuple(p.memory() for p in self.parts(name)) for name in self.PARTS}
        return Memorised(self._copies(self.LASTING), self._copies(self.PASSING), parts)

    def remember(self, memory: Memorised) -> None:
        """Take a memory for one's own; what it does not tell stays as it is."""
        for name, value in (*memory.lasting.items(), *memory.passing.items()):
            setattr(self, name, copy.deepcopy(value))
        for name, told in memory.parts.items():
            for part, one in zip(self.parts(name), told, strict=True):
                part.remember(one)

    def observable(self, at: int) -> Observed:
        """Return what of the memory may still show, if the stream goes on at offset ``at``."""
        own = {name: plain(value) for name, value in self.matters(at).items()}
        return own | {name: [p.observable(at) for p in self.parts(name)] for name in self.PARTS}

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return what of one's own memory may still show from ``at`` on; all of it, if in doubt."""
        del at
        return {name: getattr(self, name) for name in (*self.LASTING, *self.PASSING)}

    def _copies(self, names: Sequence[str]) -> Mapping[str, Any]:
        return {name: copy.deepcopy(getattr(self, name)) for name in names}

    def parts(self, name: str) -> Sequence[Remembering]:
        """Return what one of ``PARTS`` is made of: one part, several, or none."""
        part = getattr(self, name)
        if part is None:
            return ()
        return part if isinstance(part, Sequence) else (part,)


def plain(value: Any) -> Any:
    """Return a value in plain ones that are equal if it is: NaN equals itself, arrays are bytes."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, float | np.floating):
        return float(value).hex()
    if isinstance(value, bytearray):
        return bytes(value)
    if isinstance(value, Mapping):
        return {key: plain(told) for key, told in value.items()}
    if isinstance(value, Set):
        return frozenset(value)
    if isinstance(value, list | tuple | deque):
        return [plain(told) for told in value]
    if is_dataclass(value) and not isinstance(value, type):
        return [plain(getattr(value, field.name)) for field in fields(value)]
    return value


def _laid(guess: Any, before: Any, after: Any) -> Any:
    """Return a guess with what differs between ``before`` and ``after`` as it is after."""
    if isinstance(after, np.ndarray):
        alike = before.shape == after.shape == guess.shape
        return np.where(before != after, after, guess) if alike else after
    if isinstance(after, Mapping):
        out = {key: told for key, told in guess.items() if key in after or key not in before}
        for key, told in after.items():
            if key in before and key in guess:
                out[key] = _laid(guess[key], before[key], told)
            elif key not in before or plain(before[key]) != plain(told):
                out[key] = told
        return out
    if isinstance(after, Set):
        return (guess | (after - before)) - (before - after)
    return guess if plain(before) == plain(after) else after
