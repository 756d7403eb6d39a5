"""What is wrong with the buses, and why, while they are recorded: beside the recording.

A thread keeps the ledgers and judges them about once a second, or every seven where nobody
looks; whoever records only hands over what was decoded. Nothing waits for it: what it has no time
for is left out and counted.
"""

from __future__ import annotations

import importlib
import threading
import time
from collections import deque
from dataclasses import replace
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.anomalies.found import SEVERITY, Anomalies
from sniffer.decoding.joining import joined, runs
from sniffer.diagnosis.diagnosis import Diagnosis
from sniffer.diagnosis.incidents import incidents
from sniffer.diagnosis.tracking import Tracker
from sniffer.ground.model import Severity

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.tracking import IncidentChange, Tracked
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol

EVERY_S: Final = 0.5
"""How often what was decoded is taken into the ledgers, in seconds: all of that time in one go."""

UNSEEN_S: Final = 2.0
"""The same where nobody looks at incidents before they are in the file."""

JUDGED: Final = 2
UNSEEN_JUDGED: Final = 4
"""How many times as long it is until a bus is judged again, at least: where somebody looks, and
where nobody does. Where nothing was wrong and now something is, it is judged at once."""

SHARES: Final = (0.2, 0.03)
UNSEEN_SHARES: Final = (0.02, 0.01)
"""Share of the time that judging all buses may take, where somebody looks and where nobody does:
of those on which something was wrong since they were judged last, and of the others."""

_WORSE: Final = np.array([severity > Severity.NOTE for severity in SEVERITY])
"""Codes that are worse than a note, by their numbers."""

END_S: Final = 3.0
"""How long the end of a recording waits for its buses to be judged; many of them were just now."""

MOST: Final = 8 << 20
"""Bytes of the buses that wait here at most."""


class _Judged(NamedTuple):
    """When a bus was judged last, for how long if all take as long, and whether it had news."""

    began_s: float
    took_s: float
    had_news: bool


class Diagnosing:
    """A sink beside a recording. Use ``start`` once, and ``finish`` at the end.

    Args:
        now: the time, on the clock of the buses, in ns.
        is_followed: whether somebody looks at incidents before they are in the file.
    """

    def __init__(self, now: Callable[[], int], *, is_followed: bool = True) -> None:
        self.left_out = 0
        """Bytes whose records were left out: there was no time for them."""
        self.failure: Exception | None = None
        """What ended it although it should not have; the recording goes on without it."""
        self._now = now
        self._is_followed = is_followed
        self._every_s = EVERY_S if is_followed else UNSEEN_S
        self._shares = SHARES if is_followed else UNSEEN_SHARES
        self._pause_s = ((JUDGED if is_followed else UNSEEN_JUDGED) - 0.5) * self._every_s
        self._diagnosis = Diagnosis()
        self._tracker = Tracker()
        self._waiting: deque[tuple[str, BusProtocol, Batch]] = deque()
        self._given = self._taken = 0  # bytes; each is counted up by one thread alone
        self._changes: deque[IncidentChange] = deque()
        self._known: tuple[Tracked, ...] = ()
        self._news: set[tuple[str, str]] = set()
        self._judged: dict[tuple[str, str], _Judged] = {}
        self._first_s = 0.0 if is_followed else self._pause_s
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="diagnosis", daemon=True)

    def start(self) -> None:
        """Begin to judge; what tells of incidents is loaded now: later, bytes would wait for it."""
        importlib.import_module("sniffer.diagnosis.stories")
        self._thread.start()

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing: all that matters comes decoded."""

    def pace(self, bus: str, told: Pace) -> None:
        """Take what a bus is timed by; it comes before the bus's first batch."""
        self._diagnosis.pace(bus, told)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided."""
        if self._given - self._taken > MOST or self.failure is not None:
            self.left_out += len(batch.data)
            return
        self._given += len(batch.data)
        self._waiting.append((bus, protocol, batch))

    def close(self) -> None:
        """Do nothing: ``finish`` ends it."""

    def take(self) -> list[IncidentChange]:
        """Return what has become of incidents since the last call."""
        return [self._changes.popleft() for _ in range(len(self._changes))]

    def known(self) -> tuple[Tracked, ...]:
        """Return all incidents that are known now."""
        return self._known

    def finish(self) -> None:
        """Judge all that was decoded, once more and at last."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        if self.failure is None:
            self._guarded(self._last)

    def _run(self) -> None:
        while not self._stop.wait(self._every_s) and self.failure is None:
            self._guarded(self._round)

    def _guarded(self, what: Callable[[], None]) -> None:
        try:
            what()
        except Exception as error:
            self.failure = error

    def _round(self) -> None:
        self._take_in()
        for case in self._diagnosis.cases():
            key = case.bus, case.protocol.name
            now = time.monotonic()
            if key not in self._judged:
                self._judged[key] = _Judged(now + self._first_s - self._pause_s, 0.0, had_news=True)
            if now >= self._due(key):
                self._judge(case, key)
            if self._stop.is_set():
                return

    def _last(self) -> None:
        """Judge all buses once more, those first on which something is wrong, as time allows."""
        self._take_in()
        until = time.monotonic() + END_S
        keys = {(case.bus, case.protocol.name): case for case in self._diagnosis.cases()}
        for key in sorted(keys, key=lambda key: key not in self._news):
            self._judge(keys[key], key)
            if time.monotonic() > until:
                break
        self._changes += self._tracker.end(self._now())

    def _take_in(self) -> None:
        """Take what waits into the ledgers, all of a bus at once."""
        each: dict[tuple[str, str], tuple[BusProtocol, list[Batch]]] = {}
        for _ in range(len(self._waiting)):
            bus, protocol, batch = self._waiting.popleft()
            self._taken += len(batch.data)
            each.setdefault((bus, protocol.name), (protocol, []))[1].append(batch)
        for key, (protocol, batches) in each.items():
            for run in runs(batches):
                batch = joined(run)
                self._diagnosis.write(key[0], protocol, batch)
                if _WORSE[Anomalies.of(batch.anomalies).code].any():
                    self._news.add(key)

    def _judge(self, case: Case, key: tuple[str, str]) -> None:
        began = time.monotonic()
        name = ".".join(key)
        self._changes += self._tracker.update(name, incidents(case), self._now())
        self._known = tuple(replace(one) for one in self._tracker.now())
        took = (time.monotonic() - began) * max(len(self._judged), 1)
        self._judged[key] = _Judged(began, took, had_news=key in self._news)
        self._news.discard(key)

    def _due(self, key: tuple[str, str]) -> float:
        """Return when a bus is to be judged again: sooner if something is wrong since."""
        last, is_news = self._judged[key], key in self._news
        at_once = self._is_followed and is_news and not last.had_news
        pause = 0.0 if at_once else self._pause_s
        return last.began_s + max(pause, last.took_s / self._shares[not is_news])
