"""The words of clients of mightyZAP, RS30x and wCK. See ``tongue``."""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from bench.diagnosis.played.lines import LssTongue
from bench.diagnosis.played.tongue import KEEPS_NS, Say, Tongue
from sniffer.ground.model import MS
from sniffer.protocols.mightyzap.grammar import (
    BROADCAST,
    ECHO,
    LOAD,
    STORE,
    SYMMETRIC_STORE,
)
from sniffer.protocols.rs30x.grammar import ASKS_ACK, ASKS_ADDRESS, LONG
from sniffer.protocols.wck.grammar import build
from sniffer.simulation.memory import pack
from sniffer.simulation.mightyzap_servo import TOP, command, packet
from sniffer.simulation.rs30x import IDENTITY, PRESENT, flag_byte, joined, request
from sniffer.simulation.rs30x_servo import OFF, ON, Rs30xServo, tenths

if TYPE_CHECKING:
    import random
    from collections.abc import Callable, Iterator, Mapping

    from bench.diagnosis.played.stage import Stage
    from sniffer.ground.registers import Register

POSITION, BLOCK = 0x8C, 8
"""Present position, and the bytes from there to the temperature. Source: user manual v1.02, (3)."""

ONE_BY_ONE: Final = ((0x90, 2), (0x92, 1), (0x93, 1), (0x8E, 2), (0x96, 1))
"""Load, voltage, temperature, speed, moving: for clients that read the position each time, and one
of these."""

RS_POSITION, RS_BLOCK = 0x2A, 18
RS_ONE_BY_ONE: Final = ((0x30, 2), (0x34, 2), (0x32, 2), (0x2E, 2))
FLASH, REBOOT = 1 << 6, 1 << 5
"""Flags of a request. Source: RS305CR manual, 4.1, table 4.1."""

RESTART: Final = 0xF8
"""Source: mightyZAP user manual v1.02, (2) 4. COMMAND."""

LOWEST_V, HIGHEST_V = 90, 130
"""Limits of a 12 V servo, in tenths. Source: the same, (5) 6)."""

WCK_TOP: Final = 254


class MightyZapTongue(Tongue):
    """Reads blocks or single registers; its servos answer all commands or reads only."""

    patience_ns = (14 * MS, 40 * MS)

    def __init__(self, stage: Stage, rng: random.Random) -> None:
        super().__init__(stage, rng)
        self.blocks = rng.random() < 0.6
        self.reads_limits = rng.random() < 0.6
        self.mode = rng.choice((1, 2))
        delay = rng.choice((0, 50, 250, 250))
        for servo in stage.bus.servos.values():
            memory = servo.memory  # type: ignore[attr-defined]
            memory.raw["feedback_return_mode"] = self.mode
            memory.raw["return_delay_time"] = delay
            memory.raw["lowest_limit_voltage"] = LOWEST_V
            memory.raw["highest_limit_voltage"] = HIGHEST_V

    def store(self, servo_id: int, address: int, data: bytes) -> Say:
        """Write bytes from an address on."""
        raw = command(servo_id, STORE, address=address, data=data).data
        return Say(raw, self.mode == 2)

    def load(self, servo_id: int, address: int, length: int) -> Say:
        """Read bytes from an address on."""
        return Say(command(servo_id, LOAD, address=address, length=length).data)

    def identify(self, servo_id: int) -> Say:
        """Ping."""
        return Say(command(servo_id, ECHO).data)

    def hello(self, servo_id: int) -> Iterator[Say]:
        """Ping; read ids, delay and limits, or not."""
        if self.rng.random() < 0.8:
            yield self.identify(servo_id)
        if self.reads_limits:
            yield self.load(servo_id, 0x00, 0x13)

    def switch(self, servo_id: int, *, on: bool) -> Iterator[Say]:
        """Write Force On."""
        yield self.store(servo_id, 0x80, bytes([on]))

    def raw(self, servo_id: int, place: float) -> int:
        """Return position counts."""
        del servo_id
        return round(place * TOP)

    def goals(self, raws: Mapping[int, int]) -> Iterator[Say]:
        """Send a Symmetric Store, or a Store to each."""
        data = {i: pack("u16le", raw) for i, raw in raws.items()}
        if self.together:
            targets = tuple(data.items())
            told = command(BROADCAST, SYMMETRIC_STORE, address=0x86, length=2, targets=targets)
            yield Say(told.data, False)
        else:
            for servo_id, goal in data.items():
                yield self.store(servo_id, 0x86, goal)

    def look(self, servo_id: int, turn: int) -> Iterator[Say]:
        """Read the block, or the position and one of the rest."""
        if self.blocks:
            yield self.load(servo_id, POSITION, BLOCK)
        else:
            yield self.load(servo_id, POSITION, 2)
            yield self.load(servo_id, *ONE_BY_ONE[turn % len(ONE_BY_ONE)])

    def rename(self, servo_id: int, new: int) -> Iterator[Say]:
        """Write the id."""
        yield self.store(servo_id, 0x03, bytes([new]))

    def retune(self, servo_id: int, baud: int) -> Iterator[Say]:
        """Write the code and restart."""
        register = self.register("baud_rate")
        codes = {name: code for code, name in register.values.items()}
        yield self.store(servo_id, register.address, bytes([codes[str(baud)]]))
        yield from self.restart(servo_id)

    def restart(self, servo_id: int) -> Iterator[Say]:
        """Send Restart."""
        yield Say(packet(servo_id, RESTART), self.mode == 2)

    def register(self, name: str) -> Register:
        """Return a register of the table."""
        return self.stage.bus.table.register(name)


