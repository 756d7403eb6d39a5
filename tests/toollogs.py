"""One conversation as each tool would log it, laid out as the tool's own source lays it out.

Sources: xiotransfer.c of socat 1.7, jpnevulator.c 2.3.6, protocol_spy.py of pySerial 3.5 (which is
run), SerialAnalyzerResults.cpp and SerialAnalyzer.cpp of Saleae's serial analyzer, interceptty.c of
the fork of 2019, grabserial 2.2.0, logs beside the examples of Docklight's maker.
"""

from __future__ import annotations

import datetime
import io
from typing import TYPE_CHECKING, Final, NamedTuple
from unittest import mock

from serial.urlhandler import protocol_spy

from sniffer.ground.model import NS, Direction
from tests.inputs import shown

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

BAUD: Final = 57600
BIT_NS: Final = NS // BAUD
BYTE_NS: Final = 10 * BIT_NS
MS: Final = NS // 1000
BEGUN_NS: Final = 1_795_215_306 * NS
DAY_NS: Final = 24 * 3600 * NS
ASK: Final = bytes.fromhex("FFFFFF0104F28C027A")
ANSWER: Final = bytes.fromhex("FFFFFF010400FF07F4")
TX, RX = Direction.TX, Direction.RX


class Said(NamedTuple):
    """Bytes on the line: when the first began and the last was over, and who sent them."""

    begun_ns: int
    over_ns: int
    data: bytes
    wire: Direction


def conversation(exchanges: int = 20, took_ns: int = MS) -> list[Said]:
    """Return as many questions with their answers, 20 ms apart."""
    out: list[Said] = []
    for n in range(exchanges):
        at = BEGUN_NS + n * 20 * MS
        over = at + len(ASK) * BYTE_NS
        answered = over + took_ns
        out.append(Said(at, over, ASK, TX))
        out.append(Said(answered, answered + len(ANSWER) * BYTE_NS, ANSWER, RX))
    return out


def _stamped(said: Said) -> int:
    """Return when a program between the controller and the port writes bytes down."""
    return said.begun_ns if said.wire == TX else said.over_ns


