"""Robots of several buses: a fault is told of the buses that it strikes, and of no other one."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from bench.other.faults import Dead, Echo, Pauses
from bench.other.line_faults import Noise, Twin
from bench.other.making import away
from bench.other.run import Case, Judged, chunks, heard

if TYPE_CHECKING:
    from pathlib import Path

EPOCH: Final = 1795215306


@dataclass(frozen=True)
class Robot:
    """Limbs by the names of their buses; ``struck`` are those that the fault is to be told of."""

    name: str
    limbs: dict[str, Case]
    cause: str = ""
    struck: tuple[str, ...] = ()
    also: tuple[str, ...] = ()

    def write(self, where: Path) -> Path:
        """Write what is heard of all limbs, side by side."""
        lines = []
        for seed, (bus, case) in enumerate(self.limbs.items()):
            limb = replace(case, seed=case.seed + seed)
            rng = random.Random(limb.seed)
            for t, data in chunks(heard(limb), limb.stamps, limb.tap_baud or limb.baud, rng):
                lines.append((t, f"({EPOCH + t:.6f}) {bus} #{data.hex().upper()}\n"))
        path = where / f"{self.name}.log"
        path.write_text("".join(line for _, line in sorted(lines, key=lambda each: each[0])))
        return path


def judge_robot(robot: Robot, where: Path) -> Judged:
    """Write a robot's buses, and have them diagnosed: of what is told, what is wrong comes first.

    An incident of a bus that is not struck, or with another first cause, is no right one.
    """
    command = [sys.executable, "-m", "sniffer", "diagnose", str(robot.write(where))]
    done = subprocess.run(
        [*command, "--format", "json"], capture_output=True, text=True, check=False
    )
    lines = done.stdout.splitlines()
    told: list[dict[str, Any]] = json.loads(lines[0])["incidents"] if lines else []
    right = [
        i
        for i in told
        if i["bus"] in robot.struck and i["causes"][0]["cause"] in (robot.cause, *robot.also)
    ]
    missed = set(robot.struck) - {i["bus"] for i in right}
    wrong = [i for i in told if i not in right]
    # one an own bus is one fault
    first = right[: not missed] + wrong + right[len(robot.struck) :]
    case = Case(robot.name, "", "", (), robot.cause, also=robot.also)
    return Judged(case, first)


def limbs(
    kind: str, script: str, *names: str, stamps: str = "exact", **more: Any
) -> dict[str, Case]:
    """Return limbs that are alike, servos of the same ids on each."""
    return {n: Case(n, kind, script, (1, 2, 3), stamps=stamps, said=False, **more) for n in names}


def but(every: dict[str, Case], **other: dict[str, Any]) -> dict[str, Case]:
    """Return limbs of which some differ."""
    return {n: replace(case, **other.get(n, {})) for n, case in every.items()}


ARMS: Final = ("left_arm", "right_arm")
ALL: Final = (*ARMS, "left_leg", "right_leg")
MIXED: Final = {
    **limbs("mz", "fast", "left_arm"),
    **limbs("rs", "acked", "right_arm"),
    **limbs("wck", "moves", "left_leg"),
    **limbs("lss", "many", "right_leg"),
}

ROBOTS: Final = (
    Robot("s-robot-mixed", MIXED),
    Robot("s-robot-mixed-usb", {n: replace(c, stamps="usb16") for n, c in MIXED.items()}),
    Robot("s-robot-arms-ms", limbs("rs", "sync", *ARMS, stamps="ms")),
    Robot(
        "robot-dead",
        but(limbs("mz", "fast", *ALL), left_leg={"faults": (Dead((2,), 8.0),)}),
        "servo-dead",
        ("left_leg",),
    ),
    Robot(
        "robot-limb-off",
        but(MIXED, right_arm={"faults": (Dead((1, 2, 3), 8.0),)}),
        "servo-dead",
        ("right_arm",),
    ),
    Robot(
        "robot-supply-of-two",
        but(
            limbs("rs", "acked", *ALL),
            **{n: {"faults": tuple(away(k, 5.0, 0.4, 0.0) for k in (1, 2, 3))} for n in ARMS},
        ),
        "servo-reset-loop",
        ARMS,
        also=("brownout",),
    ),
    # all were judged as the first protocol's: sound buses were not raw, or spoke two protocols
    Robot(
        "robot-one-at-another-rate",
        but(limbs("lss", "many", *ALL), left_leg={"tap_baud": 57600}),
        "wrong-baud",
        ("left_leg",),
    ),
    Robot(
        "robot-one-at-another-rate-rs",
        but(limbs("rs", "acked", *ARMS), left_arm={"tap_baud": 57600}),
        "wrong-baud",
        ("left_arm",),
    ),
    Robot(
        "robot-noise-on-one",
        but(MIXED, left_arm={"faults": (Noise(0.001),)}),
        "bus-noise",
        ("left_arm",),
    ),
    Robot(
        "robot-twin-on-one",
        but(limbs("mz", "fast", *ARMS), right_arm={"faults": (Twin(2, 0.0),)}),
        "duplicate-id",
        ("right_arm",),
    ),
    Robot(
        "robot-echo-on-one",
        but(MIXED, right_arm={"faults": (Echo(),)}),
        "echo",
        ("right_arm",),
    ),
    Robot(
        "robot-program-stalls",
        but(
            limbs("rs", "sync", *ARMS, seconds=30),
            **{n: {"faults": (Pauses(4.0, 0.25),)} for n in ARMS},
        ),
        "controller-stall",
        ARMS,
    ),
)
