"""Which serial ports there are: told from trees as Linux shows them, and how they are listed."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner

from sniffer.cli.ports import lines, show
from sniffer.cli.ports import ports as command
from sniffer.ports.listing import (
    MISSING,
    READY,
    REFUSED,
    Holder,
    PortInfo,
    of_pyserial,
    port_at,
    ports,
)

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the trees are made of links")


class Machine:
    """A tree with the files and links that Linux shows for its serial ports."""

    def __init__(self, root: Path) -> None:
        self.root = root
        for folder in ("sys/class/tty", "dev", "proc"):
            (root / folder).mkdir(parents=True)
        for name in ("console", "ptmx", "tty", "tty0", "tty63"):
            (root / "sys/class/tty" / name).mkdir()

    def write(self, folder: Path, files: Mapping[str, str]) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (folder / name).write_text(f"{text}\n")
        return folder

    def link(self, link: Path, target: Path) -> None:
        link.parent.mkdir(parents=True, exist_ok=True)
        target.mkdir(parents=True, exist_ok=True)
        link.unlink(missing_ok=True)
        link.symlink_to(os.path.relpath(target, link.parent))

    def driven(self, device: Path, bus: str, driver: str) -> None:
        self.link(device / "driver", self.root / "sys/bus" / bus / "drivers" / driver)
        self.link(device / "subsystem", self.root / "sys/bus" / bus)

    def tty(self, name: str, device: Path, files: Mapping[str, str], *, node: bool = True) -> None:
        folder = self.write(device / "tty" / name, files)
        self.link(folder / "device", device)
        self.link(self.root / "sys/class/tty" / name, folder)
        if node:
            (self.root / "dev" / name).touch()

    def usb(self, where: str, vendor: str, product: str, texts: Mapping[str, str]) -> Path:
        folder = self.root / "sys/devices/pci0000:00/0000:00:14.0/usb1" / where
        return self.write(folder, {"idVendor": vendor, "idProduct": product, **texts})

    def adapter(
        self, name: str, driver: str, usb: Path, *, timer: str | None = None, node: bool = True
    ) -> None:
        device = usb / f"{usb.name}:1.0" / name
        self.write(device, {"port_number": "0"} | ({"latency_timer": timer} if timer else {}))
        self.driven(device, "usb-serial", driver)
        self.tty(name, device, {"dev": "188:0"}, node=node)

    def ftdi(self, name: str, where: str, *, timer: str, serial: str) -> None:
        texts = {"manufacturer": "FTDI", "product": "FT232R USB UART", "serial": serial}
        self.adapter(name, "ftdi_sio", self.usb(where, "0403", "6001", texts), timer=timer)
        link = self.root / f"dev/serial/by-id/usb-FTDI_FT232R_USB_UART_{serial}-if00-port0"
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(f"../../{name}")

    def uart(self, name: str, where: str, driver: str, kind: str) -> None:
        """A UART as newer kernels show it: a bus of the kernel's own stands between."""
        parent = self.root / "sys/devices" / where
        self.driven(parent, "platform", driver)
        between = parent / f"{parent.name}:0"
        self.driven(between, "serial-base", "ctrl")
        device = between / f"{parent.name}:0.{name.removeprefix('ttyS')}"
        self.driven(device, "serial-base", "port")
        self.tty(name, device, {"type": kind})

    def old_uart(self, name: str, where: str, driver: str) -> None:
        """A UART as older kernels show it to users: without the bus, and without its type."""
        device = self.root / "sys/devices" / where
        self.driven(device, "platform", driver)
        self.tty(name, device, {"type": ""})

    def program(self, pid: int, name: str, *files: str) -> None:
        folder = self.write(self.root / "proc" / str(pid), {"comm": name})
        (folder / "fd").mkdir()
        for number, file in enumerate(files):
            (folder / "fd" / str(number)).symlink_to(file)


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def only(machine: Machine) -> PortInfo:
    (found,) = ports(machine.root)
    return found


# --- what is found -----------------------------------------------------------------------------


def test_an_ftdi_adapter_is_told_with_all_that_is_known(machine: Machine) -> None:
    machine.ftdi("ttyUSB0", "1-1", timer="16", serial="A6008isP")
    assert replace(only(machine), group="") == PortInfo(
        path="/dev/ttyUSB0",
        driver="ftdi_sio",
        chip="FT232R",
        vendor_id=0x0403,
        product_id=0x6001,
        manufacturer="FTDI",
        product="FT232R USB UART",
        serial="A6008isP",
        stable="/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A6008isP-if00-port0",
        latency_ms=16,
        access=READY,
        all_seen=True,
    )


