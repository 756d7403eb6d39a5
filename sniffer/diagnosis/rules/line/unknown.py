"""Packets of a protocol that is not known here: at a wrong rate no length would be one."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.beginnings import most_begun
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.distinct import within

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

WRITE_IT: Final = (
    "The rate is right, and the protocol is none that is built in: decode it by a plug-in "
    "(`--protocol FILE.py`; examples/protocols has DYNAMIXEL and Feetech, docs/plugins.md says how to "
    "write one)."
)

FINDINGS: Final = (
    FindingCode(
        "unknown-packets",
        "The bytes are packets that state their length, of a protocol that is not known here.",
        "Less than a fifth of the bytes in frames, none of which begin well; the same two bytes thirty times and more, and a byte behind them that is, but for a constant, how far it is to the next, in nine tenths, with two lengths and more.",
        remedy=WRITE_IT,
        settle=WRITE_IT,
    ),
)

HELD: Final = 0.2
"""Part of the bytes that are frames of a known protocol by chance, at most."""

LEAST: Final = 30
"""Headers that are no chance."""

SHARE: Final = 0.9
"""Part of the packets whose length is right: at the ends of what is kept one is cut, and noise tears
some."""

LENGTHS: Final = 2
"""Different lengths: of one alone any constant byte is the length."""

SECOND: Final = 0.1
"""Part of the packets that are of other lengths than the usual one."""

PLACES, MORE = range(2, 8), range(13)
"""Where in a packet its length stands, and how many bytes it does not count. Source: DYNAMIXEL 1 and
Feetech (3, 4), DYNAMIXEL 2 (5, 7), HerkuleX (2, 0), LX-16A (3, 3), Kondo and Modbus have none."""

TRIED: Final = 3
"""Pairs of bytes that may be a header: those that come most often."""


class _Form(NamedTuple):
    """A header, where the length stands, what it does not count, and how many packets have it."""

    header: bytes
    place: int
    more: int
    n: int
    of: int
    first: int


def unknown_packets(case: Case) -> Iterator[Finding]:
    """Look whether what no frame claims are packets of a form that nobody here knows."""
    total, head = case.ledger.bytes, case.ledger.head
    lost = int(case.line["gap_bytes"].sum())
    if case.ledger.is_shared or lost < (1 - HELD) * total or most_begun(head) is not None:
        return
    form = case.once(_form)
    if form is None:
        return
    begin, end = case.line["t_first"].min(), case.line["t_last"].max()
    shown = form.header.hex(" ").upper()
    yield Finding(
        "unknown-packets",
        None,
        int(begin),
        int(end),
        form.n,
        f"{form.n} of {form.of} pieces that begin with {shown} are as long as their byte "
        f"{form.place + 1} says ({form.more} more): packets of a protocol that is not known here",
        (Place(form.first, 16, int(begin), f"a packet that begins with {shown}"),),
        brief=f"packets that begin with {shown}, of a protocol that is not known here",
    )


def _form(case: Case) -> _Form | None:
    """Return the form of most packets; None: they have none that shows."""
    head = case.ledger.head
    pairs = Counter(itertools.pairwise(head))
    forms = (_form_of(head, bytes(pair)) for pair, _ in pairs.most_common(TRIED))
    found = [form for form in forms if form is not None]
    return max(found, key=lambda form: form.n, default=None)


def _form_of(head: bytes, header: bytes) -> _Form | None:
    """Return how packets with a header state their length, if they do."""
    data = np.frombuffer(head, np.uint8).astype(np.int64)
    at = np.flatnonzero((data[:-1] == header[0]) & (data[1:] == header[1]))
    at = at[at + max(PLACES) < len(data)]
    best: _Form | None = None
    for place in PLACES:
        for more in MORE:
            ends = at + data[at + place] + more
            if np.count_nonzero(within(ends, at)) < LEAST:
                continue
            kept = _in_a_row(at, ends)
            whole = within(ends[kept], at[kept])
            n, of = int(whole.sum()), len(kept)
            lengths = np.unique(ends[kept][whole] - at[kept][whole], return_counts=True)[1]
            is_told = n >= LEAST and len(lengths) >= LENGTHS and n - lengths.max() >= SECOND * n
            if is_told and n >= SHARE * of and (best is None or n > best.n):
                best = _Form(header, place, more, n, of, int(at[kept[0]]))
    return best


def _in_a_row(at: I64, ends: I64) -> I64:
    """Return which headers begin packets: those within a packet are bytes of it."""
    kept, until = [], 0
    for k, (begin, end) in enumerate(zip(at.tolist(), ends.tolist(), strict=True)):
        if begin >= until:
            kept.append(k)
            until = end if end > begin + 2 else begin + 1
    return np.array(kept, np.int64)


RULES: Final[tuple[Rule, ...]] = (unknown_packets,)
"""The rules of this file."""
