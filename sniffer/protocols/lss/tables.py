"""The word table as arrays: entry 0 is the unknown word, the others those of ``WORDS`` in order."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.protocols.lss.grammar import MODELS, MODIFIERS, REGISTERS, WORDS, Word, packed

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sniffer.ground.model import I64, U8

SELECTORS: Final = 10
"""Selectors 0 (also: none) to 9 have a column each; all others share the last one."""

_SIZE_BITS: Final = 12
_STEP: Final = 0x9E3779B97F4A7C15  # odd, so that multiplying by it loses nothing


class Lookup:
    """Finds packed words without collisions: one multiplication, one comparison."""

    def __init__(self, words: Iterable[str]) -> None:
        keys = [packed(word) for word in words]
        self._shift = np.uint64(64 - _SIZE_BITS)
        factor = _STEP
        while len({self._slot(key, factor) for key in keys}) < len(keys):
            factor = (factor + 2 * _STEP) % 2**64 | 1
        self._factor = np.uint64(factor)
        self._key = np.full(1 << _SIZE_BITS, -1, np.int64)
        self._entry = np.zeros(1 << _SIZE_BITS, np.uint8)
        for entry, key in enumerate(keys, 1):
            slot = self._slot(key, factor)
            self._key[slot], self._entry[slot] = key, entry

    @staticmethod
    def _slot(key: int, factor: int) -> int:
        return (key * factor % 2**64) >> (64 - _SIZE_BITS)

    def find(self, keys: I64) -> U8:
        """Return the entry of each packed word, 0 for words the table does not have."""
        slot = (keys.view(np.uint64) * self._factor) >> self._shift
        return np.asarray(self._entry[slot] * (self._key[slot] == keys))


_ALL: Final = (None, *WORDS.values())


_IDENTIFYING: Final = {m.identity.register for m in MODELS if m.identity is not None}


def _register(word: Word | None, model: int) -> int:
    """Return the register that an action's or a configuration's number states."""
    return -1 if word is None else _number_only(word.registers[model])


def _of_selector(word: Word | None, model: int, selector: int) -> int:
    return -1 if word is None else word.answers[model].get(selector, -1)


def _number_only(register: int) -> int:
    return register if register >= 0 and REGISTERS[register].type == "decimal" else -1


ENTRIES: Final = Lookup(WORDS)
CANONICAL: Final = np.array([packed(w.name) if w else 0 for w in _ALL])
PLAIN: Final = np.array([w is not None and len(set(w.selectors.values())) == 1 for w in _ALL])
"""Words of queries whose selector, if they have one, changes nothing about what a reply states."""
IS_QUERY: Final = np.array([w is not None and w.is_query for w in _ALL])
REGISTER: Final = np.array([[_register(w, m) for w in _ALL] for m in range(len(MODELS))])
"""By model and word."""
NUMBER_OK: Final = np.array([w is not None and w.takes_number for w in _ALL])
EMPTY_OK: Final = np.array([w is not None and w.may_be_empty for w in _ALL])
_BY_SELECTOR: Final = [
    [[_of_selector(w, m, s) for s in range(SELECTORS)] + [-1] for w in _ALL]
    for m in range(len(MODELS))
]
LISTED: Final = np.array(_BY_SELECTOR[0]) >= 0
STATED: Final = np.vectorize(_number_only)(np.array(_BY_SELECTOR))
"""By model, word and selector."""

IDENTIFIES: Final = np.array([w is not None and not _IDENTIFYING.isdisjoint(w.asks) for w in _ALL])
"""Queries for what a model says of itself."""
TELLS: Final = IDENTIFIES | [w is not None and len({*map(bool, w.asks)}) > 1 for w in _ALL]
"""Queries whose answer may tell which model a servo is: they, and what not all tables have."""

MODIFIER_ENTRIES: Final = Lookup(MODIFIERS)
MODIFIER_REGISTER: Final = np.array(
    [[-1, *(known.registers[m] for known in MODIFIERS.values())] for m in range(len(MODELS))]
)
"""By model and modifier."""
FITS: Final = np.array(
    [
        [w is not None and w.name in allowed for w in _ALL]
        for allowed in [(), *(m.modifies for m in MODIFIERS.values())]
    ]
)
"""By modifier and word: does the page allow them together?"""
