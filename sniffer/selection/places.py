"""Places in a capture, as people write them: ``10min``, ``20:35:20.5``, ``@first-error``.

``--from`` and ``--to`` take them. A time counts from the first byte of the capture, with a minus
back from its last record; a time of day is UTC, as the table prints it. What begins with ``@``
stands where something was found: somebody has to look for it first, as for the end.
"""

from __future__ import annotations

import contextlib
import datetime
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from sniffer.decoding.called import is_name
from sniffer.ground.amounts import time_in
from sniffer.ground.limits import IDS, OFFSET_END, TIME_END_NS, number_in
from sniffer.ground.model import NS, InputError
from sniffer.ground.moments import DAY_NS
from sniffer.ground.wording import Sentence, and_
from sniffer.selection.columns import SEVERITIES, VALUES
from sniffer.selection.expression import near

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.called import ServoNames

END: Final = "end"
"""What is sought of a place that is so long before the end of a capture."""


_SECONDS: Final = re.compile(r"[0-9]{1,12}(\.[0-9]*)?|\.[0-9]+")
_CLOCK: Final = re.compile(r"([01]?\d|2[0-3]):([0-5]\d)(?::([0-5]\d)(?:\.(\d{1,9}))?)?")
_ISO: Final = re.compile(
    r"\d{4}-\d\d-\d\d"
    r"(?:[T ]\d\d:\d\d(?::\d\d)?(?:[.,](?P<part>\d{1,9}))?(?:Z|[+-]\d\d:?\d\d)?)?"
)
_FORMS: Final = (
    "10, 10min, 20:35:20.5, 2026-01-31T20:35:20Z, @first-error, @byte:12175, @anomaly:7, or -5s "
    "(before the end)"
)

FRESH: Final = "pty"
"""The port that stands for a pseudo-terminal which is made for it."""

_OF_SERVO: Final = ":servo="
"""Behind the place of an anomaly: of one servo's."""

_FROM_THERE: Final = re.compile(r"(@.+[^-+])([-+])((?:\d+(?:\.\d*)?|\.\d+)[a-z]+)", re.IGNORECASE)
"""A place and how long before or behind it: ``@first-error-100ms``. No code ends with a time."""

_PORT: Final = re.compile(rf"{FRESH}|COM[0-9]+|\.{{0,2}}/.*", re.IGNORECASE)

SINCE, OF_DAY, MOMENT, FOUND = "since", "of_day", "moment", "found"
"""What the number of a place is: ns from the capture's first byte, from midnight, or from 1970;
or none before it was looked for."""


@dataclass(frozen=True, slots=True)
class CapturePlace:
    """A place in a capture; ``text`` is how it was written, ``kind`` what ``ns`` counts from.

    What is to be looked for is ``sought``: ``byte`` (of ``bus``, if one is named), ``anomaly``, a
    severity or a code, or the ``end``; ``number`` is that of the byte, or which of them is meant,
    from 1, or how many ns before the end; where ``servo`` is told, an id or a name, of those about
    this one. What is meant is ``shift_ns`` behind what is found.
    """

    text: str
    kind: str
    ns: int = 0
    sought: str = ""
    number: int = 0
    bus: str = ""
    servo: int | str | None = None
    shift_ns: int = 0

    @property
    def is_counted(self) -> bool:
        """Whether it is one of the anomalies of a kind, of which a selection may have fewer."""
        return self.sought not in ("", "byte", "anomaly", END)

    @property
    def is_stamp(self) -> bool:
        """Whether it is what stamps say, and not a time since the capture began."""
        return self.kind in (OF_DAY, MOMENT) and not self.sought

    def about(self, bus: str, names: ServoNames) -> list[int]:
        """Return the ids of the servos of a bus that are meant, where one is told."""
        if isinstance(self.servo, str):
            return names.ids(bus, self.servo)
        return [] if self.servo is None else [self.servo]

    def known_by(self, names: ServoNames) -> None:
        """Refuse a name that nobody has.

        Raises:
            InputError: it says which name is near.
        """
        if isinstance(self.servo, str) and (why := names.nobody(self.servo)) is not None:
            if not names:
                raise InputError(_no_id(self.text, self.text.partition(_OF_SERVO)[0]))
            raise InputError(f"{self.text}: {why}")

    def at(self, first_ns: int | None) -> int:
        """Return the time that is meant; ``first_ns`` is when the capture begins, None: no clock.

        Raises:
            InputError: it has no clock, and a time of day or a date is meant.
        """
        if self.kind == SINCE:
            return (first_ns or 0) + self.ns
        if self.sought:  # found: a time that the decoder gave, of the wire's pace without a clock
            return self.ns
        if first_ns is None:
            told = "{place}: the input has no clock: count from its beginning, as in 2.5 or 10min"
            raise InputError(Sentence(told, place=self.text))
        if self.kind == OF_DAY:  # the first one that is not before the capture
            passed = (first_ns - self.ns) % DAY_NS
            return first_ns - passed if passed < DAY_NS // 2 else first_ns - passed + DAY_NS
        return self.ns

    def found(self, t_ns: int) -> CapturePlace:
        """Return the place once it is found."""
        return replace(self, kind=MOMENT, ns=t_ns + self.shift_ns)


