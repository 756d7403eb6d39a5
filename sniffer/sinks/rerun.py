"""Batches -> a Rerun recording: a .rrd that opens with its own layout, or a live viewer.

Values become ``Scalars`` at ``/<bus>/servo/<id>/<register>``, whole columns at a time; enumerated
registers and alarms become ``StateChange``, only where they change; anomalies become ``TextLog`` at
``/<bus>/anomalies``. A packet without a value adds nothing, so lines never drop to zero. rerun is
imported when a sink is made, not before. Written for rerun-sdk 0.41.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.model import (
    COMMANDED,
    CONFIG,
    F64,
    I16,
    I64,
    MEASURED,
    OK,
    RESPONSE,
    WHOLE,
    Anomaly,
    Batch,
    Chunk,
    Clock,
    OutputError,
    Severity,
)
from sniffer.protocols.base import BusProtocol
from sniffer.registers import Register
from sniffer.sinks.rerun_layout import (
    ALARMS,
    RESPONSE_TIME,
    TIMELINE,
    Colours,
    Rgb,
    Track,
    blueprint,
    mixed,
)

if TYPE_CHECKING:
    import rerun as rr

ROWS: Final = 5000
"""Rows an entity gathers before they are sent: from 1000 on a call costs less than its rows."""

DATED_NS: Final = 946_684_800_000_000_000
"""2000-01-01: times before it count from the start of a capture and are shown as a duration."""

LEVELS: Final = {Severity.NOTE: "INFO", Severity.WARN: "WARN", Severity.ERROR: "ERROR"}
WHITE: Final[Rgb] = (255, 255, 255)
IDLE: Final[Rgb] = (62, 66, 74)
ALARM: Final[Rgb] = (214, 60, 60)


@dataclass(slots=True)
class Column:
    """What waits to be sent to one entity."""

    track: Track
    servo_id: int
    role: int
    names: Register | None = None
    times: list[I64] = field(default_factory=list)
    values: list[F64] = field(default_factory=list)
    states: list[str] = field(default_factory=list)
    rows: int = 0
    last: int | None = None
    colours: dict[str, Rgb] = field(default_factory=dict)


class RerunSink:
    """Writes what it is given to a .rrd file, or to a recording that somebody else has connected.

    Args:
        path: the file. Its layout is written by ``close``, when all servos are known.
        recording: instead, a connected recording; the layout is sent anew when a servo appears.
        rows: see ``ROWS``; a live recording sends every batch at once.
        window_s: how much a live view shows of the past.

    Raises:
        OutputError: the file cannot be written.
    """

    def __init__(
        self,
        path: Path | None = None,
        *,
        recording: rr.RecordingStream | None = None,
        rows: int = ROWS,
        window_s: float = 20.0,
    ) -> None:
        import rerun as rr

        if (path is None) == (recording is None):
            raise ValueError("either a path or a recording")
        self._live = recording is not None
        if recording is None:
            assert path is not None
            self._touch(path)
            # The viewer keeps one layout an application: each file is its own.
            recording = rr.RecordingStream(f"sniffer {path.stem}", send_properties=True)
            recording.save(path)
            recording.send_recording_name(path.stem)
        self._rec = recording
        self._rows = 1 if self._live else rows
        self._window_s = window_s
        self._columns: dict[tuple[str, int, str], Column] = {}
        self._tables: dict[str, Table] = {}
        self._colours = Colours()
        self._logs: dict[str, str] = {}
        self._answered: set[tuple[str, int]] = set()
        self._dated: bool | None = None
        self._span: tuple[int, int] | None = None
        self._stale = False
