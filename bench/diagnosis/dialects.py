"""The protocols by name, and those whose packets have a header: mightyZAP and RS30x.

Packets are built from the manuals' layouts here, without the decoder, so that a mistake of the
grammars cannot hide itself.
"""

from __future__ import annotations

from functools import reduce
from operator import xor
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from bench.diagnosis.dialect import MS, US, Asked, Dialect
from bench.diagnosis.plain_dialects import Lss, Wck

if TYPE_CHECKING:
    import random
    from collections.abc import Mapping, Sequence

    from bench.diagnosis.bodies import Body


def _u16(value: float, most: int) -> bytes:
    return min(max(round(value), 0), most).to_bytes(2, "little")


def _i16(value: float) -> bytes:
    """Return a register of two bytes, which stops at its ends."""
    return min(max(round(value), -0x8000), 0x7FFF).to_bytes(2, "little", signed=True)


class MightyZap(Dialect):
    """Source: mightyZAP user manual v1.02, (2) packets, (3) data map, (4) commands."""

    name = "mightyzap"
    baud = 57600
    bauds = (19200, 57600, 115200, 250000, 400000)
    ids = range(1, 60)
    volt = 12.1
    patience_ns = 25 * MS
    delay_ns = (60 * US, 280 * US)  # the return delay register ends at 255 us

    ECHO, LOAD, STORE, SYMMETRIC = 0xF1, 0xF2, 0xF3, 0x73
    EVERYONE: Final = 0xFE
    FORCE_ON, GOAL, MEASURED, MODE = 0x80, 0x86, 0x8C, 0x10

    def fit(self, body: Body, rng: random.Random) -> None:
        """Give it a return mode: 2 answers everything, 1 only what is read."""
        body.settings["mode"] = rng.choice((1, 2))

    @staticmethod
    def packet(servo_id: int, code: int, factors: bytes = b"") -> bytes:
        body = bytes((servo_id, len(factors) + 2, code)) + factors
        return b"\xff\xff\xff" + body + bytes((~sum(body) & 0xFF,))

    def _load(self, servo_id: int, address: int, length: int) -> Asked:
        return Asked(self.packet(servo_id, self.LOAD, bytes((address, length))), self.patience_ns)

    def _store(self, body: Body, address: int, data: bytes) -> Asked:
        patience = self.patience_ns if body.settings["mode"] == 2 else 0
        return Asked(self.packet(body.servo_id, self.STORE, bytes((address,)) + data), patience)

    def ping(self, servo_id: int) -> Asked:
        return Asked(self.packet(servo_id, self.ECHO), self.patience_ns)

    def state(self, servo_id: int) -> Asked:
        return self._load(servo_id, self.MEASURED, 8)

    def position(self, servo_id: int) -> Asked:
        return self._load(servo_id, self.MEASURED, 2)

    def health(self, servo_id: int) -> Asked:
        return self._load(servo_id, self.MEASURED + 6, 2)

    def move(self, body: Body, place: float) -> Asked:
        return self._store(body, self.GOAL, _u16(place * 4095, 4095))

    def move_all(self, places: Mapping[int, float]) -> Sequence[Asked]:
        told = b"".join(bytes((i,)) + _u16(x * 4095, 4095) for i, x in places.items())
        head = bytes((self.GOAL, 2))
        return [Asked(self.packet(self.EVERYONE, self.SYMMETRIC, head + told))]

    def switch_on(self, body: Body) -> Asked:
        return self._store(body, self.FORCE_ON, b"\x01")

    def switch_off(self, body: Body) -> Asked:
        return self._store(body, self.FORCE_ON, b"\x00")

    def whom(self, request: bytes) -> int | None:
        whole = len(request) >= 7 and request[:3] == b"\xff\xff\xff"
        if not whole or len(request) != 5 + request[4] or ~sum(request[3:-1]) & 255 != request[-1]:
            return -1
        return None if request[3] == self.EVERYONE else request[3]

    def complains_of(self, request: bytes) -> int:
        """Return who sees a wrong checksum in what looks like a packet to it; -1: nobody."""
        shaped = len(request) >= 7 and request[:3] == b"\xff\xff\xff"
        return request[3] if shaped and len(request) == 5 + request[4] else -1

    def answer(self, body: Body, request: bytes) -> bytes:
        code, factors = request[5], request[6:-1]
        told = b""
        answers = body.settings["mode"] == 2 and request[3] != self.EVERYONE
        if self.whom(request) == -1:
            return self.packet(body.servo_id, 1 << 4) if answers else b""
        if code == self.SYMMETRIC:
            for k in range(2, len(factors), 3):
                if factors[k] == body.servo_id:
                    body.goal = int.from_bytes(factors[k + 1 : k + 3], "little") / 4095
        elif code == self.STORE and factors[0] == self.GOAL:
            body.goal = int.from_bytes(factors[1:3], "little") / 4095
        elif code == self.STORE and factors[0] == self.FORCE_ON:
            body.is_on = factors[1] == 1
        elif code == self.LOAD:
            told = (self._measured(body) + bytes(64))[factors[0] - self.MEASURED :][: factors[1]]
            answers = True
        elif code == self.ECHO:
            answers = True
        return self.packet(body.servo_id, 0, told) if answers else b""

    @staticmethod
    def _measured(body: Body) -> bytes:
        place = body.position * 4095 + body.rng.uniform(-1, 1)
        speed, load = body.speed * 900, body.load * 1000
        return (
            _u16(place, 4095)
            + _u16(min(abs(speed), 1023) + (1024 if speed < 0 else 0), 2047)
            + _u16(min(abs(load), 1023) + (1024 if load < 0 else 0), 2047)
            + bytes((round(body.supply.voltage * 10), round(body.temperature)))
        )


