"""Register tables that a user brings: new models of a protocol that is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.ground.model import SnifferError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sniffer.ground.registers import RegisterMap
    from sniffer.protocols.base import BusProtocol


def with_tables(protocol: BusProtocol, tables: Iterable[RegisterMap]) -> BusProtocol:
    """Return the protocol with those of the tables as further models that are tables of it.

    A protocol that can be told more models has a method ``with_models(tables)``, which returns
    another one that knows them behind its own.

    Raises:
        SnifferError: it takes none, or a model of that name is there.
    """
    mine = tuple(table for table in tables if table.protocol == protocol.name)
    if not mine:
        return protocol
    extended = getattr(protocol, "with_models", None)
    if extended is None:
        raise SnifferError(
            f"{mine[0].model}: {protocol.name} takes no further tables: its registers are part of "
            "its grammar"
        )
    known = {m.model for m in protocol.models}
    for table in mine:
        if table.model in known:
            raise SnifferError(
                f"{protocol.name} has a model {table.model}: name the one in your table otherwise"
            )
        known.add(table.model)
    more: BusProtocol = extended(mine)
    return more
