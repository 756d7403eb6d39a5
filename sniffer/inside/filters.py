"""The filter line: which lines are wanted."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from sniffer.anomalies.found import CODES
from sniffer.decoding.called import ServoNames
from sniffer.ground.codes import KINDS, OUTCOMES
from sniffer.ground.limits import IDS, number_in
from sniffer.ground.model import InputError, Severity
from sniffer.ground.wording import nearly, offered
from sniffer.inside.selecting import SelectionFilter
from sniffer.selection.columns import TABLES
from sniffer.selection.selection import complaint

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import I64, Mask
    from sniffer.inside.columns import Table
    from sniffer.inside.index import CaptureIndex

WORDS: Final = ("servo", "kind", "op", "code", "bus", "outcome", "severity")
"""What a word of the filter line may be about."""

KIND_NAMES: Final = (*KINDS, "gap")
SEVERITIES: Final = tuple(s.name.lower() for s in Severity)

_WORD: Final = re.compile(r"([a-z]+)(!=|=)([^\s'()=]+)")


class LineFilter(Protocol):
    """Says which lines are wanted; ``step`` is how many it is asked for at a time."""

    step: int

    def mask(self, index: CaptureIndex, numbers: I64) -> Mask:
        """Tell for each line number whether it is wanted."""
        ...


@dataclass(frozen=True, slots=True)
class FilterWord:
    """``servo=3,5``: one word of the line, ``named`` its values."""

    key: str
    named: tuple[str, ...]
    negated: bool


class WordFilter:
    """Words that must all be met: ``servo=3,5 kind=response op!=feedback code=no-response``."""

    step = 1 << 16

    def __init__(self, words: Sequence[FilterWord]) -> None:
        self._words = words

    def mask(self, index: CaptureIndex, numbers: I64) -> Mask:
        """Tell for each line number whether it is wanted."""
        lines = index.lines[numbers[0] : numbers[-1] + 1] if _is_run(numbers) else None
        if lines is None:
            lines = index.lines[numbers]
        out = np.ones(len(numbers), bool)
        for word in self._words:
            if word.key == "code":
                met = _coded(index, numbers, word.named)
            elif word.key == "servo":
                met = _of_servos(index, lines, word.named)
            else:
                column, wanted = _wanted(index, word)
                met = np.isin(lines[column], wanted)
            out &= met != word.negated
        return out


def filter_of(text: str, names: ServoNames | None = None) -> LineFilter | None:
    """Return what a filter line says, None where it says nothing.

    Words (``servo=3,5 kind=response``), or an expression as ``--where`` takes it. Words may tell
    servos by their ``names``.

    Raises:
        InputError: it is no filter.
    """
    if not text.strip():
        return None
    found = [_WORD.fullmatch(word) for word in text.split()]
    called = names or ServoNames()
    if not all(found):
        return SelectionFilter(text, called)
    return WordFilter([_word(one[1], one[2], one[3], called) for one in found if one])


def completions(index: CaptureIndex) -> dict[str, list[str]]:
    """Return by word what may stand behind it, as far as it was met in a capture."""
    recent = index.lines[-(1 << 16) :]
    servos = np.unique(recent["servo"])
    codes = np.unique(index.found["code"][-(1 << 16) :])
    return {
        "servo": [
            *(str(s) for s in servos.tolist() if s >= 0),
            *(name for name in index.names.known if not set(name) & set(" ,'()=")),
        ],
        "kind": list(KIND_NAMES),
        "op": sorted(index.ops),
        "code": [CODES[c] for c in codes.tolist()],
        "bus": list(dict.fromkeys([*index.wires, *index.buses])),
        "outcome": list(OUTCOMES),
        "severity": list(SEVERITIES),
    }


def completed(text: str, known: dict[str, list[str]]) -> str | None:
    """Return a filter line with its last word completed, None where nothing is known of it."""
    head, _, last = text.rpartition(" ")
    before = f"{head} " if head else ""
    key, sign, value = re.fullmatch(r"([^!=]*)(!?=?)(.*)", last, re.DOTALL).groups()  # type: ignore[union-attr]
    if not sign:
        fits = [f"{w}=" for w in WORDS if w.startswith(key)]
        fits += [
            c for columns in TABLES.values() for c in columns if c.startswith(key) and c != key
        ]
        return before + fits[0] if fits and key else None
    done, comma, part = value.rpartition(",")
    fits = [v for v in known.get(key, ()) if v.startswith(part) and v != part]
    return f"{before}{key}{sign}{done}{comma}{fits[0]}" if fits else None


def _word(key: str, sign: str, value: str, names: ServoNames) -> FilterWord:
    if key not in WORDS:
        raise InputError(f"nothing is called {key[:40]!r}: {offered(key[:40], WORDS)}")
    named = tuple(part for part in value.split(",") if part)
    known = {"kind": KIND_NAMES, "outcome": OUTCOMES, "severity": SEVERITIES, "code": CODES}
    for name in named:
        if key in known and name.replace("-", "_") not in {k.replace("-", "_") for k in known[key]}:
            near = nearly(name[:40], known[key]) or f": one of {', '.join(known[key][:8])}"
            raise InputError(f"{key} {name[:40]!r} is not known{near}")
        if key == "servo" and _id(name) is None:
            if not names:
                raise InputError(f"servo {name[:40]!r} is no id: write servo=3,5")
            try:
                names.having(name)
            except InputError as error:
                raise InputError(complaint(error)) from None
    return FilterWord(key, named, sign == "!=")


def _of_servos(index: CaptureIndex, lines: Table, named: Sequence[str]) -> Mask:
    """Tell which lines are of servos that are told by id or name; each bus has names of its own."""
    ids = [servo for name in named if (servo := _id(name)) is not None]
    met: Mask = np.isin(lines["servo"], ids)
    for name in (name for name in named if _id(name) is None):
        for number, bus in enumerate(index.buses):
            ids = index.names.ids(bus, name)
            met |= (lines["bus"] == number) & np.isin(lines["servo"], ids)
    return met


def _id(name: str) -> int | None:
    return number_in(name, 0, IDS - 1)


def _wanted(index: CaptureIndex, word: FilterWord) -> tuple[str, list[int]]:
    """Return a column and the numbers in it that a word names."""
    match word.key:
        case "kind":
            return "kind", _numbers(KIND_NAMES, word.named)
        case "outcome":
            return "outcome", _numbers(OUTCOMES, word.named)
        case "severity":
            return "severity", [n + 1 for n in _numbers(SEVERITIES, word.named)]
        case "bus":
            return "bus", _numbers(index.buses, word.named) + _numbers(index.wires, word.named)
        case _:
            return "op", _numbers(index.ops, word.named)


def _numbers(names: Sequence[str], wanted: Sequence[str]) -> list[int]:
    told = [name.replace("-", "_").lower() for name in wanted]
    return [i for i, name in enumerate(names) if name.replace("-", "_").lower() in told]


def _coded(index: CaptureIndex, numbers: I64, named: Sequence[str]) -> Mask:
    """Tell in which lines one of these codes was found."""
    found = index.found
    mine = np.isin(found["code"], _numbers(CODES, named))
    return np.isin(numbers, found["line"][mine])


def _is_run(numbers: I64) -> bool:
    """Tell whether each number follows the one before: other halves of exchanges are no run."""
    spans = len(numbers) > 0 and int(numbers[-1]) - int(numbers[0]) + 1 == len(numbers)
    return spans and bool((np.diff(numbers) == 1).all())
