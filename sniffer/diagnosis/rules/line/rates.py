"""What is said on the line at another rate."""

from __future__ import annotations

import functools
from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.beginnings import most_begun
from sniffer.diagnosis.case import BUCKET_NS
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.rates_in_use import COMMON, rates_in_use
from sniffer.diagnosis.evidence.sameness import come_again
from sniffer.diagnosis.ledger.unclaimed import first_low
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.comparing import REPEATS, SEQUENCE, is_even, repeated
from sniffer.diagnosis.physics.uart import MIDDLE
from sniffer.ground.distinct import numbers
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64, Mask

FINDINGS: Final = (
    FindingCode(
        "nothing-holds",
        "Hardly a byte belongs to a frame, from the first one on, and yet the same sequences come again and again, as in a conversation.",
        "Less than a fifth of all bytes in frames, many different values, and sequences of six bytes that repeat.",
    ),
    FindingCode(
        "begins-hold",
        "Hardly a byte belongs to a frame, and yet frames begin as they should, again and again: the rate is right.",
        "Twenty beginnings and more of frames of one protocol, with header, id and a known command, and of about the length they state, in three tenths of the bytes (nine tenths where frames are short).",
    ),
    FindingCode(
        "bits-of-another-rate",
        "The line changes its level only every few bits of the receiver: who speaks runs slower.",
        "Of bytes that are no frame nearly all begin with a low of two bits or more, in multiples of one length; or all of them are 00, and no more than half as many as fit on the line: a low lasts a byte and longer. Where no rate was stated it tells how many times slower the line is.",
    ),
    FindingCode(
        "bits-read-twice",
        "A bit of every byte has the value of the bit before it, whoever speaks: it was read twice, as the line is a little slower than the receiver.",
        "A hundredth of the bytes or more in no frame; in all bytes but one in a thousand, in frames or not, of sixteen values or more, the same bits are like their neighbours, as one rate has it, and all others differ from theirs now and then; not where nine tenths hold, and what does not is the same bytes again and again.",
    ),
)

LEAST: Final = 100
"""Bytes that no protocol explains; of fewer nothing can be said."""

HELD: Final = 0.2
"""Part of the bytes that holds by chance, at most."""

VALUES: Final = 4
"""Different values: a line that is stuck gives one or two."""

ALL_LOW: Final = 9
"""Bits that are low in a 00, with its start bit."""

TALKING, MOMENTS = 8, 8
"""Lows in a quarter second that are more than a line has that falls now and then, and in how many."""

APART: Final = 0.45
"""Part of the bytes that fit on the line: lows that are apart by a high each leave that free."""

NONE: Final = 0.01
PLENTY: Final = 500
"""Part of so many bytes that hold: noise that takes all frames from the first one on is no noise."""

TORN: Final = 0.01
"""Part of the bytes in no frame at least: where all holds, alike bits are what is said."""

MOSTLY: Final = 0.9
"""Part of the bytes in frames from which on the same bytes that are no frame, again and again, were
sent so: a rate that is off tears frames of all kinds, each by what it says."""

VARIED, MANY = 16, 40
"""Different values in which bits are alike, in one of two ways; LSS says no more with few servos."""

NOISE: Final = 1e-3
"""Part of the bytes that may be torn besides."""

UNLIKE: Final = 4
"""Values in which each other pair of bits differs."""

POINTS: Final = (0.5, MIDDLE, 0.5625)
"""Where in a bit it is sampled: a UART of 16 samples a bit sees an edge up to one sample late."""

_BITS: Final = np.arange(256)[:, None] >> np.arange(8) & 1

_PAIRS: Final = _BITS[:, :-1] ^ _BITS[:, 1:]
"""By value and bit: whether that bit differs from the next one."""

TIMES: Final = tuple(1 + k / 500 for k in range(20, 300))
"""How many times slower a line is looked for; below, no bit is read twice, above, half of them are."""


