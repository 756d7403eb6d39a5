"""Ids of a bus that are not those of single servos."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sniffer.protocols.base import Framing


def shared_ids(protocol: Framing) -> tuple[int, ...]:
    """Return the ids under which no servo answers: -1, and those that address all.

    Not 0: where it addresses all, as mightyZAP's does a servo that stands alone, servos have it
    from the factory, too.
    """
    return -1, *(servo for servo in protocol.everyone if servo)


def leading_ids(protocol: Framing) -> tuple[int, ...]:
    """Return the ids of packets that name their servos inside.

    A protocol may have them as ``leading``; one that says nothing has none.
    """
    told: tuple[int, ...] = getattr(protocol, "leading", ())
    return told
