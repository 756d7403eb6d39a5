"""RS30x: what headers in unclaimed bytes are, in columns; ``block.explain`` tells it of one run."""

from __future__ import annotations

import numpy as np

from sniffer.ground.gaps import CHECKSUM, DAMAGED, TRUNCATED
from sniffer.protocols.explaining import NOBODY, Runs, Torn, following
from sniffer.protocols.rs30x.block import OVERHEAD, PLAN, REACH, RETURN_PLAN
from sniffer.protocols.rs30x.grammar import (
    COMMAND_ADDRESS,
    MOST_DATA,
    RESET_BIT,
    RESET_WITH_DATA,
)

_RESET_LENGTH = RESET_WITH_DATA.sizeof()


def survey(runs: Runs) -> Torn:
    """Judge every header: a packet with a wrong sum, one that contradicts itself, or a cut one."""
    head = len(PLAN.header)
    returned = runs.find(RETURN_PLAN.header)
    at = np.sort(np.concatenate([runs.find(PLAN.header), returned]))  # no byte begins both
    run_end = runs.end[runs.of(at)]
    stop = following(at, at + head, run_end)
    byte = {name: runs.byte(at + k) for name, k in PLAN.at.items()}
    back = runs.byte(at) == RETURN_PLAN.header[0]
    have = stop - at
    told = have >= PLAN.prefix
    content = byte["length"] * byte["count"]
    excess = told & np.where(back, byte["count"] != 1, content > MOST_DATA)
    reset = (byte["flags"] & RESET_BIT > 0) & (byte["address"] == COMMAND_ADDRESS) & (content == 0)
    reset &= ~back & (have >= _RESET_LENGTH) & (runs.byte(at + PLAN.tail_at) == 0xFF)
    need = np.where(reset, _RESET_LENGTH, OVERHEAD + np.where(back, byte["length"], content))
    until = at + need
    whole = told & ~excess & (until <= run_end) & (stop >= until - 1)
    end = np.where(whole, until, np.where(excess, np.minimum(stop, at + REACH), stop))
    kind = np.where(whole | excess, DAMAGED, TRUNCATED).astype(np.uint8)
    sums = np.flatnonzero(whole)
    want, sent = PLAN.broken(runs.data, at[sums], until[sums])
    kind[sums[want >= 0]] = CHECKSUM
    cut = kind == TRUNCATED
    expected, got = np.where(cut & told, need, -1), np.where(cut, have, -1)
    expected[sums], got[sums] = want, sent
    read = np.minimum(stop, at + np.where(told & ~excess, need, REACH) - 1) - at
    servo_id = np.where(read > PLAN.at["servo_id"], byte["servo_id"], NOBODY)
    # Headers in a row, each too near the next to tell its length, are one gap up to the last.
    near = (have < PLAN.prefix) & (stop < run_end)
    last = np.minimum.accumulate(np.where(near, len(at), np.arange(len(at)))[::-1])[::-1]
    row = near & np.append(near[1:], False)
    end = np.where(row, at[last], end)
    kind[row] = TRUNCATED
    servo_id[row] = NOBODY
    expected[row], got[row] = -1, (end - at)[row]
    return Torn(at, end, kind, servo_id, expected, got)
