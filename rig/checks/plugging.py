"""Adapters that are pulled out and plugged in again, and what udev does then."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from rig.checks.hearing import BY_ID
from rig.checks.opening import SETTLES_S, opened_while_it_talks
from rig.listening import Recording, talk
from rig.machine import PATIENCE_S

if TYPE_CHECKING:
    from rig.machine import Machine
    from rig.report import Report

GONE = "! test -e /dev/ttyUSB0"
RULES = "/etc/udev/rules.d/60-servo-tap.rules"
LATE = "/run/udev/rules.d/73-see.rules"


def replug(rig: Machine) -> None:
    """Pull the adapter out and plug it in again."""
    rig.pull_out()
    rig.until(GONE)
    rig.plug_in()
    rig.until(f"test -e {BY_ID}")


def rule(rig: Machine, report: Report) -> None:
    """The udev rule: timer, tag, and a port that is prepared before anybody can open it."""
    rig.sh(f"install -m 644 /src/docs/60-servo-tap.rules {RULES}; mkdir -p /run/udev/rules.d")
    rig.sh(f"""echo 'SUBSYSTEM=="tty", TAG=="uaccess", ENV{{SEEN_LATE}}="yes"' > {LATE}""")
    rig.sh("udevadm control --reload")
    rig.wires["ftdi1"].sent = b""
    replug(rig)
    timer = rig.sh("cat /sys/bus/usb-serial/devices/ttyUSB0/latency_timer")
    report.check(timer == "1", f"latency_timer after plugging in: {timer}")
    told = rig.sh("udevadm info /dev/ttyUSB0")
    for word in ("uaccess", "ID_MM_PORT_IGNORE=1", "SEEN_LATE=yes", "SERVO_TAP_PREPARED=1"):
        report.check(word in told, f"udev has {word}")
    shown = rig.sh("udevadm test $(udevadm info -q path /dev/ttyUSB0) 2>&1 | grep servo-tap")
    report.check(not any(w in shown.lower() for w in ("invalid", "unknown", "fail")), shown)
    report.check(not rig.wires["ftdi1"].sent, "nothing was sent when it was plugged in")
    sent, facts = opened_while_it_talks(rig, "ftdi1", BY_ID)
    report.check(not sent, f"opened for the first time while the bus talks: {len(sent)} sent back")
    report.check(facts["echo_at_open"] == "off", "its echo was off by then")
    told = rig.sniffed("doctor", BY_ID, "--duration", "0.3")["out"]
    report.check("ok    echo" in told, "the doctor says so")
    _comes_back(rig, report)
    rig.sh(f"rm {RULES} {LATE}; udevadm control --reload")
    replug(rig)


def _comes_back(rig: Machine, report: Report) -> None:
    """The adapter comes back to a bus that talks: only the rule's own opening is too late."""
    wire = rig.wires["ftdi1"]
    run = Recording(rig, f"arm={BY_ID}=mightyzap@57600").wait_open()
    with wire.chatter():
        wire.sent = b""
        rig.pull_out()
        rig.until(GONE)
        rig.plug_in()
        run.wait_port("ttyUSB")
        at_plugging = len(wire.sent)
        before = len(run.heard("arm"))
        run.wait_heard("arm", before + 200)
    run.stop()
    time.sleep(SETTLES_S)
    report.fact(f"plugged in while the bus talks, with the rule: {at_plugging} bytes sent back")
    report.check(len(wire.sent) == at_plugging, f"then {len(wire.sent) - at_plugging} more")


def plugging(rig: Machine, report: Report) -> None:
    """Unplug and plug in again while recording, once with another adapter taking its number."""
    wire = rig.wires["ftdi1"]
    run = Recording(rig, "arm=/dev/ttyUSB0=mightyzap@57600").wait_open()
    said = wire.play(talk(1, 1))
    run.wait_heard("arm", len(said))
    replug(rig)
    run.wait_port("ttyUSB")
    time.sleep(1)  # it settles the port
    said += wire.play(talk(1, 2))
    got = run.wait_heard("arm", len(said))
    report.check(got == said, f"{len(got)} of {len(said)} bytes around a replug")
    rig.pull_out()
    rig.until(GONE)
    rig.plug_in("adapter2", "ftdi2", "OTHER")
    rig.until("test -e /dev/serial/by-id/*OTHER*")
    rig.plug_in()
    run.wait_port("ttyUSB1")
    time.sleep(1)
    said += wire.play(talk(1, 3))
    rig.wires["ftdi2"].say(b"not this one" * 10)
    got = run.wait_heard("arm", len(said))
    report.check(got == said, f"followed to another number by its by-id name: {len(got)} bytes")
    _pulled_in_mid_talk(rig, report, run)
    rig.pull_out("adapter2")
    rig.pull_out()
    rig.until("! ls /dev/ttyUSB* 2>/dev/null")
    rig.plug_in()
    rig.until(f"test -e {BY_ID}")


def _pulled_in_mid_talk(rig: Machine, report: Report, run: Recording) -> None:
    wire = rig.wires["ftdi1"]
    half = talk(2, 4)
    thread = threading.Thread(target=wire.play, args=(half,), kwargs={"lossy": True})
    thread.start()
    time.sleep(0.8)
    rig.pull_out()
    thread.join()
    wire.sent = b""
    with wire.chatter():
        rig.plug_in()
        run.wait_port("ttyUSB")
        time.sleep(1)
    report.fact(f"back on a bus that talks, without the rule: {len(wire.sent)} bytes sent back")
    tail = wire.play(talk(1, 5))
    end = time.monotonic() + PATIENCE_S
    while not run.heard("arm").endswith(tail) and time.monotonic() < end:
        time.sleep(0.5)
    run.stop()
    report.check(run.heard("arm").endswith(tail), "goes on after being pulled in mid-talk")
    kinds = [mark.partition("(")[0] for mark in run.marks("arm")]
    report.check((kinds.count("LOST"), kinds.count("BACK")) == (3, 3), f"marks {kinds}")
