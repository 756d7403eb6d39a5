"""The protocols by name. A new one is a folder here and a line in ``PROTOCOLS``."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import SnifferError
from sniffer.protocols.lss import Lss
from sniffer.protocols.mightyzap import PROTOCOL as MIGHTYZAP
from sniffer.protocols.rs30x import Rs30x
from sniffer.protocols.wck import Wck

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.protocols.base import BusProtocol

_ALL: Final[tuple[BusProtocol, ...]] = (MIGHTYZAP, Lss(), Rs30x(), Wck())
PROTOCOLS: Final[Mapping[str, BusProtocol]] = MappingProxyType({p.name: p for p in _ALL})


def protocol_named(name: str) -> BusProtocol:
    """Return a protocol.

    Raises:
        SnifferError: there is none of that name.
    """
    try:
        return PROTOCOLS[name]
    except (KeyError, TypeError):
        raise SnifferError(
            f"no protocol {str(name)[:40]!r}: one of {', '.join(PROTOCOLS)}"
        ) from None
