"""Packets that are right but for their checksums, always in the same way: who wrote them erred.

A first driver for a servo computes the checksum wrongly, and nobody answers. Every packet fails
then, and each fails alike: as if the last step were left out, as if the header counted, as if bytes
were XORed that should be added. Damage fails each packet in another way.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.decoding.holding import between, kept
from sniffer.ground.checksums import SUM8, XOR8
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sniffer.protocols.base import BusProtocol

LEAST: Final = 5
"""Packets that fail alike, of which so many sums are different, or one is always the same."""

ALIKE: Final = 0.8
"""Part of the packets that fail which must do so in one way: damage does in one of 256."""

MOST_OF: Final = 0.5
"""Part of all bytes that must fail where no formula is known: a bit that is always misread adds the
same, too, but lets packets by in which it is set already."""

MOST: Final = 400
"""Packets that are tried."""


class WrongSums(NamedTuple):
    """How packets fail their checksums: of which protocol, how many of how many, and their bytes.

    ``what`` says what stands there instead of ``formula``; ``at`` has the first ones, offset and
    length.
    """

    protocol: str
    packets: int
    of: int
    bytes: int
    what: str
    formula: str
    at: tuple[tuple[int, int], ...]

    def __str__(self) -> str:
        share = "all" if self.packets == self.of else f"{self.packets} of"
        return (
            f"{share} {self.of} packets of {self.protocol} that fail their checksum do so alike: "
            f"it should be {self.formula}, and there is {self.what}"
        )


class _Packet(NamedTuple):
    """A packet whose checksum fails: its bytes before that, those that count, both sums."""

    start: int
    raw: bytes
    counted: bytes
    right: int
    sent: int


_FOLDS: Final[tuple[tuple[str, Callable[[bytes], int]], ...]] = (
    ("sum of the bytes", SUM8),
    ("XOR of the bytes", XOR8),
)

_SEALS: Final[tuple[tuple[str, Callable[[int], int]], ...]] = (
    ("the {}", lambda total: total),
    ("the {}, inverted", lambda total: total ^ 0xFF),
    ("the {}, negated", lambda total: -total & 0xFF),
    ("the {} & 7F", lambda total: total & 0x7F),
)
"""What drivers do with the bytes, and then with the result."""


def _ranges(one: _Packet) -> tuple[tuple[str, bytes], ...]:
    """Return the bytes that may have been taken, with words where they are the wrong ones."""
    body = one.raw[:-1]
    return (
        ("", one.counted),
        (" with the header", body),
        (" without the first of them", one.counted[1:]),
        (" without the last of them", one.counted[:-1]),
    )


@kept
def wrong_sums(head: bytes, protocol: BusProtocol | None) -> WrongSums | None:
    """Return how the packets of a capture fail their checksums, if all that fail do so alike.

    Args:
        head: the first bytes, some thousand.
        protocol: by which they are decoded, where anybody knows; else all are tried.
    """
    some = [protocol] if protocol is not None else [PROTOCOLS[n] for n in PROTOCOLS.built_in]
    found = (_of(one, head) for one in some)
    return max((one for one in found if one is not None), key=lambda it: it.bytes, default=None)


def _of(protocol: BusProtocol, head: bytes) -> WrongSums | None:
    failed = _failed(protocol, head)
    if len(failed) < LEAST:
        return None
    told = _by_formula(failed)
    if told is None and sum(len(one.raw) for one in failed) > MOST_OF * len(head):
        told = _always(failed) or _by_difference(failed)
    if told is None:
        return None
    what, mine = told
    first = mine[0]
    checksum = protocol.checksum_of(first.raw)
    formula = "" if checksum is None else checksum[0].formula
    at = tuple((one.start, len(one.raw)) for one in mine[:3])
    size = sum(len(one.raw) for one in mine)
    return WrongSums(protocol.name, len(mine), len(failed), size, what, formula, at)


def _failed(protocol: BusProtocol, head: bytes) -> list[_Packet]:
    """Return the packets that hold but for their checksums of one byte."""
    out: list[_Packet] = []
    for start, end in between(protocol, head):
        for gap in protocol.explain(head[start:end], start):
            raw = head[gap.start : gap.start + gap.length]
            if gap.reason != "damaged" or "checksum_expected" not in gap.detail or len(raw) < 4:
                continue
            checksum = protocol.checksum_of(raw)
            if checksum is not None and checksum[2] == raw[-1]:
                how, counted, sent = checksum
                out.append(_Packet(gap.start, raw, counted, how(counted), sent))
        if len(out) >= MOST:
            break
    return out


def _by_formula(failed: Sequence[_Packet]) -> tuple[str, list[_Packet]] | None:
    """Look for what was computed instead."""
    best: tuple[str, list[_Packet]] | None = None
    for nth in range(len(_ranges(failed[0]))):
        for fold_name, fold in _FOLDS:
            for seal_name, seal in _SEALS:
                mine = [one for one in failed if seal(fold(_ranges(one)[nth][1])) == one.sent]
                if _is_rule(mine, failed) and (best is None or len(mine) > len(best[1])):
                    best = seal_name.format(fold_name + _ranges(failed[0])[nth][0]), mine
    return best


def _is_rule(mine: Sequence[_Packet], failed: Sequence[_Packet]) -> bool:
    return len(mine) >= ALIKE * len(failed) and len({one.sent for one in mine}) >= 2


def _always(failed: Sequence[_Packet]) -> tuple[str, list[_Packet]] | None:
    """Look whether it is always the same byte."""
    ((value, n),) = Counter(one.sent for one in failed).most_common(1)
    if n < ALIKE * len(failed) or len({one.right for one in failed}) < 2:
        return None
    if value == failed[0].raw[0]:
        told = "nothing: the next packet begins there"
    else:
        told = f"{value:02X}, always"
    return told, [one for one in failed if one.sent == value]


def _by_difference(failed: Sequence[_Packet]) -> tuple[str, list[_Packet]] | None:
    """Look whether it is always too much by the same."""
    ((off, n),) = Counter((one.sent - one.right) & 0xFF for one in failed).most_common(1)
    if n < ALIKE * len(failed) or len({one.right for one in failed}) < 2:
        return None
    more = f"{off} too much" if off < 128 else f"{256 - off} too little"
    return more, [one for one in failed if (one.sent - one.right) & 0xFF == off]
