"""What the errors of a status mean, whatever a manual calls them and however it counts them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.protocols.base import BusProtocol


def error_number(protocol: BusProtocol) -> int:
    """Return the bits of a status that are one number together, not a flag each.

    A protocol may have them as ``error_number``; one that says nothing has flags only.
    """
    told: int = getattr(protocol, "error_number", 0)
    return told


def reports_of(protocol: BusProtocol) -> Mapping[str, str]:
    """Return what a manual's names of faults mean, by the names that anomalies have.

    A protocol may say it as ``reports``: ``{"voltage": "input_voltage"}``.
    """
    told: Mapping[str, str] = getattr(protocol, "reports", {})
    return told


def meaning_of(protocol: BusProtocol, name: str) -> str:
    """Return what one of them means; a name of which nothing is said is taken as it stands."""
    return reports_of(protocol).get(name, name)
