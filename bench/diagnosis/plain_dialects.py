"""Protocols without a header in their answers, or without packets: wCK and LSS."""

from __future__ import annotations

from functools import reduce
from operator import xor
from typing import TYPE_CHECKING, Final

from bench.diagnosis.dialect import MS, US, Asked, Dialect

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bench.diagnosis.bodies import Body


class Wck(Dialect):
    """Source: wCK user's manual 1.07, 2-3 and A-1."""

    name = "wck"
    baud = 115200
    bauds = (9600, 57600, 115200, 230400)
    ids = range(30)
    volt = 8.2
    patience_ns = 15 * MS
    delay_ns = (320 * US, 900 * US)

    STATUS, PASSIVE, EVERYONE, SET, READ_10BIT = 5, 6, 31, 0xE0, 0xC9
    TORQUE: Final = 2

    @staticmethod
    def packet(data1: int, data2: int, *more: int) -> bytes:
        body = bytes((data1, data2, *more))
        return b"\xff" + body + bytes((reduce(xor, body) & 0x7F,))

    def ping(self, servo_id: int) -> Asked:
        return Asked(self.packet(self.STATUS << 5 | servo_id, 0), self.patience_ns)

    def state(self, servo_id: int) -> Asked:
        return self.ping(servo_id)

    def position(self, servo_id: int) -> Asked:
        request = self.packet(self.SET, self.READ_10BIT, servo_id, servo_id)
        return Asked(request, self.patience_ns)

    def health(self, servo_id: int) -> Asked:
        return self.ping(servo_id)

    def move(self, body: Body, place: float) -> Asked:
        target = min(max(round(place * 254), 1), 254)
        return Asked(self.packet(self.TORQUE << 5 | body.servo_id, target), self.patience_ns)

    def move_all(self, places: Mapping[int, float]) -> Sequence[Asked]:
        count = max(places) + 1
        targets = [min(max(round(places.get(i, 0.5) * 254), 1), 254) for i in range(count)]
        head = bytes((0xFF, self.TORQUE << 5 | self.EVERYONE, count))
        return [Asked(head + bytes(targets) + bytes((reduce(xor, targets) & 0x7F,)))]

    def switch_on(self, body: Body) -> Asked:
        return self.move(body, body.goal)

    def switch_off(self, body: Body) -> Asked:
        return Asked(self.packet(self.PASSIVE << 5 | body.servo_id, 0x10), self.patience_ns)

    def whom(self, request: bytes) -> int | None:
        if len(request) < 4 or request[0] != 0xFF:
            return -1
        if request[1] & 0x1F == self.EVERYONE and request[1] >> 5 < 5:
            whole = len(request) == 4 + request[2]
            return None if whole and reduce(xor, request[3:-1], 0) & 0x7F == request[-1] else -1
        if reduce(xor, request[1:-1]) & 0x7F != request[-1]:
            return -1
        if request[1] & self.SET == self.SET:
            return request[3] if len(request) == 6 else -1
        return request[1] & 0x1F if len(request) == 4 else -1

    def answer(self, body: Body, request: bytes) -> bytes:
        mode = request[1] >> 5
        if request[1] & 0x1F == self.EVERYONE and mode < 5:
            if body.servo_id < request[2]:
                body.goal, body.is_on = request[3 + body.servo_id] / 254, True
            return b""
        if mode == 7:
            place = round(min(max(body.position, 0), 1) * 1022)
            return bytes((place >> 7, (place & 0x7F) << 1))
        place = min(max(round(body.position * 254), 0), 254)
        if mode == self.PASSIVE:
            body.is_on = False
            return bytes((request[2], place))
        if mode < 5:
            body.goal, body.is_on = request[2] / 254, True
        return bytes((round(min(abs(body.load), 1) * 200), place))


class Lss(Dialect):
    """Source: Lynxmotion LSS communication protocol, version 106.1."""

    name = "lss"
    baud = 115200
    bauds = (9600, 38400, 115200, 460800)
    ids = range(1, 100)
    volt = 11.9
    patience_ns = 60 * MS
    delay_ns = (300 * US, 1200 * US)
    HEALTH: Final = ("QV", "QT", "QC", "Q")

    def _ask(self, servo_id: int, word: str) -> Asked:
        return Asked(f"#{servo_id}{word}\r".encode(), self.patience_ns)

    def ping(self, servo_id: int) -> Asked:
        return self._ask(servo_id, "Q")

    def state(self, servo_id: int) -> Asked:
        return self._ask(servo_id, "QD")

    def position(self, servo_id: int) -> Asked:
        return self._ask(servo_id, "QD")

    def health(self, servo_id: int) -> Asked:
        return self._ask(servo_id, self.HEALTH[servo_id % len(self.HEALTH)])

    def move(self, body: Body, place: float) -> Asked:
        return Asked(f"#{body.servo_id}D{self._tenths(place)}\r".encode())

    def move_all(self, places: Mapping[int, float]) -> Sequence[Asked]:
        return [Asked(f"#{i}D{self._tenths(x)}\r".encode()) for i, x in places.items()]

    def switch_on(self, body: Body) -> Asked:
        return Asked(f"#{body.servo_id}H\r".encode())

    def switch_off(self, body: Body) -> Asked:
        return Asked(f"#{body.servo_id}L\r".encode())

    @staticmethod
    def _tenths(place: float) -> int:
        return round((min(max(place, 0.0), 1.0) - 0.5) * 1800)

    @staticmethod
    def _split(request: bytes) -> tuple[int, str, str] | None:
        if request[:1] != b"#" or request[-1:] != b"\r" or not request.isascii():
            return None
        text = request[1:-1].decode()
        digits = len(text) - len(text.lstrip("0123456789"))
        word = text[digits:].rstrip("-0123456789")
        rest = text[digits + len(word) :]
        if not 0 < digits < 4 or not word.isalpha() or not (rest.lstrip("-") or "0").isdigit():
            return None
        return int(text[:digits]), word, rest

    def whom(self, request: bytes) -> int | None:
        told = self._split(request)
        if told is None:
            return -1
        return None if told[0] == 254 else told[0]

    def answer(self, body: Body, request: bytes) -> bytes:
        told = self._split(request)
        if told is None:
            return b""
        _, word, number = told
        if word == "D" and number.lstrip("-"):
            body.goal, body.is_on = int(number) / 1800 + 0.5, True
        elif word == "H":
            body.goal, body.is_on = body.position, True
        elif word == "L":
            body.is_on = False
        values = {
            "Q": 1 if not body.is_on else 6 if abs(body.speed) < 0.02 else 4,
            "QD": self._tenths(body.position),
            "QV": round(body.supply.voltage * 1000),
            "QT": round(body.temperature * 10),
            "QC": round(body.current_a * 1000),
        }
        return f"*{body.servo_id}{word}{values[word]}\r".encode() if word in values else b""
