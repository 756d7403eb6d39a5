"""``--where``: a strict subset of SQL's WHERE, read once and then a mask of each batch.

What is taken here means the same to any SQL engine; what SQL has beyond it is refused, with the
place of the mistake. NOT is carried down to the comparisons while it is read (NOT (a OR b) becomes
NOT a AND NOT b, NOT a < 1 becomes a >= 1). Behind that a row is selected where the expression is
true, and of SQL's three values only one needs a mask: a comparison with NULL is never true, and
neither is its opposite.
"""

from __future__ import annotations

import difflib
import math
from fractions import Fraction
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import InputError
from sniffer.ground.register import MEMORIES
from sniffer.ground.wording import Sentence
from sniffer.selection.columns import IS_TEXT, REALS, VALUES
from sniffer.selection.conditions import (
    COMPARE,
    INT64,
    Condition,
    all_of,
    any_of,
    columns,
    fits,
    is_null,
    numbers,
    one_of,
    texts,
)
from sniffer.selection.tokens import Token, conjuncts, tokens_of, wrong

if TYPE_CHECKING:
    from collections.abc import Iterable

LENGTH_MOST: Final = 10_000
"""Characters of an expression: nobody writes more, and a program's list of ids fits."""

DEPTH_MOST: Final = 50
"""Parentheses and NOTs inside each other: each is a call of the parser's."""

DIGITS_MOST: Final = 40
"""Characters of a number: 64-bit integers have 20."""

CLOSE: Final = 3
"""So many names that contain what was written are told: more are no help."""

EXAMPLE: Final = "servo_id = 3 AND op = 'read'"
"""Shown to who writes nothing."""

_RESERVED: Final = frozenset(
    ("and", "between", "false", "from", "group", "in", "is", "like", "not", "null", "offset")
) | {"or", "order", "select", "true", "where"}
"""Words that SQL keeps for itself; a column of such a name stands in double quotes."""

GRADED: Final = "severity"
"""The column of texts that have an order, which is not that of the alphabet."""

BY_ALPHABET: Final = (
    f"{GRADED} is a text, and 'error' stands before 'warn' in the alphabet: "
    f"write {GRADED} IN ('warn', 'error')"
)
"""What is said of severities that are compared by more and less."""

_SAME: Final = {"==": "=", "!=": "<>"}
_OPPOSITE: Final = {"=": "<>", "<>": "=", "<": ">=", ">=": "<", ">": "<=", "<=": ">"}
_TURNED: Final = {"=": "=", "<>": "<>", "<": ">", ">": "<", "<=": ">=", ">=": "<="}


class _Operand(NamedTuple):
    """A column (``name``) or a literal (``value``, a text, an integer or a fraction)."""

    token: Token
    name: str = ""
    value: str | int | Fraction = 0

    @property
    def is_text(self) -> bool:
        return IS_TEXT[self.name] if self.name else isinstance(self.value, str)


class Expression(NamedTuple):
    """An expression that was read: the columns it names, and when it is true."""

    text: str
    columns: tuple[str, ...]
    holds: Condition
    ands: tuple[str, ...]
    """What must be true of a row for all of it to be: the text is these, joined with AND."""


def read(text: str) -> Expression:
    """Read an expression.

    Raises:
        InputError: it is none; in one line, with the place.
    """
    return _Parser(text).whole()


HEADINGS: Final = {
    "id": "servo_id",
    "name": "servo_name",
    "command": "op",
    "verdict": "outcome",
    "time": "t_ns, in ns since 1970",
    "values": "value, of the quantity or register that is named beside it",
    "anomaly": "code",
    "level": "severity",
}
"""What people see above columns of a listing and type here, with the columns that it is made of."""

OF_MEMORY: Final = frozenset(
    {"volatile", "nonvolatile", "non_volatile", "eeprom", "flash", "ram", "rom"}
)
"""What people call where a register stands."""


def _no_column(name: str) -> str:
    """Return that there is no such column; of what servos tell, how it is asked for."""
    if (column := HEADINGS.get(name.lower())) is not None:
        return f"there is no such column: what is shown as {name} is {column}"
    if name.lower() in OF_MEMORY:
        either = "' or '".join(MEMORIES)
        return f"there is no such column: where a register stands is memory, '{either}'"
    from sniffer.protocols import PROTOCOLS  # what is not meant by every user is read by few

    every = [r for protocol in PROTOCOLS.values() for r in protocol.registers]
    for what, known in (
        ("quantity", {r.quantity for r in every}),
        ("register", {r.name for r in every}),
    ):
        if name in known:
            return f"{name} is a {what}: write {what} = '{name}' AND value ..."
    return f"there is no such column: {near(name, IS_TEXT)}"