def _date(t_ns: int, pattern: str) -> str:
    return datetime.datetime.fromtimestamp(t_ns // NS, datetime.UTC).strftime(pattern)


def candump(talk: Sequence[Said]) -> bytes:
    lines = (f"({s.over_ns // NS}.{s.over_ns % NS:09}) bus0 #{s.data.hex()}\n" for s in talk)
    return "".join(lines).encode()


def _socat_heads(talk: Sequence[Said], sides: str) -> list[str]:
    seen = {TX: 0, RX: 0}
    heads = []
    for s in talk:
        t, first = _stamped(s), seen[s.wire]
        seen[s.wire] += len(s.data)
        heads.append(
            f"{sides[s.wire != TX]} {_date(t, '%Y/%m/%d %H:%M:%S')}.{t % NS // 1000:09d}  "
            f"length={len(s.data)} from={first} to={seen[s.wire] - 1}\n"
        )
    return heads


def socat_x(talk: Sequence[Said], sides: str = "><") -> bytes:
    heads = _socat_heads(talk, sides)
    rows = (f" {s.data.hex(' ')}\n" for s in talk)
    return "".join(h + r for h, r in zip(heads, rows, strict=True)).encode()


def socat_x_v(talk: Sequence[Said], sides: str = "><") -> bytes:
    out = []
    for head, s in zip(_socat_heads(talk, sides), talk, strict=True):
        out.append(head)
        left = s.data
        while left:
            end = left.find(b"\n", 0, 16)
            row = left[: end + 1 if end >= 0 else 16]
            left = left[len(row) :]
            out.append("".join(f" {byte:02x}" for byte in row).ljust(48) + f"  {shown(row)}\n")
        out.append("--\n")
    return "".join(out).encode()


def jpnevulator(talk: Sequence[Said], *, ascii_too: bool = True, delta_ns: int = 100 * MS) -> bytes:
    out, held, last = "", b"", 0

    def rows(data: bytes) -> str:
        cut = [data[at : at + 16] for at in range(0, len(data), 16)]
        gutters = [f"\t{shown(row)}" if ascii_too else "" for row in cut]
        width = 47 if ascii_too else 0
        texts = (row.hex(" ").upper().ljust(width) for row in cut)
        return "".join(f"{text}{gutter}\n" for text, gutter in zip(texts, gutters, strict=True))

    for s in talk:
        for k in range(len(s.data)):
            t = s.begun_ns + (k + 1) * BYTE_NS
            if t - last > delta_ns:
                out += rows(held) + _date(t, "%Y-%m-%d %H:%M:%S") + f".{t % NS // 1000:06d}:\n"
                held = b""
            held, last = held + s.data[k : k + 1], t
    return (out + rows(held)).encode()


def spy(talk: Sequence[Said], *, color: bool = False) -> bytes:
    """Have pySerial's own formatter write it, with a clock that is wound by hand."""
    out = io.StringIO()
    now_ns = talk[0].begun_ns

    class Clockwork:
        @staticmethod
        def time() -> float:
            return (now_ns - talk[0].begun_ns) / NS

    with mock.patch.object(protocol_spy, "time", Clockwork):
        printer = protocol_spy.FormatHexdump(out, color)
        for s in talk:
            now_ns = _stamped(s)
            (printer.tx if s.wire == TX else printer.rx)(s.data)
    return out.getvalue().encode()


def _bytes_of(talk: Sequence[Said]) -> list[tuple[int, int]]:
    return [
        (s.begun_ns - BEGUN_NS + k * BYTE_NS, byte) for s in talk for k, byte in enumerate(s.data)
    ]


def saleae_1(talk: Sequence[Said]) -> bytes:
    rows = (f"{t // NS}.{t % NS:09}000000,0x{byte:02X},,\n" for t, byte in _bytes_of(talk))
    return ("Time [s],Value,Parity Error,Framing Error\n" + "".join(rows)).encode()


def saleae_2(talk: Sequence[Said]) -> bytes:
    lasts = 19 * BIT_NS // 2 / NS  # to the middle of the stop bit
    rows = (
        f'"bus0","data",{t / NS:.9f},{lasts:.4g},0x{byte:02X},\n' for t, byte in _bytes_of(talk)
    )
    return ('name,type,start_time,duration,"data","error"\n' + "".join(rows)).encode()


def docklight(talk: Sequence[Said]) -> bytes:
    out = f"Docklight Log File (HEX) - Started {_date(BEGUN_NS, '%d.%m.%Y %H:%M:%S')}.000 \n\n"
    for s in talk:
        t = s.begun_ns + (BYTE_NS if s.wire == RX else 0)
        out += f"{_date(t, '%d.%m.%Y %H:%M:%S')}.{t % NS // MS:03d} [{s.wire.name}] - "
        out += "".join(f"{byte:02X} " for byte in s.data) + "\n"
    return out.encode()


def interceptty(talk: Sequence[Said]) -> bytes:
    out = ""
    for s in talk:
        t = _stamped(s)
        stamp = f"[{_date(t, '%H:%M %S')}.{t % NS // 1000:06d}]"
        for byte in s.data:
            sign = f" ({chr(byte)})" if 33 <= byte < 127 else ""
            out += f"{stamp}{'< ' if s.wire == TX else '> ' + chr(9)}0x{byte:02x}{sign}\n"
            stamp = " " * len(stamp)
    return out.encode()


def grabserial(talk: Sequence[Said], size: int = 20) -> bytes:
    arrived = [(s.begun_ns + (k + 1) * BYTE_NS, b) for s in talk for k, b in enumerate(s.data)]
    out, last = "", arrived[0][0]
    for at in range(0, len(arrived), size):
        row = arrived[at : at + size]
        t, last, before = row[0][0], row[0][0], last
        out += f"[{_date(t, '%H:%M:%S')}.{t % NS // 1000:06d} {(t - before) / NS:.6f}] "
        out += "".join(f"{byte:02X} " for _, byte in row) + "\n" * (len(row) == size)
    return out.encode()


WRITERS: Final[Mapping[str, Callable[[Sequence[Said]], bytes]]] = {
    "socat -x": socat_x,
    "socat -x -v": socat_x_v,
    "jpnevulator": jpnevulator,
    "spy": spy,
    "saleae 1": saleae_1,
    "saleae 2": saleae_2,
    "docklight": docklight,
    "interceptty": interceptty,
    "grabserial": grabserial,
}

FIRST_ONLY: Final = ("jpnevulator", "docklight")
"""Those that state the time of the first byte of a block alone; a row of grabserial may begin with
the last byte of a packet."""

NONSENSE: Final = {
    "spy": b"12345.6 TX   0000  zz\n",
    "docklight": b"01.03.2019 14:09:28.633 [TX] - what\n",
    "interceptty": b"< what is this\n",
    "grabserial": b"[1.000000] what\n",
}
"""Lines that would be theirs: others between are left out."""

OF_THE_DAY: Final = ("interceptty", "grabserial")
"""Those whose times have no date."""

FORMAT: Final = {name: name.split()[0] for name in WRITERS}
"""What ``--input-format`` calls them."""
