"""Line errors on demand, through each driver: what is marked, counted and said to be known."""

from __future__ import annotations

import re
import time
from typing import TYPE_CHECKING, Final, NamedTuple

from rig.checks.hearing import ASKS
from rig.listening import Recording

if TYPE_CHECKING:
    from rig.machine import Machine
    from rig.report import Report

ORDERS: Final = (
    *("data 010203ff04", "error F 1112ff13", "data 21", "error P 2223", "data 31"),
    *("error B 00", "data 41", "error B 5152", "data 61", "error O 7172", "data 81"),
)
HEARD: Final = bytes.fromhex("010203ff04 1112ff13 21 2223 31 00 41 5152 61 7172 81")
FIRST: Final = re.compile(r"FRAMING\(0,(\d+),1\)")
"""The packet of four with one framing error: one error, among the bytes of the read that brought
it. How many packets a read brings depends on how busy the machine is."""

PACKET: Final = 4


class Seen(NamedTuple):
    """What is expected of a driver.

    ``keeps`` tells whether all bytes come as they were: a driver that marks a break puts a 0 in the
    place of the byte, or beside it.
    """

    line_errors: str
    has_marks: bool
    keeps: bool
    losses: str


EXPECTED: Final = {
    "ftdi": Seen("marked, for each packet", True, True, "ok"),
    "cp210x": Seen("unknown: a genuine chip", True, False, "bad"),
    "copy": Seen("unknown: a genuine chip", False, True, "note"),
    "ch341": Seen("unknown: this driver", False, True, "note"),
    "pl2303": Seen("marked, for a packet of the adapter or the next", True, False, "note"),
    "acm": Seen("unknown: counted if the device", True, False, "bad"),
}


def errors(rig: Machine, report: Report) -> None:
    """One adapter of each kind in turn."""
    for kind in EXPECTED:
        run = f"cd /src && exec python3 -S -m rig.guest.usbip {kind} /tmp/{kind} V{kind}"
        emulator = rig.start(f"{run} > /tmp/{kind}.log 2>&1", 900)
        try:
            name = rig.until(f"ls /dev/serial/by-id/*V{kind}-*").split()[0]
            _listen(rig, report, kind, name)
            _examine(rig, report, kind, name)
        finally:
            rig.sh(f"test -p /tmp/{kind} && echo pull > /tmp/{kind}")
            rig.result(emulator)


def _listen(rig: Machine, report: Report, kind: str, name: str) -> None:
    expected = EXPECTED[kind]
    rig.sh(f": > /tmp/{kind}.log")
    run = Recording(rig, f"a={name}=mightyzap@57600").wait_open()
    for order in ORDERS:
        rig.sh(f"echo '{order}' > /tmp/{kind}; sleep 0.2")
    run.wait_heard("a", len(HEARD))
    time.sleep(2)  # counters are read once a second
    counted = rig.sh(f"{ASKS} count {name}")
    run.stop()
    heard, marks = run.heard("a"), run.marks("a")
    told = run.facts("a")["line_errors"]
    report.fact(f"{kind}: {heard.hex(' ')}; {marks}; TIOCGICOUNT {counted}")
    report.check(told.startswith(expected.line_errors), f"{kind}: line errors: {told}")
    report.check(bool(marks) == expected.has_marks, f"{kind}: {len(marks)} marks")
    if expected.keeps:
        report.check(heard == HEARD, f"{kind}: all bytes as they were")
    if kind == "ftdi":
        first = FIRST.fullmatch(marks[0]) if marks else None
        is_one = first is not None and int(first[1]) >= PACKET
        report.check(is_one, f"{kind}: one error in a packet of four is {marks[:1]}")
    sent = rig.sh(f"grep -a SENT /tmp/{kind}.log")
    report.check(not sent, f"{kind}: nothing sent {sent}")


def _examine(rig: Machine, report: Report, kind: str, name: str) -> None:
    """Let the doctor listen while there is an overrun."""
    number = rig.sniff("doctor", f"{name}=mightyzap@57600", "--duration", "4")
    rig.until(f"ls -l /proc/$(cat /tmp/pid.{number})/fd | grep -q tty")
    time.sleep(1)
    rig.sh(f"echo 'error O 7172' > /tmp/{kind}")
    told = rig.result(number)["out"]
    level = {"ftdi": "bad"}.get(kind, EXPECTED[kind].losses)
    report.check(f"{level:6}losses" in told, f"{kind}: {_line(told, 'losses')}")
    report.fact(f"{kind}: {_line(told, 'errors')}")


def _line(told: str, about: str) -> str:
    return next((line for line in told.splitlines() if line[6:].startswith(about)), "")
