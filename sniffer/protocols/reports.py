"""What the errors of a status mean, whatever a manual calls them and however it counts them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.ground.wording import nearly

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


def unheard_of(protocol: BusProtocol) -> str:
    """Return which name in ``reports`` no status and no register has, in a sentence; empty: none.

    An answer's error is one byte, so all of its names are known.
    """
    told = {name for status in range(256) for name in protocol.status_names(status)}
    for register in protocol.registers:
        told.update(register.bits.values(), register.values.values())
    unknown = next((name for name in reports_of(protocol) if name not in told), None)
    if unknown is None:
        return ""
    return (
        f"reports says what {unknown} means, and no error of an answer and no value or bit of a "
        f"register is called so{nearly(unknown, told)}"
    )
