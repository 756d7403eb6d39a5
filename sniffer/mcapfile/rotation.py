"""A recording as a row of files: each is whole in itself, and between them nothing is missing.

Bytes are in the current file with the next flush, whatever else is due. A new file begins on each
bus behind the last byte that is decided, in the middle of a chunk where need be. No frame, reply or
gap crosses that place, so each file decodes alone to the frames and gaps that were decoded live.
Remarks whose rule remembers the exchanges before may differ at a file's begin: nothing of that
memory crosses the cut.

What is not decided yet is in the old file already, and written to the new one before anything
else. Then the old one gets its end mark: readers leave out what lies behind it. So a recorder that
is killed in between leaves bytes in both files, never in none.

Offsets count through all files; a file's session tells its part, the file before it, and where
each bus begins (``offset.<bus>``). Counts of the second in which the cut falls stand in both.
"""

from __future__ import annotations

import contextlib
import time
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Final

from sniffer.decoding.names import joined
from sniffer.ground.cutting import behind
from sniffer.ground.limits import BAUDS, number_in
from sniffer.ground.model import OutputError
from sniffer.ground.timing import byte_time_ns
from sniffer.ground.wording import Sentence
from sniffer.mcapfile.numbered import NumberedFiles
from sniffer.mcapfile.open import OpenIncidents
from sniffer.messages import OFFSET, TIME

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.rates import Rate
    from sniffer.decoding.sink import Part
    from sniffer.diagnosis.tracking import IncidentChange
    from sniffer.ground.cutting import Placed
    from sniffer.ground.model import Batch, Chunk
    from sniffer.mcapfile.joints import RosJoint
    from sniffer.mcapfile.ros2 import JointPlaces
    from sniffer.mcapfile.sink import McapSink
    from sniffer.protocols.base import BusProtocol

FLUSH_NS: Final = 1_000_000_000
"""How long decoded records wait to be written: a killed recorder loses so many, and `recover` makes
them again. Half as long or twice as long costs the same: what is
saved by fewer turns is lost to the memory that more of them walk through."""

STEP_NS: Final = 10_000_000
"""How long a file is ended in one go: the index of an hour takes some tenths of a second, in which
nothing that comes would be written."""


@dataclass(slots=True)
class _Bus:
    """One bus: how far it was handed in, and the chunks that may not be decided yet."""

    end: int = 0
    kept: list[Placed] = field(default_factory=list)

    @property
    def begin(self) -> int:
        """Offset of the first byte that is here."""
        return self.kept[0][0] if self.kept else self.end


