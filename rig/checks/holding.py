"""Ports that another program has, and ports that we may not open."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rig.checks.hearing import ASKS
from rig.listening import Recording
from rig.report import modem_moves, traced

if TYPE_CHECKING:
    from rig.machine import Machine
    from rig.report import Report


def held(rig: Machine, report: Report) -> None:
    """Locked, reserved, or only open: it is refused, and the other program's settings stay."""
    run = Recording(rig, "/dev/ttyS1=mightyzap@57600").wait_open()
    _refused(rig, report, "by a recorder", "is in use by sniffer")
    run.stop()
    for how, complaint in (
        ("flock", "is in use by python3"),
        ("plain", "is open in python3"),
        ("excl", "is open in python3"),
    ):
        rig.sh("rm -f /tmp/held /tmp/let-go")
        holder = rig.start(f"{ASKS} hold /dev/ttyS1 {how}")
        rig.until("test -e /tmp/held")
        _refused(rig, report, how, complaint)
        if how == "excl":
            told = rig.sniffed("doctor", "/dev/ttyS1", "--duration", "0.3", "--shared")
            report.check(told["rc"] == 2 and "is in use by" in told["err"], told["err"].strip())
        rig.sh("touch /tmp/let-go")
        kept = rig.result(holder)["out"].strip()
        report.check(kept == "57600 DTR RTS", f"{how}: its settings are still {kept!r}")


def _refused(rig: Machine, report: Report, how: str, complaint: str) -> None:
    with traced(rig) as lines:
        told = rig.sniffed("doctor", "/dev/ttyS1=mightyzap@115200", "--duration", "0.3")
    moved = modem_moves(lines)
    report.check(
        told["rc"] == 2 and complaint in told["err"] and not moved,
        f"held {how}: {told['err'].strip()}; its modem lines moved: {moved}",
    )


def permissions(rig: Machine, report: Report) -> None:
    """A user without the group, and with it."""
    for device in ("/dev/ttyS1", "/dev/ttyUSB0"):
        words = ("doctor", device, "--duration", "0.3")
        told = rig.sniffed(*words, user="tapper")
        report.check(
            told["rc"] == 2 and "dialout" in told["err"],
            f"{device} without the group: {told['err'].strip()}",
        )
    rig.sh("usermod -aG dialout tapper")
    for device in ("/dev/ttyS1", "/dev/ttyUSB0"):
        told = rig.sniffed("doctor", device, "--duration", "0.3", user="tapper")
        opened = told["rc"] == 1 and "no byte" in told["out"]
        report.check(opened, f"{device} with the group: {told['err'].strip()}")
    rig.sh("gpasswd -d tapper dialout")