def test_the_timer_is_read_as_it_stands_now(machine: Machine) -> None:
    machine.ftdi("ttyUSB0", "1-1", timer="1", serial="A1")
    assert only(machine).latency_ms == 1


def test_a_ch340_has_neither_timer_nor_serial_number(machine: Machine) -> None:
    usb = machine.usb("1-2", "1a86", "7523", {"product": "USB2.0-Serial"})
    machine.adapter("ttyUSB0", "ch341-uart", usb)
    found = only(machine)
    assert (found.chip, found.driver, found.latency_ms) == ("CH340", "ch341-uart", None)
    assert (found.device, found.serial, found.stable) == ("USB2.0-Serial", "", "")


def test_a_microcontroller_is_a_port_by_its_class(machine: Machine) -> None:
    usb = machine.usb("1-3", "2e8a", "000a", {"manufacturer": "Raspberry Pi", "product": "Pico"})
    interface = usb / "1-3:1.0"
    machine.driven(interface, "usb", "cdc_acm")
    machine.tty("ttyACM0", interface, {"dev": "166:0"})
    found = only(machine)
    assert (found.chip, found.driver, found.usb) == ("CDC ACM", "cdc_acm", True)
    assert found.device == "Raspberry Pi Pico"


def test_a_uart_on_board_is_listed_with_the_driver_behind_the_kernels_own_bus(
    machine: Machine,
) -> None:
    machine.uart("ttyS0", "pnp0/00:00", "serial", "4")
    found = only(machine)
    assert (found.path, found.chip, found.driver) == ("/dev/ttyS0", "16550A", "serial")
    assert (found.usb, found.latency_ms) == (False, None)


def test_ports_without_hardware_are_left_out(machine: Machine) -> None:
    for number in range(1, 4):
        machine.uart(f"ttyS{number}", "platform/serial8250", "serial8250", "0")
    assert ports(machine.root) == []


def test_where_the_type_is_not_told_the_8250_driver_alone_is_no_proof(machine: Machine) -> None:
    machine.old_uart("ttyS0", "pnp0/00:00", "serial")
    machine.old_uart("ttyS1", "platform/serial8250", "serial8250")
    assert only(machine).path == "/dev/ttyS0"


def test_consoles_alone_are_no_ports(machine: Machine) -> None:
    assert ports(machine.root) == []


def test_a_machine_without_any_of_these_files_has_no_ports(tmp_path: Path) -> None:
    assert ports(tmp_path) == []


def test_adapters_come_first_and_numbers_count_as_numbers(machine: Machine) -> None:
    machine.uart("ttyS0", "pnp0/00:00", "serial", "4")
    for number in (10, 2):
        machine.ftdi(f"ttyUSB{number}", f"1-{number}", timer="1", serial=f"A{number}")
    assert [p.path for p in ports(machine.root)] == ["/dev/ttyUSB2", "/dev/ttyUSB10", "/dev/ttyS0"]


def test_who_has_a_port_open_is_told(machine: Machine) -> None:
    machine.ftdi("ttyUSB0", "1-1", timer="1", serial="A1")
    machine.program(812, "ModemManager", "/dev/null", "/dev/ttyUSB0")
    machine.program(4021, "python3", "/dev/ttyUSB0", "/dev/ttyUSB0", "socket:[1234]")
    machine.program(5000, "bash", "/dev/pts/3")
    assert only(machine).holders == (Holder(812, "ModemManager"), Holder(4021, "python3"))


def test_a_port_may_lack_its_node(machine: Machine) -> None:
    usb = machine.usb("1-2", "1a86", "7523", {})
    machine.adapter("ttyUSB0", "ch341-uart", usb, node=False)
    assert only(machine).access == MISSING


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_port_may_be_forbidden(machine: Machine) -> None:
    machine.ftdi("ttyUSB0", "1-1", timer="1", serial="A1")
    (machine.root / "dev/ttyUSB0").chmod(0)
    assert only(machine).access == REFUSED