class Rs30x(Dialect):
    """Source: Futaba RS305CR manual, 4.1 packets, 4.2 memory map."""

    name = "rs30x"
    baud = 115200
    bauds = (9600, 57600, 115200, 230400, 460800)
    ids = range(1, 100)
    volt = 7.4
    patience_ns = 20 * MS
    delay_ns = (100 * US, 400 * US)  # 100 us + 50 us * n

    GOAL, TORQUE_ON, MEASURED = 0x1E, 0x24, 0x2A
    BLOCK, CHOSEN, ACK = 0x9, 0xF, 0x1
    TRAVEL: Final = 2400
    """Tenths of a degree between a joint's ends here, of 3000."""

    def fit(self, body: Body, rng: random.Random) -> None:
        """Choose whether the client asks for acknowledgements of its writes."""
        body.settings["ack"] = rng.choice((0, self.ACK))

    @staticmethod
    def packet(head: bytes, *body: int, data: bytes = b"") -> bytes:
        told = bytes(body) + data
        return head + told + bytes((reduce(xor, told),))

    def _ask(self, servo_id: int, flag: int, address: int = 0, length: int = 0) -> Asked:
        request = self.packet(b"\xfa\xaf", servo_id, flag, address, length, flag != self.CHOSEN)
        return Asked(request, self.patience_ns)

    def ping(self, servo_id: int) -> Asked:
        return self._ask(servo_id, self.CHOSEN, 0x04, 1)

    def state(self, servo_id: int) -> Asked:
        return self._ask(servo_id, self.BLOCK)

    def position(self, servo_id: int) -> Asked:
        return self._ask(servo_id, self.CHOSEN, self.MEASURED, 2)

    def health(self, servo_id: int) -> Asked:
        return self._ask(servo_id, self.CHOSEN, self.MEASURED + 6, 6)

    def _place(self, x: float) -> bytes:
        return _i16(min(max(x - 0.5, -0.5), 0.5) * self.TRAVEL)

    def _write(self, body: Body, address: int, data: bytes) -> Asked:
        ack = body.settings["ack"]
        request = self.packet(b"\xfa\xaf", body.servo_id, ack, address, len(data), 1, data=data)
        return Asked(request, self.patience_ns if ack else 0)

    def move(self, body: Body, place: float) -> Asked:
        return self._write(body, self.GOAL, self._place(place))

    def move_all(self, places: Mapping[int, float]) -> Sequence[Asked]:
        told = b"".join(bytes((i,)) + self._place(x) for i, x in places.items())
        return [Asked(self.packet(b"\xfa\xaf", 0, 0, self.GOAL, 3, len(places), data=told))]

    def switch_on(self, body: Body) -> Asked:
        return self._write(body, self.TORQUE_ON, b"\x01")

    def switch_off(self, body: Body) -> Asked:
        return self._write(body, self.TORQUE_ON, b"\x00")

    def whom(self, request: bytes) -> int | None:
        if len(request) < 8 or request[:2] != b"\xfa\xaf":
            return -1
        if len(request) != 8 + request[5] * request[6]:
            return -1
        if reduce(xor, request[2:-1]) != request[-1]:
            return -1
        return None if request[2] in (0, 255) else request[2]

    def answer(self, body: Body, request: bytes) -> bytes:
        servo_id, flag, address, length, data = (*request[2:6], request[7:-1])
        if servo_id == 0:
            for k in range(0, len(data), max(length, 1)):  # noise may make it any
                if data[k] == body.servo_id and address == self.GOAL:
                    self._go(body, data[k + 1 : k + 3])
            return b""
        if data and address == self.GOAL:
            self._go(body, data[:2])
        elif data and address == self.TORQUE_ON:
            body.is_on = data[0] == 1
        if flag & 0xF == self.ACK:
            return b"\x07"
        if flag & 0xF == self.BLOCK:
            return self._return(body, self.MEASURED, 18)
        return self._return(body, address, length) if flag & 0xF == self.CHOSEN else b""

    def _go(self, body: Body, data: bytes) -> None:
        body.goal = int.from_bytes(data, "little", signed=True) / self.TRAVEL + 0.5

    def _return(self, body: Body, address: int, length: int) -> bytes:
        if address == 0x04:
            data = bytes((body.servo_id,))
        else:
            data = (self._measured(body) + bytes(64))[address - self.MEASURED :][:length]
        return self.packet(b"\xfd\xdf", body.servo_id, 0, address, length, 1, data=data)

    def _measured(self, body: Body) -> bytes:
        place = (body.position - 0.5) * self.TRAVEL + body.rng.uniform(-1, 1)
        return (
            _i16(place)
            + _i16(0)
            + _i16(body.speed * self.TRAVEL / 10)
            + _i16(body.current_a * 1000)
            + _i16(body.temperature)
            + _i16(body.supply.voltage * 100)
            + bytes(6)
        )


DIALECTS: Final[Mapping[str, Dialect]] = MappingProxyType(
    {d.name: d for d in (MightyZap(), Rs30x(), Wck(), Lss())}
)
