"""Bytes: all of them in their order, from several ports at once, and where the recorder stood."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Final

from rig.listening import Recording, talk
from rig.machine import PATIENCE_S

if TYPE_CHECKING:
    from rig.machine import Machine
    from rig.report import Report

BY_ID: Final = "/dev/serial/by-id/usb-QEMU_QEMU_USB_SERIAL_A6008isP-if00-port0"
BUSES: Final = {"isa1": "/dev/ttyS1", "pci1": "/dev/ttyS4", "ftdi1": "/dev/ttyUSB0"}
ASKS: Final = "cd /src && python3 -S -m rig.guest.asks"


def listed(rig: Machine, report: Report) -> None:
    """``sniffer ports``."""
    rig.until(f"test -e {BY_ID}")
    told = rig.sniffed("ports")["out"]
    report.check(BY_ID in told and "ftdi_sio" in told, "by-id name and driver are listed")
    report.check("ttyS3" not in told and "ttyS4" in told, "UARTs that are not there are left out")
    report.fact(rig.sh("uname -r"))


def every_byte(rig: Machine, report: Report) -> None:
    """Three buses at once at the pace of the wire, then a break on each."""
    run = Recording(rig, *(f"{n}={d}=mightyzap@57600" for n, d in BUSES.items())).wait_open()
    said = {wire: talk(5, seed) for seed, wire in enumerate(BUSES, 1)}
    sent: dict[str, bytes] = {}

    def play(wire: str) -> None:
        sent[wire] = rig.wires[wire].play(said[wire])

    threads = [threading.Thread(target=play, args=(wire,)) for wire in BUSES]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for wire, device in BUSES.items():
        got = run.wait_heard(wire, len(sent[wire]))
        report.check(got == sent[wire], f"{device}: {len(got)} of {len(sent[wire])} bytes, equal")
        rig.qmp("chardev-send-break", id=wire)
        time.sleep(0.3)  # the break and what follows are two packets
        rig.wires[wire].say(b"after")
    for wire in BUSES:
        run.wait_heard(wire, len(sent[wire]) + 5)
    run.stop()
    for wire, device in BUSES.items():
        rest = run.heard(wire)[len(sent[wire]) :]
        report.fact(f"{device}: after a break {rest.hex(' ')}; {run.marks(wire)}")
    for wire in ("isa1", "pci1"):
        report.check("line-break" in run.codes(wire), f"{BUSES[wire]}: the break is marked")


def stopped(rig: Machine, report: Report, size: int = 100_000) -> None:
    """The recorder is stopped while the line talks on: what is missing is told to be."""
    for wire, device in (("isa1", "/dev/ttyS1"), ("ftdi1", "/dev/ttyUSB0")):
        run = Recording(rig, f"a={device}=mightyzap@57600").wait_open()
        rig.wires[wire].say(b"start")
        run.wait_heard("a", 5)
        rig.tell(run.number, "STOP")
        data = bytes(k * 7 % 251 for k in range(size))
        thread = threading.Thread(target=rig.wires[wire].say, args=(data,), daemon=True)
        thread.start()
        thread.join(10)  # the kernel keeps some, and QEMU holds the rest back
        rig.tell(run.number, "CONT")
        thread.join(PATIENCE_S)
        got = run.wait_heard("a", size + 5)
        run.stop()
        is_told = "bytes-lost" in run.codes("a")
        report.check(
            got == b"start" + data or is_told,
            f"{device}: {len(got) - 5} of {size} bytes; a loss is {'' if is_told else 'not '}told",
        )
