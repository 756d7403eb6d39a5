"""What happened to the bits of a torn frame: which of them were read wrong, and as what.

A frame whose checksum fails is tried with each of its bits turned: where one of these frames holds,
one bit was misread, and which way tells the sound frame nearest to what stood there before. Where
none holds, only the bytes that never change are compared. The protocol itself is asked what holds,
so nothing here knows a checksum.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.decoding.holding import held
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.physics.seen import ALIKE, BITS, shares_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.physics.seen import Shares
    from sniffer.protocols.base import BusProtocol

LONGEST: Final = 48
"""Bytes of a frame whose bits are tried one by one: more are hardly ever read in a loop."""

LEAST: Final = 3
"""Shorter frames have no bytes that never change."""

OF_EACH: Final = 60
"""Torn frames of one sender that are looked at: their bits differ no more after so many."""

NEAR_BYTES: Final = 3
"""A torn frame differs from what it was in no more bytes than that, or it is not it."""

MOSTLY: Final = 0.75
"""Part of the torn lines that one sign which stands in no line must explain."""

DIGITS: Final = frozenset(b"0123456789")
"""Signs of numbers, which may be any."""

BITS_FEW, FRONT, BACK, LONGER, OTHER = range(5)
"""What was torn: some bits; the first bytes; the last bytes; there is more than one frame's bytes;
anything else."""


class Flip(NamedTuple):
    """One bit that was read wrong: of which byte, which (0 is sent first), and as what.

    ``lags``: it was read as the bit before it on the line. Where several bytes may be meant,
    ``byte`` is -1, and that is not told.
    """

    byte: int
    bit: int
    up: bool
    lags: bool


class Misread(NamedTuple):
    """A torn frame by its bits. ``servo_id`` -1: the controller's."""

    damage: Damage
    shape: int
    flips: tuple[Flip, ...]
    meant: bytes
    """The frame it was, as far as that is known; empty where it is not."""
    bit: int = -1
    """Which bit of a byte it was, where it was one, of whatever byte; -1: nobody knows."""
    seen: Shares = ALIKE
    """Which bits would be seen to be wrong, were all of them altered as often."""

    @property
    def servo_id(self) -> int:
        """Who sent it; -1: the controller."""
        return self.damage.servo_id if self.damage.turn == IN_REPLY else -1

    @property
    def bytes_hit(self) -> tuple[int, ...]:
        """The numbers of the bytes that are wrong, as far as they are known."""
        return tuple(sorted({f.byte for f in self.flips if f.byte >= 0}))


def misread(
    protocol: BusProtocol,
    damages: Iterable[Damage],
    known: Mapping[bytes, tuple[bytes, ...]],
    most: int = OF_EACH,
) -> list[Misread]:
    """Return the first torn frames of each sender by their bits.

    Args:
        protocol: tells what holds.
        damages: torn places.
        known: answers of servos by the request.
        most: so many of each sender.
    """
    torn = _first_of_each(damages, most)
    alike = [alike_of(d, known) for d in torn]
    tried = [
        d.length == len(d.got) and LEAST <= d.length <= LONGEST and _fits(d.got, a)
        for d, a in zip(torn, alike, strict=True)
    ]
    firsts = {a[:1] for some in known.values() for a in some if protocol.checksum_of(a) is not None}
    whole = [d for d, t in zip(torn, tried, strict=True) if t]
    repaired = _repaired(protocol, whole, tuple(sorted(firsts)))
    found = iter(repaired)
    frames = [*known, *itertools.chain(*known.values(), *alike)]
    signs = _signs(protocol, frames)
    seen = shares_of(frames, signs)
    strange = [_strange(d, signs) for d in torn]
    if sum(one is not None for one in strange) < MOSTLY * len(torn):
        strange = [None] * len(torn)  # who speaks into lines makes such signs, too, beside others
    out = []
    for d, sound, is_tried, one in zip(torn, alike, tried, strange, strict=True):
        told = next(found) if is_tried else ()
        out.append((one or _one(d, sound, told))._replace(seen=seen))
    return out


def _signs(protocol: BusProtocol, frames: Sequence[bytes]) -> frozenset[int]:
    """Return the bytes that stand in lines of text; none of frames that have a checksum."""
    if not frames or any(protocol.checksum_of(frame) is not None for frame in frames):
        return frozenset()
    return frozenset(b"".join(frames)) | DIGITS


def _strange(d: Damage, signs: frozenset[int]) -> Misread | None:
    """Tell what was misread of a line by signs that stand in no line, where one bit explains them.

    What a line states changes, so that the next one differs from it in more than what was misread.
    """
    wrong = [k for k, byte in enumerate(d.got) if byte not in signs]
    if not signs or len(wrong) != 1 or d.length != len(d.got):
        return None
    meant = bytearray(d.got)
    for k in wrong:
        may_be = [byte for bit in range(BITS) if (byte := d.got[k] ^ 1 << bit) in signs]
        if len(may_be) != 1:
            return None
        meant[k] = may_be[0]
    flips = tuple(_flip(d.got[k : k + 1], bytes(meant[k : k + 1]))._replace(byte=k) for k in wrong)
    return Misread(d, BITS_FEW, flips, bytes(meant), flips[0].bit if len(flips) == 1 else -1)


