"""USB requests, as the captures of Linux and of Windows have them.

Sources: Documentation/usb/usbmon.rst of Linux (``struct usbmon_packet``), and for Windows the
capture format of USBPcap, desowin.org/usbpcap/captureformat.html.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.pcapfile.layout import USB_LINUX_MMAPPED, USB_WINDOWS

if TYPE_CHECKING:
    from sniffer.pcapfile.reader import CapturedPacket

CONTROL, BULK = 2, 3

SUBMITTED, COMPLETE = "S", "C"

_WINDOWS: Final = struct.Struct("<HQIHBHHBBI")
"""Size of the head, request, status, function, info, bus, device, endpoint, transfer, data. Always
with the low byte first, whatever the file has."""

_CAME_BACK: Final = 1
"""Bit of ``info``: from the host controller, so complete."""

SETUP, DATA = 0, 1
"""Stages of a control transfer, told behind the head. Later versions of USBPcap give what is sent
to a device right behind the setup, older ones in a packet of its own."""

SETUP_SIZE: Final = 8

_IN: Final = 0x80

WAITING_MOST: Final = 64
"""Setups that wait for what is sent with them at most."""


class Urb(NamedTuple):
    """A USB request: submitted (``S``) or complete (``C``).

    ``length`` is what was transferred where it has data, else what there would be room for.
    """

    number: int
    kind: str
    transfer: int
    endpoint: int
    device: str
    setup: bytes
    length: int
    data: bytes
    t_ns: int | None


class Urbs:
    """Reads the requests of a capture."""

    def __init__(self) -> None:
        self._setups: dict[int, bytes] = {}

    def of(self, packet: CapturedPacket) -> Urb | None:
        """Return the request of a packet; None where it tells none, or is cut in its head."""
        if packet.face.link == USB_WINDOWS:
            return self._of_windows(packet)
        return _of_linux(packet)

    def _of_windows(self, packet: CapturedPacket) -> Urb | None:
        data = packet.data
        if len(data) < _WINDOWS.size:
            return None
        size, number, _, _, info, bus, device, endpoint, transfer, length = _WINDOWS.unpack_from(
            data
        )
        if not _WINDOWS.size <= size <= len(data):
            return None
        kind = COMPLETE if info & _CAME_BACK else SUBMITTED
        setup, payload = b"", data[size:]
        if transfer == CONTROL and kind == SUBMITTED:
            if size == _WINDOWS.size:
                return None  # it tells no stage
            told = self._staged(number, data[_WINDOWS.size], payload)
            if told is None:
                return None
            setup, payload = told
            length = len(payload)
        return Urb(
            number,
            kind,
            transfer,
            endpoint,
            f"{bus}.{device}",
            setup,
            length,
            payload,
            packet.t_ns,
        )

    def _staged(self, number: int, stage: int, payload: bytes) -> tuple[bytes, bytes] | None:
        """Return a setup and what is sent with it, once both are known."""
        if stage == SETUP and len(payload) >= SETUP_SIZE:
            setup, sent = payload[:SETUP_SIZE], payload[SETUP_SIZE:]
            more = int.from_bytes(setup[-2:], "little")
            if setup[0] & _IN or sent or not more:
                return setup, sent
            if len(self._setups) == WAITING_MOST:
                self._setups.clear()
            self._setups[number] = setup
        elif stage == DATA and number in self._setups:
            return self._setups.pop(number), payload
        return None


def _of_linux(packet: CapturedPacket) -> Urb | None:
    head = 64 if packet.face.link == USB_LINUX_MMAPPED else 48
    data = packet.data
    if len(data) < head:
        return None
    order = packet.face.order
    number, kind, transfer, endpoint, device, bus, setup, _ = struct.unpack_from(
        f"{order}QBBBBHBB", data
    )
    (length,) = struct.unpack_from(f"{order}I", data, 32)
    asked = data[40:48] if setup == 0 and transfer == CONTROL else b""
    payload = data[head:]
    return Urb(
        number,
        chr(kind),
        transfer,
        endpoint,
        f"{bus}.{device}",
        asked,
        length,
        payload,
        packet.t_ns,
    )
