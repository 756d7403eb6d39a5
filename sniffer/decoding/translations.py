"""What programs between the wire and a capture make of bytes: terminals, telnet, text files.

A terminal that is not raw turns one control character into another, or swallows it. Telnet doubles
FF. A program that takes bytes for text writes two for one, or a mark for what it cannot read.

The frames tell which it was. What can be undone is undone, and frames hold. Where bytes are gone,
torn frames hold one by one as soon as the byte that is never seen is put back.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.holding import between, kept, mended, spans_in
from sniffer.decoding.texts import (
    CR,
    LF,
    READABLE,
    WRITTEN_OUT,
    is_around_lines,
    is_latin,
    lines_in,
    text_of,
)
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence, Set

    from sniffer.protocols.base import BusProtocol

LEAST_BYTES: Final = 64
"""Of fewer bytes nothing is said."""

LEAST_TEXT: Final = 16
"""The same of lines of text that all hold as soon as they end as they should: two lines."""

HOLDS: Final = 0.95
"""Part of the bytes that frames claim once a translation is undone."""

FEWER: Final = 4
"""By which factor the bytes that no frame claims become fewer by it."""

LONGEST: Final = 40
"""Bytes of a torn frame that is tried: each try takes its square."""

TRIED: Final = 24
"""Different torn frames that are tried."""

MENDED: Final = 0.6
"""Part of the torn frames that must hold once a byte is put back. Of frames torn otherwise one in
six does by chance: a sum of eight bits, fifteen values, up to three of one."""

LEAST_MENDED: Final = 5

DIFFERENT: Final = 3
"""So many different frames must hold: one that a controller sends wrong time and again holds by
chance as often as it comes, or never."""

MOST_MISSING: Final = 3
"""Bytes of one value that are put back into one frame at most. It is one fewer where the frame is
long, or several values may be meant: so many tries would hold by chance."""

HEADER: Final = 2
"""Bytes that frames begin with, of one protocol always the same ones."""

SHORT: Final = 14
"""Bytes of a frame that is not long."""

UNREADABLE: Final = "\N{REPLACEMENT CHARACTER}".encode()
"""What programs write for bytes that are no UTF-8 text (Unicode 15, 23.8)."""

LEAST_UNREADABLE: Final = 0.02
"""Part of a capture that these are where bytes were taken for text."""


class Translated(NamedTuple):
    """How a capture was altered: what was done, as words, and what it is known by.

    ``at`` is where the first torn places are, offset and length. ``undone`` are the bytes as they
    were, frames of ``protocol``, where all of it can be undone.
    """

    what: str
    shown: str
    at: tuple[tuple[int, int], ...] = ()
    undone: bytes = b""
    protocol: str = ""


class _Whole(NamedTuple):
    """A translation of a whole stream that can be undone; ``may_be`` tells what cannot be one.

    Of fewer bytes than ``least`` nothing is said.
    """

    what: str
    may_be: Callable[[bytes], bool]
    undo: Callable[[bytes], bytes]
    least: int = LEAST_BYTES


class _Swallowed(NamedTuple):
    """Values that are swallowed where they stand; those that are seen were not."""

    what: str
    values: bytes


class _Swapped(NamedTuple):
    """A value that was written for another one, which is never seen then."""

    what: str
    wrote: int
    meant: int


def _runs_are_even(data: bytes) -> bool:
    """Tell whether FF stands in pairs only, but at the ends of what is looked at."""
    runs = re.findall(rb"\xff+", data[data.find(b"\xff\xff") :].rstrip(b"\xff"))
    return bool(runs) and all(len(run) % 2 == 0 for run in runs)


def _pairs_turned(data: bytes) -> bytes:
    even = len(data) & ~1
    return np.frombuffer(data[:even], np.uint8).reshape(-1, 2)[:, ::-1].tobytes()


def _mirrored(data: bytes) -> bytes:
    bits = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little")
    return np.packbits(bits, bitorder="big").tobytes()


def _is_parity(odd: int) -> Callable[[bytes], bool]:
    """Return what tells whether the eighth bit is a parity bit in nearly all bytes."""

    def may_be(data: bytes) -> bool:
        ones = np.bitwise_count(np.frombuffer(data, np.uint8))
        right = int((ones % 2 == odd).sum())
        return right >= HOLDS * len(data)

    return may_be


def _is_mark(data: bytes) -> bool:
    return sum(value >= READABLE for value in data) >= HOLDS * len(data)


def _seven_bits(data: bytes) -> bytes:
    return bytes(value & 0x7F for value in data)


_CLEARED: Final = r"and was read as 8N1 (`tr '\200-\377' '\000-\177'` clears the bit)"

WHOLE: Final = (
    _Whole(
        "bytes were written as text in UTF-8, two for each from 80 on",
        is_latin,
        lambda data: (text_of(data) or "").encode("latin-1", "ignore"),
    ),
    _Whole(
        "every FF stands there twice, as telnet and terminals with PARMRK write it",
        _runs_are_even,
        lambda data: data.replace(b"\xff\xff", b"\xff"),
    ),
    _Whole(
        "a 0D stands before every 0A, as text files and terminals (ONLCR) have it",
        lambda data: data.count(LF) == data.count(CR + LF) > 0,
        lambda data: data.replace(CR + LF, LF),
    ),
    _Whole(
        "every 0D came as 0A, as terminals with ICRNL and text files make it; put them back: "
        r"`tr '\n' '\r' < FILE | sniffer decode -`",
        lambda data: CR not in data and LF in data,
        lambda data: data.replace(LF, CR),
        LEAST_TEXT,
    ),
    _Whole(
        "every 0D came as 0A, and more stands around the lines; take them out and put it back: "
        r"`grep -oE '[#*][0-9]*[A-Za-z]+[-0-9A-Za-z.]*' FILE | tr '\n' '\r' | sniffer decode -`",
        is_around_lines,
        lines_in,
        LEAST_TEXT,
    ),
    _Whole(
        r"the end of each line is sent as characters, `\r`, and is no 0D: write it as the byte",
        lambda data: WRITTEN_OUT.search(data) is not None,
        lambda data: WRITTEN_OUT.sub(CR, data),
        LEAST_TEXT,
    ),
    _Whole(
        "the ends of lines (0D) were taken away",
        lambda data: CR not in data and LF not in data,
        lambda data: re.sub(rb"(?=[#*])", CR, data),
    ),
    _Whole(
        "the two bytes of each pair are exchanged, as in dumps of 16 bit words",
        lambda data: True,
        _pairs_turned,
    ),
    _Whole(
        "the bits of each byte stand in the other order (the first sent is taken for the highest)",
        lambda data: True,
        _mirrored,
    ),
    _Whole(
        "all bits of each byte are inverted",
        lambda data: True,
        lambda data: bytes(255 - value for value in data),
    ),
    _Whole(
        f"the eighth bit of each byte is its even parity: the line is 7E1 {_CLEARED}",
        _is_parity(0),
        _seven_bits,
    ),
    _Whole(
        f"the eighth bit of each byte is its odd parity: the line is 7O1 {_CLEARED}",
        _is_parity(1),
        _seven_bits,
    ),
    _Whole(
        f"the eighth bit of each byte is set: the line is 7M1 or 7N2 {_CLEARED}",
        _is_mark,
        _seven_bits,
    ),
)
"""What can be undone. Sources: RFC 854 (telnet: IAC doubled), termios(3), PEP 278."""

SWAPPED: Final = (
    _Swapped("every 0D came as 0A, as terminals with ICRNL and text files make it", 0x0A, 0x0D),
    _Swapped("every 0A came as 0D, as terminals with INLCR make it", 0x0D, 0x0A),
)

SWALLOWED: Final = (
    _Swallowed("the byte 00 is left out, as programs do that end text with it", b"\x00"),
    _Swallowed("the byte 0D is left out, as terminals with IGNCR and text files do", CR),
    _Swallowed(
        "the bytes 11 and 13 are left out, as flow control by XON and XOFF does", b"\x11\x13"
    ),
    _Swallowed(
        "control characters are left out, as terminals do that are not raw (ISIG, ICANON, IEXTEN)",
        b"\x03\x04\x08\x0f\x11\x12\x13\x15\x16\x17\x19\x1a\x1c\x7f",
    ),
)
"""What is left out, the narrower first. Source: termios(3), ``stty -a``."""


@kept
def translated(head: bytes, protocol: BusProtocol | None) -> Translated | None:
    """Return how the beginning of a capture was altered, None where it does not look so.

    Args:
        head: the first bytes, some thousand.
        protocol: by which it is decoded, None: nobody knows. Where it does not hold, others are
            tried, too; where it does, they are not even loaded (of a small log a tenth).
    """
    if len(head) < min(whole.least for whole in WHOLE):
        return None
    some = {} if protocol is None else {protocol.name: protocol}
    if protocol is None or _unclaimed(protocol, head) > (1 - HOLDS) * len(head):
        some = {**{name: PROTOCOLS[name] for name in PROTOCOLS.built_in}, **some}
    lost = {name: _unclaimed(p, head) for name, p in some.items()}
    if not min(lost.values()):
        return None
    found = _undone(some.values(), head, min(lost.values()))
    if len(head) < LEAST_BYTES:
        return found
    if found is None and protocol is not None:
        found = _mended(protocol, head)
    return found or _mended_of(some.values(), head, lost) or _replaced(head)


def _unclaimed(protocol: BusProtocol, data: bytes) -> int:
    """Return how many bytes are in no frame."""
    return len(data) - sum(b - a for a, b in spans_in(protocol, data))


def _undone(some: Iterable[BusProtocol], head: bytes, lost: int) -> Translated | None:
    """Look for a translation of all bytes: undone, they hold."""
    for whole in WHOLE:
        if len(head) < whole.least or not whole.may_be(head):
            continue
        data = whole.undo(head)
        for protocol in some:
            left = _unclaimed(protocol, data)
            if left <= (1 - HOLDS) * len(data) and left * FEWER < lost:
                share = 100 * (1 - left / len(data))
                told = f"read otherwise, {share:.1f} % of the bytes are {protocol.name} frames"
                shown = f"{told}, else {_part(head, lost)}"
                return Translated(whole.what, shown, ((0, 1),), data, protocol.name)
    return None


def _part(head: bytes, lost: int) -> str:
    return f"{100 * (1 - lost / len(head)):.1f} %"


def _mended_of(some: Iterable[BusProtocol], head: bytes, lost: dict[str, int]) -> Translated | None:
    """Look for what is missing in frames of another protocol, where none holds."""
    if min(lost.values()) < len(head) / 2:
        return None
    found = (_mended(protocol, head) for protocol in some)
    return next((one for one in found if one is not None), None)


def _mended(protocol: BusProtocol, head: bytes) -> Translated | None:
    """Look for a value that is never seen in a stretch, and with which what is torn there holds."""
    return translated_torn(protocol, _torn(protocol, head), frozenset(head))


def translated_torn(
    protocol: BusProtocol, torn: Sequence[tuple[int, bytes]], seen: Set[int]
) -> Translated | None:
    """Look for a value that is never seen, and with which torn frames hold.

    ``torn`` has these with where they stand, ``seen`` the values that are seen.
    """
    counts = Counter(got for _, got in torn)
    if sum(counts.values()) < LEAST_MENDED:
        return None
    common = dict(counts.most_common(TRIED))
    of = sum(common.values())
    ways: list[tuple[str, str, Callable[[bytes], list[bytes]]]] = []
    for swap in SWAPPED:
        if swap.meant not in seen and swap.wrote in seen:
            told = f"hold with {swap.meant:02X} for a {swap.wrote:02X}"
            ways.append((swap.what, told, partial(_swaps, swap=swap)))
    for swallowed in SWALLOWED:
        values = [v for v in swallowed.values if v not in seen]
        if values:
            told = f"hold with {' or '.join(f'{v:02X}' for v in values)} put in"
            ways.append((swallowed.what, told, partial(_filled, values=values)))
    for what, told, tries in ways:
        good = mended(protocol, common, tries, max(LEAST_MENDED, MENDED * of))
        if len(good) >= DIFFERENT:
            at = tuple((at, len(got)) for at, got in torn if got in good)[:3]
            n = sum(common[got] for got in good)
            shown = f"{n} of {of} torn frames {told}, which is never seen"
            return Translated(what, shown, at)
    return None


def _torn(protocol: BusProtocol, head: bytes) -> list[tuple[int, bytes]]:
    """Return what no frame claims, cut where frames begin; short pieces, with their places."""
    pieces = []
    for a, b in between(protocol, head):
        gaps = protocol.explain(head[a:b], a)
        begins = [a, *(gap.start for gap in gaps[1:] if gap.reason != "noise"), b]
        pieces += list(itertools.pairwise(begins))
    # a frame that lacks a byte takes the first one of the next for its own, which is no frame then
    headers = Counter(head[a : a + HEADER] for a, _ in (*pieces, *spans_in(protocol, head)))
    usual = [h for h, n in headers.items() if n >= LEAST_MENDED and len(h) == HEADER]
    begun = re.compile(b"|".join(map(re.escape, usual))) if usual else None
    out = []
    for a, b in pieces:
        inner = (m.start() for m in begun.finditer(head, a + HEADER, b)) if begun else ()
        begins = [a, *(k for k in inner if k > a + HEADER), b]
        out += [(c, head[c:d]) for c, d in itertools.pairwise(begins) if 2 < d - c <= LONGEST]
    return out


def _swaps(got: bytes, swap: _Swapped) -> list[bytes]:
    """Return a frame with the meant value at one to three of the places of the other."""
    at = [k for k, value in enumerate(got) if value == swap.wrote]
    out = []
    for n in range(1, min(len(at), MOST_MISSING) + 1):
        for some in itertools.combinations(at, n):
            one = bytearray(got)
            for k in some:
                one[k] = swap.meant
            out.append(bytes(one))
    return out


def _filled(got: bytes, values: Sequence[int]) -> list[bytes]:
    """Return a frame with some bytes of one value put in, behind its first byte."""
    most = MOST_MISSING - (len(got) > SHORT) - (len(values) > 1)
    out = []
    for value, n in itertools.product(values, range(1, most + 1)):
        for some in itertools.combinations_with_replacement(range(1, len(got) + 1), n):
            edges = (0, *some, len(got))
            pieces = (got[a:b] for a, b in itertools.pairwise(edges))
            out.append(bytes((value,)).join(pieces))
    return out


def _replaced(head: bytes) -> Translated | None:
    """Look for what programs write for bytes that they cannot read as text."""
    marks = head.count(UNREADABLE)
    if text_of(head) is None or marks * len(UNREADABLE) < LEAST_UNREADABLE * len(head):
        return None
    what = "bytes were read as text: EF BF BD stands for each that is none, and these are lost"
    shown = f"EF BF BD stands there {marks} times, and all is UTF-8"
    return Translated(what, shown, ((head.index(UNREADABLE), len(UNREADABLE)),))