def near(name: str, known: Iterable[str]) -> str:
    """Return a question whether a known name was meant, or which there are."""
    names = list(known)
    close = difflib.get_close_matches(name.lower(), names, 1)
    close = close or [each for each in names if name and name.lower() in each.lower()][:CLOSE]
    return f"did you mean {' or '.join(close)}?" if close else f"one of {', '.join(names)}"


class _Parser:
    """Recursive descent; ``flip`` is whether an odd number of NOTs stands before."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0
        self._depth = 0
        self._columns: dict[str, None] = {}
        if len(text) > LENGTH_MOST:
            raise InputError(Sentence("{where} takes {most} characters", most=LENGTH_MOST))
        self._tokens = tokens_of(text)

    def whole(self) -> Expression:
        if self._now.kind == "end":
            raise InputError(Sentence("{where} is empty: write it like {like}", like=EXAMPLE))
        holds = self._either(flip=False)
        token = self._now
        if token.kind != "end":
            why = "a parenthesis too many" if token.text == ")" else "expected AND, OR or the end"
            raise self._wrong(token, why)
        return Expression(
            self._text.strip(), tuple(self._columns), holds, conjuncts(self._text, self._tokens)
        )

    # what stands where

    @property
    def _now(self) -> Token:
        return self._tokens[self._at]

    def _next(self) -> Token:
        token = self._now
        self._at += token.kind != "end"
        return token

    def _is(self, *words: str) -> bool:
        return self._now.lower in words or (self._now.kind == "sign" and self._now.text in words)

    def _took(self, *words: str) -> bool:
        if self._is(*words):
            self._next()
            return True
        return False

    def _must(self, word: str, why: str) -> None:
        if not self._took(word):
            raise self._wrong(self._now, why)

    def _wrong(self, token: Token, why: str) -> InputError:
        return wrong(self._text, token.at, why)

    # grammar, from the loosest to the tightest

    def _either(self, *, flip: bool) -> Condition:
        parts = [self._both(flip=flip)]
        while self._took("or"):
            parts.append(self._both(flip=flip))
        return all_of(parts) if flip else any_of(parts)

    def _both(self, *, flip: bool) -> Condition:
        parts = [self._not(flip=flip)]
        while self._took("and"):
            parts.append(self._not(flip=flip))
        return any_of(parts) if flip else all_of(parts)

    def _not(self, *, flip: bool) -> Condition:
        self._depth += 1
        if self._depth > DEPTH_MOST:
            raise self._wrong(self._now, f"more than {DEPTH_MOST} parentheses inside each other")
        try:
            if self._took("not"):
                return self._not(flip=not flip)
            if self._took("("):
                inside = self._either(flip=flip)
                self._must(")", "expected a closing parenthesis, AND or OR")
                return inside
            return self._test(flip=flip)
        finally:
            self._depth -= 1

    def _test(self, *, flip: bool) -> Condition:
        if self._is("true", "false"):
            is_so = (self._next().lower == "true") is not flip
            return lambda ask: is_so
        left = self._operand()
        if self._took("is"):
            flip ^= self._took("not")
            self._must("null", "expected NULL behind IS")
            if not left.name:
                raise self._wrong(left.token, "only a column can be NULL")
            return is_null(left.name, flip=flip)
        if self._is("not"):
            self._next()
            flip = not flip
            if not self._is("in", "between", "like"):
                raise self._wrong(self._now, "expected IN, BETWEEN or LIKE behind NOT")
        if self._took("in"):
            return self._in(left, flip=flip)
        if self._took("between"):
            low = self._operand(left)
            self._must("and", "expected AND and the upper bound of BETWEEN")
            high = self._operand(left)
            bounds = [self._compare(left, ">=", low, flip), self._compare(left, "<=", high, flip)]
            return any_of(bounds) if flip else all_of(bounds)
        if self._took("like"):
            return self._like(left, flip=flip)
        sign = self._next()
        word = _SAME.get(sign.text, sign.text)
        if sign.kind != "sign" or word not in COMPARE:
            raise self._wrong(sign, self._no_comparison(left, sign))
        return self._compare(left, word, self._operand(left), flip)

    def _no_comparison(self, left: _Operand, sign: Token) -> str:
        told = left.name or left.token.text
        if sign.text in ("+", "-"):
            return "there is no arithmetic: compare columns with numbers, texts or each other"
        return f"expected a comparison behind {told}, such as {told} = 3"

    def _in(self, left: _Operand, *, flip: bool) -> Condition:
        self._must("(", "expected a list behind IN, such as (1, 2)")
        items = [self._operand(left)]
        while self._took(","):
            items.append(self._operand(left))
        self._must(")", "expected a comma or the end of the list")
        if left.name and all(not i.name for i in items):
            for item in items:
                self._check(left, item)
            if left.is_text:
                named = frozenset(str(item.value) for item in items)
                return texts(left.name, lambda text: (text in named) is not flip)
            whole = [i.value for i in items if isinstance(i.value, int) and abs(i.value) < INT64]
            if len(whole) == len(items) > 1 and left.name not in REALS and not flip:
                return one_of(left.name, whole, self._one_by_one(left, items, flip=False))
        return self._one_by_one(left, items, flip=flip)

    def _one_by_one(self, left: _Operand, items: list[_Operand], *, flip: bool) -> Condition:
        same = "<>" if flip else "="
        each = [self._compare(left, same, item, flip=False) for item in items]
        return all_of(each) if flip else any_of(each)

    def _like(self, left: _Operand, *, flip: bool) -> Condition:
        pattern = self._operand(left)
        if not left.name or not left.is_text:
            raise self._wrong(left.token, "LIKE is for columns of texts")
        if pattern.name or not pattern.is_text:
            raise self._wrong(pattern.token, "expected a text behind LIKE, such as 'read%'")
        like = fits(str(pattern.value))
        return texts(left.name, lambda text: like(text) is not flip)

    def _compare(self, left: _Operand, sign: str, right: _Operand, flip: bool) -> Condition:
        sign = _OPPOSITE[sign] if flip else sign
        if not left.name and right.name:
            left, right, sign = right, left, _TURNED[sign]
        self._check(left, right, sign in ("=", "<>"))
        compare = COMPARE[sign]
        if not left.name:
            is_so = bool(compare(left.value, right.value))
            return lambda ask: is_so
        if right.name:
            if left.is_text:
                why = "two columns of texts are not compared with each other"
                raise self._wrong(right.token, why)
            return columns(left.name, compare, right.name)
        if left.is_text:
            text = str(right.value)
            return texts(left.name, lambda name: bool(compare(name, text)))
        return numbers(left.name, sign, right.value)

    def _check(self, left: _Operand, right: _Operand, equals: bool = True) -> None:
        """Refuse to compare a text with a number, or with a name that can never be there."""
        if left.is_text != right.is_text:
            column, other = (left, right) if left.name else (right, left)
            if not column.name:
                raise self._wrong(right.token, "a text is compared with a number")
            kind = "texts" if column.is_text else "numbers"
            wanted = "'...'" if column.is_text else "a number without quotes"
            raise self._wrong(other.token, f"{column.name} holds {kind}: write {wanted}")
        if not equals and left.name == GRADED:
            raise self._wrong(left.token, BY_ALPHABET)
        if equals and left.name in VALUES and not right.name:
            names = VALUES[left.name]
            if right.value not in names:
                shown = [name for name in names if name]
                raise self._wrong(
                    right.token, f"{left.name} is never that: {near(str(right.value), shown)}"
                )

    def _operand(self, left: _Operand | None = None) -> _Operand:
        token = self._next()
        if token.kind == "text":
            return _Operand(token, value=token.text[1:-1].replace("''", "'"))
        if token.kind == "number":
            return _Operand(token, value=self._amount(token))
        if token.kind == "sign" and token.text in "+-" and self._now.kind == "number":
            amount = self._amount(self._next())
            return _Operand(token, value=-amount if token.text == "-" else amount)
        if token.kind == "quoted":
            name = token.text[1:-1].replace('""', '"')
            if name.lower() in IS_TEXT:
                return self._column(token, name.lower())
            if self._at > 1:
                raise self._wrong(token, "a text stands in single quotes, a column in double ones")
            raise self._wrong(token, f"there is no such column: {near(name, IS_TEXT)}")
        if token.kind == "word":
            return self._word(token, left)
        raise self._wrong(token, "expected a column, a number or a text")

    def _word(self, token: Token, left: _Operand | None) -> _Operand:
        name = token.lower
        if name in _RESERVED:
            if name in IS_TEXT:
                why = f'{name} is a word of SQL: as a column write "{name}", in double quotes'
            elif name == "null":
                why = "nothing is equal to NULL: write IS NULL or IS NOT NULL"
            else:
                why = "expected a column, a number or a text"
            raise self._wrong(token, why)
        if name in IS_TEXT:
            return self._column(token, name)
        if left is not None and left.is_text:
            raise self._wrong(token, f"a text stands in single quotes: '{token.text}'")
        raise self._wrong(token, _no_column(name))

    def _column(self, token: Token, name: str) -> _Operand:
        self._columns[name] = None
        return _Operand(token, name)

    def _amount(self, token: Token) -> int | Fraction:
        if len(token.text) > DIGITS_MOST:
            raise self._wrong(token, f"a number has {DIGITS_MOST} characters at most")
        if token.text.isdecimal():
            return int(token.text)
        amount = float(token.text)
        if not math.isfinite(amount):
            raise self._wrong(token, "this number is too large")
        # a power of ten may have more digits than there is memory: what a float says of it is all
        exact = Fraction(amount) if "e" in token.text.lower() else Fraction(token.text)
        return int(exact) if exact.denominator == 1 else exact
