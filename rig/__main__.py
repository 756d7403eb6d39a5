"""``python -m rig [NAME...]``: build the machine if need be, boot it once, run all checks."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rig.build import SOURCE, build, cache
from rig.checks import CHECKS, UNDER_SYSTEMD
from rig.machine import Machine
from rig.report import Report


def main() -> int:
    """Run the checks; return 1 if one failed."""
    parser = argparse.ArgumentParser(prog="python -m rig", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join([*CHECKS, "unit"]))
    parser.add_argument("--work", type=Path, default=cache(), help="where the image is kept")
    parser.add_argument("--source", type=Path, default=SOURCE, help="the checkout that is tried")
    args = parser.parse_args()
    known = {**CHECKS, **UNDER_SYSTEMD}
    if unknown := [name for name in args.names if name not in known]:
        parser.error(f"no check {unknown[0]}: one of {', '.join(known)}")
    work = args.work.resolve()
    build(work)
    report = Report()
    names = args.names or list(CHECKS)
    for init, checks in (("/opt/init", CHECKS), ("/lib/systemd/systemd", UNDER_SYSTEMD)):
        wanted = [name for name in names if name in checks]
        if not wanted:
            continue
        with Machine(work, work / "run", args.source.resolve(), init=init) as rig:
            report.about = "boot"
            rig.wait_up()
            report.fact(f"{rig.cpu_s():.0f} s of processor time; not loaded: {rig.not_loaded!r}")
            for name in wanted:
                report.about = name
                try:
                    checks[name](rig, report)
                except Exception as error:  # the other checks go on
                    report.check(False, f"{type(error).__name__}: {error}")
            report.about = "all"
            report.fact(f"{rig.cpu_s():.0f} s of processor time")
    print(f"{report.passed} passed, {len(report.failed)} failed")
    for failed in report.failed:
        print(f"  {failed}")
    return 1 if report.failed else 0


if __name__ == "__main__":
    sys.exit(main())
