"""Captures of three robots over two weeks, and the data set that is made of them."""

from __future__ import annotations

import datetime
from typing import TYPE_CHECKING, Final, Self

import sniffer
from sniffer.fleet.run import ROBOT
from sniffer.fleet.task import decode_batch
from sniffer.simulation import faults as f
from sniffer.simulation.buses import simulate
from sniffer.simulation.faults import Fault
from sniffer.simulation.render import candump, frame_reads

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from sniffer.fleet.engines import Batch, Outcome

DAYS: Final = ("2026-11-09", "2026-11-16", "2026-11-17")
"""A day of one week, two of the next."""

SECONDS: Final = 0.8
"""How long each capture is."""

ROBOTS: Final[Mapping[str, str]] = {"r01": "mightyzap", "r02": "mightyzap", "r03": "rs30x"}

_WORSE: Final = (Fault(f.DROP, 0.06), Fault(f.BROWNOUT, 0.03, 1), Fault(f.LATE, 0.02))
_FIRMWARE: Final = ("38000C000E", "38000C000F")
"""How an answer with all registers of a mightyZAP begins: size, no error, model 12, firmware."""


class Inline:
    """An engine that decodes where it is called: no process is begun for a few small captures."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def run(self, batches: Iterable[Batch]) -> Iterator[Outcome]:
        for batch in batches:
            yield batch, decode_batch(batch)


def captured(protocol: str, day: str, seed: int, faults: tuple[Fault, ...]) -> str:
    """Return the log of a capture, a line a frame."""
    start = datetime.datetime.fromisoformat(f"{day}T09:00:00+00:00")
    start_ns = int(start.timestamp()) * 1_000_000_000
    frames = simulate(
        protocol, seed=seed, faults=faults, start_ns=start_ns, duration_s=SECONDS, rate_hz=None
    )
    return candump(frame_reads(list(frames)))


def updated(log: str) -> str:
    """Return the log of a mightyZAP bus whose servos have the next firmware."""
    old, new = _FIRMWARE
    lines = []
    for line in log.splitlines():
        if old in line:  # a byte is greater by one, so the checksum is less by one
            line = f"{line[:-2].replace(old, new)}{int(line[-2:], 16) - 1:02X}"
        lines.append(line)
    return "\n".join(lines) + "\n"


def make_captures(folder: Path) -> None:
    """Write the captures: a log a robot and day, one that breaks off, one that is none."""
    for nth, (robot, protocol) in enumerate(ROBOTS.items()):
        for day in DAYS[robot == "r03" :]:  # which was not there in the first week
            is_worse = robot == "r02" and day > DAYS[0]
            faults = _WORSE if is_worse else (Fault(f.DROP, 0.004),)
            log = captured(protocol, day, seed=10 * nth + DAYS.index(day), faults=faults)
            path = folder / f"robot={robot}" / f"{day}.log"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(updated(log) if is_worse else log, encoding="ascii")
    torn = folder / "robot=r01" / f"{DAYS[2]}-torn.log"
    begun = captured("mightyzap", DAYS[2], seed=99, faults=()).splitlines()[:80]
    torn.write_text("\n".join([*begun, "Segmentation fault"]) + "\n", encoding="ascii")
    (folder / "robot=r03" / "notes.log").write_text("left knee replaced\n", encoding="ascii")


def make_dataset(captures: Path, dataset: Path, robot: str = ROBOT) -> sniffer.FleetRun:
    """Decode captures into a data set."""
    return sniffer.decode_fleet([captures], dataset, engine=Inline(), robot=robot)
