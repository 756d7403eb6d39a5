"""A question, the one command that answers it, and what is true by the rows of the capture."""

from __future__ import annotations

import functools
import json
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from sniffer.simulation import Fault, simulate
from sniffer.simulation import faults as f
from sniffer.simulation.render import candump, frame_reads
from tests.commands import Ran, within
from tests.commands import sniffer as process
from tests.golden import CAPTURES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import pytest

Row = dict[str, Any]
Rows = list[Row]

SECONDS: Final = 12
START_NS: Final = 1_795_215_306_000_000_000
PROTOCOLS: Final = ("mightyzap", "wck", "rs30x", "lss")
HOT: Final = {"mightyzap", "rs30x"}
"""Whose servos tell a temperature and protect themselves."""

LOUD: Final = (Fault(f.DROP, 0.03, 2), Fault(f.DROP, 0.005), Fault(f.FLIP, 0.003))
LATE: Final = (Fault(f.LATE, 0.004), Fault(f.NOISE, 0.003))


@dataclass(frozen=True)
class Capture:
    """A capture, and what is in it by its rows: ``decode --format jsonl`` of all of it."""

    path: Path

    @functools.cached_property
    def rows(self) -> Rows:
        ran = process("decode", self.path, "--format", "jsonl")
        assert ran.status == 0, ran.err
        return [json.loads(line) for line in ran.out.splitlines()]

    def of(self, type_: str, /, **has: Any) -> Rows:
        """Return the rows of a type that have these values."""
        mine = [r for r in self.rows if r["type"] == type_]
        return [r for r in mine if all(r.get(k) == v for k, v in has.items())]

    @functools.cached_property
    def in_order(self) -> Rows:
        """The frames and gaps as they stand in the capture."""
        return sorted([*self.of("frame"), *self.of("gap")], key=lambda r: int(r["offset"]))

    @functools.cached_property
    def servo(self) -> int:
        """The servo that is asked most."""
        asked = Counter(r["servo_id"] for r in self.of("transaction") if r["outcome"] == "ok")
        return int(asked.most_common(1)[0][0])

    @functools.cached_property
    def poll(self) -> str:
        """The command by which it is asked."""
        asked = Counter(r["op"] for r in self.of("transaction", servo_id=self.servo, outcome="ok"))
        return str(asked.most_common(1)[0][0])

    @functools.cached_property
    def write(self) -> str:
        """The command that writes to it most."""
        mine = {r["offset"] for r in self.of("sample", role="commanded", servo_id=self.servo)}
        asked = Counter(
            r["op"]
            for r in self.of("frame", kind="request", servo_id=self.servo)
            if r["offset"] in mine
        )
        return str(asked.most_common(1)[0][0])

    @functools.cached_property
    def first_error(self) -> Row:
        return next(r for r in self.rows if r["type"] == "anomaly" and r["severity"] == "error")


@functools.cache
def sample(name: str) -> Capture:
    return Capture(CAPTURES / name)


@functools.cache
def simulated(protocol: str, folder: Path) -> Capture:
    """Return a bus on which answers get lost, frames are altered, and motors grow hot."""
    hot = (Fault(f.OVERHEAT, 1.0, 1, 4.0),) if protocol in HOT else ()
    frames = simulate(
        protocol,
        seed=7,
        duration_s=SECONDS,
        start_ns=START_NS,
        faults=(*LOUD, *(() if protocol == "lss" else LATE), *hot),
    )
    path = folder / f"{protocol}.log"
    path.write_text(candump(frame_reads(list(frames))))
    return Capture(path)


NAMES: Final = (
    *(f"{protocol}_damaged.log" for protocol in PROTOCOLS),
    *(f"{protocol} simulated" for protocol in PROTOCOLS),
)


_HELP: Final[dict[tuple[str, ...], str]] = {}
"""The help that was read already: it says the same to every question."""


class Asker:
    """Whoever asks: takes commands from ``--help``, and runs them."""

    def __init__(self, capsys: pytest.CaptureFixture[str], folder: Path) -> None:
        self._capsys = capsys
        self.folder = folder

    def ask(self, *command: str | Path, led_by: str = "") -> Ran:
        """Run a command that the help names, with each of its options and the words of who asks."""
        overview = self._help()
        assert f"\n  {command[0]} " in overview
        told = " ".join(self._help(str(command[0])).split())
        known = overview + told
        for word in command:
            if isinstance(word, str) and word.startswith("--"):
                assert word in told, f"{command[0]} --help does not name {word}"
        for word in led_by.split():
            assert word.lower() in known.lower(), f"{command[0]} --help does not say {word!r}"
        return within(self._capsys, *command)

    def _help(self, *command: str) -> str:
        if command not in _HELP:
            _HELP[command] = within(self._capsys, *command, "--help").out
        return _HELP[command]

    def rows(self, *command: str | Path, led_by: str = "") -> Rows:
        """Return what it answers, a JSON object a line."""
        ran = self.ask(*command, led_by=led_by)
        assert ran.status == 0, ran.err
        return [json.loads(line) for line in ran.out.splitlines()]

    def bus(self, *command: str | Path, led_by: str = "") -> Row:
        """Return what ``stats`` tells of the only bus."""
        (told,) = self.rows("stats", *command, "--format", "json", led_by=led_by)
        (bus,) = told["buses"]
        return dict(bus)


def frames(rows: Rows) -> list[tuple[int, str]]:
    """Return offset and bytes of the frames among rows."""
    return [(r["offset"], r["hex"]) for r in rows if r["type"] == "frame"]


def each(rows: Rows, key: Callable[[Row], Any]) -> Iterator[tuple[Any, Rows]]:
    """Yield rows by what they have in common."""
    for value in dict.fromkeys(map(key, rows)):
        yield value, [r for r in rows if key(r) == value]
