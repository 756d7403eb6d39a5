"""The four protocols by hand, from the vendors' documents: what controllers send, who answers."""

from __future__ import annotations

from typing import Any, Final

from bench.other.joints import Joint


# ---- mightyZAP
def mz(ident: int, code: int, *factors: int) -> bytes:
    body = bytes([ident, len(factors) + 2, code, *factors])
    return b"\xff\xff\xff" + body + bytes([~sum(body) & 255])


def mz_read(i: int, addr: int, n: int) -> bytes:
    return mz(i, 0xF2, addr, n)


def mz_write(i: int, addr: int, *data: int) -> bytes:
    return mz(i, 0xF3, addr, *data)


def u16(v: float) -> tuple[int, int]:
    n = max(0, min(65535, round(v)))
    return n & 255, n >> 8


def mz_goal(i: int, share: float) -> bytes:
    return mz_write(i, 0x86, *u16(share * 4095))


def mz_sync(addr: int, length: int, rows: dict[int, tuple[int, ...]]) -> bytes:
    return mz(0xFE, 0x73, addr, length, *[b for i, d in rows.items() for b in (i, *d)])


class Mz(Joint):
    NV: Final = {
        0x00: (0x36, 0x01),
        0x02: (22,),
        0x04: (32,),
        0x05: (250,),
        0x06: (0, 0),
        0x08: (0xFF, 0x0F),
        0x0B: (80,),
        0x0C: (70,),
        0x0D: (130,),
        0x0E: (0xFF, 3),
        0x10: (2,),
        0x11: (0x24,),
        0x12: (0x24,),
        0x16: (1,),
        0x25: (10,),
        0x27: (30,),
        0x28: (0x84, 3),
        0x2A: (0x34, 8),
        0x2C: (0xDC, 5),
        0x32: (0xFF, 7),
        0x34: (40, 0),
    }

    def __init__(self, *a: Any, mode: int = 2, **k: Any) -> None:
        super().__init__(*a, **k)
        self.mem = bytearray(256)
        for addr, data in {**self.NV, 0x03: (self.ident,), 0x10: (mode,)}.items():
            self.mem[addr : addr + len(data)] = bytes(data)
        self.staged: bytes = b""
        self.refused: set[int] = set()
        self.defaults()

    def defaults(self) -> None:
        self.mem[0x80:0x9A] = bytes(26)
        self.mem[0x82:0x84] = b"\x04\x04"
        self.mem[0x8A:0x8C] = self.mem[0x0E:0x10]
        self.mem[0x98:0x9A] = self.mem[0x34:0x36]
        self.mem[0x86:0x88] = bytes(u16(self.pos * 4095))
        self.goal = self.pos

    def live(self) -> None:
        way = 1024 if self.vel > 0 else 0
        self.mem[0x8C:0x8E] = bytes(u16(self.seen * 4095))
        self.mem[0x8E:0x90] = bytes(u16(min(1023, abs(self.noisy(self.vel, 0.004)) * 600) + way))
        self.mem[0x90:0x92] = bytes(u16(min(1023, abs(self.noisy(self.load, 0.012)) * 1023) + way))
        self.mem[0x92] = max(0, min(255, round(self.noisy(self.volts, 0.03) * 10)))
        self.mem[0x93] = max(0, min(255, round(self.temp)))
        self.mem[0x96] = int(abs(self.vel) > 0.01)

    def hear(self, frame: bytes, t: float) -> bytes | None:
        if frame[:3] != b"\xff\xff\xff" or len(frame) < 7 or sum(frame[3:]) & 255 != 255:
            return None
        ident, code, factors = frame[3], frame[5], frame[6:-1]
        if code == 0x73 and ident == 0xFE:
            n = factors[1]
            for at in range(2, len(factors) - n, n + 1):
                if factors[at] == self.ident:
                    self.write(factors[0], factors[at + 1 : at + 1 + n])
            return None
        if ident not in (self.ident, 0xFE):
            return None
        error, out, mode = self.error, b"", self.mem[0x10]
        old = self.ident
        self.live()
        if code == 0xF2:
            out = bytes(self.mem[factors[0] : factors[0] + factors[1]])
        elif code == 0xF3:
            if factors[0] in self.refused:
                error |= 0x08
            else:
                self.write(factors[0], factors[1:])
        elif code == 0xF4:
            self.staged = bytes(factors)
        elif code == 0xF5:
            if self.staged:
                self.write(self.staged[0], self.staged[1:])
        elif code == 0xF8:
            self.restart(t, 0.4)
        elif code != 0xF1:
            error |= 0x40
        if ident == 0xFE or (code != 0xF1 and mode < (1 if code == 0xF2 else 2)):
            return None
        return mz(old, error, *out)

    def write(self, addr: int, data: bytes) -> None:
        self.mem[addr : addr + len(data)] = data
        self.ident = self.mem[3]
        self.torque = bool(self.mem[0x80] & 1)
        if addr <= 0x87 and addr + len(data) > 0x86:
            self.goal = (self.mem[0x86] | self.mem[0x87] << 8) / 4095
        speed = self.mem[0x88] | self.mem[0x89] << 8
        self.cap = min(self.cap, 1.0) if not speed else max(0.05, min(1.0, speed / 1023))


