"""What goes out on the wire when a port is opened: seen at its far end."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from rig.listening import Recording
from rig.report import modem_moves, traced, transfers, transmitted

if TYPE_CHECKING:
    from rig.machine import Machine
    from rig.report import Report

FRESH: Final = {"isa2": "/dev/ttyS2", "ftdi1": "/dev/ttyUSB0"}
"""Ports that nobody has opened since the guest was booted, and the wires behind them."""

SETTLES_S: Final = 1.0
"""What bytes take from the guest to us, generously: none is waited for that comes."""


def opened_while_it_talks(rig: Machine, wire: str, device: str) -> tuple[bytes, dict[str, str]]:
    """Open a port on a bus that talks, hear some, let go of it.

    Returns what was sent meanwhile by its end, and the facts of the recording.
    """
    line = rig.wires[wire]
    line.sent = b""
    with line.chatter():
        run = Recording(rig, f"a={device}=mightyzap@57600").wait_open()
        run.wait_heard("a", 200)
        run.stop()
    time.sleep(SETTLES_S)
    return line.sent, run.facts("a")


def echo(rig: Machine, report: Report) -> None:
    """A port that nobody has set up, opened while the bus talks, and opened again."""
    for wire, device in FRESH.items():
        sent, facts = opened_while_it_talks(rig, wire, device)
        report.fact(f"{device}, first opening: {len(sent)} bytes sent back ({sent[:12].hex(' ')})")
        report.check(facts["echo_at_open"] == "on", f"{device} was not prepared, and it is told")
        told = facts["sent_since_plugged"]
        report.check(told == str(len(sent)), f"{device}: {told} bytes are told to have been sent")
        sent, facts = opened_while_it_talks(rig, wire, device)
        report.check(not sent, f"{device}, second opening: {len(sent)} bytes sent back")
        report.check(facts["echo_at_open"] == "off", f"{device}: its echo was off by then")


def prepared(rig: Machine, report: Report) -> None:
    """The same after ``doctor --prepare`` on a bus that was silent then."""
    for wire, device in FRESH.items():
        line = rig.wires[wire]
        rig.sh(f"stty -F {device} sane")
        line.sent = b""
        told = rig.sniffed("doctor", device, "--prepare")
        report.check(
            told["rc"] == 0 and "echo was on before" in told["out"], f"{device}: {told['out']!r}"
        )
        sent, facts = opened_while_it_talks(rig, wire, device)
        report.check(not sent, f"{device}, prepared: {len(sent)} bytes sent back")
        report.check(facts["echo_at_open"] == "off", f"{device}: its echo was off by then")
    told = rig.sniffed("doctor", "/dev/ttyS2", "--duration", "0.3")
    report.check("ok    echo" in told["out"], "the doctor says that the port was prepared")
    rig.sh("stty -F /dev/ttyS2 sane")
    told = rig.sniffed("doctor", "/dev/ttyS2", "--duration", "0.3")
    report.check(
        "warn  echo" in told["out"] or "note  echo" in told["out"], "and that it was not, else"
    )


def silence(rig: Machine, report: Report) -> None:
    """Opening and closing on a silent line, and what the modem lines do."""
    devices = {"isa1": "/dev/ttyS1", "pci1": "/dev/ttyS4", "ftdi1": "/dev/ttyUSB0"}
    for wire, device in devices.items():
        for modem in ("low", "keep"):
            line = rig.wires[wire]
            line.sent = b""
            with traced(rig) as lines:
                words = (f"a={device}=mightyzap@57600", "--modem", modem)
                told = Recording(rig, *words).wait_open().stop()
            is_ftdi = wire == "ftdi1"
            sent = len(line.sent) + (0 if is_ftdi else transmitted(lines))
            report.check(
                not sent and told["rc"] == 0,
                f"{device} --modem {modem}: {sent} sent {told['err'] if told['rc'] else ''}",
            )
            report.fact(f"modem lines: {transfers(lines) if is_ftdi else modem_moves(lines)}")
