"""Texts for people: those that come from outside, and sentences that name arguments."""

from __future__ import annotations

import re
import string
from itertools import groupby
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

WORD: Final = 300
"""A name longer than this is shown by its beginning and its end: paths in use are shorter."""

LINE: Final = 4000
"""A message is no longer than this."""

_ODD: Final = re.compile(r"[^\w.-]+")
"""What of the name of a bus does not go into that of a file."""

_LONG: Final = re.compile(rf"\S{{{WORD + 1},}}")


def plain(text: str) -> str:
    """Return a text from the input so that it cannot steer the terminal."""
    return text if text.isprintable() else ascii(text)[1:-1]


def as_text(name: str) -> str:
    """Return the name of a file as UTF-8; bytes of it that are none are written as escapes."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def short(text: str) -> str:
    """Return a text whose endless words are cut in the middle."""
    return _LONG.sub(lambda word: f"{word[0][: WORD - 60]}…{word[0][-59:]}", text)


def one_line(message: str) -> str:
    """Return a message as one line of bounded length."""
    line = short(plain(" ".join(message.split())))
    return line if len(line) <= LINE else f"{line[: LINE - 1]}…"


def and_(words: list[str]) -> str:
    """Return words as a list that people read: ``a, b and c``."""
    return ", ".join(words[:-1]) + " and " + words[-1] if len(words) > 1 else "".join(words)


def in_file_name(bus: str) -> str:
    """Return a bus as the name of a file can have it: ``_`` for what paths do not hold."""
    return _ODD.sub("_", bus)


def sums_in_words(got: int, expected: int) -> str:
    """Return what a checksum is and should be, both of as many digits."""
    return " not ".join(sums_in_hex(got, expected))


def sums_in_hex(*sums: int) -> list[str]:
    """Return checksums as they are written, all with as many digits."""
    digits = 4 if max(sums, default=0) > 0xFF else 2
    return [f"{value:0{digits}X}" for value in sums]


def offered(word: str, known: Iterable[str]) -> str:
    """Return what there is in place of a word that is not known, and which was probably meant."""
    names = list(known)
    return f"one of {', '.join(names)}{nearly(word, names)}"


def nearly(word: str, known: Iterable[str]) -> str:
    """Return the question whether another word was meant, for the end of a sentence, or nothing."""
    import difflib  # only who is mistaken waits for it

    near = difflib.get_close_matches(word, list(known), 1)
    return f": did you mean {near[0]}?" if near else ""


class Sentence(str):
    """A sentence that names arguments of a call, written once for all faces.

    As text it has the names of the Python API; ``spelled`` gives it in those of another face, the
    command line's options for instance. Fields in braces without a value are arguments, more than
    one behind ``|`` where several are meant; what stands behind a colon is what an argument is set
    to. Values may be sentences themselves.

    >>> text = Sentence("{file} is there already: say {overwrite:True}", file="run.mcap")
    >>> str(text)
    'run.mcap is there already: say `overwrite=True`'
    >>> text.spelled(lambda names, value: "--force")
    'run.mcap is there already: say --force'
    """

    __slots__ = ("_template", "_values")
    _template: str
    _values: dict[str, object]

    def __new__(cls, template: str, **values: object) -> Sentence:
        """Write a sentence."""
        out = super().__new__(cls, _filled(template, values, _argument))
        out._template, out._values = template, values
        return out

    def told_of(self, **values: object) -> Sentence:
        """Return the same sentence with other values."""
        return Sentence(self._template, **{**self._values, **values})

    def spelled(self, spell: Callable[[tuple[str, ...], str], str]) -> str:
        """Return it with arguments as ``spell`` has them: their names, and the value or nothing."""
        return _filled(self._template, self._values, spell)


def spelled(text: object, spell: Callable[[tuple[str, ...], str], str]) -> str:
    """Return a text, or what an exception says, in the words of another face."""
    if isinstance(text, BaseException) and text.args:
        text = text.args[0] if isinstance(text.args[0], Sentence) else text
    return text.spelled(spell) if isinstance(text, Sentence) else str(text)


def _argument(names: tuple[str, ...], value: str) -> str:
    """Return arguments as Python has them."""
    bare = not value or value in ("True", "False", "None") or value.isdecimal()
    told = value if bare else repr(value)
    return " or ".join(f"`{name}={told}`" if value else f"`{name}`" for name in names)


def _filled(
    template: str, values: dict[str, object], spell: Callable[[tuple[str, ...], str], str]
) -> str:
    out = []
    for text, field, setting, _ in string.Formatter().parse(template):
        out.append(text)
        if field is None:
            continue
        if field in values:
            out.append(spelled(values[field], spell))
        else:
            out.append(spell(tuple(field.split("|")), _filled(setting or "", values, spell)))
    return "".join(out)


def counted(n: int, what: str) -> str:
    """Return a number with its noun."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def between(low: object, high: object, told: str) -> str:
    """Return a range, or ``told``, how the higher end is told, where both ends are the same."""
    return told if str(low) == str(high) else f"{low} to {told}"


def servos(ids: Iterable[int]) -> str:
    """Return servos as people name them: ``servo 3``, ``servos 1, 3 and 6-10``."""
    known = sorted(set(ids))
    rows = [
        [one for _, one in row]
        for _, row in groupby(enumerate(known), key=lambda at: at[1] - at[0])
    ]
    told = [
        part
        for row in rows
        for part in ([f"{row[0]}-{row[-1]}"] if len(row) > 2 else [str(one) for one in row])
    ]
    return f"servo{'s' if len(known) > 1 else ''} {and_(told)}" if known else ""
