"""Why no frame claims some bytes, for all runs of a pass at once: ``Words.explain`` in columns."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.gaps import CHECKSUM, DAMAGED, TRUNCATED
from sniffer.protocols.explaining import NOBODY, Torn, following

if TYPE_CHECKING:
    from sniffer.ground.model import I64
    from sniffer.ground.plan import Plan
    from sniffer.protocols.explaining import Runs


def survey(
    runs: Runs,
    plan: Plan,
    heads: tuple[bytes, bytes],
    totals: tuple[I64, I64],
    sole_id: int | None,
) -> Torn:
    """Judge every header of the runs.

    Args:
        runs: to look at.
        plan: of the packets.
        heads: the header, and that of answers where they have their own.
        totals: bytes of a whole packet, and of an answer with a header of its own, by what tells
            the size; -1, or beyond the end: that tells none.
        sole_id: whose all packets are where none names a servo.

    For example, mightyZAP's answer of nine bytes with one bit wrong, and five bytes of a request::

        bytes      FF FF FF 01 04 00 10 01 E8 | FF FF FF 02 04
        at         0    9
        stop       9    18        where each ends by its own size
        onward     9    14        the next header, or the end of the run
        cut        0    1         the second one is not all there
        until      9    14
        expected   233  9         the checksum that would hold; bytes there should be
        got        232  5

    What holds: every header of a run is judged alone, by bytes of its run; a size that cannot be
    ends what it claims behind the size. A walk that went on where the last one ended would let one
    wrong size hide the headers in what it claims.
    """
    who, (size_at, width) = plan.at.get("servo_id", len(plan.header)), size_place(plan)
    every = runs.find(heads[0])
    answers = np.zeros(len(every), bool)
    if heads[1]:
        others = runs.find(heads[1])
        answers = np.repeat([False, True], [len(every), len(others)])
        every = np.concatenate([every, others])
        order = np.argsort(every, kind="stable")
        every, answers = every[order], answers[order]
    # an id is never a header's byte: of headers that overlap in one run, the last one is it
    run = runs.of(every)
    is_last = np.ones(len(every), bool)
    is_last[:-1] = (every[1:] != every[:-1] + 1) | (run[1:] != run[:-1])
    at, answers = every[is_last], answers[is_last]
    end = runs.end[runs.of(at)]
    behind = at + size_at + width
    size = sum(runs.byte(at + size_at + k) << 8 * k for k in range(width))
    size = np.where(behind <= end, size, -1)
    known = np.clip(size, 0, len(totals[0]) - 1)
    total = np.where(answers, totals[1][known], totals[0][known])
    impossible = (size >= 0) & ((size >= len(totals[0])) | (total < 0))
    stop = at + total
    onward = following(every, at + len(plan.header), end)
    cut = (size < 0) | (stop > end) | ((onward < end) & (onward < stop - plan.behind))
    cut &= ~impossible
    until = np.where(impossible, behind, np.where(cut, onward, stop))
    kind = np.where(cut, TRUNCATED, DAMAGED).astype(np.uint8)
    whole = np.flatnonzero(~impossible & ~cut)
    # One that holds and is no frame all the same has a body that its guards refuse.
    want, sent = plan.broken(runs.data, at[whole], until[whole])
    kind[whole[want >= 0]] = CHECKSUM
    # A header with nothing behind it is of no certain length, even where all packets are as long.
    expected = np.where(cut & (size >= 0) & (at + len(plan.header) < end), total, -1)
    got = np.where(cut, until - at, -1)
    expected[whole], got[whole] = want, sent
    named = ~impossible & (until - at > who)
    servo_id = runs.byte(at + who) if sole_id is None else np.full(len(at), sole_id)
    return Torn(at, until, kind, np.where(named, servo_id, NOBODY), expected, got)


def size_place(plan: Plan) -> tuple[int, int]:
    """Return where the size of a packet stands, and how wide; of none behind the header, 0 wide."""
    if not plan.size:
        return len(plan.header), 0
    return plan.at[plan.size], plan.width[plan.size]
