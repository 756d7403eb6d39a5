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
from sniffer.sources.digits import DIGITS, PAD, numbers
from sniffer.sources.sigrok import rate_in, unlike
from sniffer.sources.text import DamagedLine, LineBlock, blocks, quoted

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sniffer.ground.model import I64, U8, Mask
    from sniffer.sources.text import Opened

    U64 = npt.NDArray[np.uint64]

HEADER_MOST: Final = 4 << 20
"""Bytes of declarations: those of a large chip have some 100 000 lines."""

ID_MOST: Final = 64
"""Signs of a wire's short name: four are enough for 78 million wires, but some write the name."""

AT_ONCE: Final = 1 << 19
"""Bytes of text that are taken apart at once: their columns still lie close to the processor."""

_UNITS: Final = {"s": 1e9, "ms": 1e6, "us": 1e3, "ns": 1.0, "ps": 1e-3, "fs": 1e-6}
_SCALE: Final = re.compile(r"\$timescale\s+([0-9]{1,9})\s*([munpf]?s)\s+\$end")
_SAMPLED: Final = re.compile(r"\bat ([0-9.]+ ?[kMG]?Hz)")  # in sigrok's comment
_DECLARED: Final = re.compile(
    r"\$scope\s+\S+\s+(?P<scope>\S+)\s+\$end|(?P<up>\$upscope)"
    r"|\$var\s+\S+\s+1\s+(?P<id>\S+)\s+(?P<name>\S+)(?:\s*\[[^\]]*\])?\s+\$end"
)
_COMMENT: Final = re.compile(rb"\$comment\b.*?\$end", re.DOTALL)
_TORN: Final = re.compile(
    rb"(?:^|\s)#[0-9]*$"
)  # a time at the very end: some digits may be missing
_BLANKS: Final = b" " * PAD
_INITIAL: Final = b"$dump"  # vars, all, on: what stands in it is no change
_EXACT: Final = 8  # signs of a short name that 64 bits hold
_MIXER: Final = 0x9E37_79B9_7F4A_7C15  # of longer ones: an odd number, so that no sign is lost


def _is_bit(first: U8) -> Mask:
    """Tell which words may be a level and a name: 0, 1, x, X, z, Z."""
    return np.asarray((first | 0x01 == ord("1")) | (first | 0x22 == ord("z")))


def _is_long(first: U8) -> Mask:
    """Tell which words are values whose wire is a word of its own: b, B, r, R, s, S."""
    return np.asarray((first | 0x30 == ord("r")) | (first | 0x20 == ord("s")))


def read_vcd(opened: Opened) -> LogicInput:
    """Open a dump.

    Raises:
        InputError: it declares no wires of one bit.
    """
    text = blocks(opened.stream, size=AT_ONCE)
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
            scopes.append(_plain(match["scope"]))
        elif match["up"]:
            del scopes[-1:]
        elif len(match["id"]) <= ID_MOST and match["id"].isascii():  # others are no names
            short = match["id"].encode()
            plain.setdefault(short, _plain(match["name"]))
            full.setdefault(short, ".".join((*scopes, _plain(match["name"]))))
    count = Counter(plain.values())
    chosen = [plain[i] if count[plain[i]] == 1 else full[i] for i in plain]
    return dict(zip(plain, unlike(chosen), strict=True))


def _plain(name: str) -> str:
    """Return a name without the stroke that begins one with odd signs."""
    return name[1:] if name.startswith("\\") and len(name) > 1 else name


