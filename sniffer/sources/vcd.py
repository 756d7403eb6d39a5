"""Value change dumps (VCD, IEEE 1364): what simulators write, and sigrok, Saleae and others export.

Only wires of one bit are of interest. The text is taken apart in columns, a block of lines at a
time: which words are times, which are changes, and of which wire. sigrok puts the changes of a time
on its line, others put each on a line of its own, so words count and lines do not.
"""

from __future__ import annotations

import itertools
import re
from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import InputError
from sniffer.signals.stretch import EdgesByWire, LogicInput, Stretch
from sniffer.sources.sigrok import rate_in, unlike
from sniffer.sources.text import DamagedLine, LineBlock, blocks, quoted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import I64, U8, Mask
    from sniffer.sources.text import Opened

HEADER_MOST: Final = 4 << 20
"""Bytes of declarations: those of a large chip have some 100 000 lines."""

DIGITS: Final = 18
"""Digits of a time: more are beyond 64 bits."""

ID_MOST: Final = 8
"""Signs of a wire's short name that are told apart: four are enough for 78 million wires."""

_UNITS: Final = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0, "ps": 1e-3, "fs": 1e-6}
_SCALE: Final = re.compile(r"\$timescale\s+([0-9]{1,9})\s*([munpf]?s)\s+\$end")
_SAMPLED: Final = re.compile(r"\bat ([0-9.]+ ?[kMG]?Hz)")  # in sigrok's comment
_DECLARED: Final = re.compile(
    r"\$scope\s+\S+\s+(?P<scope>\S+)\s+\$end|(?P<up>\$upscope)"
    r"|\$var\s+\S+\s+1\s+(?P<id>\S+)\s+(?P<name>\S+)(?:\s*\[[^\]]*\])?\s+\$end"
)
_COMMENT: Final = re.compile(rb"\$comment\b.*?\$end", re.DOTALL)


def _class(signs: bytes) -> Mask:
    out = np.zeros(256, bool)
    out[list(signs)] = True
    return out


_SPACE: Final = bytes(_class(b" \t\r\n\v\f"))
_BIT: Final = _class(b"01xXzZ")
_LONG: Final = _class(b"bBrRsS")  # the wire's name is a word of its own


def read_vcd(opened: Opened) -> LogicInput:
    """Open a dump.

    Raises:
        InputError: it declares no wires of one bit.
    """
    text = blocks(opened.stream)
    header, rest = _header(text)
    scale = _SCALE.search(header)
    if scale is None or not int(scale[1]):
        raise InputError(f"{opened.name}: the dump has no $timescale")
    wires = _wires(header)
    if not wires:
        raise InputError(f"{opened.name}: the dump declares no wire of one bit")
    tick_ns = int(scale[1]) * _UNITS[scale[2]]
    sampled = _SAMPLED.search(header)
    rate = rate_in(sampled[1]) if sampled else 0.0
    sample = 1e9 / rate / tick_ns if rate else 0
    stretches = _Changes([*wires]).stretches(rest, text)
    return LogicInput([*wires.values()], tick_ns, sample, stretches, is_open_ended=True)


def _header(text: Iterator[LineBlock]) -> tuple[str, LineBlock]:
    """Return the declarations, and what stands behind them in the same block.

    Raises:
        InputError: they do not end.
    """
    head = b""
    for block in text:
        head += block.text + b"\n"
        begin, found, rest = head.partition(b"$enddefinitions")
        if found:
            number = block.number + block.text.count(b"\n") - rest.count(b"\n") + 1
            behind = rest.partition(b"$end")[2]
            return begin.decode("utf-8", "replace"), LineBlock(behind, max(number, 1), 0, False)
        if len(head) > HEADER_MOST:
            break
    raise InputError("the dump's declarations do not end: $enddefinitions is missing")


def _wires(header: str) -> dict[bytes, str]:
    """Return the names of wires of one bit by their short names, within scopes where they must."""
    scopes: list[str] = []
    plain: dict[bytes, str] = {}
    full: dict[bytes, str] = {}
    for match in _DECLARED.finditer(header):
        if match["scope"]:
            scopes.append(match["scope"])
        elif match["up"]:
            del scopes[-1:]
        elif len(match["id"]) <= ID_MOST and match["id"].isascii():  # others are no names
            short = match["id"].encode()
            plain.setdefault(short, match["name"])
            full.setdefault(short, ".".join((*scopes, match["name"])))
    count = Counter(plain.values())
    chosen = [plain[i] if count[plain[i]] == 1 else full[i] for i in plain]
    return dict(zip(plain, unlike(chosen), strict=True))


