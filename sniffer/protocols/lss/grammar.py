r"""Lynxmotion LSS: the lines of both directions, declared once, and the words that occur in them.

    '#' ID WORD [VALUE] { MODIFIER VALUE } CR          command
    '*' ID WORD [VALUE | TEXT] CR                      reply;  '*' QID VALUE CR: the one without id

Source: LSS Communication Protocol, wiki v106.1, Action Commands, Action Modifiers, Query Commands,
Configuration Commands. There is no checksum. The words come from the tables of the models,
``schemas/registers/lss*.toml``: which there are is the same for all, what a number behind one means
is each model's own.
"""

from __future__ import annotations

import functools
import re
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from construct import (
    Byte,
    Check,
    Const,
    ConstructError,
    ExprAdapter,
    ExprValidator,
    GreedyRange,
    OneOf,
    Struct,
)

from sniffer.ground.registers import load_models
from sniffer.protocols.base import joined

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.ground.registers import Register

MODELS: Final = load_models("lss", "lss-pro")
REGISTERS: Final = joined(MODELS)

_NONE: Final = (-1,) * len(MODELS)

COMMAND_MARK, REPLY_MARK, END = b"#", b"*", b"\r"

BROADCAST: Final = 254
"""All servos obey it, and each answers a query. Source: Command List 16; Details 1, 16."""

BUTTON_MODE: Final = 255
"""A servo put into this mode by its button obeys it and answers under its own id.
Source: Details 16. Identification Number (ID)."""

SERVO_IDS: Final = range(251)
"""Ids a servo can have. Source: Command List 16 (0 to 250)."""

IDS: Final = frozenset({*SERVO_IDS, BROADCAST, BUTTON_MODE})

LONGEST: Final = 96
"""Longest line in bytes, mark and CR included: a command of this protocol has 40 at most even with
three modifiers, client libraries have room for 31; the rest is margin. It bounds what a lost CR
can hold back."""

LINES: Final = 1 << 10
"""Lines of which is kept how they read: a bus repeats itself, and a line is read three times, for
its end, its fields and its values."""

ID_DIGITS: Final = 3
WORD_LETTERS: Final = 13
"""As many letters, packed to base 27, fit a 64-bit column; the longest word of the page has 7."""

NUMBER_DIGITS: Final = 18
"""As many digits fit a 64-bit column; the page's numbers have 10 at most (32 bit)."""

SELECTOR_MOST: Final = 32767
"""Greatest selector behind a query: what its column holds. The page has 1, 2 and 3."""

_DIGITS: Final = b"0123456789"
_LETTERS: Final = bytes(range(65, 91)) + bytes(range(97, 123))
_PRINTABLE: Final = bytes(b for b in range(0x20, 0x7F) if b not in COMMAND_MARK + REPLY_MARK)


def _run(characters: bytes, valid: str) -> Any:
    """Return the longest run of ``characters``, as text; it must match ``valid``."""
    text = ExprAdapter(
        GreedyRange(OneOf(Byte, characters)),
        lambda run, _: bytes(run).decode("ascii"),
        lambda text, _: list(text.encode("ascii")),
    )
    return ExprValidator(text, lambda text, _: re.fullmatch(valid, text) is not None)


ID: Final = ExprValidator(_run(_DIGITS, rf"\d{{1,{ID_DIGITS}}}"), lambda text, _: int(text) in IDS)
WORD: Final = _run(_LETTERS, rf".{{1,{WORD_LETTERS}}}")
VALUE: Final = _run(b"-" + _DIGITS, rf"(-?\d{{1,{NUMBER_DIGITS}}})?")
UNSIGNED: Final = _run(_DIGITS, rf"\d{{1,{NUMBER_DIGITS}}}")
TEXT: Final = _run(_PRINTABLE, r".+")

COMMAND: Final = Struct(
    "mark" / Const(COMMAND_MARK),
    "servo_id" / ID * "0..250 a servo, 254 all of them, 255 button mode",
    "word" / WORD,
    "value" / VALUE * "a number, or the selector of a query",
    "modifiers" / GreedyRange(Struct("word" / WORD, "value" / UNSIGNED)),
    "end" / Const(END),
)

REPLY: Final = Struct(
    "mark" / Const(REPLY_MARK),
    "servo_id" / ID,
    "word" / WORD,
    "value" / VALUE,
    "end" / Const(END),
)