class _Changes:
    """The changes of some wires, block by block."""

    def __init__(self, short: list[bytes]) -> None:
        ends = np.cumsum([len(name) for name in short])
        signs = np.frombuffer(b"".join(short), np.uint8)
        codes = _codes(signs, np.concatenate([[0], ends[:-1]]), ends)
        self._order = np.argsort(codes)
        self._codes = codes[self._order]
        # most have one sign: a table tells whose it is
        self._single = np.full(256, -1)
        for row, name in enumerate(short):
            if len(name) == 1:
                self._single[name[0]] = row
        self._levels = np.ones(len(short), np.int64)  # a wire idles high until somebody says more
        self._is_known = np.zeros(len(short), bool)
        self._now = 0
        self._begun = 0  # when the first values were told: what is said later is a change

    def stretches(self, first: LineBlock, text: Iterator[LineBlock]) -> Iterator[Stretch]:
        """Yield what the blocks say.

        Raises:
            DamagedLine: times go back, or are none.
        """
        held = b""
        for block in itertools.chain((first,), text):
            said = _TORN.sub(b"", block.text) if block.cut_off else block.text
            data, held = held + said + b"\n", b""
            if b"$" in data and b"$comment" in data:  # looking for one sign takes a tenth
                data = _COMMENT.sub(b" ", data)
                data, begun, rest = data.partition(b"$comment")
                held = begun + rest
                if len(held) > HEADER_MOST:
                    raise DamagedLine(block.number, "a comment does not end", nonsense=False)
            yield self._stretch(data, block)

    def _stretch(self, text: bytes, block: LineBlock) -> Stretch:
        data = np.frombuffer(_BLANKS + text, np.uint8)
        begin, end = _words(data)
        first = data[begin]
        is_time, bits, long = first == ord("#"), _is_bit(first), _is_long(first)
        if long.any():
            long = _alternate(long)
            named = np.concatenate([[False], long[:-1]])  # the word behind is a name, whatever
            is_time &= ~named
            bits &= ~named
        at = self._times(data, begin, end, is_time, block)
        if not self._is_known.all():
            self._begin(text, begin, at)
        bits &= end - begin > 1
        words = np.flatnonzero(bits)
        row = self._rows(data, begin[words] + 1, end[words])
        value = first[words]
        vector = np.flatnonzero(long[:-1] & (end[:-1] - begin[:-1] == 2))
        if len(vector):  # a wire of one bit may be written like a bus
            row = np.concatenate([row, self._rows(data, begin[vector + 1], end[vector + 1])])
            value = np.concatenate([value, data[begin[vector] + 1]])
            words = np.concatenate([words, vector])
            order = np.argsort(words, kind="stable")
            row, value, words = row[order], value[order], words[order]
        keep = row >= 0
        if not keep.all():
            row, value, words = row[keep], value[keep], words[keep]
        return self._changed(row, (value != ord("0")).astype(np.int64), at[words])

    def _begin(self, text: bytes, begin: I64, at: I64) -> None:
        """Find out when the first values are told, if this text tells it."""
        place = text.find(_INITIAL)
        if place >= 0 and not self._is_known.any():
            self._begun = int(at[np.searchsorted(begin, PAD + place, "right") - 1])

    def _times(self, data: U8, begin: I64, end: I64, is_time: Mask, block: LineBlock) -> I64:
        """Return the time that holds at each word."""
        words = np.flatnonzero(is_time)
        size = end[words] - begin[words] - 1
        if len(words) and (size.max() > DIGITS or not size.min()):
            first = begin[words[int(np.argmax((size > DIGITS) | (size == 0)))]]
            raise self._damaged(data, int(first), block)
        times, wrong = numbers(data, end[words], size)
        if wrong.any():
            raise self._damaged(data, int(begin[words][wrong][0]), block)
        since = np.concatenate([[self._now], times])
        if (np.diff(since) < 0).any():
            first = begin[words[int(np.argmax(np.diff(since) < 0))]]
            raise self._damaged(data, int(first), block)
        self._now = int(since[-1])
        return np.repeat(since, np.diff(words, prepend=0, append=len(is_time)))

    def _damaged(self, data: U8, at: int, block: LineBlock) -> DamagedLine:
        line = block.number + int(np.count_nonzero(data[:at] == ord("\n")))
        word = data[at : at + 40].tobytes().split()[0]
        return DamagedLine(line, f"{quoted(word)} is no time, or before the last", nonsense=False)

    def _rows(self, data: U8, begin: I64, end: I64) -> I64:
        """Return whose short names these are; -1: of no wire that is looked at."""
        size = end - begin
        if len(size) and size.max() == 1:
            return np.asarray(self._single[data[begin]])
        code = _codes(data, begin, end)
        nth = np.minimum(np.searchsorted(self._codes, code), len(self._codes) - 1)
        known = (self._codes[nth] == code) & (size <= ID_MOST)
        return np.where(known, self._order[nth], -1)

    def _changed(self, row: I64, value: I64, at: I64) -> Stretch:
        """Return the edges by wire: of what is said, what is new.

        What is said of three wires, and what becomes of it by wire (``levels`` are 1 1 1, none of
        them is known, and time 5 is when the first values are told, so that these are no edges):

            row     0  2  0  2  0      sorted   0  0  0  2  2
            value   1  0  0  0  1      said     1  0  1  0  0
            at      5  5  7  8  9      before   1  1  0  0  0
                                       new         7  9            edges of wire 0
        """
        if len(row) and self._is_known[row[0]] and (row == row[0]).all():
            return self._changed_alone(int(row[0]), value, at)
        if (row[1:] < row[:-1]).any():
            order = np.argsort(
                row.astype(np.int16) if len(self._levels) < 1 << 15 else row, kind="stable"
            )
            row, value, at = row[order], value[order], at[order]
        levels = self._levels.copy()
        begins = np.flatnonzero(np.diff(row, prepend=-1) != 0)
        first = row[begins]
        is_initial = ~self._is_known[first] & (at[begins] <= self._begun)
        levels[first[is_initial]] = value[begins[is_initial]]
        self._is_known[first] = True
        before = np.empty_like(value)
        before[1:] = value[:-1]
        before[begins] = levels[first]
        self._levels = levels.copy()
        self._levels[first] = value[np.append(begins[1:], len(value))[: len(first)] - 1]
        new = np.flatnonzero(value != before)
        edges = EdgesByWire(row[new], at[new], len(levels))
        return Stretch(levels.tolist(), edges, self._now, edges.active.tolist())

    def _changed_alone(self, row: int, value: I64, at: I64) -> Stretch:
        """Return the same where only one wire is spoken of, whose level is known."""
        levels = self._levels.tolist()
        before = np.empty_like(value)
        before[0], before[1:] = levels[row], value[:-1]
        self._levels[row] = value[-1]
        new = value != before
        edges = at if new.all() else at[new]
        wires = np.full(len(edges), row)
        active = [row] if len(edges) else []
        return Stretch(levels, EdgesByWire(wires, edges, len(levels)), self._now, active)


