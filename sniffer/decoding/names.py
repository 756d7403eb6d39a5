"""How protocols are named: one, or several that share a wire, ``mightyzap+dynamixel1``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.model import SnifferError
from sniffer.protocols import PROTOCOLS, is_file, protocol_named

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.protocols.base import BusProtocol

AND: Final = "+"
"""Stands between the names of protocols that share a wire."""


def apart(named: str) -> list[str]:
    """Return the names that a name is made of: itself, unless it joins what can be known."""
    names = named.split(AND)
    if is_file(named) and not all(is_file(one) or one in PROTOCOLS for one in names):
        return [named]  # a file may be called so
    return names


def is_known(named: str) -> bool:
    """Tell whether all protocols of a name are known; what their files hold is not asked."""
    return all(is_file(one) or one in PROTOCOLS for one in apart(named))


def protocols_named(named: str | BusProtocol) -> tuple[BusProtocol, ...]:
    """Return the protocols of a name, ``a`` or ``a+b``, in the order of their names.

    Raises:
        SnifferError: one of them is not known or cannot be used, or is named twice.
    """
    if not isinstance(named, str):
        return (protocol_named(named),)
    found = sorted((protocol_named(one) for one in apart(named)), key=lambda p: p.name)
    if len({p.name for p in found}) < len(found):
        raise SnifferError(f"{named[:80]!r} names a protocol twice")
    return tuple(found)


def joined(protocols: Sequence[BusProtocol]) -> str:
    """Return the name of protocols that share a wire."""
    return AND.join(p.name for p in protocols)
