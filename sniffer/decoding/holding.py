"""Do some bytes hold as one frame? Asked of the protocol, thousands of tries at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.framing import Block

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.protocols.base import BusProtocol


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
