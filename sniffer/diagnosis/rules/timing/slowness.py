"""Servos that take longer to answer than their peers. Silent where stamps cannot carry it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.acks import seldom_answered
from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.parts import grows, part_of
from sniffer.diagnosis.ledger.keys import pair_key, pair_of
from sniffer.diagnosis.ledger.slowest import SLOW_NS
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.distinct import within
from sniffer.protocols.base import reply_delay_ns

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.events import Happenings
    from sniffer.diagnosis.ledger.histograms import Histograms
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import F64, I64

LESS_DELAY: Final = "It does as it is told: write it a smaller return delay, if it is to answer as soon as the others."

NO_SETTING: Final = "Switch it off and on, and see whether it answers as soon as in the beginning: no setting changes by itself, so look at its temperature, its supply and its firmware."

FINDINGS: Final = (
    FindingCode(
        "slower-than-peers",
        "A servo takes longer to answer a command than the other servos do.",
        "A tenth of its answers or more, five at least, and three times as many as of its peers and by no chance, begin surely (whatever the stamps' uncertainty) 1 ms and by half later than nine tenths of its peers' answers take at least (of the middle one of them). Where the rate is unsure: the same of their ends, which need none, with as much to spare as answers of other lengths take.",
    ),
    FindingCode(
        "slow-by-its-delay",
        "A servo takes longer to answer than the other servos do, and its delay register says so.",
        "The same, where the delay that was read or written is longer than its peers take, and is what it takes at least.",
        remedy=LESS_DELAY,
        settle=LESS_DELAY,
    ),
    FindingCode(
        "slower-and-slower",
        "A servo takes longer and longer to answer, and the other servos do not.",
        "The same, where what its answers take on average grows in at least three of four steps from one fifth of the time to the next by a tenth, falls in none, and by a millisecond and more than stamps may be off in all, and that of the others' answers does not.",
        remedy=NO_SETTING,
        settle=NO_SETTING,
        concerns="",
    ),
    FindingCode(
        "late-replies",
        "Answers of a servo come so late that they are taken for those to later requests, or for nobody's.",
        "At least three answers behind their window, three times as often as those of others and by no chance.",
    ),
    FindingCode(
        "slower-than-its-delay",
        "A servo takes longer to answer than its delay register says.",
        "Half of its answers begin surely a millisecond later than the delay that was read or written.",
    ),
)

TIMES: Final = 1.5

SHARE: Final = 0.1
LEAST: Final = 5

CHANCE: Final = 1e-3
OFTENER: Final = 3
"""So seldom a servo would be late as often as it is if it were late as its peers are, and so many times
as often as they it is: a busy host is late with any servo's answer now and then, with some servo's
oftener as it is busy at some step, and a tenth of all are later than nine tenths."""

AGAIN: Final = 3
"""Answers behind their window that are a habit."""

MOSTLY: Final = 0.9
"""What nearly all answers of a servo are is the servo's: noise, and who speaks into them, move some."""

PEERS: Final = 0.9
"""Nearly all answers of the others are faster than what this share of them is."""

BEYOND_NS: Final = 1_000_000
"""What a servo may need to work out an answer, beside its delay."""

PARTS: Final = 5
RISE: Final = 0.1
"""Parts of the time, and by which part of what it was a delay that grows rises from one to the next."""


HEARD: Final = 0.5
"""Part of the others' answers that must be whole for their times to count in full."""


class _Slow(NamedTuple):
    """How slow a servo is in one command: how many answers, of how many, and the bounds."""

    op: int
    slow: int
    of: int
    usual_ns: int
    peers_ns: int
    theirs: tuple[int, int]
    """How many answers of the peers are as late, of how many."""
    too_long_ns: int
    ends: bool
    """Whether that is until its answers end."""


class _Times(NamedTuple):
    """How long the likes of one request take, by servo: a row of a histogram each."""

    op: int
    rows: Mapping[int, int]
    spare_ns: int
    """By how much more they may differ though none is slow."""


