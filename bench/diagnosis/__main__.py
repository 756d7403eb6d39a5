"""``python -m bench.diagnosis`` (``make bench-diagnosis``): every scenario through every host.

Writes bench/DIAGNOSIS.md, and what it says of sure causes into docs/diagnosing.md; where only some
of it is run, or other draws, prints it instead.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.diagnosis.catalogue import scenarios
from bench.diagnosis.figures import gathered
from bench.diagnosis.hosts import HOSTS, written
from bench.diagnosis.judging import case_of, score
from bench.diagnosis.report import RESULTS, report, restate

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from bench.diagnosis.judging import Score


ALWAYS: Final = ("exact", "usb16")
IN_TURN: Final = ("log", "raw")
"""Hosts, for a run that takes no longer than it must."""


def scores(
    hosts: Sequence[str],
    seeds: Sequence[int],
    only: str = "",
    *,
    sound: Sequence[int] = (),
    say: bool = False,
) -> Iterator[Score]:
    """Yield the score of each scenario, host and seed; of sound traffic, of more seeds.

    Where no hosts are named, two hear everything, and of the others each hears every second.
    """
    for seed in (*seeds, *sound):
        for number, scenario in enumerate(scenarios(seed, only), seed):
            if seed in sound and scenario.truths:
                continue
            heard = scenario.make(seed)
            for host in hosts or (*ALWAYS, IN_TURN[number % len(IN_TURN)]):
                it = score(case_of(scenario, heard, host, seed))
                if say:
                    _show(it)
                yield it


def _show(it: Score) -> None:
    case = it.case
    sys.stderr.write(f"\n{case.name}, {case.host}, seed {case.seed}: {case.frames} frames\n")
    for held in it.held:
        right = "named" if held.named else f"excused: {held.excused}" if held.excused else "MISSED"
        t = held.truth
        where = f"{t.first_s:.1f} to {t.last_s:.1f} s"
        sys.stderr.write(f"  is:   {t.cause} {t.servo_ids} {where}: {right}\n")
    for told in case.told:
        causes = ", ".join(f"{cause} {sure:.2f}" for cause, sure in told.causes[:4])
        sign = "right" if told in it.right else "wrong" if told.alarms else "note"
        codes = ", ".join(told.codes)
        sys.stderr.write(f"  said: {causes} {told.servo_ids} ({sign}; {codes})\n")


def write(folder: Path, seeds: Sequence[int], only: str) -> None:
    """Write each scenario as a log, for `sniffer diagnose`, and its truth beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed in seeds:
        for scenario in scenarios(seed, only):
            path = folder / f"{scenario.name}-{seed}.log"
            path.write_text(written(scenario, scenario.make(seed)), encoding="utf-8")
            told = [
                f"{t.cause} {t.servo_ids} {t.first_s:.2f} {t.last_s:.2f}\n" for t in scenario.truths
            ]
            path.with_suffix(".truth").write_text("".join(told) or "sound\n", encoding="utf-8")


def main() -> None:
    """Measure what the arguments say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="scenarios whose names hold this")
    parser.add_argument(
        "--seeds",
        type=int,
        default=1,
        help="how many draws of each scenario; 0: sound traffic alone",
    )
    parser.add_argument("--first-seed", type=int, default=0, help="the first of them")
    parser.add_argument("--sound", type=int, default=0, help="further draws of sound traffic")
    parser.add_argument("--host", choices=tuple(HOSTS), action="append", help="only this one")
    parser.add_argument("--show", action="store_true", help="tell what was said of each")
    parser.add_argument("--write", type=Path, help="write the captures to this folder, as logs")
    given = parser.parse_args()
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    sound = range(seeds.stop, seeds.stop + given.sound)
    if given.write:
        write(given.write, seeds, given.only)
        return
    began = time.perf_counter()
    hosts = given.host or ()
    figures = gathered(scores(hosts, seeds, given.only, sound=sound, say=given.show))
    if not figures.scores:
        parser.error(f"no scenario's name holds {given.only!r}")
    page = report(figures)
    if given.only or given.host or given.first_seed or not given.seeds:
        sys.stdout.write(page)
    else:
        RESULTS.write_text(page, encoding="utf-8")
        restate(page)
    sys.stderr.write(f"{len(figures.scores)} cases in {time.perf_counter() - began:.0f} s\n")
    raise SystemExit(bool(figures.failures))


if __name__ == "__main__":
    main()
