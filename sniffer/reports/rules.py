"""Rules that a capture is held to, read from TOML: ``docs/checking.md`` tells them for their users.

A rule names what it is about (``what``), what it asks of it (a bound), and of whom (bus, servos).
"""

from __future__ import annotations

import difflib
import math
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.decoding.called import is_name
from sniffer.decoding.durations import FIGURES
from sniffer.diagnosis.causes import CAUSES
from sniffer.ground.limits import IDS
from sniffer.ground.model import InputError, Severity, SnifferError
from sniffer.ground.toml import text_of
from sniffer.ground.wording import and_, spelled

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sniffer.decoding.called import ServoNames

BOUNDS: Final = ("below", "at_most", "above", "at_least")
"""What a rule may ask of a figure; one of them or two."""

INCIDENTS, ANOMALIES = "incidents", "anomalies"
RESPONSE_TIME, VALUE, GOALS = "response_time_ms", "value", "goals_acknowledged"
MISSING, DAMAGED = "answers_missing", "answers_damaged"
FOLLOWING, LAG, SETTLING = "following_error", "lag_ms", "settle_ms"
STARTING, UNREACHED = "first_motion_ms", "goals_not_reached"
IN_FRAMES, FRAMES, SECONDS = "bytes_in_frames", "frames", "seconds"

KINDS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        INCIDENTS: ("causes", "from", "confidence"),
        ANOMALIES: ("codes", "from"),
        RESPONSE_TIME: ("figure",),
        VALUE: ("quantity",),
        FOLLOWING: ("figure",),
        LAG: (),
        SETTLING: ("figure",),
        STARTING: ("figure",),
        UNREACHED: (),
        GOALS: (),
        MISSING: (),
        DAMAGED: (),
        IN_FRAMES: (),
        FRAMES: (),
        SECONDS: (),
    }
)
"""What a rule may be about, with the keys that it has of its own."""

OF_EACH: Final = frozenset(
    {RESPONSE_TIME, VALUE, FOLLOWING, LAG, SETTLING, STARTING, UNREACHED, GOALS, MISSING, DAMAGED}
)
"""Rules that each servo must keep, so that one who was never heard decides nothing."""

OF_SERVOS: Final = OF_EACH | {INCIDENTS, ANOMALIES}
"""Rules that may name servos."""

SHARES: Final = frozenset({GOALS, MISSING, DAMAGED, IN_FRAMES})
"""Rules whose figure is a share, 0..1."""

USUAL: Final[Mapping[str, Mapping[str, float]]] = MappingProxyType(
    {
        INCIDENTS: {"at_most": 0},
        ANOMALIES: {"at_most": 0},
        UNREACHED: {"at_most": 0},
        GOALS: {"at_least": 1},
    }
)
"""Bounds of rules that state none: none of them, and all of them."""

COMMON: Final = ("name", "what", "bus", "servos", "undecided", *BOUNDS)

PASS, FAIL = "pass", "fail"
UNDECIDED: Final = (FAIL, PASS)
"""How a rule counts that cannot be decided."""

_SEVERITIES: Final = tuple(s.name.lower() for s in Severity)


@dataclass(frozen=True, slots=True)
class Rule:
    """One rule.

    ``bounds`` are figures by name (``BOUNDS``); ``named`` are the causes or codes that count, all
    of them where empty, ``least`` the severity and ``sure`` the confidence from which on they do.
    ``servos`` and ``bus`` say of whom; all where empty. ``is_lenient``: what cannot be decided
    passes.
    """

    name: str
    what: str
    bounds: Mapping[str, float]
    named: tuple[str, ...] = ()
    least: Severity = Severity.NOTE
    sure: float = 0.0
    figure: str = "p99"
    quantity: str = ""
    bus: str = ""
    servos: tuple[int, ...] = ()
    is_lenient: bool = False
    called: tuple[str, ...] = ()
    """Servos that are told by name; ``meant`` has their ids."""

    def meant(self, names: ServoNames) -> Rule:
        """Return the rule on ids; servos with names of one bus make it a rule on that bus.

        Raises:
            InputError: no servo is called so, or they are on several buses.
        """
        if not self.called:
            return self
        ids: list[int] = list(self.servos)
        buses: dict[str, None] = {}
        for name in self.called:
            try:
                found = [who for who, _ in names.having(name)]
            except InputError as error:
                told = spelled(error, lambda argument, _: argument[0])
                raise InputError(f"rule {self.name!r}: {told}") from None
            mine = [w for w in found if isinstance(w, int) or self.bus in ("", w[0])]
            if not mine:
                raise InputError(f"rule {self.name!r}: no servo of {self.bus} is called {name!r}")
            buses |= dict.fromkeys(who[0] for who in mine if isinstance(who, tuple))
            ids += [who if isinstance(who, int) else who[1] for who in mine]
        if len(buses) > 1:
            told = f"its servos are those of {and_(list(buses))}: write a rule for each bus"
            raise InputError(f"rule {self.name!r}: {told}")
        bus = self.bus or next(iter(buses), "")
        return replace(self, servos=tuple(dict.fromkeys(ids)), called=(), bus=bus)

    @property
    def asked(self) -> str:
        """What is asked, in words: ``below 5``."""
        if self.bounds == {"at_most": 0} and self.what not in SHARES:
            return "none"
        factor, unit = (100, " %") if self.what in SHARES else (1, "")
        told = {bound: f"{factor * value:g}{unit}" for bound, value in self.bounds.items()}
        return " and ".join(f"{bound.replace('_', ' ')} {value}" for bound, value in told.items())


def example() -> str:
    """Return a file of rules to begin with."""
    return Path(__file__).with_name("example.toml").read_text(encoding="utf-8")


