"""Requests at one rate after the other: somebody looks for the rate of the servos."""

from __future__ import annotations

import bisect
import functools
import re
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.rates_in_use import rates_in_use
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.uart import FALLS, heard, sent
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.unclaimed import UnclaimedRun
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "rates-tried",
        "Requests are said at one rate after the other: somebody looks for the rate of the servos.",
        "Bytes of no frame are what a receiver makes of requests that hold here, of two bytes and more "
        "each, sent at two other rates and more: three requests and more, and no more answers "
        "meanwhile; nine tenths of such bytes stand among these.",
    ),
)

FULL: Final = 6
VALUES, NO_FALLS = 3, 2
"""Bytes that are no chance, of so many values; a line that falls low for a moment makes some of them."""

SHORTEST: Final = 2
"""Bytes that a request is heard as, at the least: noise is any byte, one by one."""

LEAST, RATES = 3, 2
"""Requests that were heard at another rate, and rates, that make a search."""

NEARLY: Final = 0.9
"""Part of the bytes of no frame that a search explains: others have another cause."""

BEFORE_NS: Final = 10 * NS
"""So long before the first request that is recognised, and behind the last, it may go on: what is far
slower or faster is heard as a byte or two."""

APART: Final = 1.25
"""How many times faster or slower another rate is: nearer ones are a clock that is off."""

KEPT: Final = 32
"""Requests that are tried, the first ones: each costs a tenth of a millisecond a rate."""


class _OtherRate(NamedTuple):
    """Bytes of a run that are requests at another rate."""

    baud: int
    run: UnclaimedRun
    at: int
    length: int
    n: int
    """How many requests that is."""


def rates_tried(case: Case) -> Iterator[Finding]:
    """Look for requests at other rates in the bytes that no frame claims."""
    runs = [run for run in case.ledger.unclaimed.runs if len(run.data) >= VALUES]
    total = int(case.line["gap_bytes"].sum())
    if total < FULL or not case.rate_is_known:
        return
    known = case.ledger.exchanges.kinds.requests[:KEPT]
    may_be = [one for baud in rates_in_use() for one in _at_rate(case.baud, baud, known, runs)]
    seen = _longest(may_be)
    bauds = sorted({one.baud for one in seen})
    requests = sum(one.n for one in seen)
    if requests < LEAST or len(bauds) < RATES:
        return
    then = (case.answers["t_first"] >= seen[0].run.t_ns) & (
        case.answers["t_last"] <= seen[-1].run.t_ns
    )
    if case.answers["ok"][then].sum() > requests:
        return  # a conversation goes on meanwhile: who searches has found nobody yet
    first_ns, last_ns = seen[0].run.t_ns - BEFORE_NS, seen[-1].run.t_ns + BEFORE_NS
    near = (case.line["t_first"] >= first_ns) & (case.line["t_first"] <= last_ns)
    if case.line["gap_bytes"][near].sum() < NEARLY * total:
        return
    lost = case.line["gap_bytes"][near] > 0
    told = ", ".join(map(str, bauds))
    yield Finding(
        "rates-tried",
        None,
        int(case.line["t_first"][near][lost].min()),
        int(case.line["t_last"][near][lost].max()),
        requests,
        f"requests that hold here at {case.baud} baud are also sent at {told}: bytes of no frame are what "
        f"a receiver makes of {requests} of them",
        tuple(
            Place(one.at, one.length, one.run.t_ns, f"requests at {one.baud} baud")
            for one in {one.baud: one for one in reversed(seen)}.values()
        ),
        brief=f"requests at {told} baud, too",
    )


def _at_rate(
    mine: int, baud: int, known: Sequence[bytes], runs: Sequence[UnclaimedRun]
) -> Iterator[_OtherRate]:
    """Yield where runs are known requests in a row, as they are heard if sent at another rate."""
    if 1 / APART < mine / baud < APART:
        return
    heard_as = {_heard(one, mine, baud) for one in known}
    images = sorted((i for i in heard_as if len(i) >= SHORTEST), key=len, reverse=True)
    if not images:
        return
    one = re.compile(b"|".join(map(re.escape, images)), re.DOTALL)
    in_a_row = re.compile(b"(?:%b)+" % one.pattern, re.DOTALL)
    for run in runs:
        for found in in_a_row.finditer(run.data):
            data = found.group()
            values = {*data}
            if len(data) >= FULL and len(values) >= VALUES and len(values - FALLS) >= NO_FALLS:
                n = len(one.findall(data))
                yield _OtherRate(baud, run, run.at + found.start(), len(data), n)


def _longest(found: Sequence[_OtherRate]) -> list[_OtherRate]:
    """Return of those that share bytes the longest, by place: near rates are heard alike."""
    out: list[_OtherRate] = []
    for one in sorted(found, key=lambda one: -one.length):
        k = bisect.bisect(out, one.at, key=lambda other: other.at)
        is_behind = k == 0 or out[k - 1].at + out[k - 1].length <= one.at
        if is_behind and (k == len(out) or one.at + one.length <= out[k].at):
            out.insert(k, one)
    return out


@functools.lru_cache(1 << 12)
def _heard(request: bytes, mine: int, baud: int) -> bytes:
    """Return what a receiver of a rate makes of a request that is sent at another one."""
    return heard(sent(request, mine / baud))


RULES: Final[tuple[Rule, ...]] = (rates_tried,)
"""The rules of this file."""
