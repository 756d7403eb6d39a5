"""Times, sizes and numbers as people write them: ``10min``, ``512MB``, ``1.5 ms``."""

from __future__ import annotations

import math
import re
from typing import Final

from sniffer.ground.model import NS

_NS: Final = {
    "ms": NS // 1000,
    "s": NS,
    "sec": NS,
    "m": 60 * NS,
    "min": 60 * NS,
    "h": 3600 * NS,
    "d": 86400 * NS,
}
_BYTES: Final = {
    "b": 1,
    **{prefix + "b": 1000**n for n, prefix in enumerate("kmgt", 1)},
    **{prefix + "ib": 1024**n for n, prefix in enumerate("kmgt", 1)},
}
_LETTERS: Final = {letter: 1000**n for n, letter in enumerate("KMGT", 1)}
"""As many tools write them; a small m is a minute."""

_AMOUNT: Final = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([a-zA-Z]*)")


def time_in(text: str, *, bare: bool, least: int = 1) -> int | None:
    """Return a time in ns, None where it is none; ``bare``: a number alone is one in seconds.

    ``least``: a shorter one is none, in ns.
    """
    amount, unit = _parts(text)
    return _product(amount, _NS.get(unit, NS if bare and not unit else None), least)


def period_in(text: str, *, least: int = 1) -> int | None:
    """Return the period of what is told as a rate (``50 Hz``) in ns, None where it is none.

    ``least``: a shorter one is none, in ns.
    """
    amount, unit = _parts(text)
    if unit.lower() != "hz" or amount <= 0:
        return None
    return _product(NS / amount, 1, least)


def size_in(text: str, *, bare: bool) -> int | None:
    """Return a size in bytes, None where it is none; ``bare``: a number alone is one in bytes."""
    amount, unit = _parts(text)
    known = _LETTERS.get(unit) or _BYTES.get(unit.lower())
    return _product(amount, known or (1 if bare and not unit else None), 1)


def time_as(ns: int) -> str:
    """Return a time as ``time_in`` reads it: ``2s``, ``500ms``."""
    if ns % NS == 0:
        return f"{ns // NS}s"
    return f"{ns / 1e6:.6f}".rstrip("0").rstrip(".") + "ms"


def number(value: float, digits: int = 4) -> str:
    """Return a number with so many significant digits, without an exponent where it is readable."""
    if not math.isfinite(value):
        return "none"
    if value == 0 or 1e-4 <= abs(value) < 1e7:
        shown = f"{value:.{max(0, digits - 1 - _magnitude(value))}f}"
        shown = shown.rstrip("0").rstrip(".") if "." in shown else shown
        return "0" if shown in ("-0", "") else shown
    return f"{value:.{digits}g}"


def lasting(ns: float) -> str:
    """Return a length of time in the unit that suits it."""
    if ns < NS:
        return f"{number(ns / 1e6, 3)} ms"
    seconds = ns / NS
    if seconds < 120:
        return f"{number(seconds, 4)} s"
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {seconds} s"


def _parts(text: str) -> tuple[float, str]:
    match = _AMOUNT.fullmatch(text.strip())
    return (float(match[1]), match[2]) if match is not None else (-1.0, "")


def _product(amount: float, unit: int | None, least: int) -> int | None:
    total = amount * unit if unit is not None else -1.0
    return round(total) if math.isfinite(total) and total >= least else None


def _magnitude(value: float) -> int:
    return math.floor(math.log10(abs(value))) if value else 0