def read_rules(path: Path) -> tuple[Rule, ...]:
    """Read the rules of a file.

    Raises:
        SnifferError: it cannot be read, or a line of it cannot be understood.
    """
    return rules_of(text_of(path, "rules are"), str(path))


def rules_of(text: str, name: str = "rules") -> tuple[Rule, ...]:
    """Read rules from TOML; ``name`` is what complaints call it.

    Raises:
        SnifferError: a line of it cannot be understood.
    """
    try:
        told = tomllib.loads(text)
        _known(told, ("rule", "undecided"), "")
        entries = told.get("rule", [])
        if not isinstance(entries, list) or not all(isinstance(e, dict) for e in entries):
            raise ValueError("each rule begins with a line [[rule]]")
        if not entries:
            raise ValueError("there is no rule in it: each begins with a line [[rule]]")
        usual = _choice(told.get("undecided", FAIL), UNDECIDED, "undecided")
        return tuple(_rule(entry, n, usual) for n, entry in enumerate(entries, 1))
    except ValueError as error:  # also one of TOML itself
        raise SnifferError(f"{name}: {error}") from None


def _rule(entry: Mapping[str, Any], nth: int, usual: str) -> Rule:
    """Read one rule; what cannot be is told with its name."""
    title = entry.get("name", "")
    who = f"rule {title[:60]!r}" if isinstance(title, str) and title else f"rule {nth}"
    try:
        return _made(entry, nth, usual)
    except ValueError as error:
        raise ValueError(f"{who}: {error}") from None


def _made(entry: Mapping[str, Any], nth: int, usual: str) -> Rule:
    every = {key for keys in KINDS.values() for key in keys}
    _known(entry, (*COMMON, *sorted(every)), "")
    if "what" not in entry:
        raise ValueError(f"it does not say what it is about: what = one of {', '.join(KINDS)}")
    what = _choice(entry["what"], tuple(KINDS), "what")
    _known(entry, (*COMMON, *KINDS[what]), f" where what is {what}")
    if "servos" in entry and what not in OF_SERVOS:
        raise ValueError(f"{what} is not told of servos: leave servos out")
    quantity = _text(entry, "quantity")
    if what == VALUE and not quantity:
        raise ValueError('it does not say which value: quantity = "voltage", for example')
    title = _text(entry, "name")
    return Rule(
        name=title or _usual_name(what, entry, nth),
        what=what,
        bounds=_bounds(entry, what),
        named=_named(entry, what),
        least=Severity[_choice(entry.get("from", "note"), _SEVERITIES, "from").upper()],
        sure=_number(entry.get("confidence", 0), "confidence"),
        figure=_choice(entry.get("figure", "p99"), tuple(FIGURES), "figure"),
        quantity=quantity,
        bus=_text(entry, "bus"),
        servos=tuple(who for who in _servos(entry) if isinstance(who, int)),
        called=tuple(who for who in _servos(entry) if isinstance(who, str)),
        is_lenient=_choice(entry.get("undecided", usual), UNDECIDED, "undecided") == PASS,
    )


def _usual_name(what: str, entry: Mapping[str, Any], nth: int) -> str:
    told = entry.get("quantity") or entry.get("figure") or ""
    return f"{nth}: {what.replace('_', ' ')}" + (f" {told}" if told else "")


def _bounds(entry: Mapping[str, Any], what: str) -> Mapping[str, float]:
    out: dict[str, float] = {}
    for bound in BOUNDS:
        if bound in entry:
            out[bound] = _number(entry[bound], bound)
            if what in SHARES and not 0 <= out[bound] <= 1:
                raise ValueError(f"{bound} is a share of 0..1, not {out[bound]:g}")
    if not out and what not in USUAL:
        raise ValueError(f"it asks for nothing: write one of {', '.join(BOUNDS)}")
    return out or USUAL[what]


def _number(value: Any, key: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{key} is a number to reckon with, not {value!r:.40}")
    return float(value)


def _named(entry: Mapping[str, Any], what: str) -> tuple[str, ...]:
    key, known = ("causes", CAUSES) if what == INCIDENTS else ("codes", CATALOGUE)
    given = entry.get(key, [])
    if not isinstance(given, list) or not all(isinstance(g, str) for g in given):
        raise ValueError(f"{key} is a list of texts")
    return tuple(_choice(one, tuple(known), key[:-1]) for one in given)


def _servos(entry: Mapping[str, Any]) -> list[int | str]:
    given = entry.get("servos", [])
    is_list = isinstance(given, list) and all(
        (isinstance(i, int) and not isinstance(i, bool) and 0 <= i < IDS)
        or (isinstance(i, str) and is_name(i))
        for i in given
    )
    if not is_list:
        raise ValueError(f"servos is a list of ids of 0..{IDS - 1}, or of names")
    return list(given)


def _text(entry: Mapping[str, Any], key: str) -> str:
    value = entry.get(key, "")
    if not isinstance(value, str):
        raise ValueError(f"{key} is a text, not {value!r:.40}")
    return value


def _known(entry: Mapping[str, Any], keys: Sequence[str], where: str) -> None:
    for key in entry:
        if key not in keys:
            raise ValueError(f"there is no key {key[:40]!r}{where}: {_near(key, keys)}")


def _choice(value: Any, known: Sequence[str], key: str) -> str:
    if not isinstance(value, str) or value not in known:
        raise ValueError(f"no {key} {value!r:.40}: {_near(str(value), known)}")
    return value


def _near(given: str, known: Iterable[str]) -> str:
    """Return what may have been meant, or all that there is."""
    names = list(known)
    near = difflib.get_close_matches(given, names, 1)
    return f"did you mean {near[0]}?" if near else f"one of {', '.join(names)}"
