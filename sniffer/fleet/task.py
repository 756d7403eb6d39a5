"""The work on one capture: decoded, its tables put into the data set, and then its commit.

It depends on nothing but the task and the capture, and tells nobody but by its row. So it may run
in any process of any machine, be killed, and run again, also twice at the same time: what it writes
is the same each time, and it counts when the commit is there.
"""

from __future__ import annotations

import contextlib
import datetime
import functools
import hashlib
import json
import shutil
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sniffer.fleet.dataset import commit, table_path
from sniffer.fleet.recipe import read_recipe
from sniffer.fleet.rows import (
    CRASHED,
    DAMAGED,
    FAILED,
    OK,
    CaptureRow,
    CaptureTask,
    UndividedError,
    UndoneError,
)
from sniffer.fleet.store import SENT_AT_ONCE, Store
from sniffer.fleet.tables import TABLES, CaptureTables
from sniffer.ground.limits import DATED_NS, TIME_END_NS
from sniffer.ground.model import NS, OutputError, SnifferError
from sniffer.ground.naming import worded
from sniffer.ground.wording import one_line
from sniffer.jobs.asked import Extract
from sniffer.jobs.crew import LostWorkerError
from sniffer.jobs.parts import decode_in_parts
from sniffer.jobs.session import Ending, run_source
from sniffer.jobs.telling import Teller
from sniffer.sources import open_source
from sniffer.sources.stretches import stretches_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sniffer.decoding.options import Options
    from sniffer.decoding.summary import Summary
    from sniffer.fleet.tables import TableFile

ID: Final = 16
"""Hexadecimal digits of a capture's id: of a million captures none meets another (1 in 10^7)."""

COPIES: Final = 3
"""How often a capture is copied that is changed meanwhile."""

_MACHINE: Final = (OSError, MemoryError)
"""What a machine, not a capture, is to blame for."""


def decode_capture(task: CaptureTask, jobs: int = 1) -> CaptureRow:
    """Decode a capture into its data set; return what became of it, which is committed.

    What is wrong with the capture is in the row. Several ``jobs`` decode it together, by processes
    of their own, with the same result to the byte.

    Raises:
        UndividedError: several processes cannot decode it: nothing is committed, nor here below.
        LostWorkerError: one of them was killed again and again.
        UndoneError: the machine could not (disk, memory, network): nothing is committed.
        KeyboardInterrupt: it was interrupted: nothing is committed.
    """
    (row,) = _committed([task], jobs)
    return row


def decode_batch(tasks: Sequence[CaptureTask]) -> list[CaptureRow]:
    """Decode captures of one data set one after the other.

    Raises:
        UndoneError: one of them was not done; those before it are.
        KeyboardInterrupt: it was interrupted.
    """
    return _committed(tasks)


def _committed(tasks: Sequence[CaptureTask], jobs: int = 1) -> list[CaptureRow]:
    """Decode captures and commit each, from one folder: to make one takes as long as a file."""
    out: list[CaptureRow] = []
    task = tasks[0]
    try:
        store = Store.of(task.dataset)
        with store.staging() as folder:
            for task in tasks:
                began = time.monotonic()
                row = _decoded(task, store, folder, jobs)
                row = replace(row, seconds=round(time.monotonic() - began, 3))
                with _putting(task):
                    commit(store, row, folder)
                store.empty(folder)
                out.append(row)
    except _MACHINE as error:
        raise _undone(task, error) from error
    return out


def commit_crashed(task: CaptureTask, why: str) -> CaptureRow:
    """Commit that a capture ends whoever decodes it; every run tries it again.

    Raises:
        OSError: that cannot be written.
    """
    row = replace(_blank(task), status=CRASHED, error=why)
    commit(Store.of(task.dataset), row)
    return row


def _blank(task: CaptureTask) -> CaptureRow:
    return CaptureRow(
        path=task.path,
        robot=task.robot,
        date=_day(task.mtime_ns),
        bytes=task.size,
        decoder=task.decoder,
        fingerprint=task.fingerprint,
        capture=task.fingerprint[:ID],
        status=FAILED,
    )


def _decoded(task: CaptureTask, store: Store, folder: Path, jobs: int) -> CaptureRow:
    """Decode a capture and put its tables into the data set.

    One that is changed meanwhile would have tables that are not those of its id. It is copied, and
    the copy is decoded: of a file that grows what was there then, as a whole. The next run sees
    that it is another file, and decodes it again.
    """
    try:
        source = _fetched(task, folder)
        before = _state(source)
        content = _content(source)
    except (FileNotFoundError, PermissionError) as error:
        why = f"{task.path}: cannot be read ({error.strerror})"
        return replace(_blank(task), error=why)
    row, tables = _tabled(task, content, source, folder, jobs)
    if _state(source) not in (before, None):  # one that is gone was read to its end
        store.empty(folder)
        source = Path(shutil.copy2(source, folder))
        row, tables = _tabled(task, _content(source), source, folder, 1)
    files = []
    for table, stretch, file in tables:
        path = table_path(table, row.robot, row.date, row.capture, row.decoder, stretch)
        with _putting(task):
            store.put(path, file)
        files.append(path)
    return replace(row, files=tuple(files))


def _fetched(task: CaptureTask, folder: Path) -> Path:
    """Return a capture as a file of this machine, a copy unless it is here.

    Raises:
        OSError: it cannot be read.
        UndoneError: it is changed in its store faster than it can be copied.
    """
    store = Store.of(task.uri)
    if store.is_local:
        return store.fetch("", folder)
    if task.size <= SENT_AT_ONCE:
        source = store.fetch("", folder)
        if source.stat().st_size <= SENT_AT_ONCE:  # what came with one request is of one time
            return source
    for _ in range(COPIES):
        before = store.itself()
        source = store.fetch("", folder)
        if store.itself() == before:
            return source
    raise UndoneError(f"{task.path}: it is changed again and again while it is copied")


