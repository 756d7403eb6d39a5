"""Answers without a header: which bytes of the servos' wire are one behind a request?"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import RESPONSE
from sniffer.ground.framing import Block
from sniffer.ground.model import ECHO_DIFFERS
from sniffer.merging.lanes import FITS, NEARLY

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.protocols.base import BusProtocol

REMEMBERED: Final = 4096
"""Trials whose result is kept: passes overlap, and short answers are soon all known."""


class BareAnswers:
    """Finds answers without a header, by framing bytes together with the request before them."""

    def __init__(self) -> None:
        self._known: dict[tuple[bytes, bytes], tuple[int, int]] = {}

    def find(
        self, protocol: BusProtocol, pairs: Sequence[tuple[bytes, bytes]]
    ) -> list[tuple[int, int]]:
        """Return for each request with the bytes behind it: length and worth of an answer."""
        if len(self._known) > REMEMBERED:
            self._known.clear()
        new = [pair for pair in dict.fromkeys(pairs) if pair not in self._known]
        if new:
            self._known.update(_tried(protocol, new))
        return [self._known[pair] for pair in pairs]


def _tried(
    protocol: BusProtocol, pairs: Sequence[tuple[bytes, bytes]]
) -> Iterator[tuple[tuple[bytes, bytes], tuple[int, int]]]:
    """Frame all pairs in one block, with a silence behind each."""
    # A wCK read and an io_write of 01 each with bytes behind it, as one block with barriers
    # between:
    #
    #     pair      read 07 63 01 01   read 63 01 01   io_write 07 63 01 01   io_write 01 01
    #     end       8                  15              36                     53
    #     at        4                  12              32                     51
    #     told      2, FITS            2, FITS         2, NEARLY              2, FITS
    #
    # Any two bytes but FF answer a read, and an io_write only its own byte, twice; so framing says
    # how long an answer is and ``describe`` whether it repeats what it should. No second knowledge
    # of replies is needed here, and all trials of a pass cost one call of each.
    ends = np.cumsum([len(a) + len(b) for a, b in pairs])
    data = np.frombuffer(b"".join(itertools.chain.from_iterable(pairs)), np.uint8)
    block = Block(data, ends[:-1], True)
    spans, _ = protocol.frame(block)
    flags = protocol.describe(block, spans).flags
    rows: Mapping[int, int] = {at: row for row, at in enumerate(spans.start.tolist())}
    for pair, end in zip(pairs, ends.tolist(), strict=True):
        at = end - len(pair[1])
        row = rows.get(at, 0)
        told = 0, 0
        # The request must stand whole in front of it: only then is it an answer to that one.
        whole = row > 0 and spans.start[row - 1] == at - len(pair[0])
        if whole and spans.kind[row] == RESPONSE and spans.end[row - 1] == at:
            worth = NEARLY if flags[row] & ECHO_DIFFERS else FITS
            told = int(spans.end[row] - at), worth
        yield pair, told
