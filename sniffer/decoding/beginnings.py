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
"""So many beginnings of frames, in such a part of the bytes, are no chance."""

WEAK: Final = 6
PART_WEAK: Final = 0.9
"""Bytes of frames, in the mean, that begin by chance now and then, and the part that then counts.

A line of twice the rate turns each FF FF FF into an FF and two bytes more, as frames of wCK begin.
Who sends such frames in a wrong form has no answers between them.
"""

OFF: Final = 5
"""Bytes that a frame may lack of the length it states: who reckons it wrongly counts a header or a
checksum too many; a length that a wrong rate made states anything."""

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
    part = PART_WEAK if begun.size < WEAK * begun.n else PART
    return begun if begun.n >= LEAST and begun.size >= part * len(head) else None


def _begun(protocol: BusProtocol, head: bytes) -> Begun:
    """Return what begins like frames of a protocol, with all that says whose they are.

    A header of the same byte thrice is one at many rates; a command or an answer behind it is not.
    """
    first: Counter[bytes] = Counter()
    size = 0
    for a, b in between(protocol, head):
        for gap in protocol.explain(head[a:b], a):
            fields = gap.detail.get("fields")
            if gap.reason == "noise" or fields is None or fields.get(CODE):
                continue  # a code that is no command's is what a wrong rate made of one
            if gap.detail.get("need", 0) - gap.detail.get("have", 0) <= OFF:
                first[head[gap.start : gap.start + HEADED]] += 1
                size += gap.length
    return Begun(protocol.name, first.total(), size, first)
