"""What really happened on a simulated bus, frame by frame, as JSON lines.

Each line is handed to the system as soon as its frame is on the port, so that the file is good to
the last frame of a process that was killed.
"""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

from sniffer.ground.files import writing

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.simulation.play.player import SimulatedClock
    from sniffer.simulation.provenance import Answered
    from sniffer.simulation.talk import TrueFrame


class Truth:
    """Writes one file; ``clock`` turns the times of frames into Unix time.

    Raises:
        OutputError: the file cannot be written.
    """

    def __init__(self, path: Path, clock: SimulatedClock, bus: str = "bus0") -> None:
        self._path = path
        self._clock = clock
        self._bus = json.dumps(bus)
        self._lines: list[str] = []
        self.frames = 0
        with writing(path):
            self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o666)

    def head(self, facts: dict[str, Any]) -> None:
        """Write the first line."""
        self._write(_json({"type": "simulation", **facts}) + "\n")

    def add(self, frame: TrueFrame, offset: int | None) -> None:
        """Note a frame; ``offset`` is where its bytes stand in what was written to the port.

        None: no byte of it was.
        """
        t_start, t_end, data, wire, kind, servo_id, op, fault, values = frame
        base = self._clock.base_ns
        struck = f'"{fault}"' if fault else "null"
        place = "null" if offset is None else offset
        who = servo_id if servo_id >= 0 else "null"
        # by hand, for it is done up to 25 000 times a second: names hold nothing to be escaped
        told = ",".join(
            [f'{{"servo_id":{i},"register":"{name}","raw":{raw}}}' for i, name, raw in values]
        )
        self._lines.append(
            f'{{"type":"frame","bus":{self._bus},"offset":{place},'
            f'"t_start_ns":{base + t_start},"t_end_ns":{base + t_end},'
            f'"kind":"{kind}","servo_id":{who},"op":"{op}",'
            f'"hex":"{data.hex()}","wire":"{wire.hex()}",'
            f'"fault":{struck},"values":[{told}]}}\n'
        )

    def flush(self) -> None:
        """Hand what was noted to the system."""
        if self._lines:
            self.frames += len(self._lines)
            self._write("".join(self._lines))
            self._lines.clear()

    def close(
        self, *, size: int, dropped: int, behind_ns: int, answered: Answered | None = None
    ) -> None:
        """Write the last line and close the file."""
        self.flush()
        end: dict[str, Any] = {
            "type": "end",
            "frames": self.frames,
            "bytes": size,
            "dropped_bytes": dropped,
        }
        end["behind_ms"] = round(behind_ns / 1e6, 3)
        if answered is not None:
            end["answered"] = answered.facts()
        self._write(_json(end) + "\n")
        os.close(self._fd)

    def _write(self, text: str) -> None:
        left = memoryview(text.encode())
        with writing(self._path):
            while left:
                left = left[os.write(self._fd, left) :]


def _json(fields: dict[str, Any]) -> str:
    return json.dumps(fields, separators=(",", ":"))
