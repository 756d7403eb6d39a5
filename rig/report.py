"""What a run has seen: a line for each check and each fact, and the count of them."""

from __future__ import annotations

import contextlib
import re
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rig.machine import Machine

FTDI = {
    0x4000: "reset",
    0x4001: "modem",
    0x4002: "flow",
    0x4003: "baud",
    0x4004: "data",
    0x4009: "latency=",
    0xC00A: "latency?",
    0xC005: "status?",
}
"""Control transfers to an FTDI adapter (ftdi_sio.h)."""


@dataclass
class Report:
    """Prints what is found as it is found."""

    passed: int = 0
    failed: list[str] = field(default_factory=list)
    about: str = ""
    began: float = field(default_factory=time.monotonic)

    def check(self, holds: bool, text: object) -> None:
        """Tell whether something that must hold does."""
        if holds:
            self.passed += 1
        else:
            self.failed.append(f"{self.about}: {text}")
        self._line("ok" if holds else "FAIL", text)

    def fact(self, text: object) -> None:
        """Tell what was seen, where nothing has to hold."""
        self._line("fact", text)

    def _line(self, kind: str, text: object) -> None:
        shown = "".join(c if c.isprintable() or c == "\n" else "?" for c in str(text))
        print(f"{time.monotonic() - self.began:6.0f} {kind:4} {self.about}: {shown}", flush=True)


@contextlib.contextmanager
def traced(rig: Machine) -> Iterator[list[str]]:
    """Yield what QEMU writes down meanwhile; it is there when this has ended."""
    out: list[str] = []
    before = len(rig.trace())
    yield out
    time.sleep(0.3)  # QEMU writes it from another thread
    out += rig.trace()[before:]


def modem_moves(lines: list[str]) -> list[str]:
    """Return what was written to a 16550's modem control register."""
    found = (re.search(r"serial_write .*addr 0x04 val 0x([0-9a-f]+)", line) for line in lines)
    values = [int(match[1], 16) for match in found if match]
    names = ((1, "DTR"), (2, "RTS"))
    return ["+".join(name for bit, name in names if value & bit) or "low" for value in values]


def transmitted(lines: list[str]) -> int:
    """Return how many bytes were put into a 16550's transmitter (its divisor is not that)."""
    count, latch = 0, False
    for line in lines:
        if match := re.search(r"serial_write .*addr 0x([0-9a-f]+) val 0x([0-9a-f]+)", line):
            at, value = int(match[1], 16), int(match[2], 16)
            latch = bool(value & 0x80) if at == 3 else latch
            count += at == 0 and not latch
    return count


def transfers(lines: list[str]) -> list[str]:
    """Return the control transfers to an FTDI adapter, in words."""
    out = []
    for line in lines:
        if match := re.search(
            r"_handle_control .*control 0x([0-9a-f]+), value 0x([0-9a-f]+)", line
        ):
            request, value = int(match[1], 16), int(match[2], 16)
            if request == 0x4001:
                names = ((1, "DTR"), (2, "RTS"))
                moved = ((n, value & bit) for bit, n in names if value >> 8 & bit)
                out.append("modem " + ",".join(f"{n} {'up' if up else 'down'}" for n, up in moved))
            elif request in FTDI:
                out.append(FTDI[request] + (f" {value:#x}" if value else ""))
    return out


def rates(lines: list[str]) -> list[int]:
    """Return the rates at which a line really ran."""
    found = (re.search(r"(?:baudrate=|baud rate )(\d+)", line) for line in lines)
    return [int(match[1]) for match in found if match]
