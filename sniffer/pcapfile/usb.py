"""Adapters on USB, as Linux or Windows recorded it: what the controller's own one said and heard.

Bytes to the bus are those of a bulk transfer when it is submitted, bytes from it those of one that
is complete. FTDI's chips put two status bytes in front of each USB packet (AN232B-04, 2.2;
``ftdi_process_packet`` of Linux); others send bytes alone.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Final

from sniffer.ground.limits import BAUDS
from sniffer.ground.model import MS, Chunk, Clock, DamagedInputError, Direction, Mark, MarkKind
from sniffer.ground.timing import byte_time_ns
from sniffer.pcapfile.urbs import BULK, CONTROL, Urbs
from sniffer.ports.listing import CHIPS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.pcapfile.reader import CapturedPacket
    from sniffer.pcapfile.urbs import Urb

FTDI: Final = 0x0403

STATUS: Final = 2
"""Status bytes in front of each packet of an FTDI chip: modem lines and line errors."""

FULL_SPEED, HIGH_SPEED = 64, 512
"""Bytes of a USB packet at most, of chips of the two speeds."""

_HIGH: Final = frozenset({0x0700, 0x0800, 0x0900})  # FT2232H, FT4232H, FT232H (ftdi_sio.c)
_PORTED: Final = _HIGH | {0x0500}  # chips whose requests name a port: FT2232C, too

LOOK: Final = 8
"""Transfers that are looked at where no descriptor tells whose adapter it is."""

HELD_MOST: Final = 1 << 16
"""Bytes of transfers that wait for that at most; each counts for ``HELD_EACH`` more."""

HELD_EACH: Final = 64

DEVICES_MOST: Final = 256
"""Devices of a capture at most: a bus of USB has 127."""

ASKED_MOST: Final = 64
"""Requests for a descriptor that wait for their answer at most."""

TIMER_MS: Final = 16
"""How long an FTDI chip waits for a full packet, as it is delivered (AN232B-04, 2.1)."""

_CH34X: Final = frozenset({0x1A86, 0x4348})

_ERRORS: Final = (
    (0x02, MarkKind.OVERRUN),
    (0x04, MarkKind.PARITY),
    (0x08, MarkKind.FRAMING),
    (0x10, MarkKind.BREAK),
)
"""Bits of an FTDI chip's second status byte."""

_USUAL: Final = (
    *(4800, 9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000, 921600),
    *(1_000_000, 1_250_000, 1_500_000, 2_000_000, 3_000_000),
)
"""Rates that hosts ask for; a chip's divisor makes what is next to one."""

_NEXT: Final = 0.01

_EIGHTHS: Final = (0, 4, 2, 1, 3, 5, 6, 7)
"""What the fraction bits of an FTDI divisor mean (AN232B-05)."""