def _state(source: Path) -> tuple[int, ...] | None:
    """Return what changes when a file does; None: it is not there."""
    try:
        told = source.stat()
    except FileNotFoundError:
        return None
    return told.st_dev, told.st_ino, told.st_size, told.st_mtime_ns


class _Content(NamedTuple):
    """What a file holds: its digest, and how many bytes."""

    sha256: str
    size: int


def _content(source: Path) -> _Content:
    with source.open("rb") as data:
        return _Content(hashlib.file_digest(data, "sha256").hexdigest(), data.tell())


def _tabled(
    task: CaptureTask, content: _Content, source: Path, folder: Path, jobs: int
) -> tuple[CaptureRow, Sequence[TableFile]]:
    """Decode a file; return the row of the capture, and its tables, which are in the folder."""
    task = replace(task, size=content.size)  # it may have grown since it was found
    sha256 = content.sha256
    row = replace(_blank(task), sha256=sha256, capture=sha256[:ID])
    tables = CaptureTables(folder, row.capture, in_stretches=task.is_huge)
    try:
        heard = _heard(task, source, tables, jobs)
    except (*_MACHINE, UndoneError, UndividedError, LostWorkerError):
        raise
    except Exception as error:
        if isinstance(error, OutputError) and isinstance(error.__cause__, _MACHINE):
            raise error.__cause__ from None
        known = isinstance(error, SnifferError)
        told = worded(error) if known else f"{type(error).__name__}: {error}"
        return replace(row, error=one_line(told.replace(str(source), task.path))), ()
    if heard.is_mistaken:
        return replace(row, error=one_line(heard.damage)), ()
    row = replace(_totalled(row, heard.summary, task.mtime_ns), status=OK)
    if heard.damage:
        told = one_line(heard.damage.replace(str(source), task.path))
        is_any = heard.summary.as_dict()["frames"] or row.bytes_in_gaps
        row = replace(row, status=DAMAGED if is_any else FAILED, error=told)
    counts: dict[str, Any] = {table: tables.rows(table) for table in TABLES}
    return replace(row, **counts), tables.files


@dataclass(frozen=True, slots=True)
class _Decoded:
    """What was heard of a capture; ``damage`` says what is wrong with it, empty: nothing.

    ``is_mistaken``: it speaks another protocol than was said.
    """

    summary: Summary
    damage: str
    is_mistaken: bool


def _heard(task: CaptureTask, file: Path, tables: CaptureTables, jobs: int) -> _Decoded:
    options, selection, input_format = read_recipe(task.recipe)
    told: list[str] = []
    damage: list[str] = []
    with open_source(file, input_format, wiring=options.wired) as opened:
        told_options: Options = options.with_facts(opened.facts(), opened.tables)
        plan = stretches_of(opened, task.sizes, jobs) if task.is_huge else ""
        if isinstance(plan, str) and jobs > 1:
            raise UndividedError(plan)
        run: Callable[..., tuple[Summary, Ending]] = functools.partial(run_source, lags=True)
        if not isinstance(plan, str):
            run = functools.partial(
                decode_in_parts, jobs=jobs, plan=plan, sizes=task.sizes, folder=tables.folder
            )
        summary, ending = run(
            opened,
            told_options,
            [tables],
            name=opened.name,
            tell=Teller(told.append, quiet=True),
            on_break=damage.append,
            asked=Extract.of(selection, None),
        )
    if ending == Ending.INTERRUPTED:
        raise KeyboardInterrupt
    mistaken = ending == Ending.MISTAKEN
    why = "; ".join(map(worded, told if mistaken else damage))
    return _Decoded(summary, why, mistaken)


def _totalled(row: CaptureRow, summary: Summary, mtime_ns: int) -> CaptureRow:
    total = summary.as_dict()
    timed = [bus for bus in summary.buses.values() if bus.clock != "none"]
    first = min((b.heard.first_ns for b in timed if b.heard.first_ns is not None), default=None)
    last = max((b.heard.last_ns for b in timed if b.heard.last_ns is not None), default=None)
    is_dated = first is not None and first >= DATED_NS
    return replace(
        row,
        date=_day(first if first is not None and is_dated else mtime_ns),
        date_from="stamp" if is_dated else "mtime",
        buses=tuple(summary.buses),
        protocols=tuple(sorted({bus.protocol for bus in summary.buses.values()})),
        t_first_ns=first,
        t_last_ns=last,
        errors=total["severities"].get("error", 0),
        bytes_in_gaps=total["bytes_in_gaps"],
        summary=json.dumps(total, sort_keys=True),
    )


def _day(t_ns: int) -> str:
    t_ns = min(max(t_ns, 0), TIME_END_NS)  # a file may be of any time
    return datetime.datetime.fromtimestamp(t_ns // NS, datetime.UTC).date().isoformat()


@contextlib.contextmanager
def _putting(task: CaptureTask) -> Iterator[None]:
    """Blame the data set, not the capture, for what cannot be put there."""
    try:
        yield
    except OSError as error:
        why = error.strerror or error
        told = f"{task.dataset}: cannot be written ({why})"
        raise UndoneError(told, error.errno or 0) from error


def _undone(task: CaptureTask, error: OSError | MemoryError) -> UndoneError:
    if isinstance(error, MemoryError):
        return UndoneError(f"{task.path}: there is not enough memory for it")
    return UndoneError(f"{task.path}: {error.strerror or error}", error.errno or 0)
