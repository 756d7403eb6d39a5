"""Bytes that no frame claims where the answer to a request should stand: it came, but torn.

Right behind a request there is nothing to find out. Several may be asked in a row, in one *turn*.
Then the answer that is missing stands behind that to the request before it. If none before it was
answered, it stands behind the last request of the turn.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.codes import NEVER, REQUEST
from sniffer.ground.memory import Remembering
from sniffer.ground.model import ECHO

if TYPE_CHECKING:
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, Frames, Mask
    from sniffer.protocols.base import BusProtocol


class TornAnswers(Remembering):
    """Finds torn answers block after block, also where a cut leads through a turn."""

    PASSING = ("_behind",)

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        # Where the answer begins, in the stream, to the last request before the cut that has one.
        self._behind: int | None = None  # only if the turn it is of goes on behind the cut

    def find(
        self,
        frames: Frames,
        partner: I64,
        block: Block,
        decided: int,
        base: int,
        kept: int,
        *,
        across: bool,
    ) -> Mask:
        """Tell for each row whether torn bytes stand where its answer should, or behind it.

        Args:
            frames: all rows of the block.
            partner: which request each answers, as ``match`` returned it.
            block: for its bytes and its barriers.
            decided: how far every byte of the block has its fate.
            base: offset in the stream of the block's first byte.
            kept: rows before the cut.
            across: whether an answer behind the cut belongs to a request before it.
        """
        # Three servos are asked in one go; the answer of the second has a bad checksum, so its
        # bytes (36 to 44) are no frame:
        #
        #     row        0    1    2    3    4
        #     frame      Q1   Q2   Q3   A1   A3
        #     start      0    9    18   27   45
        #     end        9    18   27   36   54
        #     torn       0    0    0    1    0    unclaimed bytes right behind it
        #     together   -    1    1    0    0    a request behind a request, nothing torn between
        #     turn       1    1    1    0    0    number of the turn, 0 for what is no request
        #     answered   3    -1   4    -1   -1   row of the answer
        #     latest     3    3    4    -1   -1   of the turn's last one answered, up to here
        #     then torn  0    1    0    1    0    by ``_in_turn``: Q2's is behind row ``latest``
        #
        # At first ``torn`` says behind which row bytes are torn, at the end also for which request.
        # That is why a row that is only a neighbour (3) may stay marked: nobody asks it of an
        # answer.
        torn = _unclaimed_behind(frames, block, decided, self._protocol.blank)
        cut = across or self._behind is not None
        if not cut and not torn.any():
            return torn
        sends = frames.kind == REQUEST
        together = sends[1:] & sends[:-1] & ~torn[:-1]
        if together.any() and len(block.barriers):
            segment = block.segment(frames.start)
            together &= segment[1:] == segment[:-1]
        if not cut and not together.any():
            return torn
        first = sends.copy()
        first[1:] &= ~together
        turn = np.cumsum(first) * sends
        answered = np.full(len(frames), -1, np.int64)
        answer = np.flatnonzero(partner >= 0)
        answered[partner[answer]] = answer
        latest = self._latest(frames, turn, answered, base)
        if torn.any():
            _in_turn(frames, torn, turn, answered, latest, self._protocol.reach)
        self._behind = None
        if kept < len(frames) and together[kept - 1] and latest[kept - 1] >= 0:
            self._behind = base + int(frames.start[latest[kept - 1]])
        return torn

    def _latest(self, frames: Frames, turn: I64, answered: I64, base: int) -> I64:
        """Return what answers the last answered request of each row's turn up to it, or -1."""
        # The row of the last answered request, carried forward: 0 0 2 2 2 in the example of
        # ``find``. It counts only inside its own turn, hence the comparison of turns behind it.
        asked = np.maximum.accumulate(np.where(answered >= 0, np.arange(len(frames)), -1))
        latest = np.where((asked >= 0) & (turn[asked] == turn), answered[asked], -1)
        if self._behind is not None:
            row = int(np.searchsorted(frames.start, self._behind - base))
            latest[(turn == 1) & (latest < 0)] = row
        return latest


def room_behind(frames: Frames, block: Block, decided: int) -> I64:
    """Return how many unclaimed bytes stand behind each row; behind an echoed one, its echo."""
    room = _room(frames, block, decided)
    echo = np.flatnonzero(frames.flags & ECHO)
    room[echo - 1] += room[echo]
    return room


def _room(frames: Frames, block: Block, decided: int) -> I64:
    end = frames.end
    following = np.append(frames.start[1:], decided)
    if len(block.barriers):
        following = np.minimum(following, block.limit(end - 1))
    if block.foreign is not None:
        row = np.searchsorted(block.foreign, end)
        following = np.minimum(following, np.append(block.foreign, block.n)[row])
    room: I64 = following - end
    return room


def _unclaimed_behind(frames: Frames, block: Block, decided: int, blank: bytes) -> Mask:
    """Tell behind which rows unclaimed bytes stand."""
    room, end = _room(frames, block, decided), frames.end
    torn: Mask = room > 0
    if not torn.any():
        return torn
    if blank:
        data = block.data.tobytes()
        for i in np.flatnonzero(torn).tolist():
            if not data[int(end[i]) : int(end[i] + room[i])].strip(blank):
                torn[i] = False
    echo = np.flatnonzero(frames.flags & ECHO)
    torn[echo - 1] |= torn[echo]
    return torn


def _in_turn(frames: Frames, torn: Mask, turn: I64, answered: I64, latest: I64, reach: int) -> None:
    """Where several were asked in a row, tell which answers are torn among those that came.

    Args:
        frames: all rows.
        torn: what is told, of all rows; those behind which torn bytes stand are told already.
        turn: the number of each request's turn, 0 for other rows.
        answered: the row of each request's answer, or -1.
        latest: the same of the last request of the turn, up to each, that has one.
        reach: bytes after which a request is closed.
    """
    some = np.zeros(int(turn.max()) + 1, bool)
    some[turn[(answered >= 0) | (latest >= 0)]] = True
    some[0] = False
    # If the answer torn is that of the first, nothing before it was answered (latest is -1) and it
    # should stand behind the turn's last request, in front of the others' answers:
    #
    #     row        0    1    2    3    4       Q1 Q2 Q3 (torn) A2 A3
    #     torn       0    0    1    0    0
    #     answered   -1   3    4    -1   -1
    #     latest     -1   3    4    -1   -1
    #     alone      0                           ``where`` goes on to row 2: torn, so is Q1's
    #
    # A turn of which no request is answered proves no order: it is left out by ``some``. What is
    # to be known of the rows behind each is worked out for all at once: a turn may be as long as a
    # block.
    alone = np.flatnonzero(some[turn] & (answered < 0) & (frames.reply != NEVER))
    start, end, n = frames.start, frames.end, len(turn)
    lasts = np.append(np.flatnonzero(np.diff(turn)), n - 1)
    run = np.concatenate([[0], np.cumsum(turn[1:] != turn[:-1])])
    # The earliest answer to this request of the turn or one behind it: the minimum from the back,
    # which begins anew in each run because its numbers are a step lower than those behind it.
    none = int(end[-1]) + reach + 1
    step = none + 1
    begins = np.where(answered >= 0, start[answered], none) + run * step
    earliest = np.minimum.accumulate(begins[::-1])[::-1] - run * step
    others = earliest[alone] - end[alone] <= reach
    behind = np.where(others, lasts[run[alone]], alone)
    where = np.where(latest[alone] >= 0, latest[alone], behind)
    torn[alone[torn[where] & (end[where] - end[alone] < reach)]] = True
