"""Which bits of torn frames were read wrong: always the same, always one way, the last, the first."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.case import sums
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import at_least, sureness
from sniffer.diagnosis.evidence.lastbit import LAST_BIT, lacks_last_bit
from sniffer.diagnosis.evidence.tracks import track
from sniffer.diagnosis.ledger.damage import IN_REPLY
from sniffer.diagnosis.ledger.lineerrors import IN_ANSWERS, IN_REQUESTS
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.misread import BITS_FEW
from sniffer.diagnosis.physics.seen import BITS, chance_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.physics.misread import Flip, Misread
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "same-bit",
        "It is always the same bit of a byte that is read wrong.",
        "At least four torn frames that one bit explains, nine tenths of them by the same bit (0..7), which chance does not do; it counts less where fewer than a fifth of the misread frames have one bit wrong, or misread ones are fewer than one in twenty of what is torn.",
        is_manner=True,
    ),
    FindingCode(
        "one-way-bits",
        "Bits are read wrong in one direction only: always 1 as 0, or always 0 as 1.",
        "At least eight torn frames that single bits explain, nineteen in twenty of one direction, more than noise that prefers one by three to one would do; it counts less where they are fewer than one in twenty of what is torn.",
        is_manner=True,
    ),
    FindingCode(
        "late-edges",
        "Bits are read as the one before them on the line: the edge between them came too late.",
        "At least five misread bits, nine tenths of them equal to the bit sent before, and one way; it counts less where fewer than a fifth of the torn frames have a bit or two misread.",
        is_manner=True,
    ),
    FindingCode(
        "late-bits",
        "The bits that are misread, of several senders, are the last ones of their bytes.",
        "Torn frames that one bit explains, of two senders or more: nine tenths of them have it at bit 5 to 7 of a byte, or of ten and more at bit 4 to 7, which chance does not do.",
        is_manner=True,
    ),
    FindingCode(
        "last-bits",
        "Of this servo's bytes the last bits are read wrong, or their stop bits are missed, and nobody else's.",
        "Misread bits of one servo are bits 5 to 7 of their bytes, of twelve and more all bits 4 to 7, or line errors stand in its answers only, and in a third of the torn ones; or the checksums of eight torn answers and more are right in bits 0 to 2 and wrong behind, in several ways; or its bare positions never have their highest bit, and follow its goals but for that.",
    ),
)

LEAST: Final = 3

SAME: Final = 4
ONE_WAY: Final = 8
LATE: Final = 5
"""Misread bits that make each pattern: fewer may be chance."""

PURE: Final = 0.9
"""Part of the misread bits that must agree: another fault may damage a frame now and then."""

PURE_WAY: Final = 0.95

LEANING: Final = 0.75
"""Noise may prefer one direction: its pulses pull the line up or down."""

CHANCE: Final = 1e-3

ENDING: Final = 5
"""From this bit of a byte on a clock that is off by a twentieth, and edges that are late beside,
show."""

PART_BITS: Final = 0.2
"""Part of the torn frames that slow edges leave with a bit or two misread: where nearly all are torn
otherwise, it is not the edges that tear them."""

PART_READ: Final = 0.05
"""Part of all torn places that are bits of one kind misread: what is hardly ever seen in what is torn
does not tear it."""

LONG_ROW: Final = 12
"""Misread bits that are all in the second half of their bytes: chance has so many once in 4096."""

OFTEN: Final = 0.05
"""Part of a servo's answers that must have a line error: noise hits one now and then."""

STOPS: Final = 0.3
"""Line errors a torn answer must have: with fewer the stop bits were where they should be."""

OTHERS: Final = 0.75
"""Part of a servo's packets with line errors that may hold another's answer as well."""

WIDE: Final = 12
"""Packets with line errors that tell whose they are."""

APART: Final = 10.0
"""How many times the others' share of line errors a servo must have."""


