"""``sniffer record`` in the guest, and what its file says."""

from __future__ import annotations

import itertools
import time
from typing import TYPE_CHECKING, Final

from rig.machine import PATIENCE_S
from sniffer.ground.model import NS
from sniffer.simulation import simulate
from sniffer.simulation.render import usb_reads
from tests.recorder import codes, facts, heard, so_far

if TYPE_CHECKING:
    from pathlib import Path
    from typing import Any

    from rig.machine import Machine

SIZED_BY_US: Final = ("HELD", "ENDED", "SILENT")
"""Marks that tell of the machine's own speed, or of how slowly we speak."""

_COUNT = itertools.count(1)


def talk(seconds: float, seed: int = 1, baud: int = 57600) -> list[tuple[float, bytes]]:
    """Return what a simulated bus says, with the times at which it does, in seconds."""
    frames = simulate("mightyzap", seed=seed, faults=[], start_ns=0, duration_s=seconds)
    return [(t / NS, data) for t, data in usb_reads(frames, baud)]


class Recording:
    """A recorder that was begun; the arguments are those of ``sniffer record``."""

    def __init__(self, rig: Machine, *words: str, timeout: float = 600) -> None:
        self.rig = rig
        self.path = f"/tmp/run-{next(_COUNT)}.mcap"
        self.here = rig.dir / self.path.rpartition("/")[2]
        self.number = rig.sniff("record", *words, "-o", self.path, timeout=timeout)

    def wait_open(self) -> Recording:
        """Wait until its file is there: then all ports are open."""
        pid = f"/tmp/pid.{self.number}"  # of one that has not begun there is none: it did not end
        ended = f"{{ test -s {pid} && ! kill -0 $(cat {pid}); }}"
        self.rig.until(f"test -s {self.path} || {ended}")
        return self

    def wait_port(self, name: str) -> None:
        """Wait until it has a port open again."""
        self.rig.until(f"ls -l /proc/$(cat /tmp/pid.{self.number})/fd | grep -q {name}")

    def fetch(self) -> Path:
        """Copy its file here, as far as it is written."""
        self.here.write_bytes(self.rig.fetch(self.path))
        return self.here

    def heard(self, bus: str) -> bytes:
        """Return what is in its file."""
        return so_far(self.fetch()).get(bus, b"")

    def wait_heard(self, bus: str, size: int) -> bytes:
        """Wait for a number of bytes; return what has come by then, or in all patience."""
        end = time.monotonic() + PATIENCE_S
        while len(found := self.heard(bus)) < size and time.monotonic() < end:
            time.sleep(0.5)
        return found

    def stop(self, signal: str = "TERM") -> dict[str, Any]:
        """End it; return its status and what it said."""
        self.rig.tell(self.number, signal)
        told = self.rig.result(self.number)
        self.fetch()
        return told

    def codes(self, bus: str) -> list[str]:
        """Return its anomalies."""
        return codes(self.here, bus)

    def marks(self, bus: str) -> list[str]:
        """Return its marks: ``KIND(start,length,count)``."""
        return [
            f"{mark.kind.name}({mark.start},{mark.length},{mark.count})"
            for chunk in heard(self.here)
            if chunk.bus == bus
            for mark in chunk.marks
            if mark.kind.name not in SIZED_BY_US
        ]

    def facts(self, bus: str) -> dict[str, str]:
        """Return what it says about a port."""
        begin = f"port.{bus}."
        told = facts(self.here).items()
        return {key.removeprefix(begin): value for key, value in told if key.startswith(begin)}
