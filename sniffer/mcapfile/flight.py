"""A flight recorder: a ring of what was heard, and a recording each time something happens.

Each recording has the time before what triggered it and the time after, and is like any other: raw
bytes as they came, and what was made of them. That is made from the file's own first byte on by a
pipeline of its own, so decoding the file again says the same. It is made in steps, because a minute
of busy buses takes longer to decode than the ports can be left alone; raw bytes of a step are in
the file before they are decoded.

What happens while a recording is written prolongs it, up to a bound. What goes on for longer begins
no other one: that needs something that is new.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final

from sniffer.decoding.names import joined, protocols_named
from sniffer.decoding.pipeline import AUTO, Options
from sniffer.ground.files import writing
from sniffer.ground.model import NS, Chunk
from sniffer.mcapfile.flightfile import FlightFile
from sniffer.mcapfile.numbered import NumberedFiles
from sniffer.mcapfile.open import OpenIncidents
from sniffer.mcapfile.ring import Ring
from sniffer.mcapfile.ringfile import RingFile, put_aside
from sniffer.messages import OFFSET, TRIGGER

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.rates import Rate
    from sniffer.decoding.sink import Part
    from sniffer.diagnosis.tracking import IncidentChange
    from sniffer.ground.model import Batch
    from sniffer.mcapfile.joints import RosJoint
    from sniffer.mcapfile.ros2 import JointPlaces
    from sniffer.protocols.base import BusProtocol

LONGEST: Final = 10
"""What goes on happening prolongs a recording to so many times the time after the first one."""

STEP_S: Final = 0.03
"""How long is worked on a recording in one round, in seconds: the ports come first."""

LATE_NS: Final = 5 * NS
"""How long after its end a recording is closed at the latest. It is closed as soon as all that was
said until then is decoded, for what is found in it may put off the end."""

READ_NS: Final = NS // 5
"""How long it may take until what was said is here."""

RING_MOST: Final = 64 << 20
"""Bytes of a ring that was asked for as a time: a minute of ten buses at 1 Mbit/s."""


@dataclass(frozen=True, slots=True)
class Happening:
    """What triggers a recording: when, on the clock of the buses, and in words.

    ``last_ns`` is until when it has been going on, where that is later. ``is_new``: it has not been
    going on already.
    """

    t_ns: int
    bus: str
    what: str
    trigger: str
    servo_ids: tuple[int, ...] = ()
    last_ns: int = 0
    is_new: bool = True

    def facts(self) -> dict[str, str]:
        """Return what a recording says of it."""
        return {
            "trigger": self.trigger,
            "t_ns": str(self.t_ns),
            "bus": self.bus,
            "servo_ids": " ".join(map(str, self.servo_ids)),
            "what": self.what,
        }


@dataclass(frozen=True, slots=True)
class Around:
    """What of the time around a happening is kept.

    ``before_ns`` None: as much as the ring has; ``most`` is the ring's size in bytes.
    """

    before_ns: int | None = None
    after_ns: int = 10 * NS
    most: int = RING_MOST


class FlightRecorder:
    """Takes what a recorder hears, and writes a file when it is told that something happened.

    It stands where the file of a recording does; see ``tap.recorder.RecordingFile``. Files are
    ``path`` with -0001 and so on behind its stem; numbers that are taken are passed over.

    Args:
        path: of all files but for the number.
        session: facts of the recording.
        options: how files are decoded; protocols that are found meanwhile are added.
        around: what of the time around a happening is kept.
        ring_file: where the ring is kept on the disk, too; None: nowhere.
        keep: so many files of this recorder are kept; older ones are deleted.
        durable: whether the disk is waited for with each flush.
        topics: what is written beside the raw bytes; None: everything.
        joints: what ROS 2 understands is written, too, see ``McapSink``.
        now: the time, on the clock of the buses, in ns.
        tell: takes what people should know.

    Raises:
        OutputError: a file cannot be written.
    """

    holds_all: ClassVar[bool] = False
    """Whether its files have every byte that is heard."""

    def __init__(
        self,
        path: Path,
        session: Mapping[str, str],
        options: Options,
        around: Around,
        *,
        ring_file: Path | None = None,
        keep: int | None = None,
        durable: bool = False,
        topics: Collection[str] | None = None,
        joints: Sequence[RosJoint] | None = None,
        now: Callable[[], int] = time.time_ns,
        tell: Callable[[str], None] = lambda line: None,
    ) -> None:
        self._base = path
        self._session = dict(session)
        self._options = options
        self._around = around
        self._durable = durable
        self._topics = topics
        self._joints: JointPlaces | None = None
        if joints is not None:
            from sniffer.mcapfile.ros2 import JointPlaces

            self._joints = JointPlaces.of(joints, session)
        self._now = now
        self._tell = tell
        span_ns = around.before_ns if around.before_ns is not None else 1 << 60
        self.ring = Ring(span_ns, around.most)
        self._number = 0
        self._files = NumberedFiles(path, keep)
        self._decided: dict[str, int] = {}
        self._open = OpenIncidents()
        self._finished = 0
        self._told_short = False
        self._current: FlightFile | None = None
        self._next: Happening | None = None
        with writing(path):
            list(path.parent.iterdir())  # whether files can be written there is seen now
        self._ring_file: RingFile | None = None
        if ring_file is not None:
            aside = self._free_path()
            if put_aside(ring_file, aside):
                tell(f"{ring_file} was left by a recorder that did not end: it is {aside} now")
            else:
                self._number -= 1
            self._ring_file = RingFile(ring_file, session, self.ring, durable=durable)

    @property
    def path(self) -> Path:
        """The file that is being written, or the last one."""
        return self._files.latest or self._base

    @property
    def size(self) -> int:
        """Bytes written, all files together."""
        return self._finished + (self._current.sink.size if self._current is not None else 0)

    @property
    def files(self) -> tuple[Path, ...]:
        """The files that are kept."""
        return self._files.kept

    @property
    def deleted(self) -> tuple[Path, ...]:
        """The files that somebody has deleted while they were written."""
        return self._files.deleted

    @property
    def remarks(self) -> list[str]:
        """What should be told of the joints in them."""
        return [] if self._joints is None or not self._files else self._joints.told()

    @property
    def is_lost(self) -> bool:
        """Tell whether the file that is being written is no more under its name."""
        return self._current is not None and self._files.is_lost

    def happened(self, what: Happening) -> None:
        """Learn that something happened; ``flush`` begins a file, or the current one goes on.

        Raises:
            OutputError: a file cannot be begun.
        """
        current = self._current
        if current is None:
            if what.is_new:
                self._begin(what)
        elif not current.is_over:
            current.until_ns = min(
                max(current.until_ns, max(what.t_ns, what.last_ns) + self._around.after_ns),
                current.last_ns,
            )
            if what.is_new:
                current.sink.note(TRIGGER, what.facts())
        elif what.is_new and self._next is None:
            self._next = what

    def rotate(self) -> None:
        """Write a file because somebody asked for it."""
        self.happened(Happening(self._now(), "", "somebody asked for it", "signal"))

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks as they came, before they are decoded."""
        if not chunks:
            return
        block = self.ring.add(bus, chunks)
        if self._ring_file is not None:
            self._ring_file.add(block, chunks)
        if self._current is not None:
            self._current.add(chunks)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Learn what a bus speaks; what was decided is decided again for a file."""
        self._know(bus, [protocol])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Learn what a bus speaks, where these are several."""
        self._know(bus, [protocol for protocol, _ in parts])

    def tuned(self, bus: str, rate: Rate) -> None:
        """Take the rate that was found for a bus: files that begin from now on say so."""
        self._session.update((f"{key}.{bus}", value) for key, value in rate.facts().items())
        if self._ring_file is not None:
            self._ring_file.tuned(bus, rate)
        o = self._options
        self._options = replace(
            o,
            bauds={**o.bauds, bus: rate.baud},
            latencies={**o.latencies, bus: rate.latency_ns},
        )

    def incidents(self, changes: Sequence[IncidentChange]) -> None:
        """Take what has become of incidents; a file begins with those that are open."""
        self._open.take(changes)
        if self._current is not None:
            self._current.sink.incidents(changes)

    def turn(self, decided: Mapping[str, int]) -> None:
        """Learn up to which offset each bus is decoded; there a file may begin."""
        self._decided.update(decided)
        self.ring.decided(decided)
        self.ring.trim(self._now())
        if self.ring.is_short and not self._told_short and self._lacks():
            self._told_short = True
            self._tell(
                f"the ring is full with {self.ring.size} bytes: there is less in it than was "
                "asked for"
            )
        current = self._current
        if current is not None and current.sink.is_deleted:
            self._files.lost(current.path)

    def flush(self) -> None:
        """Write what waits, and some of what is made of it; end a file whose time is over.

        Raises:
            OutputError: a file cannot be written.
        """
        now = self._now()
        if self._ring_file is not None:
            self._ring_file.flush(now)
        current = self._current
        if current is None:
            return
        if not current.is_over and self._is_known(current.until_ns, now):
            current.end(min(now, current.until_ns))
        if current.work(time.monotonic() + STEP_S):
            self._end(current)

    def close(self) -> None:
        """Finish what is being written."""
        try:
            if self._current is not None:
                current = self._current
                current.is_over = True  # whoever ended the recording has marked the end
                while not current.work(time.monotonic() + STEP_S):
                    pass
                self._end(current)
        finally:
            if self._ring_file is not None:
                self._ring_file.close()

    def _lacks(self) -> bool:
        """Tell whether a full ring has less than was asked for, a time or so many bytes."""
        return self._around.before_ns is not None or self.ring.size < self._around.most // 2

    def _is_known(self, t_ns: int, now: int) -> bool:
        """Tell whether a time is over, and what was said until then decoded."""
        if now <= t_ns + READ_NS:
            return False
        said = self.ring.offsets(t_ns)
        is_decoded = all(self._decided.get(bus, 0) >= at for bus, at in said.items())
        return is_decoded or now > t_ns + LATE_NS

    def _know(self, bus: str, protocols: Sequence[BusProtocol]) -> None:
        named = self._options.protocols.get(bus, self._options.protocol)
        if named == AUTO:
            told = {**self._options.protocols, bus: joined(protocols)}
            self._options = replace(self._options, protocols=told)
            if self._ring_file is not None:
                self._ring_file.know(bus, protocols)

    def _begin(self, what: Happening) -> None:
        """Begin a file with what the ring has of the time before."""
        before_ns = self._around.before_ns
        since_ns = what.t_ns - before_ns if before_ns is not None else 0
        past = self.ring.since(since_ns)
        # what is told now may have begun long ago
        until_ns = max(what.t_ns, what.last_ns) + self._around.after_ns
        last_ns = max(what.t_ns + LONGEST * self._around.after_ns, until_ns)
        path = self._free_path()
        told = {f"trigger.{key}" if key != "trigger" else key: v for key, v in what.facts().items()}
        protocols = {
            f"protocol.{bus}": joined(protocols_named(named))
            for bus, named in self._options.protocols.items()
            if named != AUTO
        }
        starts = {f"{OFFSET}.{bus}": str(some.start) for bus, some in past.items()}
        facts = {**self._session, **protocols, **told}
        current = FlightFile(
            path,
            facts,
            replace(self._options, begins={}).with_facts({**facts, **starts}),
            past,
            until_ns=until_ns,
            last_ns=last_ns,
            durable=self._durable,
            topics=self._topics,
            joints=self._joints,
        )
        self._current = current
        current.sink.incidents(self._open.changes)
        self._files.began(path)
        first = min((some.first_ns for some in past.values()), default=what.t_ns)
        self._tell(
            f"{what.what}: {path} has {max(what.t_ns - first, 0) / NS:.1f} s before it and will "
            f"have {self._around.after_ns / NS:g} s after it"
        )

    def _end(self, current: FlightFile) -> None:
        self._finished += current.sink.size
        self._current = None
        self._tell(f"{current.path}: {current.bytes} bytes")
        self._files.drop_oldest()
        what, self._next = self._next, None
        if what is not None:
            self._begin(what)

    def _free_path(self) -> Path:
        self._number = self._files.free(self._number + 1)
        return self._files.of(self._number)
