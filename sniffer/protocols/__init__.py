"""The protocols by name. A new one is a folder here and a line in ``PROTOCOLS``."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from sniffer.model import SnifferError
from sniffer.protocols.base import BusProtocol
from sniffer.protocols.mightyzap import MightyZap
from sniffer.protocols.rs30x import Rs30x
from sniffer.protocols.wck import Wck

_ALL: Final[tuple[BusProtocol, ...]] = (MightyZap(), Rs30x(), Wck())
PROTOCOLS: Final[Mapping[str, BusProtocol]] = MappingProxyType({p.name: p for p in _ALL})


def protocol_named(name: str) -> BusProtocol:
    """Return a protocol.

    Raises:
        SnifferError: there is none of that name.
    """
    try:
        return PROTOCOLS[name]
    except KeyError:
        raise SnifferError(f"no protocol {name!r}: one of {', '.join(PROTOCOLS)}") from None