def _first_of_each(damages: Iterable[Damage], most: int) -> list[Damage]:
    """Return the first torn frames of each servo, and of the controller."""
    met: dict[int, int] = {}
    out = []
    for d in damages:
        if d.turn in (IN_REPLY, IN_REQUEST):
            sender = d.servo_id if d.turn == IN_REPLY else -1
            met[sender] = met.get(sender, 0) + 1
            if met[sender] <= most:
                out.append(d)
    return out


def alike_of(d: Damage, known: Mapping[bytes, tuple[bytes, ...]]) -> tuple[bytes, ...]:
    """Return what should have stood there: what was near, what was known, what a peer says."""
    if not d.asked:
        return d.alike
    own = tuple(dict.fromkeys((*d.alike, *known.get(d.asked, ()))))
    return own or of_peers(d.asked, known)


def of_peers(asked: bytes, known: Mapping[bytes, tuple[bytes, ...]]) -> tuple[bytes, ...]:
    """Return answers to requests like this one to other servos, as this one would give them.

    Requests that differ in one byte beside the checksum are to other ids, or, where ids are written
    as text, in a row of digits; the answer has the id at the same place. Its checksum is left as it
    is: it is not to be relied on.
    """
    out: list[bytes] = []
    for request, answers in known.items():
        differ = [i for i, (a, b) in enumerate(zip(request, asked, strict=False)) if a != b]
        if len(request) != len(asked) or not differ:
            continue
        # rs30x and wCK have the sum last, LSS has none
        where = differ[:-1] if len(differ) > 1 and differ[-1] == len(asked) - 1 else differ
        at, end = where[0], where[-1] + 1
        if len(where) != end - at or (len(where) > 1 and not asked[at:end].isdigit()):
            continue
        out += (
            answer[:at] + asked[at:end] + answer[end:]
            for answer in answers
            if end <= len(answer) and answer[at:end] == request[at:end]
        )
    return tuple(dict.fromkeys(out))


def _fits(got: bytes, alike: Sequence[bytes]) -> bool:
    return not alike or any(len(a) == len(got) for a in alike)


_Key = tuple[str, bytes, bytes, tuple[bytes, ...]]
"""A protocol, the request before, what was heard, and with what answers begin."""

_REPAIRED: Final[dict[_Key, tuple[bytes, ...]]] = {}
"""What was found for torn frames: a live bus is judged again and again, and most are known."""

REMEMBERED: Final = 1 << 13


def _repaired(
    protocol: BusProtocol, torn: Sequence[Damage], firsts: tuple[bytes, ...]
) -> list[tuple[bytes, ...]]:
    """Return for each torn frame those with a bit turned that hold, and with another first byte.

    ``firsts`` are the first bytes of answers: what is on the line when one begins spoils all of it.
    """
    keys: list[_Key] = [
        (protocol.name, d.asked, d.got, firsts)
        if d.turn == IN_REPLY
        else (protocol.name, b"", d.got, ())
        for d in torn
    ]
    new = [key for key in dict.fromkeys(keys) if key not in _REPAIRED]
    tries: list[bytes] = []
    sizes: list[int] = []
    for _, asked, got, begins in new:
        tries += [
            asked + got[:k] + bytes((byte ^ 1 << bit,)) + got[k + 1 :]
            for k, byte in enumerate(got)
            for bit in range(BITS)
        ]
        tries += [asked + first + got[1:] for first in begins]
        sizes += [len(got)] * (len(got) * BITS + len(begins))
    holds = held(protocol, tries, sizes)
    found: dict[_Key, tuple[bytes, ...]] = {}
    at = 0
    for key in new:
        behind = at + len(key[2]) * BITS + len(key[3])
        found[key] = tuple(tries[i][-sizes[i] :] for i in range(at, behind) if holds[i])
        at = behind
    out = [found[key] if key in found else _REPAIRED[key] for key in keys]
    if len(_REPAIRED) + len(found) > REMEMBERED:
        _REPAIRED.clear()
    _REPAIRED.update(found)
    return out


