"""Frames that begin as they should and do not hold: at a wrong rate nothing begins so."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.decoding.holding import between
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from sniffer.protocols.base import BusProtocol

LEAST: Final = 20
PART: Final = 0.3
"""So many beginnings of frames, in such a part of the bytes, are no chance: of 48 captures at a
wrong rate none had more than seven."""

HEADED: Final = 5
"""Bytes of a beginning that are told apart: header, id and what follows."""

CODE: Final = "code"
"""The field of what is no command's code: an answer's errors, of which there are mostly none."""


class Begun(NamedTuple):
    """Frames of a protocol that begin and do not hold.

    How many, in how many bytes, and what they begin with, each with how often.
    """

    protocol: str
    n: int
    size: int
    first: Counter[bytes]

    def __str__(self) -> str:
        ((common, n),) = self.first.most_common(1)
        shown = f"{common.hex(' ').upper()} ({n} times)"
        return (
            f"{self.n} times a frame of {self.protocol} begins as it should, such as {shown}, and "
            "does not end so"
        )


def most_begun(head: bytes) -> Begun | None:
    """Return what begins like frames of the protocol that most of them are of; None: nothing."""
    begun = max((_begun(PROTOCOLS[name], head) for name in PROTOCOLS.built_in), key=lambda b: b.n)
    return begun if begun.n >= LEAST and begun.size >= PART * len(head) else None


def _begun(protocol: BusProtocol, head: bytes) -> Begun:
    """Return what begins like frames of a protocol, with all that says whose they are.

    A header of the same byte thrice is one at many rates; a command or an answer behind it is not.
    """
    first: Counter[bytes] = Counter()
    size = 0
    for a, b in between(protocol, head):
        for gap in protocol.explain(head[a:b], a):
            fields = gap.detail.get("fields")
            if gap.reason != "noise" and fields is not None and not fields.get(CODE):
                first[head[gap.start : gap.start + HEADED]] += 1
                size += gap.length
    return Begun(protocol.name, first.total(), size, first)
