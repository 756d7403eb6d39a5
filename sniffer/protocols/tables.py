"""Register tables that a user brings: new models of a protocol that is known."""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

from sniffer.ground.model import SnifferError
from sniffer.ground.wording import offered, one_line
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

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
    try:
        more: BusProtocol = extended(mine)
    except (TypeError, ValueError) as error:  # of one written elsewhere
        raise SnifferError(one_line(f"{mine[0].model}: {protocol.name}: {error}")) from error
    return more


def check_tables(
    tables: Iterable[RegisterMap], own: Mapping[str, BusProtocol], *, others: bool
) -> None:
    """Refuse tables that nothing of what is decoded can be read by.

    ``own`` are the protocols that were named; ``others``: any other one may be spoken, too.

    Raises:
        SnifferError: a table names no protocol, or another one, or its protocol does not take it.
    """
    tables = tuple(tables)
    for table in tables:
        name = table.protocol
        why = ""
        if not name:
            why = 'it does not say whose it is: write protocol = "..." into its head'
        elif name not in own and not others:
            why = f"it is a table of {name}, and what is named is {', '.join(own)}"
        elif name not in own and name not in PROTOCOLS:
            why = f"no protocol {name[:40]!r}: {offered(name, PROTOCOLS)}"
        if why:
            raise SnifferError(f"{table.model}: {why}")
        with_tables(own[name] if name in own else PROTOCOLS[name], tables)


def owner_of(
    model: str, tables: Iterable[RegisterMap] = (), also: Iterable[BusProtocol] = ()
) -> str | None:
    """Return the name of the protocol that has a model; None: nobody knows it.

    ``tables`` and ``also`` are looked through first: plug-ins are only loaded where they must be.
    """
    of_table = next((t.protocol for t in tables if t.model == model), None)
    if of_table is not None:
        return of_table
    everyone = chain(also, PROTOCOLS.values())
    return next((p.name for p in everyone if any(m.model == model for m in p.models)), None)


def known_models(tables: Iterable[RegisterMap] = (), also: Iterable[BusProtocol] = ()) -> list[str]:
    """Return the names of all models, sorted."""
    everyone = chain(also, PROTOCOLS.values())
    return sorted({*(t.model for t in tables), *(m.model for p in everyone for m in p.models)})
