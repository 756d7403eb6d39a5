"""Requests that list whom they ask: each servo in the list owes an answer of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sniffer.ground.codes import MANY

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, Frames


class Listing(NamedTuple):
    """Servos that requests list, a row each, in the order in which they are to answer.

    ``by`` is the id that the answer bears: the servo's own, or that of one packet for all of them.
    ``address`` and ``length`` are of what it is asked for, ``reply`` says how far it owes that.
    ``begins`` is how many bytes of the packet stand before its own: 0 for the first, who begins it.
    """

    row: I64  # of the request
    servo_id: I64
    by: I64
    address: I64
    length: I64
    reply: I64
    begins: I64


class ListedServo(NamedTuple):
    """One of them, for the oracle."""

    servo_id: int
    by: int
    reply: int
    begins: int


def targets_of(protocol: object, block: Block, frames: Frames) -> Listing | None:
    """Return whom the requests among some frames of a block list; None: none lists anybody.

    A protocol may say it as ``targets``. It is no part of the interface: of one that does not, a
    request to several servos is answered by any of them, and none is missed.

    Args:
        protocol: whose frames they are.
        block: what they stand in.
        frames: rows of it.
    """
    told: Callable[[Block, Frames], Listing] | None = getattr(protocol, "targets", None)
    if told is None or not np.any(frames.reply == MANY):
        return None
    found = told(block, frames)
    return found if len(found.row) else None
