"""The protocols by name. A new one is a folder here and a line below, or a plug-in."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer.ground.loading import PluginWarning
from sniffer.ground.model import SnifferError
from sniffer.ground.wording import offered
from sniffer.protocols.plugins import PluginError
from sniffer.protocols.registry import Registry

if TYPE_CHECKING:
    from sniffer.protocols.base import BusProtocol

PROTOCOLS: Final = Registry(
    {
        "mightyzap": "sniffer.protocols.mightyzap:PROTOCOL",
        "lss": "sniffer.protocols.lss:Lss",
        "rs30x": "sniffer.protocols.rs30x:Rs30x",
        "wck": "sniffer.protocols.wck:Wck",
    },
    signs={
        "mightyzap": (b"\xff",),
        "lss": (b"#\r", b"*\r"),
        "rs30x": (b"\xfa\xaf", b"\xfd\xdf"),
        "wck": (b"\xff",),
    },
)
"""The built-in protocols, then plug-ins, as a mapping; each is loaded when it is asked for."""


def is_file(named: str | BusProtocol) -> bool:
    """Tell whether a protocol is named by the file that defines it."""
    return isinstance(named, str) and named.endswith(".py")


def protocol_named(named: str | BusProtocol) -> BusProtocol:
    """Return a protocol by its name, or that of a file which defines ``PROTOCOL`` (``*.py``).

    One that is given as an object is returned as it is.

    Raises:
        SnifferError: there is none of that name, or it cannot be used.
    """
    if not isinstance(named, str):
        if not hasattr(named, "models"):
            raise SnifferError(f"a protocol is a name or one of PROTOCOLS, not {named!r:.40}")
        return named
    if is_file(named):
        return PROTOCOLS.file(Path(named))
    if named not in PROTOCOLS:
        raise SnifferError(f"no protocol {named[:40]!r}: {offered(named, PROTOCOLS)}")
    return PROTOCOLS[named]


__all__ = ["PROTOCOLS", "PluginError", "PluginWarning", "Registry", "is_file", "protocol_named"]