def names_port(text: str) -> bool:
    """Tell whether a text names a port instead of a place: a path, COM<n>, or ``pty``."""
    return _PORT.fullmatch(text) is not None


def names_anomaly(word: str) -> bool:
    """Tell whether a word names anomalies in a place: ``anomaly``, a severity or a code."""
    return word == "anomaly" or word in SEVERITIES or word in VALUES["code"]


def place_in(text: str) -> CapturePlace:
    """Read a place.

    Raises:
        InputError: it is none; in one line, with the forms that there are.
    """
    plain = text.strip()
    if plain.startswith("@"):
        apart = _FROM_THERE.fullmatch(plain)
        shift_ns = None if apart is None else time_in(apart[3], bare=False)
        if apart is None or shift_ns is None:
            return _sought(plain)
        shift_ns = -shift_ns if apart[2] == "-" else shift_ns
        return replace(_sought(apart[1]), text=plain, shift_ns=shift_ns)
    if (ns := _duration(plain.removeprefix("-"))) is not None:
        if plain.startswith("-"):
            return CapturePlace(plain, FOUND, sought=END, number=ns)
        return CapturePlace(plain, SINCE, ns)
    if (match := _CLOCK.fullmatch(plain)) is not None:
        hours, minutes, seconds = (int(part or "0") for part in match.groups()[:3])
        ns = (hours * 3600 + minutes * 60 + seconds) * NS + _ns(match[4] or "")
        return CapturePlace(plain, OF_DAY, ns)
    if (match := _ISO.fullmatch(plain)) is not None:
        return CapturePlace(plain, MOMENT, _moment(plain, match))
    advice = f"write it like {_FORMS}"
    with contextlib.suppress(InputError):
        advice = f"did you mean {_sought(f'@{plain}').text}?"
    raise InputError(f"{_cut(text)} is no place in a capture: {advice}")


def _duration(text: str) -> int | None:
    """Return a time in ns, of seconds to the last digit; None where it is none."""
    if _SECONDS.fullmatch(text):
        whole, _, part = text.partition(".")
        return int(whole or "0") * NS + _ns(part)
    return time_in(text, bare=True, least=0)


def _sought(text: str) -> CapturePlace:
    place, told, who = text.partition(_OF_SERVO)
    if told:
        return _of_servo(text, _sought(place), who)
    word, colon, number = text[1:].partition(":")
    if word == "byte":
        bus, _, number = number.rpartition(":")
        return CapturePlace(text, FOUND, sought=word, number=_number(text, word, number), bus=bus)
    known = [f"first-{level}" for level in SEVERITIES]
    if word in known:
        if colon:
            raise InputError(_no_first(text, word, number))
        return CapturePlace(text, FOUND, sought=word.removeprefix("first-"), number=1)
    if names_anomaly(word) and (colon or word not in SEVERITIES):
        nth = _number(text, word, number, 1) if colon or word == "anomaly" else 1
        return CapturePlace(text, FOUND, sought=word, number=nth)
    names = ["byte:12175", "anomaly:7", *known]
    close = near(word, [*known, *VALUES["code"]])
    hint = close if close.startswith("did") else f"one of @{', @'.join(names)}, @CODE or @CODE:3"
    raise InputError(f"{_cut(text)}: there is no such place: {hint}")


def _of_servo(text: str, place: CapturePlace, who: str) -> CapturePlace:
    if not place.is_counted:
        told = f"{_cut(place.text)} is one place, of whatever servo: leave {_OF_SERVO}{who} out"
        raise InputError(f"{_cut(text)}: {told}")
    is_id = re.fullmatch("[0-9-]*", who) is not None
    if (is_id and number_in(who, 0, IDS - 1) is None) or not (is_id or is_name(who)):
        raise InputError(_no_id(text, place.text))
    return replace(place, text=text, servo=int(who) if is_id else who)


def _no_id(text: str, place: str) -> str:
    return f"{_cut(text)}: write the id of a servo, as in {place}{_OF_SERVO}3"


def _no_first(text: str, word: str, number: str) -> str:
    """Return what is wrong with a first one that has a number: a servo is meant, or the nth."""
    if not re.fullmatch("[0-9]{1,3}", number) or not 0 < int(number) < IDS:
        return f"{_cut(text)}: write @{word}, or of a servo @{word}{_OF_SERVO}3"
    level = word.removeprefix("first-")
    told = f"of servo {int(number)} it is @{word}{_OF_SERVO}{int(number)}"
    return f"{_cut(text)}: {told}; number {int(number)} of them all is @{level}:{int(number)}"


