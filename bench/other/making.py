"""More of what goes wrong, put together from less."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bench.other.faults import Loops, Replace, World, at_place
from bench.other.talk import Lss, Mz, lss, mz, mz_write, rs_goal, u16
from bench.other.wire import Bus, Fault

if TYPE_CHECKING:
    from bench.other.joints import Joint


def away(place: int, every: float, lasts: float, jitter: float = 0.1) -> World:
    """Its firmware crashes again and again."""
    state = {"due": every}

    def tick(bus: Bus, t: float) -> None:
        if t > state["due"]:
            state["due"] = t + every * bus.rng.uniform(1 - jitter, 1 + jitter)
            at_place(bus, place).restart(t, lasts)

    return World(tick)


def once(t0: float, frame: bytes, wait: float = 0.05) -> Loops:
    """One frame at one moment."""
    return Loops(lambda bus: frame, 1e9, 1, t0, wait)


def set_at(place: int, **what: float) -> World:
    def start(bus: Bus) -> None:
        for name, value in what.items():
            setattr(at_place(bus, place), name, value)

    return World(start=start)


def refusing(place: int, address: int) -> World:
    def start(bus: Bus) -> None:
        servo = at_place(bus, place)
        assert isinstance(servo, Mz)
        servo.refused.add(address)

    return World(start=start)


def mute(place: int, word: str) -> World:
    def start(bus: Bus) -> None:
        servo = at_place(bus, place)
        assert isinstance(servo, Lss)
        servo.mute.add(word)

    return World(start=start)


def no_torque(i: int) -> Replace:
    return Replace(lambda bus, f: f if f != mz_write(i, 0x80, 1) else mz(i, 0xF1))


def over(place: int, above: float, lasts: float, error: int, drop: bool = True) -> World:
    """Its protection trips once the load has been high for so long; it lets go and stays so."""
    state = {"since": 0.0}

    def tick(bus: Bus, t: float) -> None:
        s = at_place(bus, place)
        if s.load < above:
            state["since"] = t
        elif t - state["since"] > lasts and not s.error & error:
            s.error |= error
            s.torque = s.torque and not drop

    return World(tick)


def jumps(proto: str, i: int, share: float, moments: tuple[float, ...]) -> Replace:
    left = list(moments)

    def change(bus: Bus, f: bytes) -> bytes:
        if left and bus.now > left[0]:
            if proto == "mz" and len(f) > 8 and f[3] == i and f[5] == 0xF3 and f[6] == 0x86:
                left.pop(0)
                return mz_write(i, 0x86, *u16(4095 * share))
            if proto == "rs" and f[2] == i and f[4] == 0x1E:
                left.pop(0)
                return rs_goal(i, share, flg=f[3])
            if proto == "lss" and f.startswith(f"#{i}D".encode()):
                left.pop(0)
                return lss(i, "D", round((share - 0.5) * 1800))
        return f

    return Replace(change)


def sums(proto: str) -> Replace:
    if proto == "wck":
        return Replace(lambda b, f: f[:-1] + bytes([sum(f[1:-1]) & 127]))
    if proto == "rs":
        return Replace(lambda b, f: f[:-1] + bytes([f[-1] ^ f[0] ^ f[1]]))
    return Replace(lambda b, f: f[:-1] + bytes([sum(f[3:-1]) & 255]))


class Other(Loops):
    """A servo of another protocol on the same wires, and who asks it."""

    def __init__(self, frame: bytes, servo: Joint, every: float) -> None:
        super().__init__(lambda bus: frame, every)
        self.servo = servo

    def start(self, bus: Bus) -> None:
        self.servo.supply = bus.servos[0].supply
        bus.servos.append(self.servo)


def flaky_encoder(place: int, every: float) -> World:
    def tick(bus: Bus, t: float) -> None:
        s = at_place(bus, place)
        s.dither = 0.0006 if (t % every) > 0.02 else 0.9

    return World(tick)


class Text(Fault):
    """A program that takes bytes for text: each byte becomes others, or none."""

    def __init__(self, becomes: dict[int, tuple[int, ...]]) -> None:
        self.becomes = becomes

    def tap(self, bus: Bus, heard: list[tuple[float, int]]) -> list[tuple[float, int]]:
        return [(t, b) for t, byte in heard for b in self.becomes.get(byte, (byte,))]
