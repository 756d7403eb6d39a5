"""The rate at which a line really runs, told by QEMU, and what is said of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from rig.checks.hearing import ASKS
from rig.report import rates as ran_at
from rig.report import traced

if TYPE_CHECKING:
    from rig.machine import Machine
    from rig.report import Report

CASES: Final = (
    ("/dev/ttyS1", 57600, ""),
    ("/dev/ttyS1", 76800, "divides 115200 by a whole number, and would run at 57600"),
    ("/dev/ttyS1", 100000, "divides 115200 by a whole number, and would run at 115200"),
    ("/dev/ttyS1", 250000, "its driver has set "),
    ("/dev/ttyUSB0", 74880, ""),
    ("/dev/ttyUSB0", 3000000, ""),
    ("/dev/ttyUSB0", 4000000, "its driver has set 9600 instead"),
)


def rates(rig: Machine, report: Report) -> None:
    """Rates that UART and adapter can do are taken, others are refused with the true reason."""
    for device in ("/dev/ttyS1", "/dev/ttyUSB0"):
        report.fact(f"{device} reports {rig.sh(f'{ASKS} bauds {device}')}")
    for device, baud, complaint in CASES:
        rig.sh(f"stty -F {device} 57600")
        with traced(rig) as lines:
            words = ("--duration", "0.2s", "--force", "-o", "/tmp/rate.mcap")
            told = rig.sniffed("record", f"{device}=mightyzap@{baud}", *words)
        said = told["err"].strip().splitlines()[:1]
        last = ran_at(lines)[-1:]
        fits = told["rc"] == 2 and complaint in told["err"] if complaint else told["rc"] == 0
        report.check(fits, f"{device}@{baud} ran at {last}: rc {told['rc']} {said}")
    rig.sh("stty -F /dev/ttyS1 57600; stty -F /dev/ttyUSB0 57600")
