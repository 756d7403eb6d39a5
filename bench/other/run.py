"""Conversations written as captures: stamps of several kinds, logs, hex, bare bytes."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from bench.other.controllers import SCRIPTS
from bench.other.joints import Joint, Supply
from bench.other.rounds import rounds
from bench.other.sessions import session
from bench.other.talk import Lss, Mz, Rs, Wck
from bench.other.wire import Bus, Fault, uart

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bench.other.controllers import Steps

KIND: Final[dict[str, type[Joint]]] = {"mz": Mz, "lss": Lss, "wck": Wck, "rs": Rs}


@dataclass
class Case:
    name: str
    proto: str
    script: str
    ids: tuple[int, ...]
    cause: str = ""
    servos: tuple[int, ...] = ()
    faults: tuple[Fault, ...] = ()
    baud: int = 115200
    seconds: float = 20.0
    stamps: str = "exact"  # exact, cs, ms, usb16, none, hex
    tap_baud: float = 0.0
    said: bool = True  # whether --baud is given
    args: dict[str, Any] = field(default_factory=dict)
    second: tuple[str, dict[str, Any]] | None = None  # another controller's script
    speed: float = 1.2
    ohms: float = 0.12
    seed: int = 1
    patience: float = 9.0
    retries: int = 0
    absent: tuple[int, ...] = ()
    also: tuple[str, ...] = ()  # answers that are as right


def _script(proto: str, name: str) -> Callable[..., Steps]:
    of_all = {"rounds": rounds, "session": session}
    return partial(of_all[name], proto) if name in of_all else SCRIPTS[proto][name]


def build(case: Case) -> Bus:
    supply = Supply(12.0 if case.proto != "wck" else 9.0, case.ohms)
    servos = [KIND[case.proto](i, supply, case.seed, case.speed) for i in case.ids]
    bus = Bus(
        case.baud, servos, case.seed, 0.0008 if case.stamps != "exact" else 0.0003, case.faults
    )
    bus.patience, bus.retries = case.patience, case.retries
    bus.controller(
        _script(case.proto, case.script)(bus, tuple(sorted((*case.ids, *case.absent))), **case.args)
    )
    if case.second:
        name, args = case.second
        bus.controller(SCRIPTS[case.proto][name](bus, case.ids, **args), 1.37)
    bus.run(case.seconds)
    return bus


def heard(case: Case) -> list[tuple[float, int]]:
    bus = build(case)
    got = uart(bus.says, case.tap_baud or case.baud, bus.rng)
    for fault in case.faults:
        got = fault.tap(bus, got)
    return got


def chunks(
    got: list[tuple[float, int]], stamps: str, baud: float, rng: random.Random
) -> list[tuple[float, bytes]]:
    out: list[tuple[float, bytes]] = []
    if stamps in ("exact", "cs"):
        run, last = bytearray(), -1.0
        for t, b in got:
            if run and t - last > 11.5 / baud:
                out.append((last, bytes(run)))
                run = bytearray()
            run.append(b)
            last = t
        return [*out, (last, bytes(run))]
    tick = 0.001 if stamps == "ms" else 0.016
    full, run, due = 62, bytearray(), tick * rng.random()
    for t, b in got:
        if t > due:
            if run:
                out.append((due + rng.uniform(0, 0.0003), bytes(run)))
                run = bytearray()
            due += tick * (1 + int((t - due) / tick))
        run.append(b)
        if len(run) == full:
            out.append((t + rng.uniform(0.0001, 0.0004), bytes(run)))
            run = bytearray()
    return [*out, (due, bytes(run))] if run else out


def write(case: Case, where: Path) -> Path:
    got = heard(case)
    rng = random.Random(case.seed)
    if case.stamps in ("none", "hex"):
        data = bytes(b for _, b in got)
        path = where / f"{case.name}.{'bin' if case.stamps == 'none' else 'hex'}"
        if case.stamps == "none":
            path.write_bytes(data)
        else:
            path.write_text(
                "\n".join(data[k : k + 32].hex(" ") for k in range(0, len(data), 32)) + "\n"
            )
        return path
    path = where / f"{case.name}.log"
    with path.open("w") as f:
        for t, data in chunks(got, case.stamps, case.tap_baud or case.baud, rng):
            digits = 2 if case.stamps == "cs" else 6
            f.write(f"({1795215306 + t:.{digits}f}) arm #{data.hex().upper()}\n")
    return path


class Judged(NamedTuple):
    """A conversation, and the incidents that were told of it."""

    case: Case
    incidents: list[dict[str, Any]]


def judge(case: Case, where: Path) -> Judged:
    """Write a conversation, and have it diagnosed."""
    command = [sys.executable, "-m", "sniffer", "diagnose", str(write(case, where))]
    if case.said and case.stamps not in ("none", "hex"):
        command += ["--baud", str(int(case.tap_baud or case.baud))]
    done = subprocess.run(
        [*command, "--format", "json"], capture_output=True, text=True, check=False
    )
    lines = done.stdout.splitlines()
    return Judged(case, json.loads(lines[0])["incidents"] if lines else [])
