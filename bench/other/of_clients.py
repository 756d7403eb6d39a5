"""What clients of third parties do to a bus, as they were seen to do it when they were run.

LSS_Query and LSS_Knob_Mimic of Lynxmotion's Arduino library print to the port that the bus is on;
RaspberryPi-DXL-MightyZap empties its port (tcflush) when it has written; futaba_RS405CB writes its
reverse mode to the address of the id.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.other.faults import Dead, Loops, Replace
from bench.other.making import once
from bench.other.run import Case
from bench.other.talk import lss, rs

if TYPE_CHECKING:
    from bench.other.wire import Bus


def prints(text: str, every: float) -> Loops:
    """A program that prints a line on the bus now and then."""
    return Loops(lambda bus: text.format(round(100 * bus.now)).encode(), every, wait=0.004)


def thrown_away(share: float) -> Replace:
    """A program that throws the end of some requests away before they are sent."""

    def change(bus: Bus, frame: bytes) -> bytes:
        return frame[: bus.rng.randrange(2, len(frame))] if bus.rng.random() < share else frame

    return Replace(change)


def falters(place: int, since: float) -> tuple[Dead, ...]:
    """A servo whose oscillator warms: it does not hear some requests, then none."""
    moments = (0.0, 0.35, 0.9, 1.4, 1.7)
    return (
        *(Dead((place,), since + t, since + t + 0.03) for t in moments),
        Dead((place,), since + 2.2),
    )


PRINTED: Final = (
    ("lss", "\r\n---- LSS telemetry ----\r\nPosition  (1/10 deg) = {}\r\n", 1.0),
    ("mz", "Input @ {}\r\n", 0.3),
    ("rs", "rst:0x1 (POWERON_RESET),boot:0x13 (SPI_FAST_FLASH_BOOT) {}\r\n", 7.0),
    ("wck", "Torque set to {}\n", 0.8),
)

CLIENTS: Final = (
    *(
        Case(
            f"prints-{proto}",
            proto,
            "rounds",
            (1, 2, 3),
            "malformed-command",
            faults=(prints(text, every),),
        )
        for proto, text, every in PRINTED
    ),
    *(
        Case(
            f"throws-away-{proto}-{stamps}",
            proto,
            "rounds",
            (1, 2, 3),
            "malformed-command",
            faults=(thrown_away(0.05),),
            stamps=stamps,
        )
        for proto, stamps in (("mz", "exact"), ("rs", "usb16"), ("mz", "none"))
    ),
    Case(
        "asks-all-lss",
        "lss",
        "rounds",
        (1, 2, 3, 4),
        "malformed-command",
        faults=(Loops(lambda bus: lss(254, "QV"), 0.6, wait=0.03),),
    ),
    *(
        Case(
            f"id-given-twice-{proto}",
            proto,
            "rounds",
            (1, 2, 3),
            "duplicate-id",
            faults=(once(4.0, frame),),
            also=("id-changed",),
        )
        for proto, frame in (("rs", rs(2, 0, 0x04, 1, 1, b"\1")), ("lss", lss(2, "CID", 1)))
    ),
    *(
        Case(
            f"falters-{proto}",
            proto,
            "rounds",
            (1, 2, 3),
            "servo-dead",
            servos=(1,),
            faults=falters(1, 9.0),
            also=("bad-cable",),
            args={"goals": False},
        )
        for proto in ("rs", "lss")
    ),
)