def slow(case: Case) -> Iterator[Finding]:
    """Servos slower than their peers."""
    if not case.has_clock:
        return
    found = _slower(case, *_to_the_beginning(case), ends=False)
    if not found and case.ledger.exchanges.slower_ns:
        found = _slower(case, *_to_the_end(case), ends=True)
    for servo, several in found.items():
        yield _finding(case, servo, several)


def _slower(
    case: Case, told: Histograms, likes: Sequence[_Times], *, ends: bool
) -> dict[int, list[_Slow]]:
    """Return the servos that are slower than their peers, in most of what they are asked."""
    found: dict[int, list[_Slow]] = {}
    fair: dict[int, int] = {}
    for one in likes:
        keys = [*one.rows.values()]
        usual_of = {k: bounds for k in keys if (bounds := told.at(k, PEERS)) is not None}
        in_order = sorted(usual_of, key=lambda k: usual_of[k])
        every = sum(map(told.count, keys))
        later: dict[int, int] = {}  # how many answers of all of them are later than that
        for servo, key in one.rows.items():
            count = told.count(key)
            peers = [k for k in in_order if k != key]
            if servo not in case.servos or not peers or count < LEAST:
                continue
            fast = usual_of[peers[(len(peers) - 1) // 2]]
            more = SLOW_NS + one.spare_ns
            too_long = max(fast.low + more, round(TIMES * fast.low))
            late = told.above(key, too_long)
            if too_long not in later:
                later[too_long] = sum(told.above(k, too_long) for k in keys)
            as_late, of_all = later[too_long] - late, every - count
            # one more than was seen: of peers that never were late nobody knows that they never are
            theirs = (1 + as_late) / (1 + of_all)
            is_more = late >= OFTENER * theirs * count and at_least(late, count, theirs) < CHANCE
            if is_more and late >= max(LEAST, SHARE * count):
                usual = told.at(key, 0.5)
                assert usual is not None
                found.setdefault(servo, []).append(
                    _Slow(
                        one.op,
                        late,
                        count,
                        usual.low,
                        fast.high,
                        (as_late, of_all),
                        too_long,
                        ends,
                    )
                )
            else:
                fair[servo] = fair.get(servo, 0) + count
    if len(found) > len(case.answering) / 2:  # then it is the others that are fast
        return {}
    return {
        servo: several
        for servo, several in found.items()
        if sum(s.of for s in several) >= fair.get(servo, 0)
    }


def _to_the_beginning(case: Case) -> tuple[Histograms, list[_Times]]:
    """Return how long servos take to begin their answers, by command."""
    took = case.ledger.took
    by_op: dict[int, dict[int, int]] = {}
    for key in took.keys:
        servo, op = pair_of(key)
        by_op.setdefault(op, {})[servo] = key
    return took, [_Times(op, rows, 0) for op, rows in by_op.items()]


def _to_the_end(case: Case) -> tuple[Histograms, list[_Times]]:
    """Return how long servos take to end their answers: that needs no rate, which nobody stated.

    Answers of one length take as long at any; where there are several they may differ by that.
    """
    exchanges = case.ledger.exchanges
    kinds, lengths = exchanges.kinds, np.flatnonzero(exchanges.answer_lengths)
    differ = int(lengths[-1] - lengths[0]) if len(lengths) else 0
    byte_ns = case.ledger.byte_ns + exchanges.slower_ns
    spare = max(case.latency_ns - SLOW_NS, exchanges.unsure_ns - SLOW_NS, 0) + differ * byte_ns
    likes: dict[tuple[int, int, int], dict[int, int]] = {}
    for k in range(len(kinds)):
        alike = kinds.op[k], kinds.address[k], kinds.odd[k]
        likes.setdefault(alike, {})[kinds.servo_id[k]] = k
    return exchanges.spans, [_Times(op, rows, spare) for (op, *_), rows in likes.items()]


def _finding(case: Case, servo: int, several: list[_Slow]) -> Finding:
    worst = max(several, key=lambda s: s.slow)
    delay = _delay(case, servo)
    first, last = _late_within(case, servo, worst.too_long_ns)
    come = "end" if worst.ends else "come"
    middle = f", the middle one after {worst.usual_ns / 1e6:.2f} ms at least"
    usual = middle if worst.usual_ns > worst.peers_ns else ""  # else stamps hide how late it is
    word = case.protocol.op_name(worst.op)  # its last 32 bits, which hold any usual word
    keys = pair_key(np.full(len(several), servo), np.array([s.op for s in several]))
    slowest = [case.ledger.slowest.of(key) for key in keys.tolist()]
    places = tuple(
        Place(s.at, s.length, s.t_ns, "the request of the slowest answer") for s in slowest if s
    )
    code, by, brief = "slower-than-peers", "", f"servo {servo} answers slowly"
    if delay is not None and _is_by(delay.ns, worst):
        code = "slow-by-its-delay"
        by = f"; its delay register says {delay.ns / 1e6:.2f} ms"
        brief += f": its delay is {delay.ns / 1e6:.2f} ms"
        places = (*case.places(delay.told, "its return delay"), *places)
    elif (parts := _grown(case, servo)) is not None:
        code, brief = "slower-and-slower", f"servo {servo} answers more and more slowly"
        told = ", ".join(f"{ns / 1e6:.2f}" for ns in parts)
        by = f"; it takes longer and longer: {told} ms on average by fifths of the time"
    return Finding(
        code,
        servo,
        first,
        last,
        sum(s.slow for s in several),
        f"{worst.slow} of {worst.of} answers of servo {servo} to {word} {come} surely later than "
        f"{worst.too_long_ns / 1e6:.2f} ms{usual}; of the others' {worst.theirs[0]} of "
        f"{worst.theirs[1]} do{by}",
        places,
        strength=min(0.7 + worst.slow / max(worst.of, 1), 1.0) * _are_heard(case, servo),
        brief=brief,
        values=(("usual_ns", worst.usual_ns), ("peers_ns", worst.peers_ns)),
        # whatever befalls frames now and then, most of a servo's answers do not wait for it
        is_own=worst.slow >= MOSTLY * worst.of,
    )


def _are_heard(case: Case, servo: int) -> float:
    """Return how far the times of the others' answers are known: late ones may be those that are torn."""
    others = [one for one in case.answering if one != servo]
    sound = sum(case.total("ok", one) for one in others)
    lost = sum(case.total("missing", one) + case.total("damaged", one) for one in others)
    return min(sound / max(HEARD * (sound + lost), 1), 1.0)


def _grown(case: Case, servo: int) -> list[float] | None:
    """Return what a servo takes to answer by parts of the time, where it alone takes ever longer."""
    its, others = _by_parts(case, {servo}), _by_parts(case, {*case.answering} - {servo})
    if its is None or others is None or not grows(its, RISE, SLOW_NS):
        return None
    grown_ns = float(its[-1] - its[0])
    is_sure = grown_ns >= max(SLOW_NS, case.latency_ns)
    return its.tolist() if is_sure and not grows(others, RISE, SLOW_NS) else None


def _by_parts(case: Case, servos: set[int]) -> F64 | None:
    """Return how long answers of servos take on average, part by part; None: some have too few."""
    a = case.answers
    mine = np.flatnonzero(within(a["servo_id"], [*servos]))
    part = part_of(a["t_first"][mine], case.first_ns, case.last_ns, PARTS)
    n, took = (np.bincount(part, a[name][mine], PARTS) for name in ("took_n", "took_sum"))
    return took / n if n.min() >= LEAST else None


def _late_within(case: Case, servo: int, too_long_ns: int) -> tuple[int, int]:
    """Return from when to when answers of a servo come surely later than a time."""
    a = case.answers
    rows = np.flatnonzero((a["servo_id"] == servo) & (a["took_max"] > too_long_ns))
    if not len(rows):
        return case.first_ns, case.last_ns
    return int(a["t_first"][rows[0]]), int(a["t_last"][rows[-1]])


def beyond_delay(case: Case) -> Iterator[Finding]:
    """Servos slower than their own delay register, where that is in microseconds."""
    if not case.has_clock:
        return
    took = case.ledger.took
    for servo in case.answering:
        delay = _delay(case, servo)
        if delay is None:
            continue
        keys = [k for k in took.keys if pair_of(k)[0] == servo]
        key = max(keys, key=took.count, default=None)
        usual = None if key is None else took.at(key, 0.5)
        if key is None or usual is None or took.count(key) < LEAST:
            continue
        too_long_ns = delay.ns + BEYOND_NS
        if usual.low > too_long_ns:
            yield Finding(
                "slower-than-its-delay",
                servo,
                *_late_within(case, servo, too_long_ns),
                took.count(key),
                f"servo {servo} takes at least {usual.low / 1e6:.2f} ms to answer in the middle; "
                f"its delay register says {delay.ns / 1e6:.2f} ms",
                case.places(delay.told, "its return delay"),
                strength=0.8,
                brief=f"servo {servo} answers slowly",
            )


class _Delay(NamedTuple):
    """The longest delay that a servo was told or states, and where that stands."""

    ns: int
    told: Happenings


def _delay(case: Case, servo: int) -> _Delay | None:
    """Return how long a servo is to wait before it answers; None where nobody knows."""
    delays = [
        (row, delay)
        for row, (what, raw) in enumerate(_settings(case, servo))
        if (delay := reply_delay_ns(case.protocol, case.protocol.registers[what], raw)) is not None
    ]
    if not delays:
        return None
    told = case.settings(servo_id=servo).take(np.array([row for row, _ in delays]))
    return _Delay(max(delay for _, delay in delays), told)


def _is_by(delay_ns: int, slow: _Slow) -> bool:
    """Tell whether a delay is what a servo takes longer than its peers."""
    return slow.peers_ns < delay_ns and slow.usual_ns <= delay_ns + BEYOND_NS


def _settings(case: Case, servo: int) -> list[tuple[int, int]]:
    h = case.settings(servo_id=servo)
    return [*zip(h.what.tolist(), h.after.tolist(), strict=True)]


def late_replies(case: Case) -> Iterator[Finding]:
    """Servos whose answers come behind their window."""
    late = {
        s: case.count("late-response", servo_id=s) - len(_to_memory(case, s)) for s in case.servos
    }
    said = case.once(seldom_answered)
    late = {s: n for s, n in late.items() if s not in said or said[s].n < n}
    for servo, n in late.items():
        others = sum(late.values()) - n
        answered = max(case.total("ok", servo), n)  # one may come too late to count as an answer
        theirs = (1 + others) / (1 + max(case.total("ok") - answered, others))
        is_more = n >= OFTENER * theirs * answered and at_least(n, answered, theirs) < CHANCE
        # beside nobody it must be a habit: hosts and bridges are late with any answer now and then
        alone = len(case.answering) < 2 and n >= SHARE * answered
        if n < AGAIN or not (is_more or alone):
            continue
        told = case.anomalies("late-response", servo_id=servo)
        told = told.take(~within(told.at, _to_memory(case, servo)))
        beside = f"of all others {others}" if len(case.answering) > 1 else "and no other answers"
        yield Finding(
            "late-replies",
            servo,
            int(told.t_ns.min()),
            int(told.t_ns.max()),
            n,
            f"{n} of {answered} answers of servo {servo} come behind their window, {beside}",
            case.places(told, "a late answer"),
            strength=min(0.5 + n / 20, 1.0),
            brief=f"servo {servo} answers late",
        )


def _to_memory(case: Case, servo: int) -> I64:
    """Return where a servo was told what it writes to its memory, and said so late: that takes time."""
    told = case.settings(servo_id=servo)
    kept = [not case.protocol.registers[what].volatile for what in told.what.tolist()]
    writes = told.at[np.array(kept, bool) & (told.written > 0)]
    late: I64 = case.anomalies("late-response", servo_id=servo).at
    return late[within(late, writes)]


RULES: Final[tuple[Rule, ...]] = (slow, beyond_delay, late_replies)
"""The rules of this file."""