class _Changes:
    """The changes of some wires, block by block."""

    def __init__(self, short: list[bytes]) -> None:
        codes = np.array([int.from_bytes(name, "big") for name in short], np.uint64)
        self._order = np.argsort(codes)
        self._codes = codes[self._order]
        self._levels = np.ones(len(short), np.int64)  # a wire idles high until somebody says more
        self._is_known = np.zeros(len(short), bool)
        self._now = 0

    def stretches(self, first: LineBlock, text: Iterator[LineBlock]) -> Iterator[Stretch]:
        """Yield what the blocks say.

        Raises:
            DamagedLine: times go back, or are none.
        """
        held = b""
        for block in itertools.chain((first,), text):
            data, held = held + block.text + b"\n", b""
            if b"$comment" in data:
                data = _COMMENT.sub(b" ", data)
                data, begun, rest = data.partition(b"$comment")
                held = begun + rest
                if len(held) > HEADER_MOST:
                    raise DamagedLine(block.number, "a comment does not end", nonsense=False)
            yield self._stretch(data, block)

    def _stretch(self, text: bytes, block: LineBlock) -> Stretch:
        data = np.frombuffer(text, np.uint8)
        space = np.frombuffer(b"\1" + text.translate(_SPACE), bool)
        # a word begins behind a space and ends before one; the text ends in one
        borders = np.flatnonzero(space[1:] != space[:-1])
        begin, end = borders[::2], borders[1::2]
        first = data[begin]
        is_time = first == ord("#")
        long = _LONG[first]
        long = _alternate(long) if long.any() else long
        named = np.concatenate([[False], long[:-1]])  # the word behind is a name, whatever it is
        is_time &= ~named
        at = self._times(data, begin, end, is_time, block)
        bits = _BIT[first] & ~named & (end - begin > 1)
        words = np.flatnonzero(bits)
        row = self._rows(data, begin[words] + 1, end[words])
        value = first[words]
        vector = np.flatnonzero(long[:-1] & (end[:-1] - begin[:-1] == 2)) if len(begin) else words
        if len(vector):  # a wire of one bit may be written like a bus
            row = np.concatenate([row, self._rows(data, begin[vector + 1], end[vector + 1])])
            value = np.concatenate([value, data[begin[vector] + 1]])
            words = np.concatenate([words, vector])
            order = np.argsort(words, kind="stable")
            row, value, words = row[order], value[order], words[order]
        keep = row >= 0
        return self._changed(row[keep], (value[keep] != ord("0")).astype(np.int64), at[words[keep]])

    def _times(self, data: U8, begin: I64, end: I64, is_time: Mask, block: LineBlock) -> I64:
        """Return the time that holds at each word."""
        words = np.flatnonzero(is_time)
        size = end[words] - begin[words] - 1
        if len(words) and (size.max() > DIGITS or not size.min()):
            first = begin[words[int(np.argmax((size > DIGITS) | (size == 0)))]]
            raise self._damaged(data, int(first), block)
        times = np.zeros(len(words), np.int64)
        # nearly all times have as many digits
        is_one = len(size) > 0 and size.min() == size.max()
        for width in size[:1].tolist() if is_one else np.unique(size).tolist():
            alike = np.flatnonzero(size == width)
            behind = end[words[alike]]
            told, wrong = np.zeros(len(alike), np.int64), np.zeros(len(alike), bool)
            for place in range(width, 0, -1):
                digit = data[behind - place] - np.uint8(ord("0"))
                wrong |= digit > 9  # what is less than a 0 has wrapped
                told *= 10
                told += digit
            if wrong.any():
                raise self._damaged(data, int(begin[words[alike]][wrong][0]), block)
            times[alike] = told
        since = np.concatenate([[self._now], times])
        if (np.diff(since) < 0).any():
            first = begin[words[int(np.argmax(np.diff(since) < 0))]]
            raise self._damaged(data, int(first), block)
        self._now = int(since[-1])
        return since[np.cumsum(is_time)]

    def _damaged(self, data: U8, at: int, block: LineBlock) -> DamagedLine:
        line = block.number + int(np.count_nonzero(data[:at] == ord("\n")))
        word = data[at : at + 40].tobytes().split()[0]
        return DamagedLine(line, f"{quoted(word)} is no time, or before the last", nonsense=False)

    def _rows(self, data: U8, begin: I64, end: I64) -> I64:
        """Return whose short names these are; -1: of no wire that is looked at."""
        size = end - begin
        code = np.zeros(len(begin), np.uint64)
        for place in range(min(int(size.max()) if len(size) else 0, ID_MOST)):
            there = size > place
            code[there] = code[there] << np.uint64(8) | data[begin[there] + place]
        nth = np.minimum(np.searchsorted(self._codes, code), len(self._codes) - 1)
        known = (self._codes[nth] == code) & (size <= ID_MOST)
        return np.where(known, self._order[nth], -1)

    def _changed(self, row: I64, value: I64, at: I64) -> Stretch:
        """Return the edges by wire: of what is said, what is new.

        What is said of three wires, and what becomes of it by wire (``levels`` are 1 1 1 and none
        of them known, so that the first value of each is no edge):

            row     0  2  0  2  0      sorted   0  0  0  2  2
            value   1  0  0  0  1      said     1  0  1  0  0
            at      5  5  7  8  9      before   1  1  0  0  0
                                       new         7  9            edges of wire 0
        """
        order = np.argsort(row, kind="stable")
        wires, said, at = row[order], value[order], at[order]
        levels = self._levels.copy()
        begins = np.flatnonzero(np.diff(wires, prepend=-1))
        first = wires[begins]
        fresh = first[~self._is_known[first]]
        levels[fresh] = said[begins][~self._is_known[first]]  # the first value is no change
        self._is_known[first] = True
        before = np.roll(said, 1)
        before[begins] = levels[first]
        self._levels = levels.copy()
        self._levels[first] = said[np.append(begins[1:], len(said))[: len(first)] - 1]
        new = said != before
        edges = EdgesByWire(wires[new], at[new], len(levels))
        return Stretch(levels.tolist(), edges, self._now, edges.active.tolist())


def _alternate(words: Mask) -> Mask:
    """Tell which of these words are values: of several in a row every other one is a name."""
    if not (words[1:] & words[:-1]).any():
        return words
    before = np.concatenate([[False], words[:-1]])
    run = np.maximum.accumulate(np.where(words & ~before, np.arange(len(words)), 0))
    return np.asarray(words & ((np.arange(len(words)) - run) % 2 == 0))
