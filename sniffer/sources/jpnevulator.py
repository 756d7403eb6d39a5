"""What ``jpnevulator --read --timing-print`` writes, with and without ``--ascii``.

    2026-11-20 22:55:10.000656: /dev/ttyS0
    FA AF 01 0F 2A 02 00 26                        <TAB>....*..&

A line with a time comes where the port changes, or after more than ``--timing-delta`` (100 ms)
without a byte: it is the time at which the first byte behind it was read, and nothing tells when
the others came, however many there are (headerWrite in jpnevulator.c, 2.3.6). So only that byte has
a stamp.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.patterns import later
from sniffer.sources.blockstamps import StampedLog
from sniffer.sources.text import DamagedLine, Opened, quoted, read_log, remarks
from sniffer.sources.walltime import SUMMER_ENDS, ZONELESS, WallClock

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.model import Chunk

STAMP: Final = later(rb"(\d{4}-\d\d-\d\d) (\d\d:\d\d:\d\d)\.(\d{6}):(?: (\S.*))?")
"""Day, time, microseconds, and the port or its alias where there are several."""

_COUNT: Final = later(rb"([0-9A-F]{8,16})\t(.*)")  # --byte-count
_PAIRS: Final = later(rb"[0-9A-F]{2}(?: [0-9A-F]{2})*")
_BITS: Final = later(rb"[01]{8}(?: [01]{8})*")
_CENTURY: Final = b"20"
_LINES: Final = later(rb"le=[01], dtr=[01], ")  # --control


def is_row(line: bytes) -> bool:
    """Tell whether a line holds bytes, and nothing else but a gutter."""
    return bool(_PAIRS.fullmatch(line.partition(b"   ")[0].partition(b"\t")[0].rstrip(b" ")))


class _Blocks(StampedLog):
    """Where a log has got to: of which port the bytes are, and what waits for a stamp."""

    def __init__(self, bus: str) -> None:
        super().__init__(bus)
        self._default = bus
        self._clock = WallClock(local=True)
        self._count: dict[str, int] = {}

    def _line(self, line: bytes, number: int, cut_off: bool) -> Iterator[Chunk]:
        stamp = STAMP.fullmatch(line)
        if stamp:
            name = stamp[4]
            bus = name.decode("utf-8", "replace") if name else self._default
            t_ns = self._clock.ns(stamp[1], stamp[2], stamp[3], number)
            yield from self._block.begin(t_ns, bus)
            return
        yield from self._block.add(self._row(line, number, cut_off))

    def _row(self, line: bytes, number: int, cut_off: bool) -> bytes:
        counted = _COUNT.fullmatch(line)
        text = counted[2] if counted else line
        pairs = text.partition(b"\t")[0].rstrip(b" ")
        if not pairs or _LINES.match(line):
            return b""
        if cut_off and (not _PAIRS.fullmatch(pairs) or self._is_no_row(pairs, counted is not None)):
            self.cut_off = True
            return self._half(pairs)
        if not _PAIRS.fullmatch(pairs):
            if _BITS.fullmatch(pairs):
                raise DamagedLine(number, "these are bits: log in base 16")
            raise DamagedLine(number, f"{quoted(line)} is no line of jpnevulator")
        data = bytes.fromhex(pairs.decode("ascii"))
        if counted:
            self._counted(int(counted[1], 16), len(data), number)
        return data

    def _is_no_row(self, pairs: bytes, counted: bool) -> bool:
        """Tell whether two digits at the very end are those of a year, or of a byte count."""
        return len(pairs) == 2 and (
            (pairs == _CENTURY and self._block.t_ns is None) or bool(self._count and not counted)
        )

    def _half(self, pairs: bytes) -> bytes:
        """Return the whole bytes of a row that breaks off, none of anything else."""
        half = _PAIRS.match(pairs)
        whole = half is not None and pairs[half.end() : half.end() + 1] == b" "
        return bytes.fromhex(half[0].decode("ascii")) if half and whole else b""

    def _counted(self, count: int, size: int, number: int) -> None:
        due = self._count.get(self._block.bus, count)
        if count != due:
            why = f"byte {count:08X} stands where {due:08X} is due: the log is damaged"
            raise DamagedLine(number, why, nonsense=False)
        self._count[self._block.bus] = count + size

    def notes(self) -> Iterator[str]:
        """Yield what is worth knowing about the log, at its end."""
        first = "only the first byte of a block has a time: no response times follow from them"
        yield f"{ZONELESS}; {first}"
        yield from remarks(SUMMER_ENDS if self._clock.went_back else "", cut_off=self.cut_off)


def read_jpnevulator(opened: Opened) -> Iterator[Chunk]:
    """Yield the first byte of each block with its time, the others without; a port is a bus."""
    return read_log(opened, _Blocks(opened.bus))
