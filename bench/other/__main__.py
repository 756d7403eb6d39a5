"""``python -m bench.other [NAME...]``: another generator of sound and faulty conversations.

``make bench-diagnosis`` grew beside the rules it judges. What is here shares nothing with it, nor
with the simulator: frames by hand, joints with a supply and a temperature, controllers that are no
tidy loops. Each conversation is written as a file and given to ``sniffer diagnose``.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from bench.other.brought import BROUGHT, BROUGHT_SOUND
from bench.other.of_buses import ROBOTS, Robot, judge_robot
from bench.other.of_clients import CLIENTS
from bench.other.of_line import LINE
from bench.other.of_programs import PROGRAMS
from bench.other.of_servos import SERVOS
from bench.other.run import Case, judge
from bench.other.sound import SOUND

if TYPE_CHECKING:
    from bench.other.run import Judged

AT_ONCE = 2


class Verdict(NamedTuple):
    """How far what was said is right."""

    is_cause: bool
    is_servo: bool
    incidents: int

    @property
    def mark(self) -> str:
        if not self.is_cause:
            return "MISS"
        if not self.is_servo:
            return "servo"
        return "ok" if self.incidents == 1 else "many"


def verdict(judged: Judged) -> Verdict:
    """Hold what was said of a fault against it."""
    case, told = judged.case, judged.incidents
    first = told[0]["causes"][0]["cause"] if told and told[0]["causes"] else ""
    is_cause = first in (case.cause, *case.also)
    is_servo = is_cause and (not case.servos or set(told[0]["servo_ids"]) == set(case.servos))
    return Verdict(is_cause, is_servo, len(told))


def judged_in(where: Path, case: Case | Robot) -> Judged:
    """Have a conversation, or those of a robot's buses, diagnosed."""
    return judge_robot(case, where) if isinstance(case, Robot) else judge(case, where)


def shown(judged: Judged) -> str:
    """Return what was said, a line an incident."""
    lines = [
        f"        {one['severity']} {one['servo_ids']} {one['count']} times: "
        + ", ".join(f"{c['cause']} {c['confidence']:.0%}" for c in one["causes"][:2])
        for one in judged.incidents[:5]
    ]
    return "\n".join([*lines, ""]) if lines else "        nothing\n"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.other", description=__doc__)
    parser.add_argument("names", nargs="*", help="conversations whose names begin so")
    parser.add_argument("--write", type=Path, help="keep the captures in this folder")
    args = parser.parse_args()
    every: tuple[Case | Robot, ...] = (
        *SOUND,
        *BROUGHT_SOUND,
        *LINE,
        *SERVOS,
        *PROGRAMS,
        *BROUGHT,
        *CLIENTS,
        *ROBOTS,
    )
    cases = [c for c in every if not args.names or c.name.startswith(tuple(args.names))]
    verdicts, alarms, sound = [], 0, 0
    with tempfile.TemporaryDirectory() as passing, ThreadPoolExecutor(AT_ONCE) as pool:
        where = args.write or Path(passing)
        where.mkdir(exist_ok=True)
        for judged in pool.map(partial(judged_in, where), cases):
            if judged.case.cause:
                one = verdict(judged)
                verdicts.append(one)
                mark = one.mark
            else:
                sound += 1
                alarms += len(judged.incidents)
                mark = "ALARM" if judged.incidents else "ok"
            sys.stdout.write(f"{mark:6}{judged.case.name}\n")
            if mark != "ok":
                sys.stdout.write(shown(judged))
            sys.stdout.flush()
    sys.stdout.write(
        f"{len(verdicts)} faults: first cause right {sum(v.is_cause for v in verdicts)}, with the "
        f"right servo {sum(v.is_servo for v in verdicts)}, incidents a fault "
        f"{sum(v.incidents for v in verdicts) / max(len(verdicts), 1):.2f}\n"
        f"{sound} sound conversations: {alarms} alarms\n"
    )


if __name__ == "__main__":
    main()
