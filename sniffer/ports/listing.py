"""Which serial ports there are, what stands behind each of them, and who has it open.

Nothing is opened for that: on Linux it is all in sysfs and procfs. On other systems pySerial says
what it knows.
"""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

CHIPS: Final[Mapping[tuple[int, int], str]] = MappingProxyType(
    {
        (0x0403, 0x6001): "FT232R",  # the older FT232B and 8U232AM have the same number
        (0x0403, 0x6010): "FT2232",
        (0x0403, 0x6011): "FT4232H",
        (0x0403, 0x6014): "FT232H",  # in the U2D2 too
        (0x0403, 0x6015): "FT-X",  # FT230X, FT231X, FT234X
        (0x10C4, 0xEA60): "CP2102",  # CP2103, CP2104, CP2109 and CP2102N too
        (0x10C4, 0xEA70): "CP2105",
        (0x10C4, 0xEA71): "CP2108",
        (0x1A86, 0x7523): "CH340",
        (0x1A86, 0x7522): "CH340K",
        (0x1A86, 0x5523): "CH341",
        (0x4348, 0x5523): "CH341",
        (0x1A86, 0x55D2): "CH342",
        (0x1A86, 0x55D3): "CH343",
        (0x1A86, 0x55D4): "CH9102",
        (0x067B, 0x2303): "PL2303",
        (0x067B, 0x23A3): "PL2303GC",
        (0x067B, 0x23B3): "PL2303GB",
        (0x067B, 0x23C3): "PL2303GT",
        (0x067B, 0x23D3): "PL2303GL",
        (0x067B, 0x23E3): "PL2303GE",
        (0x067B, 0x23F3): "PL2303GS",
    }
)
"""Chips by USB vendor and product, from the id tables of Linux' drivers (ftdi_sio, cp210x, ch341,
pl2303) and of WCH's own; a maker may have given a chip numbers of his own."""

CDC: Final = "CDC ACM"
"""A device that is a serial port by USB's own class: a microcontroller, mostly."""

UARTS: Final[Mapping[int, str]] = MappingProxyType(
    {1: "8250", 2: "16450", 3: "16550", 4: "16550A", 32: "PL011"}
)
"""UARTs on board by the kernel's number (PORT_... in linux/serial_core.h); 0 is: none there."""

READY: Final = "ready"
REFUSED: Final = "no permission"
MISSING: Final = "no device node"

_BETWEEN: Final = "serial-base"
"""The bus that newer kernels put between a UART and its tty; its drivers say nothing."""


@dataclass(frozen=True, slots=True)
class Holder:
    """A program that has a port open."""

    pid: int
    name: str


@dataclass(frozen=True, slots=True)
class PortInfo:
    """One serial port; texts are empty and numbers None where nothing is known.

    ``stable`` is a name that stays when adapters are plugged in another order. ``latency_ms`` is
    the adapter's timer; None where it has none. ``group`` may read the port. ``holders`` are the
    programs that have it open, as far as we may see; ``all_seen`` tells whether we saw all.
    """

    path: str
    driver: str = ""
    chip: str = ""
    vendor_id: int | None = None
    product_id: int | None = None
    manufacturer: str = ""
    product: str = ""
    serial: str = ""
    stable: str = ""
    latency_ms: int | None = None
    access: str = READY
    group: str = ""
    holders: tuple[Holder, ...] = ()
    all_seen: bool = False

    @property
    def usb(self) -> bool:
        """Whether it is an adapter on USB."""
        return self.vendor_id is not None

    @property
    def device(self) -> str:
        """What its maker calls it."""
        maker = "" if self.product.startswith(self.manufacturer) else self.manufacturer
        told = " ".join(word for word in (maker, self.product) if word)
        if not self.serial:
            return told
        return f"{told}, serial {self.serial}" if told else f"serial {self.serial}"


def ports(root: Path = Path("/")) -> list[PortInfo]:
    """Return the serial ports that have hardware behind them, adapters on USB first.

    Args:
        root: where ``sys``, ``proc`` and ``dev`` are.
    """
    if not sys.platform.startswith("linux") and root == Path("/"):
        from serial.tools import list_ports

        return sorted((of_pyserial(found) for found in list_ports.comports()), key=_order)
    devices = _devices(root)
    holders, all_seen = _holders(root, {f"/dev/{name}" for name in devices})
    stable = _stable(root)
    out = [
        _described(root, name, device, stable.get(name, ""), holders, all_seen=all_seen)
        for name, device in devices.items()
    ]
    return sorted(out, key=_order)


def port_at(path: str, root: Path = Path("/")) -> PortInfo | None:
    """Return what is known about one port, by any of its names; None where it is none of ours."""
    real = os.path.realpath(path) if root == Path("/") else path
    return next((info for info in ports(root) if path == info.path or real == info.path), None)


def holders_of(path: str, root: Path = Path("/")) -> tuple[tuple[Holder, ...], bool]:
    """Return who has a pseudo terminal open, and whether every program could be looked into.

    A program that has its other end is no reader of it, though it may hold this end open, too.
    """
    found, all_seen = _holders(root, {path})
    number = path.rpartition("/")[2]
    rivals = [h for h in found.get(path, ()) if not _has_master(root / "proc" / str(h.pid), number)]
    return tuple(rivals), all_seen


def of_pyserial(found: Any) -> PortInfo:
    """Return a port as pySerial found it (its ``ListPortInfo``)."""
    known = found.vid is not None
    told = found.product or ("" if found.description in (None, "n/a") else found.description)
    return PortInfo(
        path=found.device,
        chip=CHIPS.get((found.vid, found.pid), "") if known else "",
        vendor_id=found.vid,
        product_id=found.pid,
        manufacturer=found.manufacturer or "",
        product=told,
        serial=found.serial_number or "",
    )


