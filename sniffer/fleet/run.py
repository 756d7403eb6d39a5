"""``sniffer.decode_fleet``: many captures become one data set; what ``sniffer fleet`` calls."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from sniffer.decoding.options import Options
from sniffer.fleet import rows
from sniffer.fleet.engines import cores, engine_named
from sniffer.fleet.progress import FleetProgress
from sniffer.fleet.rows import (
    CRASHED,
    FAILED,
    CaptureTask,
    UndoneError,
    WorkerDiedError,
)
from sniffer.ground.model import InputError, OutputError, SnifferError
from sniffer.ground.needs import need_pyarrow
from sniffer.ground.wording import Sentence, as_text, counted
from sniffer.jobs.telling import Teller
from sniffer.sources.several import inputs_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence
    from pathlib import Path

    from sniffer.fleet.dataset import CaptureList, Withdrawal
    from sniffer.fleet.engines import Batch, Engine
    from sniffer.fleet.inputs import FoundCapture
    from sniffer.fleet.rows import CaptureRow
    from sniffer.fleet.store import Store
    from sniffer.selection.selection import Selection

ROBOT: Final = r"robot=([^/]+)"
"""Whose a capture is, where nothing else is said: a folder ``robot=r07`` on its path."""

UNKNOWN: Final = "unknown"
"""The robot of a capture whose path names none."""

DIGITS: Final = 24
"""Hexadecimal digits of a fingerprint: 96 bits, so that no two captures of any fleet meet."""

BATCH_BYTES: Final = 8_000_000
"""Captures of so many bytes together are one batch: some 2 s of work, more than handing it out."""

SHARES: Final = 4
"""Batches that each worker has at least, where there are captures enough: none waits for long."""

BATCH_CAPTURES: Final = 64
"""Captures of a batch at most: small ones take some 10 ms each, however small they are."""

FULL: Final = frozenset({errno.ENOSPC, errno.EDQUOT})
"""There is no room: whoever makes some goes on with the same command."""

HOPELESS: Final = FULL | {errno.EROFS}
"""What no other capture would fare better with: no room, or nothing may be written."""


@dataclass(frozen=True, slots=True)
class FleetRun:
    """What a run did: the captures it was to see to, and what became of them.

    ``skipped`` were done before. ``statuses`` counts by status those that are in the data set now.
    ``undone`` are the places of those that are not, ``reasons`` what was said of some.
    ``troubles`` has a sentence for each of those decoded now that were not read to their end.
    ``bytes`` are those of the files decoded, ``seconds`` is how long it all took.
    """

    captures: int
    decoded: int
    skipped: int
    statuses: Counter[str]
    undone: tuple[str, ...]
    reasons: tuple[str, ...]
    troubles: tuple[str, ...]
    bytes: int
    seconds: float
    is_interrupted: bool = False

    @property
    def is_whole(self) -> bool:
        """Whether every capture has its row in the data set, whatever its status."""
        return not self.undone and not self.reasons and not self.is_interrupted

    @property
    def failures(self) -> int:
        """How many captures nothing could be read of."""
        return self.statuses[FAILED] + self.statuses[CRASHED]


def decode_fleet(
    inputs: str | Path | Sequence[str | Path],
    dataset: str | Path,
    options: Options | None = None,
    *,
    input_format: str = "auto",
    selection: Selection | None = None,
    robot: str = ROBOT,
    engine: str | Engine = "local",
    workers: int | None = None,
    scheduler: str | None = None,
    shard: tuple[int, int] | None = None,
    retry_failed: bool = False,
    progress: Callable[[FleetProgress], None] = lambda so_far: None,
    tell: Teller | None = None,
) -> FleetRun:
    """Decode captures into one data set of Parquet tables; those that are in it are skipped.

    ``docs/fleet.md`` has the layout. An interruption (KeyboardInterrupt) ends it; what is committed
    stays.

    Args:
        inputs: files, patterns (``*``, ``**``), folders.
        dataset: the folder of the data set, or a URI of an object store.
        options: how captures are decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        selection: which records the tables have; all of them where None.
        robot: a regular expression whose first group is the robot, looked for on a capture's path.
        engine: ``"local"`` or another name of ``sniffer.fleet.engines.ENGINES``, or an engine.
        workers: processes; as many as there are processors where None.
        scheduler: the address of a cluster, for engines that have one.
        shard: ``(i, n)``: only the i-th of n parts of the captures, from 1; n such runs do all.
        retry_failed: captures that failed before are tried again.
        progress: is told how far it is.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: an input is not there, or the data set cannot be read.
        OutputError: the data set cannot be written; pyarrow or the engine's library is missing.
        SnifferError: an argument that cannot be meant.
    """
    began = time.monotonic()
    need_pyarrow()
    from sniffer.fleet.dataset import CaptureList, Withdrawal, hive_folder
    from sniffer.fleet.store import Store

    options = options or Options()
    options.check()
    tell = tell or Teller(lambda line: None, quiet=True)
    chosen = engine_named(engine, workers, scheduler) if isinstance(engine, str) else engine
    if not str(dataset):
        raise OutputError(Sentence("'' names no data set: give {dataset} a folder of its own"))
    store = Store.of(dataset)
    if (within := hive_folder(store.root)) is not None:
        told = "{root}: readers of tables would take {within} for that of each row: give {dataset} "
        told += "a folder that does not lie in it"
        raise OutputError(Sentence(told, root=dataset, within=within))
    inputs = inputs_of(inputs)
    tasks, unread = _tasks(inputs, store, options, selection, input_format, robot, shard, tell)
    try:
        store.probe()
    except OSError as error:
        if error.errno not in FULL:  # of these the run tells at its end
            told = "{root}: cannot be written ({why}): give {dataset} a folder that can be"
            why = error.strerror or error
            raise OutputError(Sentence(told, root=dataset, why=why)) from None
    try:
        store.sweep()
        listed = CaptureList(store)
        withdrawal = Withdrawal(store, listed.known)
        for task in tasks:
            known = listed.known.get(task.fingerprint)
            if known is None:
                continue
            if not known.was_read or (retry_failed and known.status == FAILED):
                withdrawal.take(task.fingerprint)
    except OSError as error:
        raise InputError(f"{dataset}: cannot be read ({error.strerror or error})") from None
    todo = [task for task in tasks if task.fingerprint not in listed.known]
    work = _Work(store, todo, withdrawal, progress, began, reasons=unread)
    work.decode(chosen, batches_of(todo, workers or cores()))
    return work.finished(tasks, listed)


def _tasks(
    inputs: Sequence[str | Path],
    store: Store,
    options: Options,
    selection: Selection | None,
    input_format: str,
    robot: str,
    shard: tuple[int, int] | None,
    tell: Teller,
) -> tuple[list[CaptureTask], list[str]]:
    """Return the captures that this run sees to, the biggest first; what it cannot look into."""
    from sniffer.fleet.inputs import find_captures
    from sniffer.fleet.recipe import decoder_name, write_recipe

    whose = _robot(robot)
    nth, of = shard or (1, 1)
    if not 1 <= nth <= of:
        raise SnifferError(Sentence("{shard}: parts are counted from 1: write 1/4 to 4/4 of four"))
    recipe = write_recipe(options, selection, input_format)
    decoder = decoder_name(recipe)
    try:
        found = find_captures(inputs, store)
    except OSError as error:
        which = error.filename or ", ".join(map(str, inputs))  # an object store names no file
        raise InputError(f"{which}: cannot be read ({error.strerror or error})") from None
    if found.left_out:
        what = counted(found.left_out, "file")
        tell.talk(f"left out {what} of folders, called like no capture: *.log, *.mcap and so on")
    if found.in_dataset:
        what = counted(found.in_dataset, "file")
        tell.talk(f"left out {what} of the data set itself: what lies in it is no capture")
    if found.others:
        what = counted(found.in_others, "file")
        where = found.others[0] if len(found.others) == 1 else f"{len(found.others)} of them"
        tell.talk(f"left out {what} of another data set, {where}: what it is made of is no capture")
    if found.astray:
        what = counted(found.astray, "link")
        tell.talk(f"left out {what} called like captures: where they lead nothing can be read")
    tasks = tasks_of(found.captures, store, recipe, decoder, whose)
    return [t for t in tasks if int(t.fingerprint, 16) % of == nth - 1], found.unread


def tasks_of(
    captures: Iterable[FoundCapture],
    store: Store,
    recipe: str,
    decoder: str,
    whose: Callable[[FoundCapture], str],
) -> list[CaptureTask]:
    """Return what is to be done for captures, the biggest first: nobody waits for one at the end.

    ``whose`` gives a capture's robot.
    """
    dataset = store.root if store.is_local else store.uri
    tasks = []
    for capture in captures:
        robot = whose(capture)
        fingerprint = _fingerprint(capture, robot, decoder)
        place = (capture.uri, capture.size, capture.mtime_ns)
        told = (robot, dataset, recipe, decoder, fingerprint)
        tasks.append(CaptureTask(*place, *told, sizes=rows.HUGE))
    return sorted(tasks, key=lambda task: (-task.size, task.uri))


def _robot(pattern: str) -> Callable[[FoundCapture], str]:
    """Return what tells whose a capture is."""
    try:
        known = re.compile(pattern)
    except re.error as error:
        raise SnifferError(Sentence("{robot}: no regular expression ({why})", why=error)) from None
    if not known.groups:
        told = "{robot}: the robot is what a group in parentheses matches: write 'logs/([^/]+)/'"
        raise SnifferError(Sentence(told))

    def whose(capture: FoundCapture) -> str:
        found = known.search(as_text(capture.uri))
        return (found[1] if found is not None else None) or UNKNOWN

    return whose


def _fingerprint(capture: FoundCapture, robot: str, decoder: str) -> str:
    told = f"{capture.uri}\n{capture.size} {capture.mtime_ns} {decoder}\n{robot}"
    return hashlib.sha256(told.encode("utf-8", "surrogateescape")).hexdigest()[:DIGITS]


def batches_of(tasks: Sequence[CaptureTask], workers: int = 1) -> list[Batch]:
    """Return captures in batches, in their order: big ones alone, small ones together.

    Where there are few they are so small that every worker has some.
    """
    shares = SHARES * workers
    most_bytes = min(BATCH_BYTES, sum(task.size for task in tasks) // shares)
    most = min(BATCH_CAPTURES, -(-len(tasks) // shares))
    out: list[list[CaptureTask]] = []
    held = 0
    for task in tasks:
        if not out or held + task.size > most_bytes or len(out[-1]) >= most:
            out.append([])
            held = 0
        out[-1].append(task)
        held += task.size
    return [tuple(batch) for batch in out]


@dataclass(slots=True)
class _Work:
    """What a run decodes, and what came of it so far."""

    store: Store
    todo: list[CaptureTask]
    withdrawal: Withdrawal
    progress: Callable[[FleetProgress], None]
    began: float
    rows: dict[str, CaptureRow] = field(default_factory=dict)
    bytes: int = 0
    reasons: list[str] = field(default_factory=list)
    is_interrupted: bool = False
    of_bytes: int = 0

    def decode(self, engine: Engine, batches: Sequence[Batch]) -> None:
        """Have all of it decoded, as far as that goes."""
        self.of_bytes = sum(task.size for task in self.todo)
        try:
            with engine:
                for batch, got in engine.run(batches):
                    self._take(batch, got)
        except KeyboardInterrupt:
            self.is_interrupted = True
        except _HopelessError as error:
            self.reasons = [str(error)]
        except UndoneError as error:
            self.reasons.append(str(error))
        except OSError as error:
            self.reasons.append(self._refused(error))

    def _take(self, batch: Batch, got: Sequence[CaptureRow] | BaseException) -> None:
        from sniffer.fleet.task import commit_crashed

        if isinstance(got, WorkerDiedError):
            got = [commit_crashed(task, str(got)) for task in batch]
        if isinstance(got, BaseException):
            if isinstance(got, UndoneError) and got.errno in HOPELESS:
                raise _HopelessError(self._refused(got))
            self.reasons.append(str(got))
            return
        for row in got:
            if row.fingerprint not in self.rows:
                self.bytes += row.bytes
            self.rows[row.fingerprint] = row
            self.withdrawal.replace(row)
        took = time.monotonic() - self.began
        done, of = len(self.rows), len(self.todo)
        self.progress(FleetProgress(done, of, self.bytes, self.of_bytes, took))

    def _refused(self, error: OSError | UndoneError) -> str:
        """Return in a line what a data set that cannot be written to means."""
        why = error.strerror if isinstance(error, OSError) else os.strerror(error.errno)
        return f"{self.store.uri}: cannot be written ({why or error})"

    def finished(self, tasks: Sequence[CaptureTask], listed: CaptureList) -> FleetRun:
        """Tidy up, write the list of captures anew where it is not right; tell what was done."""
        from sniffer.fleet.dataset import committed, read_commits

        new = {task.fingerprint for task in self.todo}
        statuses = Counter(
            listed.known[task.fingerprint].status for task in tasks if task.fingerprint not in new
        )
        there: set[str] = set()
        try:
            self.store.sweep()  # what is broken off takes room that the list may need
            there = committed(self.store)
            for task in tasks:
                if task.fingerprint in there:  # what an earlier run has left, too
                    self.withdrawal.outdate(task.path, task.fingerprint)
            others = read_commits(self.store, (new & there) - self.rows.keys())
            self.rows |= {row.fingerprint: row for row in others}
            if self.rows or committed(self.store) != listed.listed:
                listed.write()
            self.store.sweep()
        except OSError as error:
            self.reasons.append(self._refused(error))
        statuses.update(row.status for row in self.rows.values())
        undone = [
            task.path for task in self.todo if task.fingerprint not in self.rows.keys() | there
        ]
        return FleetRun(
            captures=len(tasks),
            decoded=len(self.rows),
            skipped=len(tasks) - len(self.todo),
            statuses=statuses,
            undone=tuple(undone),
            reasons=tuple(dict.fromkeys(self.reasons)),
            troubles=tuple(sorted(_trouble(row) for row in self.rows.values() if row.error)),
            bytes=sum(row.bytes for row in self.rows.values()),
            seconds=time.monotonic() - self.began,
            is_interrupted=self.is_interrupted,
        )


def _trouble(row: CaptureRow) -> str:
    told = row.error if row.path in row.error else f"{row.path}: {row.error}"
    return f"{row.status}: {told}"


class _HopelessError(OutputError):
    """The data set takes no more."""