class RotatingMcap:
    """Writes a recording, in one file or in several.

    A file that is deleted while it is written is followed by a new one.
    Without limits the file is ``path``, and those that ``rotate`` asks for are ``path`` with -0002
    and so on behind its stem; with limits the first is -0001. A name that is taken when a later
    file begins is passed over. Call ``turn`` after each decoding pass, and then ``flush``.

    Args:
        path: of the file, or of all of them but for the number.
        session: facts of the recording; ``baud.<bus>`` or ``baud`` tells how long a byte takes.
        rotate_bytes: a new file is due when the current one has so many bytes, beside those that
            were undecided when it was begun.
        rotate_ns: the same when the first byte came so long ago that was handed in since; a file
            without such bytes is kept on.
        keep: so many files are kept, the current one among them; older ones of this recording are
            deleted, if they are still those that were written.
        durable: whether the disk is waited for with each flush, against a power failure.
        overwrite: whether files that are there may be replaced.
        flush_ns: how long what was decoded may wait to be written; raw bytes never wait.
        topics: what is written beside the raw bytes, see ``McapSink``; None: everything.
        joints: what ROS 2 understands is written, too, see ``McapSink``.
        now: the time, for the limit.

    Raises:
        OutputError: a file cannot be written, or without ``overwrite`` one of that name is there;
            what was written before stays readable.
    """

    holds_all: ClassVar[bool] = True
    """Whether its files have every byte that is heard."""

    def __init__(
        self,
        path: Path,
        session: Mapping[str, str],
        *,
        rotate_bytes: int | None = None,
        rotate_ns: int | None = None,
        keep: int | None = None,
        durable: bool = False,
        overwrite: bool = False,
        flush_ns: int = FLUSH_NS,
        topics: Collection[str] | None = None,
        joints: Sequence[RosJoint] | None = None,
        now: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._session = dict(session)
        self._rotate_bytes = rotate_bytes
        self._rotate_ns = rotate_ns
        self._durable = durable
        self._overwrite = overwrite
        self._flush_ns = flush_ns
        self._topics = topics
        self._joints: JointPlaces | None = None
        if joints is not None:
            from sniffer.mcapfile.ros2 import JointPlaces

            self._joints = JointPlaces.of(joints, session)
        self._now = now
        self._buses: dict[str, _Bus] = {}
        self._protocols: dict[str, list[BusProtocol]] = {}
        self._files = NumberedFiles(path, keep)
        self._part = self._finished = self._carried = 0
        self._asked = self._closed = False
        self._began: int | None = None
        self._failure: str | None = None
        self._open = OpenIncidents()
        self._published: dict[str, int] = {}
        self._old: McapSink | None = None
        self._ending: Iterator[None] = iter(())
        numbered = rotate_bytes is not None or rotate_ns is not None
        if numbered and not overwrite:
            self._files.refuse_others()
        self._number = 1
        self.path = self._files.of(1) if numbered else path
        """The file that is being written."""
        self._sink = self._begin(self.path, {}, {})

    @property
    def rotates(self) -> bool:
        """Tell whether new files begin by themselves."""
        return self._rotate_bytes is not None or self._rotate_ns is not None

    @property
    def size(self) -> int:
        """Bytes written, all files together."""
        ending = self._old.size if self._old is not None else 0
        return self._finished + ending + self._sink.size

    @property
    def deleted(self) -> tuple[Path, ...]:
        """The files that somebody has deleted while they were written."""
        return self._files.deleted

    @property
    def files(self) -> tuple[Path, ...]:
        """The files of this recording that are kept, the current one last."""
        return self._files.kept

    @property
    def remarks(self) -> list[str]:
        """What should be told of the joints in it."""
        return [] if self._joints is None else self._joints.told()

    @property
    def is_lost(self) -> bool:
        """Tell whether the current file is no more under its name."""
        return self._files.is_lost

    def rotate(self) -> None:
        """Ask for a new file; a signal handler may do so."""
        self._asked = True

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks as they came, before they are decoded."""
        self._check()
        if not chunks:
            return
        self._began = self._now() if self._began is None else self._began
        state = self._buses.setdefault(bus, _Bus())
        for chunk in chunks:
            state.kept.append((state.end, chunk))
            state.end += len(chunk.data)
        self._sink.raw(bus, chunks)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided; the chunks it was decoded from were taken before."""
        self.write_together(bus, [(protocol, batch)])

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Take what several protocols said in one pass."""
        self._check()
        self._protocols[bus] = [protocol for protocol, _ in parts]
        self._sink.write_together(bus, parts)

    def tuned(self, bus: str, rate: Rate) -> None:
        """Take the rate that was found for a bus; files that follow say so, too."""
        self._check()
        self._session.update((f"{key}.{bus}", value) for key, value in rate.facts().items())
        self._sink.tuned(bus, rate)

    def incidents(self, changes: Sequence[IncidentChange]) -> None:
        """Take what has become of incidents; a new file begins with those that are open."""
        self._check()
        self._open.take(changes)
        self._sink.incidents(changes)

    def turn(self, decided: Mapping[str, int]) -> None:
        """Learn up to which offset each bus is decoded; here a new file may begin.

        A bus that is not named counts as decided up to its last byte.
        """
        self._check()
        if self._sink.is_deleted and self._files.lost(self.path):
            self._asked = True  # what comes from now on goes where it can be found
        places = {
            bus: min(max(decided.get(bus, b.end), b.begin), b.end) for bus, b in self._buses.items()
        }
        if self._due(self._now()):
            self._change(places)
        for bus, state in self._buses.items():
            del state.kept[: bisect_right(state.kept, places[bus], key=_end)]

    def flush(self) -> None:
        """Write what waits: raw bytes at once, what was decoded in time."""
        self._check()
        self._sink.flush()
        self._end_old(STEP_NS)

    def close(self) -> None:
        """Finish the file; after a failure everything is left as it is."""
        if self._closed:
            return
        self._closed = True
        if self._failure is None:
            try:
                self._end_old()
            finally:
                self._sink.close()

    def _check(self) -> None:
        if self._failure is not None or self._closed:
            raise OutputError(self._failure or f"{self.path} is closed")

    def _due(self, now: int) -> bool:
        """Tell whether the file has reached a limit; one without bytes never has."""
        if self._asked or self._began is None:
            return self._asked
        size = self._sink.size - self._carried
        full = self._rotate_bytes is not None and size >= self._rotate_bytes
        return full or (self._rotate_ns is not None and now - self._began >= self._rotate_ns)

    def _change(self, places: Mapping[str, int]) -> None:
        """Go on in a new file, and end the current one at ``places``."""
        old, ends = self._sink, dict[str, str]()
        undecided: dict[str, list[Placed]] = {}
        for bus, state in self._buses.items():
            ends[f"{OFFSET}.{bus}"] = str(places[bus])
            undecided[bus], t_ns = behind(state.kept, places[bus], self._byte_ns(bus))
            if t_ns is not None:
                ends[f"{TIME}.{bus}"] = str(t_ns)
        self._end_old()
        try:
            # no file follows one that has not got all before it: that would be a hole
            old.flush()
            path = self._next_path()
            self._sink = self._begin(path, places, undecided)
        except OutputError as error:
            self._fail(error)
        self.path = path
        self._sink.incidents(self._open.changes)
        self._asked, self._began = False, None
        for bus, placed in undecided.items():
            self._buses[bus].kept = placed
        self._old, self._ending = old, old.closing(ends)
        self._end_old(STEP_NS)

    def _end_old(self, most_ns: int | None = None) -> None:
        """Go on ending the file before the current one, in ``most_ns`` where that is given."""
        if self._old is None:
            return
        began = time.monotonic_ns()
        failure: OutputError | None = None
        try:
            for _ in self._ending:
                if most_ns is not None and time.monotonic_ns() - began >= most_ns:
                    return
        except OutputError as error:
            failure = error
        self._finished += self._old.size
        self._old = None
        self._files.drop_oldest()
        if failure is not None:
            self._fail(failure)

    def _fail(self, error: OutputError) -> None:
        """Finish the current file and refuse everything else."""
        self._failure = Sentence("{why}", why=error)
        for ending in (self._ending, self._sink.closing({})):
            with contextlib.suppress(OutputError):
                for _ in ending:
                    pass
        raise OutputError(self._failure) from None

    def _begin(
        self, path: Path, starts: Mapping[str, int], undecided: Mapping[str, Sequence[Placed]]
    ) -> McapSink:
        """Begin a file with what was undecided; where that fails, nothing of it is left."""
        from sniffer.mcapfile.sink import McapSink  # the mcap library is loaded when it is needed

        facts = {**self._session, "part": str(self._part + 1)}
        if self._files.latest is not None:
            facts["previous"] = self._files.latest.name
        facts.update((f"protocol.{bus}", joined(p)) for bus, p in self._protocols.items())
        was_there = path.exists()
        try:
            sink = McapSink(
                path,
                facts,
                flush_ns=self._flush_ns,
                overwrite=self._overwrite,
                live=True,
                durable=self._durable,
                topics=self._topics,
                starts=starts,
                joints=self._joints,
                published=self._published,
            )
            empty = sink.size
            for bus, placed in undecided.items():
                if placed:
                    sink.raw(bus, [chunk for _, chunk in placed])
            sink.flush()
        except OutputError:
            if not was_there:
                with contextlib.suppress(OSError):
                    path.unlink()
            raise
        self._carried = sink.size - empty
        self._part += 1
        self._files.began(path)
        return sink

    def _byte_ns(self, bus: str) -> int:
        """Return how long a byte of a bus takes, 0 where nobody knows."""
        baud = self._session.get(f"baud.{bus}", self._session.get("baud", ""))
        rate, protocols = number_in(baud, *BAUDS), self._protocols.get(bus)
        if rate is None and protocols:
            rate = protocols[0].baud
        return 0 if rate is None else byte_time_ns(rate)

    def _next_path(self) -> Path:
        self._number += 1
        if not self._overwrite:
            self._number = self._files.free(self._number)
        return self._files.of(self._number)


def _end(placed: Placed) -> int:
    return placed[0] + len(placed[1].data)