# ---- LSS
def lss(i: int, word: str, value: object = "", *mods: str) -> bytes:
    return f"#{i}{word}{value}{''.join(mods)}\r".encode()


def deg(share: float) -> int:
    return round((share - 0.5) * 1800)


class Lss(Joint):
    def __init__(self, *a: Any, **k: Any) -> None:
        super().__init__(*a, **k)
        self.limit_volts = 6.5
        self.mute: set[str] = set()
        self.state: int | None = None

    def defaults(self) -> None:
        self.goal = self.pos

    def hear(self, frame: bytes, t: float) -> bytes | None:
        text = frame.decode("latin1")
        if text[:1] != "#" or text[-1:] != "\r":
            return None
        digits = len(text[1:]) - len(text[1:].lstrip("0123456789"))
        if not digits or int(text[1 : 1 + digits]) not in (self.ident, 254):
            return None
        rest = text[1 + digits : -1]
        word = rest[: len(rest) - len(rest.lstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ"))]
        value = rest[len(word) :]
        if word in ("D", "PD"):
            self.torque, self.goal = True, 0.5 + int(value.split("T")[0].split("S")[0] or 0) / 1800
            if "T" in value:
                need = abs(self.goal - self.pos) / max(
                    0.05, int(value.split("T")[1].split("C")[0].split("S")[0]) / 1000
                )
                self.cap = max(0.05, min(1.0, 1.4 * need / self.top))
        elif word == "MD":
            self.torque, self.goal = True, self.goal + int(value.split("T")[0]) / 1800
        elif word == "P":
            self.torque, self.goal = True, (int(value.split("T")[0].split("S")[0]) - 500) / 2000
        elif word == "L":
            self.torque = False
        elif word == "H":
            self.torque, self.goal = True, self.pos
        elif word == "RESET":
            self.restart(t, 0.9)
        elif word == "CID":
            self.ident = int(value)
        if not word.startswith("Q") or word in self.mute:
            return None
        status = self.state or (
            1 if not self.torque else 6 if abs(self.goal - self.pos) < 0.006 else 4
        )
        said = {
            "QD": deg(self.seen),
            "QDT": deg(self.goal),
            "QV": round(self.noisy(self.volts, 0.02) * 1000),
            "QT": round(self.noisy(self.temp, 0.1) * 10),
            "QC": max(0, round(self.noisy(self.current, 0.006) * 1000)),
            "Q": status,
            "QS": round(self.vel * 2000),
            "QWD": round(self.vel * 1800),
            "QMS": "LSS-HS1",
            "QN": 44100000 + self.place,
            "QF": 368,
            "QSD": 600,
            "QP": round(500 + 2000 * self.seen),
            "QLED": 3,
            "QG": 1,
            "QO": 0,
            "QAR": 1800,
            "QAS": 0,
            "QAH": 4,
            "QB": 115200,
        }
        return f"*{self.ident}{word}{said.get(word, 0)}\r".encode()


# ---- wCK
def wck(d1: int, d2: int) -> bytes:
    return bytes([255, d1, d2, (d1 ^ d2) & 127])


def wck_move(i: int, share: float, torque: int = 1) -> bytes:
    return wck(torque << 5 | i, max(0, min(254, round(share * 254))))


def wck_status(i: int) -> bytes:
    return wck(5 << 5 | i, 0)


def wck_passive(i: int) -> bytes:
    return wck(6 << 5 | i, 1 << 4)


def wck_wheel(i: int, way: int, speed: int) -> bytes:
    return wck(6 << 5 | i, way << 4 | speed)


def wck_set(i: int, op: int, d3: int, d4: int) -> bytes:
    d1 = 7 << 5 | i
    return bytes([255, d1, op, d3, d4, (d1 ^ op ^ d3 ^ d4) & 127])


def wck_sync(targets: list[float], torque: int = 1) -> bytes:
    t = [max(0, min(254, round(x * 254))) for x in targets]
    s = 0
    for x in t:
        s ^= x
    return bytes([255, torque << 5 | 31, len(t), *t, s & 127])


class Wck(Joint):
    def __init__(self, *a: Any, **k: Any) -> None:
        super().__init__(*a, **k)
        self.delay = 0.00065
        self.gains = [20, 30]
        self.dither = 0.003

    def hear(self, frame: bytes, t: float) -> bytes | None:
        if len(frame) < 4 or frame[0] != 255:
            return None
        d1, d2 = frame[1], frame[2]
        mode, ident = d1 >> 5, d1 & 31
        load, pos = (
            min(254, round(abs(self.noisy(self.load, 0.01)) * 120)),
            min(254, round(self.seen * 254)),
        )
        if mode <= 4 and ident == 31:
            if self.ident < d2:
                self.goal, self.torque = frame[3 + self.ident] / 254, True
            return None
        if ident != self.ident:
            return None
        if mode <= 4:
            self.goal, self.torque = d2 / 254, True
            return bytes([load, pos])
        if mode == 5:
            return bytes([load, pos])
        if mode == 6:
            if d2 >> 4 == 1:
                self.torque = False
                return bytes([d2, pos])
            return bytes([int(t * 3) & 255, pos])
        op, d3, d4 = frame[2], frame[3], frame[4]
        if op == 0x09:
            self.gains = [d3, d4]
        if op == 0x0C:
            self.ident = d3
        if op == 0x0A:
            return bytes(self.gains)
        if op in (0x0E,):
            return bytes([0, 60])
        if op == 0x12:
            return bytes([1, 254])
        if op == 0x10:
            return bytes([33, 33])
        return None if op == 0x17 else bytes([d3, d4])


# ---- RS30x
def rs(i: int, flg: int, adr: int, length: int, cnt: int, data: bytes = b"") -> bytes:
    body = bytes([i, flg, adr, length, cnt]) + data
    s = 0
    for x in body:
        s ^= x
    return b"\xfa\xaf" + body + bytes([s])


def s16(v: float) -> bytes:
    return (round(v) & 0xFFFF).to_bytes(2, "little")


def rs_goal(i: int, share: float, time: int | None = None, flg: int = 0) -> bytes:
    data = s16((share - 0.5) * 2800) + (b"" if time is None else s16(time))
    return rs(i, flg, 0x1E, len(data), 1, data)


def rs_long(adr: int, rows: dict[int, bytes]) -> bytes:
    n = len(next(iter(rows.values())))
    return rs(0, 0, adr, n + 1, len(rows), b"".join(bytes([i]) + d for i, d in rows.items()))


class Rs(Joint):
    READS: Final = {3: (0, 30), 5: (30, 30), 7: (20, 10), 9: (42, 18), 0xB: (30, 12)}

    def __init__(self, *a: Any, **k: Any) -> None:
        super().__init__(*a, **k)
        self.delay = 0.00012
        self.mem = bytearray(64)
        self.mem[0:30] = bytes.fromhex(
            "5030 03 00 01 00 07 00 DC05 24FA 0000 5000 0000000000000000 02020A0AB400".replace(
                " ", ""
            )
        )
        self.mem[4] = self.ident
        self.mem[0x23] = 100
        self.dither, self.limit_volts = 0.0006, 7.0

    def defaults(self) -> None:
        self.mem[30:42] = bytes(12)
        self.mem[0x23] = 100
        self.goal = self.pos

    def hear(self, frame: bytes, t: float) -> bytes | None:
        s = 0
        for x in frame[2:]:
            s ^= x
        if frame[:2] != b"\xfa\xaf" or s or len(frame) < 8:
            return None
        ident, flg, adr, length, cnt, data = (
            frame[2],
            frame[3],
            frame[4],
            frame[5],
            frame[6],
            frame[7:-1],
        )
        if ident == 0:
            for k in range(cnt):
                row = data[k * length : (k + 1) * length]
                if row[0] == self.ident:
                    self.write(adr, row[1:])
            return None
        if ident not in (self.ident, 255):
            return None
        if flg & 0x20:
            self.restart(t, 1.5)
            return None
        if cnt and length and data:
            self.write(adr, data)
        m = self.mem
        m[0x2A:0x2C] = s16((self.seen - 0.5) * 2800)
        m[0x2E:0x30] = s16(self.noisy(self.vel, 0.003) * 280)
        m[0x30:0x32] = s16(max(0, self.noisy(self.current, 0.004)) * 1000)
        m[0x32:0x34] = s16(self.temp)
        m[0x34:0x36] = s16(self.noisy(self.volts, 0.02) * 100)
        if ident == 255:
            return None
        kind = flg & 15
        if kind == 1:
            return b"\x07"
        if kind == 0xF:
            a, n = adr, length
        elif kind in self.READS:
            a, n = self.READS[kind]
        else:
            return None
        body = bytes([self.ident, self.error, a, n, 1]) + bytes(m[a : a + n])
        s = 0
        for x in body:
            s ^= x
        return b"\xfd\xdf" + body + bytes([s])

    def write(self, adr: int, data: bytes) -> None:
        self.mem[adr : adr + len(data)] = data
        self.ident = self.mem[4]
        self.torque = self.mem[0x24] == 1
        if adr <= 0x1E < adr + len(data):
            self.goal = 0.5 + int.from_bytes(self.mem[0x1E:0x20], "little", signed=True) / 2800
            time = int.from_bytes(self.mem[0x20:0x22], "little") / 100
            if time:
                self.cap = max(0.05, min(1.0, 1.4 * abs(self.goal - self.pos) / time / self.top))
            else:
                self.cap = 1.0