def bits(case: Case) -> Iterator[Finding]:
    """Tell whether misread bits are always the same, go one way, or follow their neighbour."""
    read = [m for m in case.misreads if m.shape == BITS_FEW and m.flips]
    if len(read) < SAME or _at_the_turn(read):
        return
    singles = [m.flips[0] for m in read if len(m.flips) == 1]
    every = [m.flips[0] for m in read]  # what befell one byte is one event
    seen = min(len(read) / (PART_READ * len(case.damages)), 1.0)
    seen *= min(len(singles) / (PART_BITS * len(case.misreads)), 1.0)
    yield from _same_bit(read, singles, seen)
    ups = sum(f.up for f in every)
    n, most = len(every), max(ups, len(every) - ups)
    way = "0 as 1" if ups == most else "1 as 0"
    chance = at_least(most, n, _leaning(read, up=ups == most))
    if n >= ONE_WAY and most >= PURE_WAY * n:
        yield bits_finding(
            "one-way-bits",
            read,
            f"{most} of {n} misread bits are {way}",
            f"bits read {way} only",
            sureness(chance, 1e-2) * seen,
        )
    known = [f for f in every if f.byte >= 0]
    lags = sum(f.lags for f in known)
    if len(known) >= LATE and lags >= PURE * len(known) and most >= PURE * n:
        yield bits_finding(
            "late-edges",
            read,
            f"{lags} of {len(known)} misread bits are read as the bit before them, {way}",
            "edges come late",
            sureness(at_least(lags, len(known), 0.5) * chance, CHANCE)
            * min(len(read) / (PART_BITS * len(case.misreads)), 1.0),
        )


def _leaning(read: Sequence[Misread], *, up: bool) -> float:
    """Return how likely noise that prefers one direction has a bit of some frames go that way.

    A frame that is mostly zeros has more of them to be read as ones. What stands before the first
    byte that was hit is not seen to be: without its header nothing is a frame.
    """
    first = min((k for m in read for k in m.bytes_hit), default=0)
    bits = [(8 * len(m.meant[first:]), int.from_bytes(m.meant[first:]).bit_count()) for m in read]
    every, ones = (sum(column) for column in zip(*bits, strict=True))
    share = (every - ones if up else ones) / every if every else 0.5
    return LEANING * share / (LEANING * share + (1 - LEANING) * (1 - share))


def _at_the_turn(read: Sequence[Misread]) -> bool:
    """Tell whether it is the first byte of answers that is misread, and no other.

    A driver that lets go late alters it in one way, too.
    """
    if not read:
        return False
    front = sum(m.damage.turn == IN_REPLY and set(m.bytes_hit) == {0} for m in read)
    return front >= PURE_WAY * len(read)


def _same_bit(read: Sequence[Misread], singles: Sequence[Flip], seen: float) -> Iterator[Finding]:
    if len(singles) < SAME:
        return
    bit, count = Counter(f.bit for f in singles).most_common(1)[0]
    chance = BITS * at_least(count, len(singles), chance_of([m.seen for m in read], [bit]))
    # the same way, and behind the same level: chance has that more seldom
    (*_, lags), alike = (
        Counter((f.bit, f.up, f.lags) for f in singles if f.byte >= 0).most_common(1)[0]
        if any(f.byte >= 0 for f in singles)
        else ((False,), 0)
    )
    if lags and alike == len(singles):
        chance = min(chance, 4 * BITS * (LEANING / 2 / BITS) ** alike)
    if count >= PURE * len(singles) and chance < CHANCE:
        yield bits_finding(
            "same-bit",
            read,
            f"{count} of {len(singles)} frames with one wrong bit have it at bit {bit} of a byte",
            f"always bit {bit}",
            sureness(chance) * seen,
        )