def test_odd_texts_of_a_device_do_not_reach_the_terminal(machine: Machine) -> None:
    usb = machine.usb("1-2", "1a86", "7523", {"product": "Ad\x1b[31mapter", "serial": "\x07"})
    machine.adapter("ttyUSB0", "ch341-uart", usb)
    assert only(machine).device.isprintable()


def test_one_port_is_found_by_its_path(machine: Machine) -> None:
    machine.ftdi("ttyUSB0", "1-1", timer="16", serial="A1")
    found = port_at("/dev/ttyUSB0", machine.root)
    assert found is not None
    assert found.latency_ms == 16
    assert port_at("/dev/pts/3", machine.root) is None


def test_what_pyserial_finds_on_other_systems_is_told_alike() -> None:
    from serial.tools.list_ports_common import ListPortInfo

    info = ListPortInfo("COM3")
    info.vid, info.pid, info.serial_number = 0x0403, 0x6014, "FT4THVLX"
    info.manufacturer, info.product = "FTDI", "USB <-> Serial Converter"
    found = of_pyserial(info)
    assert (found.path, found.chip, found.usb) == ("COM3", "FT232H", True)
    assert found.device == "FTDI USB <-> Serial Converter, serial FT4THVLX"
    bare = of_pyserial(ListPortInfo("/dev/cu.debug"))
    assert (bare.chip, bare.usb, bare.device) == ("", False, "")


def test_this_machines_own_ports_can_be_listed() -> None:
    assert all(info.path.startswith("/dev/") for info in ports())


# --- how it is shown ---------------------------------------------------------------------------

FTDI = PortInfo(
    "/dev/ttyUSB0",
    "ftdi_sio",
    "FT232R",
    0x0403,
    0x6001,
    "FTDI",
    "FT232R USB UART",
    "A6008isP",
    "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A6008isP-if00-port0",
    16,
    READY,
    "dialout",
    (Holder(4021, "python3"),),
    all_seen=True,
)
NATIVE = PortInfo("/dev/ttyS0", "serial", "16550A", access=REFUSED, group="dialout", all_seen=True)
CH340 = PortInfo("/dev/ttyUSB1", "ch341-uart", "CH340", 0x1A86, 0x7523, "", "USB2.0-Serial")


def test_the_table_at_80_columns() -> None:
    assert lines([FTDI, CH340, NATIVE], 80) == [
        "port          chip    driver      timer  state",
        "/dev/ttyUSB0  FT232R  ftdi_sio    16 ms  open in python3 (4021)",
        "    FTDI FT232R USB UART, serial A6008isP",
        "    /dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A6008isP-if00-port0",
        "/dev/ttyUSB1  CH340   ch341-uart  -      free?",
        "    USB2.0-Serial",
        "/dev/ttyS0    16550A  serial      -      no permission",
        "",
        "no permission: sudo usermod -aG dialout $USER, then log in again",
        "timer 16 ms: `sniffer doctor /dev/ttyUSB0` tells how to lower it",
        "free?: programs of other users cannot be seen without root",
    ]


def test_the_table_at_140_columns() -> None:
    table = lines([FTDI, CH340], 140)
    assert all(len(line) <= 140 for line in table)
    row = "/dev/ttyUSB0  FT232R  ftdi_sio    0403:6001  16 ms  open in python3 (4021)"
    assert table[:4] == [
        "port          chip    driver      usb        timer  state                   adapter",
        f"{row}  FTDI FT232R USB UART, serial A6008isP",
        "    /dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A6008isP-if00-port0",
        "/dev/ttyUSB1  CH340   ch341-uart  1a86:7523  -      free?                   USB2.0-Serial",
    ]


def test_no_port_is_no_mistake_and_says_what_to_do(capsys: Capsys) -> None:
    show([], "text")
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("sniffer: no serial port")
    assert "sniffer simulate" in err


def test_ports_as_json_lines(capsys: Capsys) -> None:
    show([FTDI, NATIVE], "jsonl")
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert (first["type"], first["path"], first["vendor_id"]) == ("port", "/dev/ttyUSB0", "0403")
    assert first["holders"] == [{"pid": 4021, "name": "python3"}]
    assert (second["vendor_id"], second["stable"], second["latency_ms"]) == (None, None, None)


@pytest.mark.parametrize("arguments", [[], ["--format", "jsonl"]], ids=str)
def test_the_command_lists_this_machine(arguments: list[str]) -> None:
    assert CliRunner().invoke(command, arguments).exit_code == 0
