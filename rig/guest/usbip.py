"""Plug a software adapter into the guest: the vhci_hcd module, and this in place of its server.

    python3 -m rig.guest.usbip ftdi|cp210x|copy|ch341|pl2303|acm /tmp/orders SERIAL

Attaches one adapter and takes orders, one a line, from a named pipe:
    data HEX            the line says these bytes
    error KINDS HEX     the same, in one packet with line status: any of F P B O
    pull                unplug
What the driver asks of it is written to standard output, and ``SENT`` with what it sends. Messages
are those of Documentation/usb/usbip_protocol of Linux.
"""

from __future__ import annotations

import os
import selectors
import socket
import struct
import subprocess
import sys
from pathlib import Path
from typing import Final

from rig.guest.adapters import KINDS, Adapter

HEAD: Final = struct.Struct(">5I")
VHCI: Final = Path("/sys/devices/platform/vhci_hcd.0")
UNLINK: Final = 2
UNLINKED: Final = -104  # ECONNRESET: it was still waiting
STALLED: Final = -32  # EPIPE
HIGH_SPEED: Final = 2
FREE: Final = "004"


class Gone(Exception):
    """The kernel has let go of the adapter."""


class Plug:
    """An adapter in a virtual socket."""

    def __init__(self, adapter: Adapter) -> None:
        self.adapter = adapter
        self.waiting: dict[int, list[tuple[int, int]]] = {}
        """By endpoint: number and length of the transfers that nothing has come for."""
        self.socket, kernels = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        rows = map(str.split, (VHCI / "status").read_text().splitlines())
        self.port = next(int(row[1]) for row in rows if row[0] == "hs" and row[2] == FREE)
        number = 0x10000 + self.port + 1
        told = f"{self.port} {kernels.fileno()} {number} {HIGH_SPEED}"
        (VHCI / "attach").write_text(told)
        kernels.close()

    def pull(self) -> None:
        """Unplug it."""
        (VHCI / "detach").write_text(str(self.port))

    def serve(self) -> None:
        """Take one message of the kernel's."""
        head = self._exactly(48)
        command, number, _, is_in, end = HEAD.unpack(head[:20])
        if command == UNLINK:
            self._unlink(number, int.from_bytes(head[20:24], "big"))
            return
        length = int.from_bytes(head[24:28], "big")
        data = b"" if is_in else self._exactly(length)
        if end == 0:
            told = self.adapter.control(head[40:48], data)
            if told is None:
                self._answer(number, status=STALLED)
            else:
                self._answer(number, told[:length] if is_in else b"", None if is_in else length)
        elif is_in:
            self.waiting.setdefault(end, []).append((number, length))
            self.pump()
        else:
            print(f"SENT {data.hex(' ')}", flush=True)
            self._answer(number, size=length)

    def pump(self) -> None:
        """Hand over what is there to the transfers that wait for it."""
        for end, packets in self.adapter.ready.items():
            while packets and self.waiting.get(end):
                number, length = self.waiting[end].pop(0)
                self._answer(number, packets.pop(0)[:length])

    def _unlink(self, number: int, unlinked: int) -> None:
        found = False
        for waiting in self.waiting.values():
            for one in [w for w in waiting if w[0] == unlinked]:
                waiting.remove(one)
                found = True
        status = struct.pack(">i24x", UNLINKED if found else 0)
        self.socket.sendall(HEAD.pack(4, number, 0, 0, 0) + status)

    def _answer(
        self, number: int, data: bytes = b"", size: int | None = None, status: int = 0
    ) -> None:
        size = len(data) if size is None else size
        body = struct.pack(">iIIII8x", status, size, 0, 0, 0)
        self.socket.sendall(HEAD.pack(3, number, 0, 0, 0) + body + data)

    def _exactly(self, size: int) -> bytes:
        data = b""
        while len(data) < size:
            more = self.socket.recv(size - len(data))
            if not more:
                raise Gone
            data += more
        return data


def obey(plug: Plug, line: str) -> bool:
    """Do what an order says; return whether it was the last one."""
    word, *words = line.split(" ")
    if word == "data":
        plug.adapter.say(bytes.fromhex(words[0]))
    elif word == "error":
        plug.adapter.say(bytes.fromhex(words[1]), words[0])
    elif word == "pull":
        plug.pull()
        return True
    plug.pump()
    return False


def main() -> None:
    """Plug in, serve and obey until it is pulled."""
    kind, name, serial = sys.argv[1:]
    subprocess.run(["modprobe", "vhci_hcd"], check=True)
    plug = Plug(KINDS[kind](serial))
    if not Path(name).exists():
        os.mkfifo(name)
    orders = os.open(name, os.O_RDWR | os.O_NONBLOCK)
    with selectors.DefaultSelector() as selector:
        selector.register(plug.socket, selectors.EVENT_READ)
        selector.register(orders, selectors.EVENT_READ)
        while True:
            for key, _ in selector.select():
                if key.fileobj is plug.socket:
                    plug.serve()
                elif any(obey(plug, line) for line in os.read(orders, 65536).decode().split("\n")):
                    return


if __name__ == "__main__":
    try:
        main()
    except Gone:
        sys.exit("the kernel let go of it")
