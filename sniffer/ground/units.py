"""Units as they are shown; the tables of registers have them in ASCII."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

SIGNS: Final[Mapping[str, str]] = MappingProxyType(
    {"degC": "°C", "deg": "°", "deg/s": "°/s", "us": "µs"}
)
"""Units whose sign is another than their name."""

TIGHT: Final = frozenset({"°"})
"""Signs that stand behind a number without a blank."""


def sign_of(unit: str) -> str:
    """Return a unit as it stands in pages and plots; empty where there is none."""
    return SIGNS.get(unit, unit)


def word_of(unit: str) -> str:
    """Return a unit as it stands in text: as it is named, but for the one that is no word."""
    return sign_of(unit) if unit == "degC" else unit


def behind(unit: str) -> str:
    """Return what stands behind a number: the sign of its unit, and the blank where it has one."""
    sign = sign_of(unit)
    return sign if sign in TIGHT or not sign else f" {sign}"
