"""A virtual machine with serial ports whose other ends are in our hands."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import shlex
import shutil
import socket
import subprocess
import threading
import time
from typing import IO, TYPE_CHECKING, Any, Final

from rig.wire import Wire

if TYPE_CHECKING:
    from pathlib import Path

PATIENCE_S: Final = 120.0
"""How long anything in the guest is waited for: its processor is translated, and ours is shared."""

BOOT_S: Final = 600.0

WIRES: Final = ("isa1", "isa2", "pci1", "ftdi1", "ftdi2")
"""ttyS1, ttyS2, ttyS4, and two adapters."""

PLUGGED: Final = "usb-serial,bus=usb.0,always-plugged=on"
ADAPTER: Final = {"driver": "usb-serial", "bus": "usb.0", "always_plugged": True}

EVENTS: Final = (
    *("serial_write", "serial_update_parameters", "usb_serial_handle_control"),
    *("usb_serial_set_baud", "usb_serial_set_data", "usb_serial_set_flow_control"),
    *("usb_serial_reset", "usb_serial_unsupported_control"),
)
"""What QEMU writes down: the real line, for nothing. strace in the guest costs 19 CPU-s a run."""

CMDLINE: Final = (
    "console=ttyS0 quiet loglevel=3 mitigations=off tsc=reliable nokaslr no_timer_check "
    "random.trust_cpu=on audit=0 systemd.show_status=0 8250.nr_uarts=8 net.ifnames=0 "
    "systemd.journald.forward_to_console=0 usbcore.autosuspend=-1"
)

Told = dict[str, Any]


class Machine:
    """The booted guest. Use it with ``with``.

    Args:
        image: the folder with kernel, initrd and disk.
        run: a folder for sockets and logs, emptied first.
        source: the checkout that is tried.
        init: what the kernel starts; ``/lib/systemd/systemd`` boots all of Debian.
    """

    def __init__(self, image: Path, run: Path, source: Path, *, init: str = "/opt/init") -> None:
        self.dir = run
        shutil.rmtree(run, ignore_errors=True)
        run.mkdir(parents=True)
        self.wires = {name: Wire(run / f"{name}.sock") for name in WIRES}
        self.not_loaded = ""
        self._ids = 0
        self._answers: dict[int, Told] = {}
        self._here = threading.Condition()
        self._ready = threading.Event()
        self._qmp_lock = threading.Lock()
        (run / "events").write_text("\n".join(EVENTS) + "\n")
        self._process = subprocess.Popen(
            self._command(image, source, init),
            stdin=subprocess.DEVNULL,
            stderr=(run / "stderr").open("w"),
        )
        try:
            self._agent = self._connect("agent.sock")
            self._qmp: IO[str] = self._connect("qmp.sock").makefile("rw")
            self._qmp.readline()
            self.qmp("qmp_capabilities")
            threading.Thread(target=self._hear, daemon=True).start()
            for wire in self.wires.values():
                wire.plug()
        except BaseException:
            self.close()
            raise

    def _command(self, image: Path, source: Path, init: str) -> list[str]:
        run = self.dir
        command = [
            *("qemu-system-x86_64", "-nodefaults", "-no-user-config", "-display", "none"),
            *("-no-reboot", "-nic", "none", "-accel", "tcg,thread=multi"),
            # numpy's wheels want a newer processor; with five levels of pages it does not boot
            *("-cpu", "max,la57=off", "-smp", "2", "-m", "768"),
            *("-kernel", f"{image}/vmlinuz", "-initrd", f"{image}/initrd"),
            *("-append", f"{CMDLINE} rig.init={init}"),
            *("-drive", f"file={image}/disk.img,if=none,id=disk,format=raw,snapshot=on"),
            *("-device", "virtio-blk-pci,drive=disk", "-object", "rng-builtin,id=rng"),
            *("-device", "virtio-rng-pci,rng=rng"),
            *("-chardev", f"file,id=console,path={run}/console.log"),
            *("-device", "isa-serial,chardev=console,index=0", "-device", "virtio-serial-pci"),
            *("-chardev", f"socket,id=agent,path={run}/agent.sock,server=on,wait=off"),
            *("-device", "virtserialport,chardev=agent,name=rig"),
            *("-fsdev", f"local,id=src,path={source},security_model=none,readonly=on"),
            *("-device", "virtio-9p-pci,fsdev=src,mount_tag=src", "-device", "qemu-xhci,id=usb"),
            *("-qmp", f"unix:{run}/qmp.sock,server=on,wait=off"),
            *("-D", f"{run}/qemu.log", "-trace", f"events={run}/events"),
        ]
        for name in WIRES:
            command += ["-chardev", f"socket,id={name},path={run}/{name}.sock,server=on,wait=off"]
        return [
            *command,
            *("-device", "isa-serial,chardev=isa1,index=1"),
            *("-device", "isa-serial,chardev=isa2,index=2"),
            *("-device", "pci-serial,chardev=pci1"),
            *("-device", f"{PLUGGED},chardev=ftdi1,id=adapter1,serial=A6008isP"),
        ]

    # --- the machine itself ----------------------------------------------------------------------

    def wait_up(self) -> None:
        """Wait until the guest obeys."""
        until = time.monotonic() + BOOT_S
        while not self._ready.wait(0.2):
            if self._process.poll() is not None or time.monotonic() > until:
                raise RuntimeError(f"the guest did not come up; see {self.dir}")

    def cpu_s(self) -> float:
        """Return how many seconds of processor time the machine has taken."""
        with open(f"/proc/{self._process.pid}/stat") as told:  # noqa: PTH123
            stat = told.read().rpartition(")")[2].split()
        return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")

    def qmp(self, command: str, **arguments: object) -> object:
        """Give QEMU an order."""
        with self._qmp_lock:
            named = {key.replace("_", "-"): value for key, value in arguments.items()}
            self._qmp.write(json.dumps({"execute": command, "arguments": named}) + "\n")
            self._qmp.flush()
            while True:
                told = json.loads(self._qmp.readline())
                if "error" in told:
                    raise RuntimeError(f"{command}: {told['error']['desc']}")
                if "return" in told:
                    return told["return"]

    def plug_in(
        self, name: str = "adapter1", wire: str = "ftdi1", serial: str = "A6008isP"
    ) -> None:
        """Plug an FTDI adapter in."""
        self.qmp("device_add", **ADAPTER, id=name, chardev=wire, serial=serial)

    def pull_out(self, name: str = "adapter1") -> None:
        """Pull an adapter out."""
        self.qmp("device_del", id=name)

    def trace(self) -> list[str]:
        """Return QEMU's trace so far."""
        with contextlib.suppress(OSError):
            return (self.dir / "qemu.log").read_text(errors="replace").splitlines()
        return []

    # --- what the guest is told ------------------------------------------------------------------

    def start(self, text: str, timeout: float = PATIENCE_S) -> int:
        """Begin to run shell text in the guest; ``result`` waits for its end."""
        return self._ask({"run": text, "timeout": timeout})

    def sniff(self, *words: str, timeout: float = PATIENCE_S, user: str = "") -> int:
        """Begin to run ``sniffer``."""
        return self._ask({"sniffer": list(words), "timeout": timeout, "user": user})

    def result(self, number: int, timeout: float = 2 * PATIENCE_S) -> Told:
        """Wait for what was begun; return its status, output and errors."""
        with self._here:
            if not self._here.wait_for(lambda: number in self._answers, timeout):
                raise TimeoutError(f"guest command {number}")
            return self._answers.pop(number)

    def sniffed(self, *words: str, user: str = "") -> Told:
        """Run ``sniffer``."""
        return self.result(self.sniff(*words, user=user))

    def run(self, text: str) -> Told:
        """Run shell text in the guest."""
        return self.result(self.start(text))

    def sh(self, text: str) -> str:
        """Run shell text in the guest; return what it printed, errors too."""
        told = self.run(text)
        return str(told["out"] + told["err"]).strip()

    def until(self, text: str) -> str:
        """Wait until shell text succeeds in the guest; return its output."""
        end = time.monotonic() + PATIENCE_S
        while True:
            told = self.run(text)
            if told["rc"] == 0:
                return str(told["out"])
            if time.monotonic() > end:
                raise TimeoutError(f"{text}: {told}")
            time.sleep(0.2)

    def tell(self, number: int, signal: str) -> None:
        """Send a signal to a ``sniffer`` that was begun."""
        self.sh(f"kill -{signal} $(cat /tmp/pid.{number})")

    def fetch(self, path: str) -> bytes:
        """Return a file of the guest."""
        return base64.b64decode(self.run(f"base64 {shlex.quote(path)}")["out"])

    def _ask(self, asked: Told) -> int:
        self._ids += 1
        self._agent.sendall(json.dumps({"id": self._ids, **asked}).encode() + b"\n")
        return self._ids

    def _hear(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            for line in self._agent.makefile():
                told = json.loads(line)
                if "ready" in told:
                    self.not_loaded = told["ready"]
                    self._ready.set()
                    continue
                with self._here:
                    self._answers[told["id"]] = told
                    self._here.notify_all()

    def _connect(self, name: str) -> socket.socket:
        until = time.monotonic() + PATIENCE_S
        while True:
            one = socket.socket(socket.AF_UNIX)
            try:
                one.connect(str(self.dir / name))
                return one
            except OSError:
                one.close()
                if self._process.poll() is not None or time.monotonic() > until:
                    raise RuntimeError((self.dir / "stderr").read_text()) from None
                time.sleep(0.05)

    def close(self) -> None:
        """Switch it off."""
        for wire in self.wires.values():
            with contextlib.suppress(OSError):
                wire.unplug()
        self._process.terminate()
        try:
            self._process.wait(5)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def __enter__(self) -> Machine:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
