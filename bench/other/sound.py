"""Sound conversations, none of which is a tidy poll loop."""

from __future__ import annotations

from typing import Final

from bench.other.run import Case

A: Final = (3, 7, 8, 12, 21, 30)
B14: Final = tuple(range(14))
B18: Final = (1, 2, 3, 5, 6, 7, 9, 10, 11, 13, 14, 15, 17, 18, 19, 21, 22, 23)

SOUND: Final = (
    Case("s-mz-walk", "mz", "walk", (4, 9), baud=57600),
    Case("s-mz-walk-usb", "mz", "walk", A, baud=115200, stamps="usb16", args={"hz": 25}),
    Case("s-mz-walk-settle", "mz", "walk", (4, 9, 10), args={"settle": 0.6}, seconds=60),
    Case("s-mz-walk-weak", "mz", "walk", (4, 9, 10), args={"settle": 0.3}, seconds=60, speed=0.2),
    Case("s-lss-pick-long", "lss", "pick", (1, 2, 3), seconds=60, speed=0.15),
    Case("s-rs-script-long", "rs", "script", (1, 2, 3), seconds=60, args={"rest": 4}),
    Case("s-mz-burst-long", "mz", "burst", (2, 5, 6, 11), seconds=60, speed=0.2),
    Case("s-mz-zero-walk", "mz", "walk", (0, 1, 2), seconds=30),
    Case("s-mz-zero-staged", "mz", "staged", (0, 4)),
    Case("s-mz-zero-fast-usb", "mz", "fast", (0, 4), stamps="usb16"),
    Case("s-mz-burst", "mz", "burst", (2, 5, 6, 11, 40, 41)),
    Case("s-mz-burst-ms", "mz", "burst", tuple(range(1, 15)), stamps="ms"),
    Case("s-mz-fast", "mz", "fast", (3, 7, 8)),
    Case("s-mz-fast-usb", "mz", "fast", (3, 7, 8), stamps="usb16"),
    Case("s-mz-fast-bin", "mz", "fast", (3, 7, 8), stamps="none"),
    Case("s-mz-states", "mz", "states", (1, 17)),
    Case("s-mz-states-one", "mz", "states", (0,), baud=57600, stamps="ms"),
    Case("s-mz-states-bin", "mz", "states", A, stamps="none"),
    Case("s-mz-staged", "mz", "staged", A),
    Case("s-mz-staged-hex", "mz", "staged", (2, 3), stamps="hex"),
    Case("s-lss-many", "lss", "many", (5, 11)),
    Case("s-lss-many-slow", "lss", "many", (5,), baud=9600, stamps="ms"),
    Case("s-lss-many-usb", "lss", "many", A, stamps="usb16"),
    Case("s-lss-burst", "lss", "burst", B18),
    Case("s-lss-burst-bin", "lss", "burst", B18, stamps="none"),
    Case("s-lss-teach", "lss", "teach", (1, 2, 6)),
    Case("s-lss-teach-usb", "lss", "teach", (1, 2, 6), stamps="usb16"),
    Case("s-lss-pick", "lss", "pick", (1, 2, 3, 4, 5)),
    Case("s-lss-pick-nobaud", "lss", "pick", (1, 2), said=False),
    Case("s-lss-there", "lss", "there", (3, 4), seconds=40, speed=0.3),
    Case("s-lss-there-usb", "lss", "there", (3, 4), stamps="usb16", seconds=40, speed=0.3),
    Case("s-lss-slider", "lss", "slider", (1, 2, 3), seconds=60),
    Case("s-lss-slider-usb", "lss", "slider", (1, 2, 3), stamps="usb16", seconds=60),
    Case("s-wck-moves", "wck", "moves", (0, 1, 4, 9)),
    Case("s-wck-moves-one", "wck", "moves", (12,), baud=38400, stamps="ms"),
    Case("s-wck-moves-usb", "wck", "moves", B14, stamps="usb16"),
    Case("s-wck-moves-bin", "wck", "moves", (0, 1, 4, 9), stamps="none"),
    Case("s-wck-scenes", "wck", "scenes", tuple(range(16))),
    Case("s-wck-scenes-ms", "wck", "scenes", tuple(range(18)), stamps="ms"),
    Case("s-wck-teach", "wck", "teach", (2, 3, 8)),
    Case("s-wck-teach-bin", "wck", "teach", (2, 3, 8), stamps="none"),
    Case("s-wck-rover", "wck", "rover", (0, 1, 5, 6)),
    Case("s-wck-rover-usb", "wck", "rover", (0, 1, 5, 6), stamps="usb16", seconds=40),
    Case("s-rs-sync", "rs", "sync", B18),
    Case("s-rs-sync-usb", "rs", "sync", (1, 2, 5), stamps="usb16"),
    Case("s-rs-sync-bin", "rs", "sync", (1, 2, 5), stamps="none"),
    Case("s-rs-script", "rs", "script", A, baud=230400),
    Case("s-rs-script-ms", "rs", "script", (1,), stamps="ms", seconds=40),
    Case("s-rs-acked", "rs", "acked", (1, 2, 3, 10)),
    Case("s-rs-acked-usb", "rs", "acked", (1, 2, 3, 10), stamps="usb16"),
    Case("s-rs-acked-hex", "rs", "acked", (1, 2, 3, 10), stamps="hex"),
    Case("s-rs-acked-nobaud", "rs", "acked", (1, 2, 3, 10), said=False),
    Case("s-session-mz", "mz", "session", (3, 7, 8, 12), seconds=75),
    Case("s-session-mz-usb", "mz", "session", (1, 2, 3, 4, 5, 6), stamps="usb16", seconds=75),
    Case("s-session-lss", "lss", "session", (5, 6, 11), seconds=75),
    Case("s-session-rs", "rs", "session", (1, 2, 3, 10), stamps="ms", seconds=75),
    Case("s-session-wck-usb", "wck", "session", (0, 1, 4, 9), stamps="usb16", seconds=75),
)