def _is_id_query(x: Any) -> bool:
    return bool(x.word.upper() == "QID" and int(x.value) in SERVO_IDS)


ID_REPLY: Final = Struct(
    "mark" / Const(REPLY_MARK),
    "word" / WORD,
    "value" / _run(_DIGITS, rf"\d{{1,{ID_DIGITS}}}") * "the servo's id",
    Check(_is_id_query),
    "end" / Const(END),
)
"""The one reply without an id. Source: Details 16. Query Identification (QID)."""


def _by_model() -> Iterator[tuple[int, int, Register]]:
    """Yield each register with the row of its model and its own."""
    for m, model in enumerate(MODELS):
        for k, register in enumerate(model.registers):
            yield m, model.first + k, register


@dataclass(frozen=True, slots=True)
class Word:
    """What a command's word means; aliases share one ``Word``, ``name`` is the canonical one.

    By model: ``registers`` are stated by an action's or configuration's number (-1: none),
    ``answers`` tell by selector which one the reply to a query states. The default model has those
    of the others, too, where it has none of its own: such a word says itself whose it is.
    ``texts`` may stand in place of the number ("" nothing, "*" any). ``asks`` names what a query
    asks for in each model's own table, "" where it has no such query.
    """

    name: str
    kind: str
    registers: tuple[int, ...] = _NONE
    answers: tuple[Mapping[int, int], ...] = ({},) * len(MODELS)
    texts: Mapping[str, str] = field(default_factory=dict)
    asks: tuple[str, ...] = ("",) * len(MODELS)

    @property
    def register(self) -> int:
        """Return the register of the default model."""
        return self.registers[0]

    @property
    def selectors(self) -> Mapping[int, int]:
        """Return the selectors that any model knows, with the default model's registers."""
        return self.answers[0]

    @property
    def is_query(self) -> bool:
        """Tell whether the word asks."""
        return self.kind == "query"

    @property
    def takes_number(self) -> bool:
        """Tell whether a number may follow the word of an action or configuration."""
        decimal = any(r >= 0 and REGISTERS[r].type == "decimal" for r in self.registers)
        return decimal or self.kind == "unclear"

    @property
    def may_be_empty(self) -> bool:
        """Tell whether an action may go without a number, or a reply to a query."""
        return (
            "" in self.texts
            or (not self.is_query and not self.takes_number)
            or self.kind == "unclear"
        )


class Modifier(NamedTuple):
    """A modifier's register by model, and the actions (by word) a page allows it for."""

    registers: tuple[int, ...]
    modifies: tuple[str, ...]

    @property
    def register(self) -> int:
        """Return the register of the default model."""
        return self.registers[0]


def _first(registers: Sequence[int]) -> tuple[int, ...]:
    """Return registers by model; the default model takes another's where it has none."""
    own = next((r for r in registers if r >= 0), -1)
    return (own, *registers[1:])


def _words() -> dict[str, Word]:
    said: dict[str, list[int]] = {}
    names: dict[str, dict[str, None]] = {}
    kinds: dict[str, str] = {}
    asked: dict[str, list[dict[int, int]]] = {}
    texts: dict[str, dict[str, str]] = {}
    for m, i, r in _by_model():
        if r.kind not in ("query", "modifier"):
            said.setdefault(r.word, [*_NONE])[m] = i
            names.setdefault(r.word, {}).update(dict.fromkeys((r.word, *r.aliases)))
            kinds.setdefault(r.word, r.kind)
            texts.setdefault(r.word, {}).update(r.texts)
        queries = r.queries or ((r.word,) if r.kind == "query" else ())
        for query in queries:
            name = query.rstrip("0123456789")
            by_model = asked.setdefault(name, [{} for _ in MODELS])
            by_model[m][int(query[len(name) :] or 0)] = i
            texts.setdefault(name, {}).update(r.texts)
    words: dict[str, Word] = {}
    for name, registers in said.items():
        word = Word(name, kinds[name], _first(registers), texts=texts[name])
        words |= dict.fromkeys(names[name], word)
    for name, answers in asked.items():
        own = {s: r for by_selector in reversed(answers) for s, r in by_selector.items()}
        asks = tuple(next((REGISTERS[r].name for r in by.values()), "") for by in answers)
        words[name] = Word(name, "query", answers=(own, *answers[1:]), texts=texts[name], asks=asks)
    return words


