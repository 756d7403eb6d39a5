"""Signs for severities: told by shape and word, so that nobody needs to see their colours."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import Severity
from sniffer.reports.markup import Markup, tag

if TYPE_CHECKING:
    from collections.abc import Mapping

SIGNS: Final[Mapping[Severity, str]] = MappingProxyType(
    {Severity.ERROR: "■", Severity.WARN: "▲", Severity.NOTE: "●"}
)
"""As a text has them."""

_PATHS: Final[Mapping[Severity, str]] = MappingProxyType(
    {
        Severity.ERROR: "M5 1h6l4 4v6l-4 4h-6l-4-4v-6z",
        Severity.WARN: "M8 1l7.5 14h-15z",
        Severity.NOTE: "M8 1a7 7 0 1 0 .01 0z",
    }
)
_INSIDE: Final[Mapping[Severity, str]] = MappingProxyType(
    {
        Severity.ERROR: "M5.5 5.5l5 5m0-5l-5 5",
        Severity.WARN: "M8 6v4m0 2.4v.2",
        Severity.NOTE: "M8 7v4.5M8 4.4v.2",
    }
)


def shape(severity: Severity) -> Markup:
    """Return the sign of a severity; its word is read to those who cannot see it."""
    word = severity.name.lower()
    return tag(
        "svg",
        tag("path", d=_PATHS[severity], cls="sign"),
        tag("path", d=_INSIDE[severity], cls="inside"),
        view_box="0 0 16 16",
        cls=f"shape {word}",
        role="img",
        aria_label=word,
    )