def _holds(servo: Rs30xServo) -> None:
    """Let a servo stay where it is when its torque is switched on, and not go to 0 first.

    Source: RS305CR manual, 4.3 No. 30, torque-on holding.
    """
    usual = servo.power_on

    def power_on() -> None:
        usual()
        servo.memory.raw["goal_position"] = tenths(servo.joint.position)

    servo.power_on = power_on  # type: ignore[method-assign]
    servo.memory.raw["goal_position"] = tenths(servo.joint.position)


class Rs30xTongue(Tongue):
    """Reads by nibble or by address; writes with or without an acknowledgement."""

    patience_ns = (15 * MS, 60 * MS)

    def __init__(self, stage: Stage, rng: random.Random) -> None:
        super().__init__(stage, rng)
        self.blocks = rng.choice(("nibble", "address", "single"))
        self.acks = rng.random() < 0.5
        self.timed = rng.random() < 0.6
        self.reads_limits = rng.random() < 0.7
        delay = rng.choice((0, 0, 2, 10))
        for servo in stage.bus.servos.values():
            servo.memory.raw["return_delay"] = delay  # type: ignore[attr-defined]
            servo.burn()  # type: ignore[attr-defined]
            _holds(servo)  # type: ignore[arg-type]

    def write(self, servo_id: int, address: int, data: bytes, *, ack: bool | None = None) -> Say:
        """Write bytes from an address on."""
        wanted = self.acks if ack is None else ack
        flags = flag_byte(ASKS_ACK if wanted else 0)
        return Say(request(servo_id, flags, address, len(data), 1, data), wanted)

    def read(self, servo_id: int, address: int, length: int) -> Say:
        """Read bytes from an address on."""
        return Say(request(servo_id, flag_byte(ASKS_ADDRESS), address, length, 0))

    def identify(self, servo_id: int) -> Say:
        """Read the model."""
        return self.read(servo_id, 0x00, 3)

    def hello(self, servo_id: int) -> Iterator[Say]:
        """Read the fixed and the ROM area, or not."""
        if self.reads_limits:
            yield Say(request(servo_id, flag_byte(IDENTITY), 0, 0, 1))

    def switch(self, servo_id: int, *, on: bool) -> Iterator[Say]:
        """Write Torque Enable."""
        yield self.write(servo_id, 0x24, bytes([ON if on else OFF]))

    def raw(self, servo_id: int, place: float) -> int:
        """Return tenths of a degree."""
        del servo_id
        return tenths(place)

    def goals(self, raws: Mapping[int, int]) -> Iterator[Say]:
        """Send a long packet, or a write to each; with a goal time, or without."""
        time = b"\x02\x00" if self.timed else b""
        data = {i: pack("i16le", raw) + time for i, raw in raws.items()}
        if self.together:
            length = 3 + len(time)
            built = joined(length, tuple(data.items()))
            yield Say(request(LONG, flag_byte(), 0x1E, length, len(data), built), False)
        else:
            for servo_id, goal in data.items():
                yield self.write(servo_id, 0x1E, goal)

    def look(self, servo_id: int, turn: int) -> Iterator[Say]:
        """Read No. 42 to 59, or the position and one of the rest."""
        if self.blocks == "nibble":
            yield Say(request(servo_id, flag_byte(PRESENT), 0, 0, 1))
        elif self.blocks == "address":
            yield self.read(servo_id, RS_POSITION, RS_BLOCK)
        else:
            yield self.read(servo_id, RS_POSITION, 2)
            yield self.read(servo_id, *RS_ONE_BY_ONE[turn % len(RS_ONE_BY_ONE)])

    def rename(self, servo_id: int, new: int) -> Iterator[Say]:
        """Write the id, which holds at once."""
        yield self.write(servo_id, 0x04, bytes([new]))

    def retune(self, servo_id: int, baud: int) -> Iterator[Say]:
        """Write the code, write the flash, reboot."""
        register = self.stage.bus.table.register("baud_rate")
        codes = {name: code for code, name in register.values.items()}
        yield self.write(servo_id, register.address, bytes([codes[str(baud)]]))
        yield Say(request(servo_id, FLASH, 0xFF, 0, 0), False)
        yield from self.restart(servo_id)

    def restart(self, servo_id: int) -> Iterator[Say]:
        """Send a packet with the flag for it."""
        yield Say(request(servo_id, REBOOT, 0xFF, 0, 0), False)


