"""What was written to simulated servos is read back, by a program of its own on a port."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Final

import serial

from sniffer.ground.registers import TYPES
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import BUSES
from tests.lists import each_in_turn
from tests.simulations import DEADLINE_S, running
from tests.streams.mightyzap import packet as zap
from tests.streams.rs30x import packet, returned, write
from tests.streams.wck import command as wck
from tests.test_simulate_manuals import LOAD, STORE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.registers import Register


def samples(register: Register) -> Iterator[int]:
    """Yield raw values that the register may have, the last one unlike its default."""
    if register.values:
        yield from register.values
    else:
        bits = 7 if register.type == "decimal" else 8 * register.width - 1
        low, high = register.range or (0, 1 << bits - 1)
        yield from (low, (low + high) // 2, high, max(low, min(high, 3)))


def settable(name: str, model: str) -> list[Register]:
    table = next(m for m in PROTOCOLS[name].models if m.model == model)
    kept = [r for r in table.registers if r.access == "rw" and r.address >= 0]
    assert len(kept) > 10
    return [r for r in kept if r.name not in ("servo_id", "lock")]


def packed(register: Register, raw: int) -> bytes:
    dtype = TYPES[register.type]
    return raw.to_bytes(
        dtype.itemsize, "big" if dtype.byteorder == ">" else "little", signed=dtype.kind == "i"
    )


@contextlib.contextmanager
def controller(*arguments: str) -> Iterator[serial.Serial]:
    """Open the port of simulated servos as client libraries do."""
    with (
        running(*arguments, "--respond", "--no-tap") as it,
        serial.Serial(it.ports[0], BUSES[arguments[0]].baud, timeout=DEADLINE_S) as port,
    ):
        yield port


ADDRESSED: Final = [
    ("mightyzap", "mightyzap-l12"),
    ("mightyzap", "mightyzap-12lf"),
    ("rs30x", "rs305cr"),
    ("rs30x", "rs405cb"),
]


@each_in_turn(2, ("name", "model"), ADDRESSED)
def test_a_client_reads_back_every_register_that_it_writes(name: str, model: str) -> None:
    with controller(name, "--model", model, "--servos", "1,2") as port:

        def asked(request: bytes, size: int) -> bytes:
            port.write(request)
            return port.read(size)

        def stored(register: Register, raw: int) -> None:
            data = packed(register, raw)
            if name == "rs30x":
                assert asked(write(1, register.address, data, 1), 1) == b"\x07"
            else:
                port.write(zap(1, STORE, bytes([register.address]) + data))
                if mode == 2:
                    port.read(7)

        mode = 0 if name == "rs30x" else asked(zap(1, LOAD, b"\x10\x01"), 8)[6]
        for register in settable(name, model):
            if register.effect == "feedback":
                continue
            for raw in samples(register):
                stored(register, raw)
                size, data = register.width, packed(register, raw)
                if name == "rs30x":
                    got = asked(packet(1, 0x0F, register.address, size), 8 + size)
                    assert got == returned(1, register.address, data), register.name
                else:
                    got = asked(zap(1, LOAD, bytes([register.address, size])), 7 + size)
                    assert got[6:-1] == data, register.name


def test_an_lss_client_reads_back_every_configuration_that_it_writes() -> None:
    (table,) = (m for m in PROTOCOLS["lss"].models if m.model == "lss")
    kept = [
        r
        for r in table.registers
        if r.kind in ("configuration", "action") and r.type == "decimal" and r.queries
    ]
    skipped = {"servo_id", "goal_position", "wheel_speed", "wheel_speed_in_rpm"}  # these are moves
    assert len(kept) > 20
    with controller("lss", "--servos", "1,2") as port:
        for register in (r for r in kept if r.name not in skipped):
            for raw in list(samples(register))[:3]:
                port.write(f"#1{register.word}{raw}\r#1{register.queries[-1]}\r".encode())
                word = register.queries[-1].rstrip("0123456789")
                assert port.read_until(b"\r").decode() == f"*1{word}{raw}\r", register.name
        port.write(b"#1CID9\r#1RESET\r#9QID\r")
        assert port.read_until(b"\r") == b"*9QID9\r"


WCK_SETS: Final = {
    # what is set: its code, values, and what reads it back
    "speed": (0x0D, bytes([20, 50]), 0x0E),
    "p and d gain": (0x09, bytes([33, 44]), 0x0A),
    "i gain": (0x15, bytes([7, 7]), 0x16),
    "overload": (0x0F, bytes([92, 92]), 0x10),
    "boundary": (0x11, bytes([20, 230]), 0x12),
    "outputs": (0x64, bytes([2, 2]), 0x65),
}


def test_a_wck_client_reads_back_what_it_sets() -> None:
    with controller("wck", "--servos", "0,1") as port:
        for name, (code, data, read) in WCK_SETS.items():
            port.write(wck(0xE1, code, data))
            assert port.read(2) == data, name
            port.write(wck(0xE1, read, b"\0\0"))
            got = port.read(2)
            assert got[:1] == data[:1], name
            assert name == "outputs" or got == data
        port.write(wck(0xE1, 0x0C, bytes([40, 40])))
        assert port.read(2) == bytes([40, 40])
        port.write(wck(0xE0, 0xC9, bytes([40, 40])))
        assert port.read(2)[0] <= 7