def late_bits(case: Case) -> Iterator[Finding]:
    """Tell whether the bits that are misread, of whomever, are the last ones of their bytes."""
    read = [m for m in case.misreads if m.bit >= 0]
    # the longer the row of low bits must be, the later is the first bit that falls
    for first in (ENDING, BITS // 2):
        late = [m for m in read if m.bit >= first]
        likely = chance_of([m.seen for m in read], range(first, BITS))
        chance = at_least(len(late), len(read), likely)
        if len(late) >= PURE * len(read) and chance <= CHANCE:
            break
    else:
        return
    senders = {m.servo_id for m in late}
    if len(senders) < 2:
        return
    yield bits_finding(
        "late-bits",
        late,
        f"of {len(read)} frames with one wrong bit {len(late)}, of {len(senders)} senders, have it "
        f"at bit {first} to 7 of a byte",
        "the last bits of bytes are misread",
        sureness(chance),
    )


def last_bits(case: Case) -> Iterator[Finding]:
    """Find servos whose last bits are misread: their clock is not the bus's."""
    if len(case.answering) + len(case.misreads) == 0:
        return
    e = case.line_errors
    errors = sums({k: v[e["place"] == IN_ANSWERS] for k, v in e.items()}, "servo_id", "n")
    elsewhere = int(e["n"][e["place"] == IN_REQUESTS].sum())
    answered = {s: case.total("ok", s) + case.total("damaged", s) for s in case.servos}
    ending = sum(
        sum(f.bit >= ENDING for f in m.flips) or m.bit >= ENDING
        for m in case.misreads
        if m.shape == BITS_FEW
    )
    of_frames = len({m.damage.got for m in case.misreads if m.bit >= ENDING})
    second = sum(f.bit >= BITS // 2 for m in case.misreads for f in m.flips)
    for servo in case.servos:
        read = [m for m in case.misreads if m.servo_id == servo]
        flips = [f for m in read if m.shape == BITS_FEW for f in m.flips]
        late = sum(f.bit >= ENDING for f in flips)
        # a clock that is further off misreads one bit more
        half = sum(f.bit >= BITS // 2 for f in flips)
        mine = errors.get(servo, 0)
        others = elsewhere + sum(n for s, n in errors.items() if s != servo)
        rest = max(case.ledger.frames - answered[servo], 1)
        alone = mine >= OFTEN * answered[servo] and mine >= LEAST
        alone = alone and mine / max(answered[servo], 1) >= APART * (others + 1) / rest
        # the stop bit is the last one: a clock that tears answers misses it in nearly all of them
        alone = alone and mine >= STOPS * case.total("damaged", servo)
        bitwise = len(flips) >= SAME and late >= PURE * max(len(flips), ending)
        likely = chance_of([m.seen for m in read], range(ENDING, BITS))
        chance = at_least(late, len(flips), likely) if bitwise else 1.0
        told = list[str]()
        # frames that one bit explains, of whatever byte; the same one over and over is one
        whole = list({m.damage.got: m.bit for m in read if m.bit >= 0}.values())
        ends_whole = sum(bit >= ENDING for bit in whole)
        if not bitwise and len(whole) >= SAME and ends_whole >= PURE * max(len(whole), of_frames):
            bitwise, late, chance = True, ends_whole, at_least(ends_whole, len(whole), likely)
            told.append(f"in {late} of {len(whole)} frames one of the last bits of a byte is wrong")
        if not bitwise and half == len(flips) >= max(LONG_ROW, PURE * second):
            likely = chance_of([m.seen for m in read], range(BITS // 2, BITS))
            bitwise, chance, late = True, likely**half, half
        bitwise = bitwise and not _at_the_turn([m for m in read if m.flips])
        if not (alone or bitwise):
            continue
        if bitwise and not told:
            told.append(f"{late} of {len(flips)} misread bits are the last ones of their bytes")
        if alone:
            told.append(
                f"{mine} line errors stand in its {answered[servo]} answers, {others} elsewhere"
            )
        rows = (e["servo_id"] == servo) & (e["place"] == IN_ANSWERS)
        read = [m for m in read if m.flips] or read
        times = [m.damage.t_ns for m in read] + e["t_first"][rows].tolist()
        ends = [m.damage.t_ns for m in read] + e["t_last"][rows].tolist()
        yield Finding(
            "last-bits",
            servo,
            min(times),
            max(ends),
            late + mine,
            f"of servo {servo} " + ", and ".join(told),
            _places(read)
            or tuple(
                Place(at, 1, t, "a byte without a stop bit")
                for at, t in zip(
                    e["at"][rows][:3].tolist(), e["t_first"][rows][:3].tolist(), strict=True
                )
            ),
            strength=1.0 if alone and bitwise else max(sureness(chance, 1e-4), 0.8 * alone),
            brief=f"the last bits of servo {servo} are misread",
        )


STOPS_ALONE: Final = 0.2
"""Part of its answers that a clock tears which is as much off as makes stop bits be missed: from 5.3 %
on a stop bit is, from 5.9 % on the bit before."""


def wide_errors(case: Case) -> Iterator[Finding]:
    """Find the one servo in whose answers all line errors are that an adapter tells by the packet."""
    errors = case.ledger.line_errors
    within = {s: told for s, told in errors.within.items() if s in case.answering}
    ahead = sorted(within, key=lambda s: -within[s][0])
    if errors.wide < WIDE or len(ahead) < 2 or len(case.answering) < 2:
        return
    one, other = ahead[:2]
    n, first, last = within[one]
    answered = case.total("ok", one) + case.total("damaged", one)
    if n < PURE_WAY * errors.wide or within[other][0] > OTHERS * n or n < OFTEN * answered:
        return
    torn = sum(d.turn == IN_REPLY and d.servo_id == one for d in case.damages)
    if torn > n / 2:
        return  # what tears answers makes such errors, too
    if case.has_checksum and torn < STOPS_ALONE * answered:
        return  # a clock that is so much off misreads the last bits as well, and the check fails
    yield Finding(
        "last-bits",
        one,
        first,
        last,
        n,
        f"of {errors.wide} packets with line errors {n} hold an answer of servo {one}, "
        f"{within[other][0]} one of servo {other}; its frames are hardly ever torn",
        strength=0.8,
        brief=f"stop bits of servo {one} are missed",
    )


def bits_finding(
    code: str, read: Sequence[Misread], what: str, brief: str, strength: float
) -> Finding:
    """Return a finding about torn frames, of their one sender where it is a servo."""
    servos = {m.servo_id for m in read}
    servo = servos.pop() if len(servos) == 1 else -1
    return Finding(
        code,
        servo if servo >= 0 else None,
        min(m.damage.t_ns for m in read),
        max(m.damage.t_ns for m in read),
        len(read),
        what,
        _places(read),
        strength=strength,
        brief=brief,
    )


def _places(read: Iterable[Misread]) -> tuple[Place, ...]:
    return tuple(
        Place(m.damage.at, m.damage.length, m.damage.t_ns, "a torn frame") for m in list(read)[:3]
    )


def last_bit_of_places(case: Case) -> Iterator[Finding]:
    """Find servos whose bare answers tell places without their highest bit."""
    for servo in case.servos:
        one = track(case, servo)
        if one is None or not lacks_last_bit(case, one):
            continue
        p, bit = one.position, LAST_BIT * one.position.scale
        yield Finding(
            "last-bits",
            servo,
            int(p.t_first[0]),
            int(p.t[-1]),
            int(p.n.sum()),
            f"none of {int(p.n.sum())} positions of servo {servo} has bit 7, and where its goals are "
            f"beyond that it follows them {bit:.4g} {p.unit} lower",
            (Place(int(p.at[0]), 1, int(p.t_first[0]), f"position {p.told(p.first[0])}"),),
            strength=0.8,
            brief=f"the last bits of servo {servo} are misread",
        )


RULES: Final[tuple[Rule, ...]] = (bits, late_bits, last_bits, wide_errors, last_bit_of_places)
"""The rules of this area."""