def _order(info: PortInfo) -> tuple[bool, list[tuple[str, int]]]:
    """Sort adapters first, then names, with numbers as numbers."""
    parts = re.findall(r"(\D+)(\d*)", info.path)
    return not info.usb, [(text, int(number or -1)) for text, number in parts]


def _devices(root: Path) -> dict[str, Path]:
    """Return the ttys with a device behind them; consoles and pseudo terminals have none."""
    out: dict[str, Path] = {}
    folder = root / "sys/class/tty"
    for entry in sorted(folder.iterdir()) if folder.is_dir() else ():
        device = entry / "device"
        if device.exists() and not _is_dead(entry, device.resolve()):
            out[entry.name] = device.resolve()
    return out


def _is_dead(entry: Path, device: Path) -> bool:
    """Tell whether this is one of the ports that the 8250 driver keeps ready without hardware."""
    kind = _line(entry / "type")
    if kind.isdecimal():
        return kind == "0"
    # older kernels show the type to root only; what no bus has found is most likely not there
    return (entry / "type").exists() and _driver(device) == "serial8250"


def _described(
    root: Path,
    name: str,
    device: Path,
    stable: str,
    holders: Mapping[str, list[Holder]],
    *,
    all_seen: bool,
) -> PortInfo:
    node = root / "dev" / name
    usb = _usb_device(device)
    ids = (_hex(usb / "idVendor"), _hex(usb / "idProduct")) if usb else (None, None)
    kind = _line(root / "sys/class/tty" / name / "type")
    driver = _driver(device)
    chip = UARTS.get(int(kind), "") if kind.isdecimal() else ""
    if ids[0] is not None and ids[1] is not None:
        chip = CHIPS.get((ids[0], ids[1]), CDC if driver == "cdc_acm" else "")
    timer = _line(device / "latency_timer")
    access = READY if os.access(node, os.R_OK) else REFUSED if node.exists() else MISSING
    return PortInfo(
        path=f"/dev/{name}",
        driver=driver,
        chip=chip,
        vendor_id=ids[0],
        product_id=ids[1],
        manufacturer=_line(usb / "manufacturer") if usb else "",
        product=_line(usb / "product") if usb else "",
        serial=_line(usb / "serial") if usb else "",
        stable=stable,
        latency_ms=int(timer) if timer.isdecimal() else None,
        access=access,
        group=_group(node),
        holders=tuple(holders.get(f"/dev/{name}", ())),
        all_seen=all_seen,
    )


def _line(path: Path) -> str:
    """Return the first line of one of the system's small files; nothing where there is none."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ""
    text = lines[0].strip() if lines else ""
    return text if text.isprintable() else ascii(text)[1:-1]


def _hex(path: Path) -> int | None:
    text = _line(path)
    return int(text, 16) if re.fullmatch("[0-9a-fA-F]{1,4}", text) else None


def _driver(device: Path) -> str:
    """Return the driver's name; where the kernel has put a bus of its own between, look behind."""
    while (device / "subsystem").resolve().name == _BETWEEN:
        device = device.parent
    driver = device / "driver"
    return driver.resolve().name if driver.exists() else ""


def _usb_device(device: Path) -> Path | None:
    """Return the USB device that this tty belongs to."""
    return next((up for up in (device, *device.parents) if (up / "idVendor").is_file()), None)


def _stable(root: Path) -> dict[str, str]:
    """Return for each tty the link that names the adapter by maker and serial number."""
    out: dict[str, str] = {}
    folder = root / "dev/serial/by-id"
    for link in sorted(folder.iterdir()) if folder.is_dir() else ():
        out.setdefault(link.resolve().name, f"/dev/serial/by-id/{link.name}")
    return out


def _group(node: Path) -> str:
    """Return the group that may read a port, if a group may."""
    import grp

    try:
        found = node.stat()
        return grp.getgrgid(found.st_gid).gr_name if found.st_mode & 0o040 else ""
    except (OSError, KeyError):
        return ""


def _holders(root: Path, paths: set[str]) -> tuple[dict[str, list[Holder]], bool]:
    """Return who has the ports open, and whether every program could be looked into."""
    out: dict[str, list[Holder]] = {}
    all_seen = True
    folder = root / "proc"
    numbers = (
        [int(p.name) for p in folder.iterdir() if p.name.isdecimal()]
        if paths and folder.is_dir()
        else []
    )
    for pid in sorted(numbers):
        try:
            files = list((folder / str(pid) / "fd").iterdir())
        except PermissionError:
            all_seen = all_seen and _is_over(folder / str(pid))
            continue
        except OSError:  # it ended meanwhile
            continue
        for path in paths & {_target(file) for file in files}:
            out.setdefault(path, []).append(Holder(pid, _line(folder / str(pid) / "comm")))
    return out, all_seen


def _has_master(process: Path, number: str) -> bool:
    """Tell whether a process has the master of this pseudo terminal (fdinfo's tty-index)."""
    try:
        return any(
            re.search(rf"^tty-index:\s*{number}$", info.read_text(encoding="utf-8"), re.MULTILINE)
            for info in (process / "fdinfo").iterdir()
        )
    except OSError:  # it ended meanwhile, or closed one
        return False


def _is_over(process: Path) -> bool:
    """Tell whether a process has ended and only waits to be noticed: it has nothing open."""
    state = _line(process / "stat").rpartition(")")[2].split()[:1]
    return state in ([], ["Z"], ["X"])


def _target(link: Path) -> str:
    try:
        return str(link.readlink())
    except OSError:  # closed meanwhile
        return ""
