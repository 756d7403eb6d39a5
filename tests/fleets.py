"""Data sets made of captures, and captures that hold up or end whoever decodes them."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self

import sniffer
from sniffer.fleet.rows import CaptureRow, UndoneError
from sniffer.fleet.task import decode_batch
from tests.commands import talk
from tests.golden import CAPTURES as SAMPLES
from tests.terminals import PATIENCE_S

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from sniffer.fleet.engines import Batch, Outcome

HELD_UP: Final = b"held up"
"""In a capture it has whoever decodes it by the plug-in say so and wait for a gate to be opened."""

DEADLY: Final = b"deadly"
"""In a capture it ends whoever decodes it by the plug-in."""

PLUGIN: Final = """
import os, signal, time
from dataclasses import replace
from pathlib import Path
from sniffer.protocols.mightyzap.grammar import FAMILY
from sniffer.protocols.packets import Member

PROTOCOL = Member(replace(FAMILY, name="perilous"))
HERE = Path(__file__).parent
framed = PROTOCOL.frame

def frame(block):
    data = bytes(block.data)
    if {deadly!r} in data:
        os.kill(os.getpid(), signal.SIGKILL)
    if {held_up!r} in data:
        (HERE / f"{{os.getpid()}}.pid").touch()
        while not (HERE / "gate").exists():
            time.sleep(0.01)
    return framed(block)

PROTOCOL.frame, PROTOCOL.auto = frame, False
"""


class Peril:
    """A protocol whose captures may hold up or end the process that decodes them."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.folder = folder
        self.protocol = folder / "perilous.py"
        self.protocol.write_text(PLUGIN.format(deadly=DEADLY, held_up=HELD_UP), encoding="utf-8")
        self._met: set[int] = set()

    def held_up(self) -> int:
        """Wait until another process is held up; return its id."""
        return eventually(lambda: next(iter(self._waiting()), None))

    def _waiting(self) -> Iterator[int]:
        for file in self.folder.glob("*.pid"):
            if (pid := int(file.stem)) not in self._met:
                self._met.add(pid)
                yield pid

    def open(self) -> None:
        """Hold nobody up any more."""
        (self.folder / "gate").touch()


def eventually(found: Callable[[], int | None]) -> int:
    """Wait until something is found."""
    until = time.monotonic() + PATIENCE_S
    while (what := found()) is None:
        assert time.monotonic() < until, "nothing came of it"
        time.sleep(0.01)
    return what


def is_running(pid: int) -> bool:
    """Tell whether a process is there, and no corpse."""
    with contextlib.suppress(OSError):
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
        return state not in "ZX"
    return False


def parent(pid: int) -> int:
    """Return the process that has begun another one."""
    told = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
    return int(told.rpartition(")")[2].split()[1])


def descendants(pid: int) -> set[int]:
    """Return the processes that a process has begun, and those that they have."""
    out: set[int] = set()
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, task.read_text(encoding="ascii").split()):
            out |= {child} | descendants(child)
    return out


class Serial:
    """An engine that decodes here, one capture after the other."""

    def run(self, batches: Iterable[Batch]) -> Iterator[Outcome]:
        for batch in batches:
            try:
                yield batch, decode_batch(batch)
            except UndoneError as error:
                yield batch, error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return


def serial(inputs: Path | str, dataset: Path | str, **options: Any) -> sniffer.FleetRun:
    """Decode captures here, one after the other."""
    return sniffer.decode_fleet([inputs], dataset, engine=Serial(), **options)


def captures(folder: Path) -> Path:
    """Write captures of two robots: of several protocols, with times and without."""
    for nth, name in enumerate(("lss_damaged.log", "wck_clean.log", "mightyzap_manual.hex")):
        robot = folder / f"robot=r{nth % 2}"
        robot.mkdir(parents=True, exist_ok=True)
        shutil.copy(SAMPLES / name, robot)
    return folder


def talks(folder: Path, *marks: bytes) -> Path:
    """Write captures of mightyZAP's talk, each with a mark in its midst."""
    folder.mkdir(parents=True, exist_ok=True)
    for nth, mark in enumerate(marks):
        (folder / f"{nth}.bin").write_bytes(talk(8, nth) + mark + talk(8, nth + 100))
    return folder


def content(dataset: Path) -> dict[str, str]:
    """Return what a data set holds: digests of its tables by path, its commits without times."""
    out: dict[str, str] = {}
    for path in sorted(dataset.rglob("*")):
        name = path.relative_to(dataset).as_posix()
        if path.is_dir() or name == "captures.parquet":
            continue
        if name.startswith("_done/"):
            row = CaptureRow.from_json(path.read_text(encoding="utf-8"))
            out[name] = repr({k: getattr(row, k) for k in row.__slots__ if k != "seconds"})
        else:
            out[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    return out


def end(pid: int) -> None:
    """Kill a process."""
    os.kill(pid, 9)
