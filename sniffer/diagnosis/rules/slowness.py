"""Servos that take longer to answer than their peers. Silent where stamps cannot carry it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place
from sniffer.protocols.base import reply_delay_ns

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "slower-than-peers",
        "timing",
        "A servo takes longer to answer a command than the other servos do.",
        "A tenth of its answers or more, five at least, begin surely (whatever the stamps' uncertainty) 1 ms and by half later than nine tenths of the answers of its peers do (of the middle one of them).",
    ),
    FindingCode(
        "slower-than-its-delay",
        "timing",
        "A servo takes longer to answer than its delay register says.",
        "Half of its answers begin surely a millisecond later than the delay that was read or written.",
    ),
)

MORE_NS: Final = 1_000_000
"""Servos of one kind differ by less: return delays are set in steps of 2 to 50 us, and firmware
answers within some hundred, that of text lines within a millisecond."""

TIMES: Final = 1.5

SHARE: Final = 0.1
LEAST: Final = 5

PEERS: Final = 0.9
"""Nearly all answers of the others are faster than what this share of them is."""

BEYOND_NS: Final = 1_000_000
"""What a servo may need to work out an answer, beside its delay."""


class _Slow(NamedTuple):
    """How slow a servo is in one command: how many answers, of how many, and the bounds."""

    op: int
    slow: int
    of: int
    usual_ns: int
    peers_ns: int
    too_long_ns: int


def slow(case: Case) -> Iterator[Finding]:
    """Servos slower than their peers."""
    if not case.has_clock:
        return
    took = case.ledger.took
    by_op: dict[int, list[int]] = {}
    for key in took.keys:
        by_op.setdefault(key & 0xFFFFFFFF, []).append(key)
    found: dict[int, list[_Slow]] = {}
    fair: dict[int, int] = {}
    for op, keys in by_op.items():
        for key in keys:
            servo, count = (key >> 32) - 1, took.count(key)
            peers = sorted(b for k in keys if k != key and (b := took.at(k, PEERS)) is not None)
            if servo not in case.servos or not peers or count < LEAST:
                continue
            fast = peers[(len(peers) - 1) // 2]
            too_long = max(fast.high, fast.low + MORE_NS, round(TIMES * fast.low))
            late = took.above(key, too_long)
            if late >= max(LEAST, SHARE * count):
                usual = took.at(key, 0.5)
                assert usual is not None
                found.setdefault(servo, []).append(
                    _Slow(op, late, count, usual.low, fast.high, too_long)
                )
            else:
                fair[servo] = fair.get(servo, 0) + count
    if len(found) > len(case.answering) / 2:  # then it is the others that are fast
        return
    for servo, several in found.items():
        if sum(s.of for s in several) < fair.get(servo, 0):
            continue
        yield _finding(case, servo, several)


def _finding(case: Case, servo: int, several: list[_Slow]) -> Finding:
    worst = max(several, key=lambda s: s.slow)
    rows = np.flatnonzero(
        (case.answers["servo_id"] == servo) & (case.answers["took_max"] > worst.too_long_ns)
    )
    a = case.answers
    first, last = (
        (int(a["t_first"][rows[0]]), int(a["t_last"][rows[-1]]))
        if len(rows)
        else (case.first_ns, case.last_ns)
    )
    word = case.protocol.op_name(worst.op)  # its last 32 bits, which hold any usual word
    return Finding(
        "slower-than-peers",
        servo,
        first,
        last,
        sum(s.slow for s in several),
        f"servo {servo} takes at least {worst.usual_ns / 1e6:.2f} ms to answer {word} in the "
        f"middle, {worst.slow} of {worst.of} times longer than it should; nine tenths of another "
        f"servo's answers come within {worst.peers_ns / 1e6:.2f} ms",
        tuple(
            Place(int(a["at"][r]), 1, int(a["t_first"][r]), "a slow answer's request")
            for r in rows[:3]
        ),
        strength=min(0.7 + worst.slow / max(worst.of, 1), 1.0),
        brief=f"servo {servo} answers slowly",
        values=(("usual_ns", worst.usual_ns), ("peers_ns", worst.peers_ns)),
    )


def beyond_delay(case: Case) -> Iterator[Finding]:
    """Servos slower than their own delay register, where that is in microseconds."""
    if not case.has_clock:
        return
    took = case.ledger.took
    for servo in case.answering:
        delays = [
            (row, delay)
            for row, (what, raw) in enumerate(_settings(case, servo))
            if (delay := reply_delay_ns(case.protocol, case.protocol.registers[what], raw))
            is not None
        ]
        if not delays:
            continue
        told = case.settings(servo_id=servo).take(np.array([row for row, _ in delays]))
        delay_ns = max(delay for _, delay in delays)
        keys = [k for k in took.keys if (k >> 32) - 1 == servo]
        key = max(keys, key=took.count, default=None)
        usual = None if key is None else took.at(key, 0.5)
        if key is None or usual is None or took.count(key) < LEAST:
            continue
        if usual.low > delay_ns + BEYOND_NS:
            yield Finding(
                "slower-than-its-delay",
                servo,
                case.first_ns,
                case.last_ns,
                took.count(key),
                f"servo {servo} takes at least {usual.low / 1e6:.2f} ms to answer in the middle; "
                f"its delay register says {delay_ns / 1e6:.2f} ms",
                case.places(told, "its return delay"),
                strength=0.8,
                brief=f"servo {servo} answers slowly",
            )


def _settings(case: Case, servo: int) -> list[tuple[int, int]]:
    h = case.settings(servo_id=servo)
    return [*zip(h.what.tolist(), h.after.tolist(), strict=True)]


RULES: Final[tuple[Rule, ...]] = (slow, beyond_delay)
"""The rules of this file."""
