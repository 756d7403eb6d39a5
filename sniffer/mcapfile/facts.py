"""What a recording says of a bus: its metadata, and the tables that it is read by."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.decoding.names import joined
from sniffer.messages import TABLES
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.protocols.base import BusProtocol


def facts_of(
    bus: str, protocols: Sequence[BusProtocol], session: Mapping[str, str]
) -> dict[str, str]:
    """Return what a recording says of a bus."""
    baud = session.get(f"baud.{bus}", session.get("baud", str(protocols[0].baud)))
    told = {"bus": bus, "protocol": joined(protocols), "baud": baud}
    if plugins := [p for p in map(PROTOCOLS.origin, (p.name for p in protocols)) if p]:
        told["plugin"] = ", ".join(plugins)
    return told


def attached_tables(protocols: Sequence[BusProtocol]) -> Iterator[tuple[str, bytes]]:
    """Yield the register tables of protocols as they are attached: name and contents."""
    for table in (table for protocol in protocols for table in protocol.models):
        if table.text:
            yield f"{TABLES}{table.model}.toml", table.text.encode()