class UsbDevice:
    """One device of a capture: what it is, and the chunks of its bulk transfers."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.is_ftdi: bool | None = None
        self.how = ""
        self.baud: int | None = None
        self.timer_ms = TIMER_MS
        self.ids: tuple[int, int] | None = None
        self.buses: set[str] = set()
        self._release = 0
        self._packet = 0
        self._held: list[Urb] = []
        self._held_size = 0
        self._asked: set[int] = set()

    @property
    def latency_ns(self) -> int:
        """How long the adapter may hold bytes back."""
        if self.ids is not None and self.ids[0] in _CH34X:
            return 2 * MS
        return (self.timer_ms + 1) * MS  # of others that do not tell it is a guess

    @property
    def told(self) -> str:
        """What it is, in words."""
        chip = CHIPS.get(self.ids, "") if self.ids else ""
        chip = chip or (f"{self.ids[0]:04x}:{self.ids[1]:04x}" if self.ids else "")
        if self.is_ftdi:
            named = f"FTDI {chip}".strip()
            return (
                f"an adapter with {STATUS} status bytes a packet ({named}, by its {self.how}): "
                "they are left out"
            )
        return f"an adapter without status bytes ({chip or 'not FTDI'}, by its {self.how})"

    def take(self, urb: Urb) -> Iterator[Chunk]:
        """Yield the chunks that a request makes known."""
        if urb.transfer == CONTROL:
            self._control(urb)
            if self.is_ftdi is not None and self._held:
                yield from self._release_held()
            return
        if urb.transfer != BULK:
            return
        is_in = bool(urb.endpoint & 0x80)
        if urb.kind != ("C" if is_in else "S") or not (urb.data or urb.length):
            return
        if self.is_ftdi is None:
            self._held.append(urb)
            self._held_size += len(urb.data) + HELD_EACH
            self._look()
            if self.is_ftdi is not None:
                yield from self._release_held()
            return
        yield from self._chunks(urb)

    def end(self) -> Iterator[Chunk]:
        """Yield what still waits to be told what device it is of."""
        if self.is_ftdi is None and self._held:
            self._look(is_end=True)
        yield from self._release_held()

    def _release_held(self) -> Iterator[Chunk]:
        held, self._held = self._held, []
        for urb in held:
            yield from self._chunks(urb)

    def _control(self, urb: Urb) -> None:
        if urb.kind == "C" and urb.number in self._asked:
            self._asked.remove(urb.number)
            if len(urb.data) >= 14 and urb.data[1] == 1:  # a device descriptor (USB 2.0, 9.6.1)
                vendor, product, self._release = struct.unpack_from("<HHH", urb.data, 8)
                self.ids = (vendor, product)
                if not self.buses:
                    self.is_ftdi, self.how = vendor == FTDI, "descriptor"
        if urb.kind != "S" or len(urb.setup) < 8:
            return
        to, request, value, index, _ = struct.unpack("<BBHHH", urb.setup)
        if (to, request, value >> 8) == (0x80, 6, 1):
            if len(self._asked) == ASKED_MOST:
                self._asked.clear()
            self._asked.add(urb.number)
        elif (to, request) in ((0x21, 0x20), (0x41, 0x1E)) and len(urb.data) >= 4:
            # SET_LINE_CODING of CDC, SET_BAUDRATE of the CP210x
            self._rate(struct.unpack_from("<I", urb.data)[0])
        elif self.is_ftdi and (to, request) == (0x40, 9):
            self.timer_ms = min(max(value & 0xFF, 1), 255)
        elif self.is_ftdi and (to, request) == (0x40, 3):
            self._rate(_ftdi_baud(value, index, self._release))

    def _rate(self, baud: int) -> None:
        if BAUDS[0] <= baud <= BAUDS[1]:
            self.baud = baud

    def _look(self, *, is_end: bool = False) -> None:
        """Tell by the content whether there are status bytes."""
        received = [u.data for u in self._held if u.endpoint & 0x80 and u.data]
        self.how = "content"
        if any(len(data) < STATUS or data[0] & 15 != 1 for data in received):
            self.is_ftdi = False
        elif len(received) >= LOOK or is_end or self._held_size >= HELD_MOST:
            idle = any(len(data) == STATUS for data in received)
            self.is_ftdi = bool(received) and (idle or len(received) >= LOOK)

    def _chunks(self, urb: Urb) -> Iterator[Chunk]:
        data, lost, t_ns = urb.data, max(urb.length - len(urb.data), 0), urb.t_ns
        marks: list[Mark] = []
        if urb.endpoint & 0x80:
            wire = Direction.RX
            if self.is_ftdi:
                data, marks = self._stripped(data)
        else:
            wire = Direction.TX
            if t_ns is not None and self.baud:
                t_ns += len(data) * byte_time_ns(self.baud)  # handed over before it is sent
        if lost:
            marks.append(Mark(MarkKind.OVERRUN, len(data), 0, lost))
        if data or marks:
            bus = self._bus(urb.endpoint)
            self.buses.add(bus)
            clock = Clock.NONE if t_ns is None else Clock.FILE
            yield Chunk(data, t_ns, clock, bus, wire, tuple(marks))

    def _bus(self, endpoint: int) -> str:
        """Return the name of a port: an FTDI chip's second one has the endpoints 3 and 4."""
        port = (max(endpoint & 0x0F, 1) - 1) // 2 if self.is_ftdi else 0
        return f"{self.name}.{port + 1}" if port else self.name

    def _stripped(self, data: bytes) -> tuple[bytes, list[Mark]]:
        """Return what is behind the status bytes, and the line errors that they tell."""
        size = self._size_of_packets(data)
        out, marks = b"", []
        for at in range(0, len(data), size):
            payload = data[at + STATUS : at + size]
            status = data[at + 1] if at + 1 < len(data) else 0
            marks += [Mark(kind, len(out), len(payload)) for bit, kind in _ERRORS if status & bit]
            out += payload
        return out, marks

    def _size_of_packets(self, data: bytes) -> int:
        if self._packet:
            return self._packet
        if self._release:
            self._packet = HIGH_SPEED if self._release in _HIGH else FULL_SPEED
        elif len(data) > FULL_SPEED:  # the next packet begins with the same modem lines
            again = data[FULL_SPEED::FULL_SPEED]
            self._packet = FULL_SPEED if set(again) == {data[0]} else HIGH_SPEED
        return self._packet or FULL_SPEED


class UsbDevices:
    """The devices of a capture by bus and number."""

    def __init__(self) -> None:
        self.known: dict[str, UsbDevice] = {}
        self._urbs = Urbs()

    def take(self, packet: CapturedPacket) -> Iterator[Chunk]:
        """Yield the chunks that a packet makes known; one that is cut in its head says nothing.

        Raises:
            DamagedInputError: there are more devices than there can be.
        """
        urb = self._urbs.of(packet)
        if urb is not None:
            device = self.known.get(urb.device)
            if device is None:
                if len(self.known) == DEVICES_MOST:
                    raise DamagedInputError(f"more than {DEVICES_MOST} devices on USB")
                device = self.known[urb.device] = UsbDevice(urb.device)
            yield from device.take(urb)

    def end(self) -> Iterator[Chunk]:
        """Yield what waits."""
        for device in self.known.values():
            yield from device.end()


def _ftdi_baud(value: int, index: int, release: int) -> int:
    """Return the rate that an FTDI divisor makes (AN232B-05; ``get_ftdi_divisor`` of Linux)."""
    high = index >> 8 if release in _PORTED else index
    divisor = value & 0x3FFF
    eighths = 8 * divisor + _EIGHTHS[value >> 14 | (high & 1) << 2]
    clock = 12_000_000 if release in _HIGH and high & 2 else 3_000_000
    if divisor < 2 and clock == 3_000_000:  # 0 and 1 stand for what they cannot be
        return 3_000_000 if eighths == 0 else 2_000_000
    made = 8 * clock / eighths if eighths else 0
    return next((usual for usual in _USUAL if abs(made - usual) <= _NEXT * usual), round(made))
