"""Where a recording goes: one file or a row of them, or one each time something happens."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sniffer.decoding.pipeline import Options
from sniffer.ground.files import files_of, refuse_occupied
from sniffer.ground.model import NS, OutputError, SnifferError
from sniffer.ground.wording import Sentence
from sniffer.jobs.outputs import open_outputs
from sniffer.mcapfile.flight import RING_MOST, Around, FlightRecorder
from sniffer.mcapfile.ringfile import is_ring
from sniffer.mcapfile.rotation import RotatingMcap
from sniffer.sinks import suffix_known
from sniffer.tap.watching import awaited_in

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.sink import Sink
    from sniffer.mcapfile.joints import RosJoint

RecordingFiles = RotatingMcap | FlightRecorder
"""What stands for the recording while it is made."""


@dataclass(frozen=True, slots=True)
class Flight:
    """A flight recorder: no recording, but one each time something happens.

    ``before_ns`` and ``most`` are the ring, in time and in bytes; None: bounded by the other one.
    ``triggers`` are what ``watching.awaited_in`` reads: codes, causes, rules. In ``ring_file`` the
    ring is kept on the disk, too.
    """

    before_ns: int | None
    most: int | None
    triggers: tuple[str, ...]
    after_ns: int = 10 * NS
    ring_file: Path | None = None


@dataclass(frozen=True, slots=True)
class Files:
    """Where a recording goes.

    ``recording`` is the MCAP file; the suffixes of ``others`` name their formats (.jsonl, .csv,
    .parquet, .rrd). ``topics`` are what the recording has beside the raw bytes, None for everything
    (names of ``sniffer.messages.CHOICES``). A new file is begun after ``rotate_bytes`` or
    ``rotate_ns``, and only the last ``keep`` of them stay. ``durable``: each round waits for the
    disk. ``overwrite``: files that are there already are replaced. ``flight``: ``recording`` is a
    row of files, one each time something happens. ``joints``: it has what ROS 2 understands, too,
    of these, or of all servos whose position has a physical unit where there are none.
    """

    recording: Path | None
    others: Sequence[Path] = ()
    rotate_bytes: int | None = None
    rotate_ns: int | None = None
    keep: int | None = None
    topics: Sequence[str] | None = None
    durable: bool = False
    overwrite: bool = False
    flight: Flight | None = None
    joints: Sequence[RosJoint] | None = None

    @property
    def rotates(self) -> bool:
        """Whether there will be several files: their names are numbered."""
        return self.rotate_bytes is not None or self.rotate_ns is not None


def check_files(files: Files) -> None:
    """Refuse what cannot be meant, before a port is opened for it.

    Raises:
        OutputError: a file is there already, or its suffix is not known.
        SnifferError: what does not go together was asked for, or a trigger is none.
    """
    if files.recording is None:
        if files.flight is not None:
            told = "a flight recorder writes recordings: {recording:x.mcap}"
            raise SnifferError(Sentence(told))
        if files.rotates or files.keep is not None:
            told = "{rotate_bytes|rotate_ns} and {keep} are about a recording: {recording:x.mcap}"
            raise SnifferError(Sentence(told))
        if files.topics is not None:
            raise SnifferError(Sentence("{topics} is about a recording: {recording:x.mcap}"))
        if files.joints is not None:
            raise SnifferError(Sentence("{joints} is about a recording: {recording:x.mcap}"))
    if files.keep is not None and not (files.rotates or files.flight):
        raise SnifferError(Sentence("{keep} goes with {rotate_bytes|rotate_ns}"))
    if files.flight is not None:
        if files.rotates:
            told = (
                "a flight recorder begins files by itself: {rotate_bytes|rotate_ns} is not for it"
            )
            raise SnifferError(Sentence(told))
        for text in files.flight.triggers:
            awaited_in(text)
        ring_file = files.flight.ring_file
        if ring_file is not None and not files.overwrite and not is_ring(ring_file):
            refuse_occupied([ring_file])
    own = () if files.recording is None else (files.recording,)
    for path in (*own, *files.others):
        suffix_known(path)
        numbered = (
            files.rotates or files.flight is not None
        ) and path in own  # their names are looked at later
        if not numbered and not files.overwrite:
            refuse_occupied(files_of(path))


def open_files(
    files: Files,
    facts: Mapping[str, str],
    options: Options | None = None,
    *,
    now: Callable[[], int] = time.time_ns,
    tell: Callable[[str], None] = lambda line: None,
) -> tuple[RecordingFiles | None, list[Sink]]:
    """Open the outputs; where one cannot be opened, none is left behind.

    ``options``, ``now`` (the clock of the buses) and ``tell`` are for a flight recorder.
    """
    recording: RecordingFiles | None = None
    if files.recording is not None and files.flight is not None:
        flight = files.flight
        recording = FlightRecorder(
            files.recording,
            facts,
            options or Options(),
            Around(flight.before_ns, flight.after_ns, flight.most or RING_MOST),
            ring_file=flight.ring_file,
            keep=files.keep,
            durable=files.durable,
            topics=files.topics,
            joints=files.joints,
            now=now,
            tell=tell,
        )
    elif files.recording is not None:
        recording = RotatingMcap(
            files.recording,
            facts,
            rotate_bytes=files.rotate_bytes,
            rotate_ns=files.rotate_ns,
            keep=files.keep,
            durable=files.durable,
            topics=files.topics,
            joints=files.joints,
            overwrite=files.overwrite,
        )
    try:
        others = open_outputs(files.others, facts, "", force=files.overwrite)
    except OutputError:
        if recording is not None:
            recording.close()
            for path in recording.files:
                path.unlink(missing_ok=True)
        raise
    return recording, [*([recording] if recording is not None else []), *others]
