"""Damage explained in columns: all runs of bytes that no frame claims, of one pass, at once.

``explain`` of a protocol looks at one run and tells everything, some 10 us a damaged place. What is
needed of every gap (where it ends, its kind, whose frame it may have been) is found here for all
runs together; ``explain`` is asked for those that somebody looks at. A test holds the two equal.

Every header may begin a torn frame, and says where that would end whatever stands before it. So all
of them are judged at once; which of them are gaps, a walk tells: from the first header of a run to
the first one behind its end, and so on. All runs walk in step, so the steps are as many as the gaps
of the fullest run. An example, mightyZAP, one run (``H`` a header, times show offsets):

    offset   0  3        9 10          20        the run: noise, two frames, the first cut
             ..  H.......  H...........
    at          [3, 10]                          each header
    end         [10, 20]                         ... where its frame ends
    next        [1, 2]                           the first header at or behind that end
    walk        3 -> 10 -> over                  and noise is what is between: 0..3
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

import numpy as np

from sniffer.ground.gaps import NOISE

if TYPE_CHECKING:
    from sniffer.ground.model import I64, U8

NOBODY = -1


class Runs(NamedTuple):
    """Bytes that no frame claims, put together; run i is ``data[start[i]:end[i]]``."""

    data: U8
    start: I64
    end: I64

    def byte(self, at: I64) -> I64:
        """Return the bytes at some offsets, as numbers; what lies behind the last one is it."""
        return self.data[np.minimum(at, len(self.data) - 1)].astype(np.int64)

    def find(self, header: bytes) -> I64:
        """Return where a header stands, also overlapping, that no run's end cuts."""
        m = max(len(self.data) - len(header) + 1, 0)
        mask = np.ones(m, bool)
        for k, byte in enumerate(header):
            mask &= self.data[k : k + m] == byte
        at = np.flatnonzero(mask)
        return at[at + len(header) <= self.end[self.of(at)]]

    def of(self, at: I64) -> I64:
        """Return the number of the run that each offset lies in."""
        return np.searchsorted(self.end, at, "right")


class Torn(NamedTuple):
    """What each header would be the beginning of, if a gap began there; numbers as in ``Gaps``."""

    at: I64
    end: I64
    kind: U8
    servo_id: I64
    expected: I64
    got: I64


class Pieces(NamedTuple):
    """The gaps of all runs, in order: edges, kinds, servos (-1: none told), numbers and runs."""

    start: I64
    end: I64
    kind: U8
    servo_id: I64
    expected: I64
    got: I64
    run: I64


@runtime_checkable
class Surveyor(Protocol):
    """A protocol that can tell in columns what headers in unclaimed bytes are."""

    def survey(self, runs: Runs) -> Torn:
        """Judge every header of the runs, in order, as ``explain`` would."""
        ...


def pieces(protocol: Surveyor, data: U8, start: I64, end: I64) -> Pieces:
    """Cut the runs ``data[start:end]`` into gaps as ``protocol.explain`` does.

    Args:
        protocol: of these bytes.
        data: of the pass.
        start: of each run, in order; runs do not overlap.
        end: of each run, behind its last byte.
    """
    size = end - start
    last = np.cumsum(size)
    shift = start - (last - size)
    runs = Runs(data[np.arange(int(last[-1])) + np.repeat(shift, size)], last - size, last)
    torn = protocol.survey(runs)
    kept = _walk(runs, torn)
    at, behind = torn.at[kept], torn.end[kept]
    # Noise is what lies between one piece (or the run's beginning) and the next (or its end).
    begins = np.sort(np.concatenate([runs.start, behind]))
    ends = np.sort(np.concatenate([at, runs.end]))
    some = np.flatnonzero(ends > begins)
    first = np.concatenate([at, begins[some]])
    order = np.argsort(first, kind="stable")
    nothing = np.full(len(some), -1)
    first = first[order]
    run = runs.of(first)
    who, expected, got = (
        np.concatenate([column[kept], nothing])[order]
        for column in (torn.servo_id, torn.expected, torn.got)
    )
    return Pieces(
        first + shift[run],
        np.concatenate([behind, ends[some]])[order] + shift[run],
        np.concatenate([torn.kind[kept], np.full(len(some), NOISE, np.uint8)])[order],
        who,
        expected,
        got,
        run,
    )


def _walk(runs: Runs, torn: Torn) -> I64:
    """Return which headers begin a gap, from left to right in every run."""
    stop = np.searchsorted(torn.at, runs.end)
    row = np.searchsorted(torn.at, runs.start)
    onward = np.searchsorted(torn.at, torn.end)
    found: list[I64] = []
    while True:
        going = row < stop
        row, stop = row[going], stop[going]
        if not len(row):
            return np.sort(np.concatenate(found)) if found else row
        found.append(row)
        row = onward[row]


def following(every: I64, at: I64, end: I64) -> I64:
    """Return for each offset the first header at or behind it, or the end of its run."""
    onward = np.append(every, np.iinfo(np.int64).max)[np.searchsorted(every, at)]
    return np.asarray(np.minimum(onward, end))
