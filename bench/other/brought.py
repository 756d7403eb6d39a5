"""Captures as people bring them: power that comes late, rests, scans, stamps without digits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from bench.other.faults import Dead, Replace, Slow, World
from bench.other.run import Case

if TYPE_CHECKING:
    from bench.other.wire import Bus


def from_power_on(at: float) -> World:
    """All servos are deaf until then."""

    def start(bus: Bus) -> None:
        for servo in bus.servos:
            servo.boots = at

    return World(start=start)


def now_and_then_late(bus: Any) -> float:
    return 0.0027 if bus.rng.random() < 0.25 else 0.0


def without_count(bus: Bus, frame: bytes) -> bytes:
    """An RS30x write that says it has no block."""
    del bus
    return frame[:6] + b"\x00" + frame[7:] if frame[4] == 0x1E else frame


BROUGHT_SOUND: Final = (
    Case("s-power-mz", "mz", "rounds", (1, 2, 3), faults=(from_power_on(4),), args={"waits": True}),
    Case("s-power-rs", "rs", "rounds", (1, 2), faults=(from_power_on(3),), args={"waits": True}),
    Case("s-steps-rs", "rs", "rounds", tuple(range(1, 9)), args={"steps": 12, "rest": 0.45}),
    Case("s-steps-mz-usb", "mz", "rounds", (1, 2), stamps="usb16", args={"steps": 12, "rest": 0.5}),
    Case("s-idle-lss", "lss", "rounds", (1, 2, 3), seconds=640, args={"idle": (200, 600.0)}),
    Case("s-idle-mz", "mz", "rounds", (1, 2), seconds=640, args={"idle": (300, 610.0)}),
    Case("s-hundredths-lss", "lss", "rounds", (1, 2, 3, 4), stamps="cs", said=False),
    Case(
        "s-hundredths-rs", "rs", "rounds", tuple(range(1, 7)), stamps="cs", said=False, seconds=30
    ),
    Case("s-scan-mz", "mz", "rounds", (1, 2, 9), args={"looks": range(1, 60)}),
    Case("s-scan-wck-hex", "wck", "rounds", (0, 4, 7), stamps="hex", args={"looks": range(31)}),
    Case("s-scan-lss-usb", "lss", "rounds", (2, 5), stamps="usb16", args={"looks": range(1, 60)}),
)

BROUGHT: Final = (
    *(
        Case(
            f"session-hangs-{proto}",
            proto,
            "session",
            (3, 7, 8, 12),
            "servo-dead",
            (7,),
            (Dead((7,), 13.0, 38.0),),
            seconds=75,
        )
        for proto in ("mz", "lss", "wck")
    ),
    *(
        Case(
            f"wrong-baud-{proto}-{baud}-at-{tap}",
            proto,
            "rounds",
            (1, 2, 3),
            "wrong-baud",
            baud=baud,
            tap_baud=tap,
            said=False,
            args={"hz": 5},
        )
        for proto, baud, tap in (
            ("lss", 9600, 115200),
            ("mz", 9600, 115200),
            ("rs", 9600, 57600),
            ("wck", 4800, 57600),
            ("mz", 115200, 57600),
            ("lss", 38400, 115200),
        )
    ),
    *(
        Case(
            f"impatient-late-{proto}-{stamps}",
            proto,
            "rounds",
            (1, 2, 3, 4),
            "impatient-controller",
            faults=tuple(Slow(i, now_and_then_late) for i in (1, 2, 3, 4)),
            patience=0.002,
            stamps=stamps,
            args={"goals": False},
        )
        for proto, stamps in (("lss", "exact"), ("lss", "hex"), ("rs", "exact"))
    ),
    Case(
        "no-count-rs",
        "rs",
        "rounds",
        (1, 2, 3),
        "malformed-command",
        faults=(Replace(without_count),),
    ),
)
