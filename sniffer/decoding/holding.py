"""Which bytes hold as frames of a protocol: of a stretch, and of thousands of tries at once."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final, TypeVar

import numpy as np

from sniffer.ground.framing import Block

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sniffer.protocols.base import BusProtocol


REMEMBERED: Final = 64
"""Beginnings of captures for which an answer is kept."""

T = TypeVar("T")


def kept(
    find: Callable[[bytes, BusProtocol | None], T],
) -> Callable[[bytes, BusProtocol | None], T]:
    """Keep what is found in the beginning of a capture, by a protocol or by all.

    A live bus is judged again and again, and begins with the same bytes.
    """
    known: dict[tuple[str, bytes], T] = {}

    @functools.wraps(find)
    def found(head: bytes, protocol: BusProtocol | None) -> T:
        key = "" if protocol is None else protocol.name, head
        if key not in known:
            if len(known) >= REMEMBERED:
                known.clear()
            known[key] = find(head, protocol)
        return known[key]

    return found


def spans_in(protocol: BusProtocol, data: bytes, cuts: Sequence[int] = ()) -> list[tuple[int, int]]:
    """Return the frames of a protocol in some bytes, in order: from, and up to which byte.

    None goes across one of ``cuts``.
    """
    block = Block(np.frombuffer(data, np.uint8), np.array(cuts, np.int64), True)
    spans, _ = protocol.frame(block)
    return list(zip(spans.start.tolist(), spans.end.tolist(), strict=True))


def between(protocol: BusProtocol, data: bytes) -> list[tuple[int, int]]:
    """Return the stretches that no frame claims."""
    edges = [0, *(k for span in spans_in(protocol, data) for k in span), len(data)]
    return [(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True) if b > a]


def held(protocol: BusProtocol, tries: Sequence[bytes], sizes: Sequence[int]) -> list[bool]:
    """Tell of which tries the last so many bytes are one frame, and all of it is frames."""
    if not tries:
        return []
    length = np.array([len(t) for t in tries], np.int64)
    ends = np.cumsum(length)
    block = Block(np.frombuffer(b"".join(tries), np.uint8), ends[:-1], True)
    spans, _ = protocol.frame(block)
    covered = np.zeros(len(tries), np.int64)
    np.add.at(covered, block.segment(spans.start), spans.end - spans.start)
    row = np.searchsorted(spans.end, ends)
    last = np.append(spans.start, -1)[np.minimum(row, len(spans))]
    ended = np.append(spans.end, -1)[np.minimum(row, len(spans))] == ends
    whole: list[bool] = (ended & (covered == length) & (ends - last == sizes)).tolist()
    return whole


def mended(
    protocol: BusProtocol,
    torn: Mapping[bytes, int],
    tries: Callable[[bytes], list[bytes]],
    least: float,
) -> set[bytes]:
    """Return which torn frames are frames by one of their tries.

    Args:
        protocol: of which they are.
        torn: how often each of them came.
        tries: what each may have been.
        least: none are told, and no more are tried, where all that are left came less often.
    """
    out, left = set[bytes](), sum(torn.values())
    for got, times in torn.items():
        meant = tries(got)
        if any(held(protocol, meant, [len(one) for one in meant])):
            out.add(got)
        else:
            left -= times
        if left < least:
            return set()
    return out