def nothing_holds(case: Case) -> Iterator[Finding]:
    """Look whether this is a conversation that was read at a wrong rate."""
    total, head = case.ledger.bytes, case.ledger.head
    lost = int(case.line["gap_bytes"].sum())
    # a line that is held for long behind sound talk has no frame there, and no conversation either
    talked = total - case.held_bytes
    if total < LEAST or total - lost > HELD * talked or case.ledger.is_shared:
        return
    again = repeated(head)
    slower = _slower(case, head)
    if len(set(head)) < VALUES and slower is None:
        return
    # bits that a wrong rate cuts anew each time repeat little, but nothing ever holds by them
    varies = again < REPEATS and slower is None
    if varies and (total - lost > NONE * total or total < PLENTY or is_even(head)):
        return
    t = case.line["t_first"].min(), case.line["t_last"].max()
    place = Place(0, min(total, 64), int(t[0]), "no frame")
    rate = case.baud
    yield Finding(
        "nothing-holds",
        None,
        int(t[0]),
        int(t[1]),
        lost,
        f"{100 * (1 - lost / total):.1f} % of {total} bytes are in frames, and {100 * again:.0f} % "
        f"of their sequences of {SEQUENCE} come again",
        (place,),
        strength=min(0.6 + again, 1.0),
        brief=f"nothing holds at {rate} baud" if case.rate_is_known else "nothing holds",
    )
    begun = most_begun(head)
    if begun is not None:
        yield Finding(
            "begins-hold",
            None,
            int(t[0]),
            int(t[1]),
            begun.n,
            str(begun),
            (place,),
            brief="frames begin well, and do not end so",
        )
    elif slower is not None:
        times, told = slower
        known, least = case.rate_is_known, " or less" * (times == ALL_LOW)
        yield Finding(
            "bits-of-another-rate",
            None,
            int(t[0]),
            int(t[1]),
            lost,
            f"the line changes every {times} bits of the receiver or more: "
            + "; ".join(
                f"heard at {heard} baud, it runs at about {runs}{least}"
                for heard, runs in ([(rate, told)] if known else _usual(times))
            ),
            (place,),
            strength=0.5 if least else 1.0,  # nobody has seen how long a low is
            brief=f"the line runs at about {told} baud{least}"
            if known
            else f"the line is {times} times slower than the receiver" + " or more" * bool(least),
            values=(("baud", told),) if known else (),
        )


def _usual(times: int) -> list[tuple[int, int]]:
    """Return the rates at which a tap usually listens, and what a line then runs at."""
    usual = sorted({PROTOCOLS[name].baud for name in PROTOCOLS.built_in}, reverse=True)
    return [(heard, _rate(heard, times)) for heard in usual]


def bits_read_twice(case: Case) -> Iterator[Finding]:
    """Look whether bits are alike in all bytes as a receiver has it that is a little too fast.

    A bit is sampled so long after the start bit began; of a line that is 1.11 times slower the
    fourth and the fifth sample fall into its fourth bit. What holds at such a rate are bytes in
    which these are alike anyway, so requests and answers of some kinds may be whole.
    """
    total, head = case.ledger.bytes, np.frombuffer(case.ledger.head, np.uint8)
    lost = int(case.line["gap_bytes"].sum())
    if total < LEAST or lost < TORN * total:
        return
    if lost < (1 - MOSTLY) * total and come_again(case):
        return
    values = len(numbers(head))
    if values < VARIED:
        return
    # a loop that says little may have bits alike in all it says; what noise does to it, has not
    unclaimed = np.frombuffer(b"".join(run.data for run in case.ledger.unclaimed.runs), np.uint8)
    counts = [np.bincount(some, minlength=256) for some in (head, unclaimed)]
    fit = {ways for ways in set(map(_twice, TIMES)) if _fits(ways, *counts)}
    fitting = [times for times in TIMES if _twice(times) in fit]
    if not fitting:
        return
    rate = case.baud
    fits = [b for b in rates_in_use() if fitting[0] <= rate / b <= fitting[-1]]
    told = min(fits, key=lambda b: abs(b * (fitting[0] + fitting[-1]) / 2 - rate), default=None)
    share = _PAIRS[head].mean(0)
    bits = sorted({k for times in fitting for way in _twice(times) for k in way})
    bits = [k for k in bits if share[k] <= NOISE] or bits
    t = int(case.line["t_first"].min()), int(case.line["t_last"].max())
    slower = [round(100 * (1 - 1 / times)) for times in (fitting[0], fitting[-1])]
    by = f"{slower[0]} to {slower[1]} %" if slower[0] < slower[1] else f"{slower[0]} %"
    pairs = " or ".join(f"bit {k + 1} as bit {k}" for k in bits)
    yield Finding(
        "bits-read-twice",
        None,
        *t,
        lost,
        f"{len(head)} bytes, {values} different ones, have {pairs}: the line is {by} slower "
        f"than the receiver" + (f", at {rate} baud it is {told}" if told else ""),
        (Place(0, min(total, 64), t[0], "each byte has these bits alike"),),
        brief="a bit of every byte is read twice"
        + (f": the line runs at {told} baud" if told and case.rate_is_known else ""),
        values=(("baud", told),) if told and case.rate_is_known else (),
    )


