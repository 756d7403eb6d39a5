"""The parts of an expression as masks: each gives the rows of a batch for which it is true."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.selection.columns import Names, Numbers
from sniffer.selection.texts import TextTest

if TYPE_CHECKING:
    from fractions import Fraction

    from sniffer.ground.model import Mask

MANY: Final = 8
"""From so many numbers on a list is looked up, not compared one by one."""

SHORT: Final = 1 << 15
"""Numbers of 16 bits lie below it; of these each has a place in a table."""

INT64: Final = 1 << 63

Ask = Callable[[str], Numbers | Names]
"""Gives a column by its name."""

Condition = Callable[[Ask], "Mask | bool"]
"""Gives the rows where it is true, or one answer for all."""

COMPARE: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "=": operator.eq,
    "<>": operator.ne,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
"""Comparisons by their signs."""


def all_of(parts: list[Condition]) -> Condition:
    """Return the condition that all hold."""
    if len(parts) == 1:
        return parts[0]

    def holds(ask: Ask) -> Mask | bool:
        mask = parts[0](ask)
        for part in parts[1:]:
            mask = mask & part(ask)
        return mask

    return holds


def any_of(parts: list[Condition]) -> Condition:
    """Return the condition that one of them holds."""
    if len(parts) == 1:
        return parts[0]

    def holds(ask: Ask) -> Mask | bool:
        mask = parts[0](ask)
        for part in parts[1:]:
            mask = mask | part(ask)
        return mask

    return holds


def is_null(name: str, *, flip: bool) -> Condition:
    """Return the condition that a column has no value; ``flip``: that it has one."""

    def holds(ask: Ask) -> Mask | bool:
        column = ask(name)
        if isinstance(column, Names):
            here = True if column.present is None else column.present()
        else:
            here = present(column.values, column.blank)
        if isinstance(here, bool):
            return here is flip
        return here if flip else np.logical_not(here)

    return holds


def texts(name: str, passes: Callable[[str], bool]) -> Condition:
    """Return the condition that the text of a column passes."""
    test = TextTest(passes)

    def holds(ask: Ask) -> Mask | bool:
        column = ask(name)
        assert isinstance(column, Names)
        return column.test(test)

    return holds


def numbers(name: str, sign: str, value: Any) -> Condition:
    """Return the condition that a column compares so with a number."""
    rough = COMPARE[sign], float(value)
    whole = _whole(sign, value)
    limits: dict[Any, Any] = {}
    # what stands for NULL may pass a comparison, too; where it cannot, nobody need look for it
    passes_blank = COMPARE[sign](-1, value)

    def holds(ask: Ask) -> Mask | bool:
        column = ask(name)
        assert isinstance(column, Numbers)
        values, blank = column
        kind = values.dtype
        if kind.kind == "f":
            compare, limit = rough
            mask: Mask = compare(values, limit)
            return mask & present(values, blank) if sign == "<>" else mask
        if isinstance(whole, bool):
            mask = np.full(len(values), whole)
        else:
            compare, limit = whole
            told = limits.get(kind)
            if told is None:
                told = limits[kind] = _as(kind, limit)
            mask = compare(values, told)
        return mask & present(values, blank) if passes_blank else mask

    return holds


def one_of(name: str, values: list[int], one_by_one: Condition) -> Condition:
    """Return the condition that a column has one of some whole numbers.

    ``one_by_one`` says the same by a comparison with each.
    """
    known = np.array(values, np.int64)
    small = np.zeros(1 << 16, bool)  # by number, those below 0 from the end as an index has it
    small[[n for n in values if -SHORT <= n < SHORT]] = True

    def holds(ask: Ask) -> Mask | bool:
        column = ask(name)
        assert isinstance(column, Numbers)
        if column.values.dtype == np.int16:
            mask: Mask = small[column.values]
        elif len(values) < MANY:
            return one_by_one(ask)
        else:
            mask = np.isin(column.values, known)
        return mask & present(*column) if -1 in values else mask

    return holds


def fits(pattern: str) -> Callable[[str], bool]:
    """Return the test of SQL's LIKE: % is any text, _ any character."""
    first, *rest = (re.escape(part).replace("_", ".") for part in pattern.split("%"))
    # what stands between two % fits best where it fits first: no other place is tried
    middle = "".join(f"(?>.*?{part})" for part in rest[:-1])
    whole = re.compile(first + middle + (f".*{rest[-1]}" if rest else ""), re.DOTALL)
    return lambda text: whole.fullmatch(text) is not None


def present(values: Any, blank: float | None) -> Mask | bool:
    """Return which values are not missing; NaN alone is not equal to itself."""
    if blank is None:
        return True
    mask: Mask = values >= 0 if blank == -1 else values == values
    return mask


def _whole(sign: str, value: int | Fraction) -> bool | tuple[Callable[[Any, Any], Any], int]:
    """Return the comparison with a whole number that says the same of whole numbers."""
    if isinstance(value, int):
        return COMPARE[sign], value
    if sign in ("=", "<>"):
        return sign == "<>"
    is_less = sign in ("<", "<=")
    return (operator.le, math.floor(value)) if is_less else (operator.ge, math.ceil(value))


def _as(kind: np.dtype[Any], number: int) -> Any:
    """Return a whole number as a column's own, which takes half the time of few rows to compare.

    What a column of this kind cannot have stays Python's, of which numpy knows what that means.
    """
    range_ = np.iinfo(kind)
    return np.array(number, kind) if range_.min <= number <= range_.max else number


def columns(left: str, compare: Callable[[Any, Any], Any], right: str) -> Condition:
    """Return the condition that two columns of numbers compare so."""

    def holds(ask: Ask) -> Mask | bool:
        one, other = ask(left), ask(right)
        assert isinstance(one, Numbers)
        assert isinstance(other, Numbers)
        mask: Mask = compare(one.values, other.values)
        return mask & present(*one) & present(*other)

    return holds