def _one(d: Damage, alike: Sequence[bytes], repaired: Sequence[bytes]) -> Misread:
    same = [a for a in alike if len(a) == d.length]
    if len(same) > 1:  # several bits may be wrong, and one more make the checksum hold
        fixed = _fixed(same)
        repaired = [
            r
            for r in repaired
            if all(a == b for a, b, f in zip(r, same[0], fixed, strict=True) if f)
        ]
    first = [r for r in repaired if (r[0] ^ d.got[0]).bit_count() > 1]
    if first:  # more than a bit, and the check holds: what is behind is as it was sent
        return Misread(d, BITS_FEW, _turned_all(first[0], d.got, [0]), first[0])
    if repaired:
        best = min(_distance(r, same) for r in repaired)
        near = [r for r in repaired if _distance(r, same) == best]
        flips = {_flip(d.got, r) for r in near}
        bits = {_flip(d.got, r).bit for r in repaired}
        which = bits.pop() if len(bits) == 1 else -1
        if len(flips) == 1:
            return Misread(d, BITS_FEW, tuple(flips), near[0], which)
        ways = {(f.bit, f.up) for f in flips}
        if len(ways) == 1:
            bit, up = ways.pop()
            flip = Flip(-1, bit, up, lags=False)
            return Misread(d, BITS_FEW, (flip,), b"", which)
        return Misread(d, BITS_FEW, (), b"", which)
    return _compared(d, same) or Misread(d, _shape(d, alike), (), b"")


def _compared(d: Damage, same: Sequence[bytes]) -> Misread | None:
    """Compare with a frame that differs in one byte, else the bytes that never change."""
    near = [(a, k) for a in same if len(k := _differ(a, d.got)) == 1]
    if near:
        meant, wrong = near[0]
        flips = _turned_all(meant, d.got, wrong)
        return Misread(d, BITS_FEW, flips, meant, flips[0].bit if len(flips) == 1 else -1)
    if not same:
        return None
    fixed = _fixed(same)
    meant = bytes(a if f else g for a, g, f in zip(same[0], d.got, fixed, strict=True))
    wrong = _differ(meant, d.got)
    if not wrong or len(wrong) > NEAR_BYTES:
        return None
    return Misread(d, BITS_FEW, _turned_all(meant, d.got, wrong), b"")


def _shape(d: Damage, alike: Sequence[bytes]) -> int:
    """Tell which end of a frame is right, where one is."""
    for size in dict.fromkeys(len(a) for a in alike):
        some = [a for a in alike if len(a) == size]
        fixed = [k for k, f in enumerate(_fixed(some)) if f]
        one, got = some[0], d.got
        head = _run(k < len(got) and got[k] == one[k] for k in fixed)
        behind = [size - k for k in reversed(fixed)]
        tail = _run(k <= len(got) and got[-k] == one[-k] for k in behind)
        lacks = size - d.length
        if 0 < lacks <= LEAST and tail and tail >= sum(k >= lacks for k in fixed) - 1:
            return FRONT
        if not head and tail:
            return FRONT
        if head >= 2 and d.length < size and not tail:
            return BACK
    if alike and d.length > max(len(a) for a in alike):
        return LONGER
    return OTHER


def _run(right: Iterable[bool]) -> int:
    """Return how many are right before the first that is not."""
    return sum(1 for _ in itertools.takewhile(bool, right))


def _differ(a: bytes, b: bytes) -> list[int]:
    return [k for k, (x, y) in enumerate(zip(a, b, strict=True)) if x != y]


def _turned_all(meant: bytes, got: bytes, wrong: Sequence[int]) -> tuple[Flip, ...]:
    return tuple(
        _turned(meant, k, bit)
        for k in wrong
        for bit in range(BITS)
        if (meant[k] ^ got[k]) >> bit & 1
    )


def _fixed(same: Sequence[bytes]) -> list[bool]:
    """Tell which bytes are the same in all frames, from the beginning and from the end on.

    What a servo measures may rest, so it ends with the first that is not; of one frame alone all
    but the last three are taken.
    """
    size = len(same[0])
    if len(same) == 1:
        return [k < size - LEAST for k in range(size)]
    equal = [len(set(column)) == 1 for column in zip(*same, strict=True)]
    head, tail = _run(equal), _run(reversed(equal))
    return [k < head or k >= size - tail for k in range(size)]


def _distance(frame: bytes, same: Sequence[bytes]) -> int:
    """Return in how many bytes a frame differs from the nearest of some; 0 where there is none."""
    return min(
        (sum(a != b for a, b in zip(frame, one, strict=True)) for one in same),
        default=0,
    )


def _flip(got: bytes, meant: bytes) -> Flip:
    at = next(k for k, (a, b) in enumerate(zip(got, meant, strict=True)) if a != b)
    return _turned(meant, at, (got[at] ^ meant[at]).bit_length() - 1)


def _turned(meant: bytes, at: int, bit: int) -> Flip:
    """Return what it means that a bit of a frame was read wrong."""
    value = meant[at]
    was = value >> bit & 1
    before = value >> (bit - 1) & 1 if bit else 0  # the start bit is low
    return Flip(at, bit, up=not was, lags=before != was)
