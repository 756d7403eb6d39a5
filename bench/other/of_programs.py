"""Faults of controllers."""

from __future__ import annotations

from typing import Final

from bench.other.faults import Dead, Loops, Pauses, Replace, Slow
from bench.other.line_faults import Cable, shaken
from bench.other.making import flaky_encoder, jumps, sums
from bench.other.run import Case
from bench.other.sound import B18, A
from bench.other.talk import lss, mz, mz_write, rs, s16, u16, wck_set

PROGRAMS: Final = (
    # impatient-controller
    Case(
        "impatient-mz",
        "mz",
        "states",
        (4, 9),
        "impatient-controller",
        faults=(
            Slow(4, lambda b: b.rng.uniform(0.001, 0.006)),
            Slow(9, lambda b: b.rng.uniform(0.001, 0.006)),
        ),
        patience=0.004,
    ),
    Case(
        "impatient-lss",
        "lss",
        "many",
        (5, 11),
        "impatient-controller",
        faults=(
            Slow(5, lambda b: b.rng.uniform(0.001, 0.006)),
            Slow(11, lambda b: b.rng.uniform(0.001, 0.006)),
        ),
        patience=0.004,
    ),
    Case(
        "impatient-rs",
        "rs",
        "acked",
        (1, 2, 3),
        "impatient-controller",
        faults=tuple(Slow(i, lambda b: b.rng.uniform(0.0, 0.002)) for i in (1, 2, 3)),
        patience=0.001,
    ),
    # controller-stall
    Case(
        "gc-mz-fast",
        "mz",
        "fast",
        (3, 7, 8),
        "controller-stall",
        faults=(Pauses(4.0, 0.35),),
        seconds=30,
    ),
    Case(
        "gc-rs",
        "rs",
        "sync",
        (1, 2, 3),
        "controller-stall",
        faults=(Pauses(4.0, 0.25),),
        seconds=30,
        stamps="usb16",
    ),
    Case(
        "gc-wck",
        "wck",
        "moves",
        (0, 1, 4),
        "controller-stall",
        faults=(Pauses(5.0, 0.5),),
        seconds=30,
    ),
    Case("gc-lss", "lss", "burst", B18, "controller-stall", faults=(Pauses(4.0, 0.6),), seconds=30),
    # controller-jitter
    Case("jitter-mz", "mz", "fast", (3, 7, 8), "controller-jitter", faults=(Pauses(jitter=0.004),)),
    Case("jitter-rs", "rs", "sync", (1, 2, 3), "controller-jitter", faults=(Pauses(jitter=0.008),)),
    # bus-saturated
    Case("full-lss", "lss", "many", B18, "bus-saturated", baud=19200, args={"every": 0.0001}),
    Case("full-mz", "mz", "walk", A, "bus-saturated", baud=19200, args={"hz": 500, "pause": 0.0}),
    Case("full-rs", "rs", "acked", A, "bus-saturated", baud=38400, args={"every": 0.0}),
    # goal-out-of-range
    Case(
        "range-mz",
        "mz",
        "staged",
        (2, 3),
        "goal-out-of-range",
        (2,),
        (Loops(lambda b: mz_write(2, 0x86, *u16(4300)), 1.3),),
    ),
    Case(
        "range-rs",
        "rs",
        "sync",
        (1, 2),
        "goal-out-of-range",
        (1,),
        (Loops(lambda b: rs(1, 0, 0x1E, 2, 1, s16(1700)), 1.7, wait=0),),
    ),
    # position-jump
    Case(
        "jump-mz",
        "mz",
        "fast",
        (3, 7, 8),
        "position-jump",
        (3,),
        (jumps("mz", 3, 0.97, (6.0, 13.0)),),
    ),
    Case(
        "jump-rs", "rs", "acked", (1, 2, 3), "position-jump", (2,), (jumps("rs", 2, 0.02, (7.0,)),)
    ),
    Case(
        "jump-encoder-mz", "mz", "fast", (3, 7, 8), "position-jump", (3,), (flaky_encoder(3, 2.3),)
    ),
    # read-only-write, partial-write
    Case(
        "readonly-mz",
        "mz",
        "walk",
        (4, 9),
        "read-only-write",
        (4,),
        (Loops(lambda b: mz_write(4, 0x8C, 0, 8), 0.6),),
    ),
    Case(
        "readonly-rs",
        "rs",
        "sync",
        (1, 2),
        "read-only-write",
        (2,),
        (Loops(lambda b: rs(2, 0, 0x2A, 2, 1, s16(50)), 0.8, wait=0),),
    ),
    Case(
        "partial-mz",
        "mz",
        "fast",
        (3, 7, 8),
        "partial-write",
        (7,),
        (Loops(lambda b: mz_write(7, 0x86, 200), 0.9),),
    ),
    Case(
        "partial-rs",
        "rs",
        "script",
        (1, 2),
        "partial-write",
        (1,),
        (Loops(lambda b: rs(1, 0, 0x1E, 1, 1, b"\x40"), 0.9, wait=0),),
    ),
    # malformed-command
    Case(
        "malformed-mz-sync",
        "mz",
        "burst",
        A,
        "malformed-command",
        faults=(
            Replace(
                lambda b, f: (
                    mz(0xFE, 0x73, *f[6:-3]) if f[5:6] == b"\x73" and b.rng.random() < 0.1 else f
                )
            ),
        ),
    ),
    Case(
        "malformed-lss",
        "lss",
        "many",
        (5, 11),
        "malformed-command",
        faults=(Loops(lambda b: lss(5, "QZZ"), 0.8),),
    ),
    Case(
        "malformed-wck-sum", "wck", "moves", (0, 1, 4), "malformed-command", faults=(sums("wck"),)
    ),
    Case("malformed-mz-sum", "mz", "walk", (4, 9), "malformed-command", faults=(sums("mz"),)),
    # nv-wear
    Case(
        "wear-mz",
        "mz",
        "walk",
        (4, 9),
        "nv-wear",
        (),
        (Loops(lambda b: mz_write(4, 0x06, 100, 0), 0.02),),
    ),
    Case(
        "wear-rs",
        "rs",
        "sync",
        (1, 2),
        "nv-wear",
        (),
        (Loops(lambda b: rs(1, 0x40, 0xFF, 0, 0), 1.5, wait=0),),
        seconds=60,
    ),
    Case(
        "wear-lss",
        "lss",
        "many",
        (5, 11),
        "nv-wear",
        (),
        (Loops(lambda b: lss(5, "CO", -50), 0.1, wait=0),),
    ),
    Case(
        "wear-wck",
        "wck",
        "moves",
        (0, 1, 4),
        "nv-wear",
        (),
        (Loops(lambda b: wck_set(1, 0x09, 20, 30), 0.5, wait=0.2),),
        seconds=40,
    ),
    # retry-storm
    Case(
        "storm-mz",
        "mz",
        "walk",
        (4, 9, 10),
        "retry-storm",
        (9,),
        (Cable((9,), shaken(4, 1.5), 1.0),),
        retries=25,
        patience=0.006,
        seconds=30,
        also=("bad-cable",),
    ),
    Case(
        "storm-rs",
        "rs",
        "sync",
        (1, 2, 3),
        "retry-storm",
        (2,),
        (Dead((2,), 5, 9), Dead((2,), 13, 15)),
        retries=40,
        patience=0.004,
    ),
)
