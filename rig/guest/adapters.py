"""USB serial adapters as their drivers know them: descriptors, answers, bytes and line errors.

Numbers are those of USB 2.0's chapter 9 and of what the drivers in drivers/usb/serial and
drivers/usb/class/cdc-acm.c of Linux ask and take.
"""

from __future__ import annotations

import struct
from typing import Final

Class = tuple[int, int, int]
VENDOR: Final[Class] = (255, 0, 0)
IN: Final = 0x80
"""The bit of a request that wants data."""


def string(text: str) -> bytes:
    """Return a string descriptor."""
    data = text.encode("utf-16-le")
    return bytes([len(data) + 2, 3]) + data


def endpoint(address: int, kind: int, size: int, interval: int = 0) -> bytes:
    """Return an endpoint descriptor; kind 2 is bulk, 3 interrupt."""
    return struct.pack("<BBBBHB", 7, 5, address, kind, size, interval)


def interface(
    number: int, endpoints: list[bytes], cls: Class = VENDOR, extra: bytes = b""
) -> bytes:
    """Return an interface descriptor with all that belongs to it."""
    head = struct.pack("<9B", 9, 4, number, 0, len(endpoints), *cls, 2)
    return head + extra + b"".join(endpoints)


def bits(errors: str, **of: int) -> int:
    """Return the bits of the errors that are named: F(raming), P(arity), B(reak), O(verrun)."""
    return sum(bit for letter, bit in of.items() if letter in errors)


class Adapter:
    """An FT232R; the others differ in what they answer and how they tell of errors.

    ``ready`` holds what waits to be fetched from each endpoint.
    """

    ids: tuple[int, int] = (0x0403, 0x6001)
    version = 0x0600
    cls = 0
    names = ("FTDI", "FT232R USB UART")

    def __init__(self, serial: str) -> None:
        self.serial = serial
        self.ready: dict[int, list[bytes]] = {}
        self.timer = 16

    def interfaces(self) -> list[bytes]:
        """Return the interface descriptors."""
        return [interface(0, [endpoint(0x81, 2, 64), endpoint(0x02, 2, 64)])]

    def descriptor(self, kind: int, index: int) -> bytes | None:
        """Return the descriptor of the device, its configuration, or a string."""
        if kind == 1:
            numbers = (*self.ids, self.version, 1, 2, 3, 1)
            return struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, self.cls, 0, 0, 8, *numbers)
        if kind == 2:
            parts = self.interfaces()
            body = b"".join(parts)
            size = 9 + len(body)
            return struct.pack("<BBHBBBBB", 9, 2, size, len(parts), 1, 0, 0xA0, 45) + body
        if kind != 3 or index > 3:
            return None
        return b"\x04\x03\x09\x04" if index == 0 else string((*self.names, self.serial)[index - 1])

    def control(self, setup: bytes, data: bytes) -> bytes | None:
        """Answer a control transfer; None: with a stall."""
        kind, request, value, index, length = struct.unpack("<BBHHH", setup)
        nothing = bytes(length) if kind & IN else b""
        if kind & 0x60 == 0:
            return self.descriptor(value >> 8, value & 0xFF) if request == 6 else nothing
        detail = data.hex() or (f"asks {length}" if kind & IN else "")
        print(
            f"control {kind:02x} {request:02x} value {value:04x} index {index:04x} {detail}",
            flush=True,
        )
        answer = self.answer(kind, request, value, length)
        return nothing if answer is None else answer

    def answer(self, kind: int, request: int, value: int, length: int) -> bytes | None:
        """Answer what only this chip is asked; None: with zeros."""
        if (kind, request) == (0xC0, 0x0A):
            return bytes([self.timer])
        if (kind, request) == (0x40, 0x09):
            self.timer = value & 0xFF
        return b"\xb1\x60" if (kind, request) == (0xC0, 0x05) else None

    def put(self, at: int, data: bytes, size: int, head: bytes = b"") -> None:
        """Let data wait in packets of a size, each with the same head."""
        for begun in range(0, len(data) or 1, size):
            self.ready.setdefault(at, []).append(head + data[begun : begun + size])

    def say(self, data: bytes, errors: str = "") -> None:
        """Let the line say this; every packet begins with modem and line status."""
        self.put(1, data, 62, bytes([0xB1, 0x60 | bits(errors, O=2, P=4, F=8, B=16)]))