def _words(data: U8) -> tuple[I64, I64]:
    """Return where words begin and end; the text begins with blanks and ends with one."""
    space = data[PAD - 1 :] <= ord(" ")
    if not (space[1:] & space[:-1]).any():  # nearly always there is one blank between two words
        blank = np.flatnonzero(space)
        blank += PAD - 1
        return blank[:-1] + 1, blank[1:]
    borders = np.flatnonzero(space[1:] != space[:-1])
    borders += PAD
    return borders[::2], borders[1::2]


def _codes(signs: U8, begin: I64, end: I64) -> U64:
    """Return a number for each of these names: another one for another name, as good as always."""
    size = end - begin
    code = np.zeros(len(begin), np.uint64)
    for place in range(min(int(size.max()) if len(size) else 0, ID_MOST)):
        there = size > place
        factor = 1 << 8 if place < _EXACT else _MIXER
        code[there] = code[there] * factor + signs[begin[there] + place]
    return code


def _alternate(words: Mask) -> Mask:
    """Tell which of these words are values: of several in a row every other one is a name."""
    if not (words[1:] & words[:-1]).any():
        return words
    before = np.concatenate([[False], words[:-1]])
    run = np.maximum.accumulate(np.where(words & ~before, np.arange(len(words)), 0))
    return np.asarray(words & ((np.arange(len(words)) - run) % 2 == 0))
