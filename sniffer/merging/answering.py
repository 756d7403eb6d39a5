"""By how much two clocks differ that each stamped one wire of a bus: found from who answers what.

The two wires have no byte in common. But each answer comes a moment after a request that it fits.
So each difference is held against all of them: how many answers find a request so much earlier?
Controllers ask in rounds, so a difference that is wrong by a round has nearly as many; what is
asked now and then, or went without an answer, tells them apart. Only a difference for which clearly
more answers speak than for any other is taken.

How long servos take to answer cannot be told apart from the difference: the fastest answer counts
as one that came at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.codes import IF_READ, MUST, REQUEST, RESPONSE
from sniffer.ground.framing import Block
from sniffer.ground.model import ANY_ID, NEVER_NS
from sniffer.ground.timing import byte_time_ns
from sniffer.merging.aligning import LEAST, Alignment, stamped

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sniffer.ground.model import I64, Chunk, Frames, Mask
    from sniffer.protocols.base import BusProtocol

MOST: Final = 1500
"""Requests, and answers, that are compared: all with all, so some two million pairs."""

SPREADS_NS: Final = (3_000_000, 20_000_000)
"""Between the fastest answer and the slowest, as the stamps have it. Servos of one bus answer
within a few ms of each other; where the stamps are of adapters that hold bytes for 16 ms, the
narrow one fits few."""

STRAYS: Final = 0.97
"""So many of the answers that speak for the foremost difference must speak for the one taken: that
of the fastest answer but for strays."""

NARROW: Final = 0.97
"""Where so many of the answers that speak for the foremost difference of the wide spread lie within
the narrow one, that is taken: it is wrong by less."""

BOTH: Final = 0.2
"""The share of requests, and of answers, that a wire of one direction has not: what crosses over to
it from the other wire, or reads as the other kind, is less."""

CLEARLY: Final = 0.005
"""So many of the answers more must speak for a difference than for any other, and 3 at least."""


class WireHeard(NamedTuple):
    """What a wire carried: its frames, and when each of its bytes came by the stamps."""

    frames: Frames
    stamps: I64
    byte_ns: int

    @classmethod
    def of(cls, chunks: Iterable[Chunk], *, protocol: BusProtocol, baud: int) -> WireHeard:
        """Return it of chunks on a clock of their own; ``baud`` in bits per second."""
        byte_ns = byte_time_ns(baud)
        data, stamps = stamped(chunks, byte_ns)
        block = Block(data, np.empty(0, np.int64), True)
        return cls(protocol.describe(block, protocol.frame(block)[0]), stamps, byte_ns)

    def has_only(self, kind: int) -> bool:
        """Tell whether all its frames are of a kind, and not few."""
        return len(self.frames) >= LEAST and bool((self.frames.kind == kind).all())

    def has_both(self) -> bool:
        """Tell whether requests and answers are on it, and not few of either."""
        asked = float((self.frames.kind == REQUEST).mean()) if len(self.frames) >= LEAST else 0.0
        return BOTH <= asked <= 1 - BOTH


def are_taps(asked: WireHeard, heard: WireHeard) -> bool:
    """Tell whether each heard the whole bus: requests and answers alike."""
    return asked.has_both() and heard.has_both()


def are_swapped(asked: WireHeard, heard: WireHeard) -> bool:
    """Tell whether the first is the servos' wire: all there answer, and all on the other ask."""
    return asked.has_only(RESPONSE) and heard.has_only(REQUEST)


def answered(asked: WireHeard, heard: WireHeard) -> Alignment | None:
    """Return by how much the clock of the servos' wire is ahead, None where nothing tells.

    Its ``runs`` are answers, and all of them but for strays lie within ``spread_ns``. ``asked`` is
    the controller's wire, ``heard`` the servos'.
    """
    answers, ahead = _pairs(asked, heard)
    if not len(ahead):
        return None
    narrow, wide = (_foremost(answers, ahead, spread) for spread in SPREADS_NS)
    best = narrow if narrow.runs >= NARROW * wide.runs else wide
    return Alignment(best.offset_ns, best.spread_ns, best.runs) if best.is_clear else None


def _pairs(asked: WireHeard, heard: WireHeard) -> tuple[I64, I64]:
    """Return of each pair that fits which answer it is, and how long after the request's end."""
    f = asked.frames
    asks = f.take(np.flatnonzero((f.kind == REQUEST) & np.isin(f.reply, (MUST, IF_READ)))[:MOST])
    told = asked.stamps[asks.end - 1][:, None]
    says = heard.frames.take(np.flatnonzero(heard.frames.kind == RESPONSE)[:MOST])
    if len(says):
        began = heard.stamps[says.start]
        who = asks.servo_id[:, None], asks.alt_id[:, None]
        may: Mask = (who[0] == says.servo_id) | (who[1] == says.servo_id) | (who[1] == ANY_ID)
        may &= (asks.token[:, None] == says.token) | (says.token == -1)
    else:  # answers without a header: each piece may be one, of whoever was asked
        apart = np.diff(heard.stamps, prepend=-NEVER_NS) > 2 * heard.byte_ns
        began = heard.stamps[apart][:MOST]
        may = np.ones((len(told), len(began)), bool)
    _, answers = np.nonzero(may)
    return answers, (began - heard.byte_ns - told)[may]


class _Vote(NamedTuple):
    """The difference that most answers speak for, and how many speak for the next."""

    offset_ns: int
    spread_ns: int
    runs: int
    others: int

    @property
    def is_clear(self) -> bool:
        """Whether no other difference is nearly as likely."""
        least = max(LEAST, self.others + 3, self.others * (1 + CLEARLY))
        return self.runs >= least


def _foremost(answers: I64, ahead: I64, spread: int) -> _Vote:
    """Return the difference that most answers speak for, all of them within so much."""
    # Spread 3. Answer 0 is 2 and 12 behind a request that it fits, answer 1 only 4: then 0 speaks
    # for differences of -1 to 2 and 9 to 12, answer 1 for 1 to 4. From 1 to 2 both do, and the
    # greatest of these is taken, with which the fastest answer comes at once: strays aside, that
    # fit a request in passing.
    order = np.lexsort((ahead, answers))
    whose, ahead = answers[order], ahead[order]
    apart = (np.diff(whose) > 0) | (np.diff(ahead) > spread)
    begins = ahead[np.append(True, apart)] - spread
    ends = ahead[np.append(apart, True)]
    at = np.concatenate([begins, ends])
    step = np.repeat([1, -1], len(begins))
    order = np.lexsort((-step, at))  # where one ends as another begins, both speak
    at, count = at[order], np.cumsum(step[order])
    runs = int(count.max(initial=0))
    likely = np.flatnonzero(count >= STRAYS * runs)
    best = at[np.argmax(count)]
    likely = likely[np.abs(at[likely] - best) <= spread]
    least, most = int(at[likely[0]]), int(at[likely[-1] + 1])
    far = (at < least - spread) | (at > most + spread)
    others = int(count[far].max(initial=0))
    return _Vote(most, max(spread - (most - least), 0), runs, others)