class Cp210x(Adapter):
    """A CP2102: errors are inserted into the stream, if the driver has asked for that."""

    ids, version = (0x10C4, 0xEA60), 0x0100
    names = ("Silicon Labs", "CP2102 USB to UART Bridge Controller")
    part = b"\x02\x00"
    escape = 0

    def interfaces(self) -> list[bytes]:
        """Return the interface descriptors."""
        return [interface(0, [endpoint(0x81, 2, 64), endpoint(0x01, 2, 64)])]

    def answer(self, kind: int, request: int, value: int, length: int) -> bytes | None:
        """Answer what only this chip is asked."""
        if request == 0xFF and value == 0x370B:
            return self.part[:length]
        if request == 0x15:
            self.escape = value & 0xFF
        return b"\x33" if request == 0x08 else None

    def say(self, data: bytes, errors: str = "") -> None:
        """Let the line say this."""
        out = b""
        status = bits(errors, O=2, P=4, F=8, B=16)
        for byte in data:
            if self.escape and errors:
                out += bytes([self.escape, 1, status, byte])
            elif self.escape and byte == self.escape:
                out += bytes([byte, 0])
            else:
                out += bytes([byte])
        self.put(1, out, 60)


class Copy(Cp210x):
    """A copy of it: it answers with one byte for its part number, and tells of no error."""

    part = b"\x02"


class Ch341(Adapter):
    """A CH340: errors come by an endpoint of their own, which nobody reads for that."""

    ids, version, cls = (0x1A86, 0x7523), 0x0263, 255
    names = ("", "USB Serial")

    def interfaces(self) -> list[bytes]:
        """Return the interface descriptors."""
        ends = [endpoint(0x82, 2, 32), endpoint(0x02, 2, 32), endpoint(0x81, 3, 8, 1)]
        return [interface(0, ends, (255, 1, 2))]

    def answer(self, kind: int, request: int, value: int, length: int) -> bytes | None:
        """Answer what only this chip is asked."""
        if request == 0x5F:
            return b"\x31\x00"
        return b"\xff\xee"[:length] if (request, value) == (0x95, 0x0706) else None

    def say(self, data: bytes, errors: str = "") -> None:
        """Let the line say this."""
        self.put(2, data, 32)
        if errors:
            self.ready.setdefault(1, []).append(b"\x08\x00\xff\xee")


class Pl2303(Adapter):
    """A PL2303: the line's state comes by an endpoint of its own."""

    ids, version = (0x067B, 0x2303), 0x0300
    names = ("Prolific Technology Inc.", "USB-Serial Controller")

    def interfaces(self) -> list[bytes]:
        """Return the interface descriptors."""
        ends = [endpoint(0x81, 3, 10, 1), endpoint(0x02, 2, 64), endpoint(0x83, 2, 64)]
        return [interface(0, ends)]

    def say(self, data: bytes, errors: str = "") -> None:
        """Let the line say this."""
        if errors:
            state = 3 | bits(errors, B=4, F=16, P=32, O=64)
            told = bytes.fromhex("a1200000000002") + bytes([0, state, 0])
            self.ready.setdefault(1, []).append(told)
        self.put(3, data, 64)


class Acm(Adapter):
    """A microcontroller's own port, whose firmware tells of errors (most do not)."""

    ids, version, cls = (0x2341, 0x0043), 0x0001, 2
    names = ("Arduino", "Uno")

    def interfaces(self) -> list[bytes]:
        """Return the interface descriptors."""
        extra = bytes.fromhex("0524001001 04240206 0524060001 0524010001")
        return [
            interface(0, [endpoint(0x82, 3, 16, 16)], (2, 2, 1), extra),
            interface(1, [endpoint(0x81, 2, 64), endpoint(0x01, 2, 64)], (10, 0, 0)),
        ]

    def answer(self, kind: int, request: int, value: int, length: int) -> bytes | None:
        """Answer what only such a device is asked: its line coding."""
        return struct.pack("<IBBB", 9600, 0, 0, 8) if request == 0x21 else None

    def say(self, data: bytes, errors: str = "") -> None:
        """Let the line say this."""
        if errors:
            state = struct.pack("<H", 3 | bits(errors, B=4, F=16, P=32, O=64))
            self.ready.setdefault(2, []).append(bytes.fromhex("a120000000000200") + state)
        self.put(1, data, 64)


KINDS: Final[dict[str, type[Adapter]]] = {
    "ftdi": Adapter,
    "cp210x": Cp210x,
    "copy": Copy,
    "ch341": Ch341,
    "pl2303": Pl2303,
    "acm": Acm,
}