def _modifiers() -> dict[str, Modifier]:
    registers: dict[str, list[int]] = {}
    modifies: dict[str, dict[str, None]] = {}
    for m, i, r in _by_model():
        if r.kind == "modifier":
            registers.setdefault(r.word, [*_NONE])[m] = i
            modifies.setdefault(r.word, {}).update(dict.fromkeys(r.modifies))
    return {w: Modifier(_first(by), tuple(modifies[w])) for w, by in registers.items()}


WORDS: Final[Mapping[str, Word]] = MappingProxyType(_words())
"""Every word a command may have, aliases included; selector 0 stands for none, too."""

MODIFIERS: Final[Mapping[str, Modifier]] = MappingProxyType(_modifiers())

TEXT_WORDS: Final = tuple(
    sorted((w for w, word in WORDS.items() if word.is_query and set(word.texts) - {""}), key=len)
)[::-1]
"""Queries answered with a text, the longest first: their text may begin with letters."""


def _text_reply(word: str) -> Any:
    letters = [OneOf(Byte, (c + c.lower()).encode()) for c in word]
    prefix = ExprAdapter(
        Struct(*(str(i) / one for i, one in enumerate(letters))),
        lambda x, _: "".join(chr(x[str(i)]) for i in range(len(word))),
        lambda text, _: {str(i): ord(c) for i, c in enumerate(text)},
    )
    return Struct(
        "mark" / Const(REPLY_MARK),
        "servo_id" / ID,
        "word" / prefix,
        "text" / TEXT,
        "end" / Const(END),
    )


TEXT_REPLIES: Final[Mapping[str, Any]] = MappingProxyType({w: _text_reply(w) for w in TEXT_WORDS})
"""Source: Details 18 (DIS), 20. Query Model String; dotted firmware versions: third-party code."""


def query_form(word: str) -> str:
    """Return a word with the Q that the page's example of QAR leaves out of the reply.

    Source: Details 7. Angular Range (AR). A word too long to take one stays as it is.
    """
    return word if word.startswith("Q") or len(word) == WORD_LETTERS else "Q" + word


@functools.lru_cache(LINES)
def fitting(raw: bytes) -> tuple[Any, Any] | None:
    """Return the grammar that a line fits, and what it made of it; None where none fits.

    A reply whose word is known and whose value is a number comes first, then the longest word
    that may be followed by a text, then any word with a number.
    """
    if raw[:1] == COMMAND_MARK:
        return _tried(COMMAND, raw)
    plain = _tried(REPLY, raw)
    if plain is not None:
        word = WORDS.get(query_form(plain[1].word.upper()))
        if word is not None and word.is_query:
            return plain
    for grammar in TEXT_REPLIES.values():
        found = _tried(grammar, raw)
        if found is not None:
            return found
    return plain or _tried(ID_REPLY, raw)


def _tried(grammar: Any, raw: bytes) -> tuple[Any, Any] | None:
    try:
        return grammar, grammar.parse(raw)
    except ConstructError:
        return None


def command(
    servo_id: int, word: str, value: int | None = None, modifiers: Mapping[str, int] | None = None
) -> bytes:
    """Build a command line; for a query ``value`` is its selector."""
    built: bytes = COMMAND.build(
        {
            "servo_id": str(servo_id),
            "word": word,
            "value": "" if value is None else str(value),
            "modifiers": [{"word": k, "value": str(v)} for k, v in (modifiers or {}).items()],
        }
    )
    return built


def reply(servo_id: int | None, word: str, value: int | str | None = None) -> bytes:
    """Build a reply line with a number, a text or nothing; without id only for QID."""
    fields = {"word": word, "value": "" if value is None else str(value)}
    if servo_id is None:
        built: bytes = ID_REPLY.build(fields)
    elif isinstance(value, str):
        built = TEXT_REPLIES[word].build({"servo_id": str(servo_id), "word": word, "text": value})
    else:
        built = REPLY.build({"servo_id": str(servo_id), **fields})
    return built


def packed(word: str) -> int:
    """Return a word (folded to upper case) as one number, base 27: A is 1, Z is 26."""
    number = 0
    for letter in word.upper():
        number = number * 27 + ord(letter) - 64
    return number


def unpacked(number: int) -> str:
    """Return the word that ``packed`` made a number of."""
    letters = ""
    while number > 0:
        number, letter = divmod(number, 27)
        letters = chr(64 + letter) + letters
    return letters