@functools.lru_cache(1 << 12)
def _wck(op: str, who: int, fields: tuple[tuple[str, int], ...]) -> bytes:
    return build(op, data1={"id": who}, data2={}, **dict(fields))


class WckTongue(Tongue):
    """Moves all at once and reads each, or moves each and has its state for an answer."""

    patience_ns = (12 * MS, 100 * MS)

    def __init__(self, stage: Stage, rng: random.Random) -> None:
        super().__init__(stage, rng)
        self.reads_limits = rng.random() < 0.7

    def _op(self, op: str, who: int, **fields: int) -> Say:
        built = _wck(op, who, tuple(fields.items()))
        return Say(built, True, KEEPS_NS if fields else 0)

    def identify(self, servo_id: int) -> Say:
        """Read the overload limit."""
        return self._op("overload_read", servo_id)

    def hello(self, servo_id: int) -> Iterator[Say]:
        """Read the boundaries, or not."""
        if self.reads_limits:
            yield self._op("boundary_read", servo_id)

    def switch(self, servo_id: int, *, on: bool) -> Iterator[Say]:
        """Let it be moved by hand; a move switches it on."""
        if not on:
            yield self._op("passive", servo_id)

    def raw(self, servo_id: int, place: float) -> int:
        """Return steps of the 8-bit commands."""
        del servo_id
        return round(place * WCK_TOP)

    def goals(self, raws: Mapping[int, int]) -> Iterator[Say]:
        """Send a Synchronized Position Move, or a Position Move to each."""
        if self.together:
            count = max(raws) + 1
            targets = [raws.get(i, 127) for i in range(count)]
            head = {"data1": {"torque_level": 1}, "data2": {"count": count}}
            yield Say(build("sync_position_move", **head, targets=targets), False)
        else:
            for servo_id, raw in raws.items():
                head = {"data1": {"torque_level": 1, "id": servo_id}}
                yield Say(build("position_move", **head, data2={"goal_position": raw}))

    def look(self, servo_id: int, turn: int) -> Iterator[Say]:
        """Read load and position."""
        del turn
        yield self._op("status_read", servo_id)

    def rename(self, servo_id: int, new: int) -> Iterator[Say]:
        """Set the id."""
        yield self._op("id_set", servo_id, servo_id=new)

    def retune(self, servo_id: int, baud: int) -> Iterator[Say]:
        """Set the baud rate, which holds behind the answer."""
        register = self.stage.bus.table.register("baud_rate")
        codes = {name: code for code, name in register.values.items()}
        yield self._op("baud_rate_set", servo_id, baud_rate=codes[str(baud)])

    def restart(self, servo_id: int) -> Iterator[Say]:
        """Say nothing: the protocol has no word for it."""
        del servo_id
        yield from ()


TONGUES: Final[Mapping[str, Callable[[Stage, random.Random], Tongue]]] = MappingProxyType(
    {"mightyzap": MightyZapTongue, "lss": LssTongue, "rs30x": Rs30xTongue, "wck": WckTongue}
)
"""By protocol."""