def _number(text: str, word: str, number: str, least: int = 0) -> int:
    if not re.fullmatch("[0-9]{1,17}", number) or not least <= int(number) < OFFSET_END:
        told = f"which {word}" if word in ("byte", "anomaly") else "which of them is meant"
        raise InputError(f"{_cut(text)}: write {told}, as in @{word}:7")
    return int(number)


def _moment(text: str, match: re.Match[str]) -> int:
    part = match["part"] or ""
    plain = re.sub(r"[.,]\d+", "", text)
    try:
        moment = datetime.datetime.fromisoformat(plain)
    except ValueError:
        raise InputError(f"{_cut(text)}: there is no such day or time") from None
    if moment.tzinfo is None:
        moment = moment.replace(tzinfo=datetime.UTC)
    ns = int(moment.timestamp()) * NS + _ns(part)
    if not 0 <= ns < TIME_END_NS:
        raise InputError(f"{_cut(text)}: times lie between 1970 and 2257")
    return ns


def _ns(digits: str) -> int:
    """Return the ns of what stands behind a decimal point."""
    return int(digits[:9].ljust(9, "0")) if digits else 0


def _cut(text: str) -> str:
    return repr(text if len(text) <= 40 else f"{text[:39]}…")


def ambiguous(place: CapturePlace, having: Sequence[str]) -> str:
    """Return that several buses have the byte which is meant, and how one of them is named."""
    told = f"{and_(list(having))} have a byte {place.number}: say of which bus, as in"
    return f"{place.text}: {told} @byte:{having[0]}:{place.number}"


@dataclass(frozen=True, slots=True)
class Window:
    """A part of a capture: from a place to a place, each in words (``place_in``) or in seconds.

    A ``datetime`` is a moment, of UTC where it names no zone; a ``timedelta`` counts as seconds do.

    ``around_ns`` widens it on both sides; where only one place is given, it is the part around it.
    Without any place it is all of the capture.
    """

    start: float | str | datetime.datetime | datetime.timedelta = 0.0
    stop: float | str | datetime.datetime | datetime.timedelta | None = None
    around_ns: int = 0

    @property
    def is_part(self) -> bool:
        """Whether something is left out."""
        return bool(self.start) or self.stop is not None

    def places(self) -> tuple[CapturePlace | None, CapturePlace | None]:
        """Return where it begins and ends; None: with the capture.

        Raises:
            InputError: what is written is no place, or it ends before it begins.
        """
        start = _place(self.start) if self.start else None
        stop = None if self.stop is None else _place(self.stop)
        if self.around_ns:
            if start is None and stop is None:
                raise InputError(Sentence("{around_ns} goes with {start} or {stop}"))
            start, stop = start or stop, stop or start
        elif stop is not None and stop.kind == SINCE and stop.ns <= _since(start):
            raise InputError(Sentence("{stop} must lie behind {start}"))
        return start, stop

    def elsewhere(self, start: str | None, stop: str | None) -> Window:
        """Return the part of another run: where that begins or ends otherwise, it is told.

        A part in seconds that only begins elsewhere is as long as this one.

        Raises:
            InputError: what is written is no place, or nobody can say how long the part is.
        """
        if start is None or stop is not None or self.stop is None:
            return Window(start or self.start, stop or self.stop, self.around_ns)
        own, end = self.places()
        begin = place_in(start)
        if end is None or end.kind == FOUND:  # it is looked for in either run
            return Window(start, self.stop, self.around_ns)
        if any(place is not None and place.kind != SINCE for place in (own, end, begin)):
            told = "{start_b}: nobody knows how long the part of A is: say {stop_b}, too"
            raise InputError(Sentence(told))
        ns = begin.ns + end.ns - (0 if own is None else own.ns)
        seconds = f"{ns // NS}.{ns % NS:09d}".rstrip("0").rstrip(".")
        return Window(start, seconds, self.around_ns)


def _since(start: CapturePlace | None) -> int:
    """Return how long behind the first byte a place is at least, -1 where nobody knows yet."""
    if start is None:
        return 0
    return start.ns if start.kind == SINCE else -1


def _place(given: float | str | datetime.datetime | datetime.timedelta) -> CapturePlace:
    if isinstance(given, datetime.timedelta):
        given = given.total_seconds()
    if isinstance(given, datetime.datetime):
        return place_in(given.isoformat())
    if isinstance(given, str):
        return place_in(given)
    try:
        return place_in(f"{given:.9f}")
    except (TypeError, ValueError):
        raise InputError(f"{given!r} is no place in a capture: write it like {_FORMS}") from None