Pairs = tuple[int, ...]
"""Bits that are read as those before them, by these."""


def _fits(ways: Sequence[Pairs], *counts: I64) -> bool:
    """Tell whether all bytes are as one of some ways has it, or each as any of them.

    Not where there is no way: then no bit is read twice, or not by every receiver. Of each part of
    the bytes it is told how often each value comes, and of all of them first.
    """
    if not ways:
        return False
    alike: list[Mask] = [_PAIRS[:, list(way)].sum(1) == 0 for way in ways]
    if np.count_nonzero(counts[0]) >= MANY:
        alike.append(np.logical_or.reduce(alike))
    others = [k for k in range(7) if not any(k in way for way in ways)]
    differ = np.count_nonzero(_PAIRS[:, others] * counts[0][:, None], axis=0)
    return bool((differ >= UNLIKE).all()) and any(
        all(count[mine].sum() >= (1 - NOISE) * count.sum() for count in counts) for mine in alike
    )


@functools.cache
def _twice(times: float) -> tuple[Pairs, ...]:
    """Return which bits are read twice of a line that is so many times slower, in all ways.

    Where a sample falls near the edge of a bit, when in its own clock the receiver saw the start
    bit tells on which side.
    """
    at = np.arange(8) + 1
    read = [np.floor((at + point) / times) for point in POINTS]
    ways = [tuple(np.flatnonzero(np.diff(one) == 0).tolist()) for one in read]
    return tuple(dict.fromkeys(ways)) if all(ways) else ()


def _slower(case: Case, data: bytes) -> tuple[int, int] | None:
    """Return how many times slower the line is, and the rate; None where it is not."""
    lows = Counter(first_low(data))
    total = sum(lows.values())
    if total <= TORN * len(data):
        return _much_slower(case)
    if total < LEAST // 2 or lows[1] > 0.05 * total:
        return None
    if max(lows.values()) == len(data):
        return None  # one value alone: nobody says only that
    times = next(n for n in sorted(lows) if sum(lows[k] for k in lows if k <= n) > 0.05 * total)
    return times, _rate(case.baud, times)


def _much_slower(case: Case) -> tuple[int, int] | None:
    """Return the same of a line of which each low lasts a byte or longer, so that all is 00.

    A line that is held low is heard as one 00, or as one behind the other; of one that much slower
    the receiver hears half as many at most, as each low is followed by a high no shorter.
    """
    if not case.has_clock:
        return None
    baud = case.baud if case.rate_is_known else max(PROTOCOLS[n].baud for n in PROTOCOLS.built_in)
    heard = case.line["bytes"]
    talks = (heard >= TALKING) & (heard * byte_time_ns(baud) < APART * BUCKET_NS)
    if talks.sum() < MOMENTS or talks.sum() < 0.9 * (heard > 0).sum():
        return None
    return ALL_LOW, _rate(case.baud, ALL_LOW)


def _rate(heard: int, times: int) -> int:
    """Return the rate in use that is so many times slower than one at which the line was heard."""
    if times >= ALL_LOW:  # or more
        return max((one for one in COMMON if one <= heard / times), default=COMMON[0])
    return min(rates_in_use(), key=lambda rate: abs(rate * times / heard - 1))


RULES: Final[tuple[Rule, ...]] = (nothing_holds, bits_read_twice)
"""The rules of this file."""
