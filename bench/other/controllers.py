"""Controllers that are no tidy poll loops: scripts that walk, burst, wait, teach and play back."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Generator, Sequence
from typing import Any

from bench.other.talk import (
    lss,
    mz,
    mz_goal,
    mz_read,
    mz_sync,
    mz_write,
    rs,
    rs_goal,
    rs_long,
    s16,
    u16,
    wck_move,
    wck_passive,
    wck_set,
    wck_status,
    wck_sync,
    wck_wheel,
)
from bench.other.wire import Ask, Sleep

Steps = Generator[Ask | Sleep, bytes | None, Any]


def jerk(a: float, b: float, s: float) -> float:
    """Minimum jerk from a to b, s from 0 to 1."""
    s = min(1.0, max(0.0, s))
    return a + (b - a) * (10 * s**3 - 15 * s**4 + 6 * s**5)


def pose(rng: random.Random, ids: Sequence[int]) -> dict[int, float]:
    return {i: rng.uniform(0.25, 0.75) for i in ids}


# ---- mightyZAP
def mz_begin(ids: Sequence[int], speed: int = 0) -> Steps:
    for i in ids:
        yield Ask(mz(i, 0xF1))
        yield Ask(mz_read(i, 0, 3))
        yield Ask(mz_write(i, 0x80, 1))
        if speed:
            yield Ask(mz_write(i, 0x88, *u16(speed)))


def mz_walk(
    bus: Any, ids: Sequence[int], hz: float = 50, pause: float = 2.5, settle: float = 0.0
) -> Steps:
    """Moves in stages with pauses in between; state is read only after each stage."""
    rng, at = random.Random(ids[0] + 5), dict.fromkeys(ids, 0.5)
    yield from mz_begin(ids)
    while True:
        to, steps = pose(rng, ids), int(1.2 * hz)
        for n in range(steps + 1):
            for i in ids:
                yield Ask(mz_goal(i, jerk(at[i], to[i], n / steps)))
            yield Sleep(max(0.001, 1 / hz - 0.0025 * len(ids)))
        at = to
        yield Sleep(settle)
        for i in ids:
            yield Ask(mz_read(i, 0x8C, 8))
        yield Sleep(rng.uniform(0.6, 1.4) * pause)


def mz_burst(bus: Any, ids: Sequence[int], hz: float = 100) -> Steps:
    """A second of symmetric stores, then nothing but a rare look at one servo's block."""
    rng, at, k = random.Random(3), dict.fromkeys(ids, 0.5), 0
    yield from mz_begin(ids)
    while True:
        to = pose(rng, ids)
        for n in range(int(hz) + 1):
            yield Ask(mz_sync(0x86, 2, {i: u16(4095 * jerk(at[i], to[i], n / hz)) for i in ids}), 0)
            yield Sleep(1 / hz)
        at = to
        for _ in range(4):
            yield Ask(mz_read(ids[k % len(ids)], 0x8C, 8))
            k += 1
            yield Sleep(0.5)


def mz_fast_one(bus: Any, ids: Sequence[int], hz: float = 500) -> Steps:
    """One servo is held in a fast loop, the others are looked at once a second."""
    yield from mz_begin(ids)
    n, first = 0, ids[0]
    while True:
        t = n / hz
        if n % 2:
            yield Ask(mz_goal(first, 0.5 + 0.2 * math.sin(2.1 * t)))
        else:
            yield Ask(mz_read(first, 0x8C, 2))
        if n % int(hz) == int(hz) - 1:
            for i in ids[1:]:
                yield Ask(mz_goal(i, 0.5 + 0.2 * math.sin(0.5 * t + i)))
                yield Ask(mz_read(i, 0x90, 4))
        n += 1
        yield Sleep(0.0002)


def mz_states(bus: Any, ids: Sequence[int], dwell: float = 0.3) -> Steps:
    """A state machine: the whole block, torque, a goal, 'moving' until it stands, the next one."""
    rng = random.Random(11)
    while True:
        for i in ids:
            yield Ask(mz_read(i, 0x80, 24))
            yield Ask(mz_write(i, 0x80, 1))
            yield Ask(mz_write(i, 0x86, *u16(rng.uniform(900, 3200)), *u16(600)))
            for _ in range(120):
                yield Sleep(0.03)
                moving = yield Ask(mz_read(i, 0x96, 1))
                if moving and moving[6] == 0:
                    break
            yield Ask(mz_read(i, 0x8C, 8))
            yield Sleep(dwell)


def mz_staged(bus: Any, ids: Sequence[int], every: float = 0.25) -> Steps:
    """Goals are sent ahead and executed together; volts and heat are read in turn."""
    rng, k = random.Random(8), 0
    yield from mz_begin(ids, 500)
    while True:
        for i in ids:
            yield Ask(mz(i, 0xF4, 0x86, *u16(rng.uniform(1600, 2500))))
        yield Ask(mz(0xFE, 0xF5), 0)
        for _ in range(4):
            yield Sleep(every)
            yield Ask(mz_read(ids[k % len(ids)], 0x92, 2))
            yield Ask(mz_read(ids[k % len(ids)], 0x8C, 2))
            k += 1


# ---- LSS
def lss_many(bus: Any, ids: Sequence[int], every: float = 0.02) -> Steps:
    """Questions of many kinds, and moves with a time each few seconds."""
    rng, kinds, n = random.Random(4), ["QD", "QV", "QC", "Q", "QT", "QD", "QDT", "QS"], 0
    for i in ids:
        for word in ("QMS", "QN", "QF", "QLED", "QG", "QO"):
            yield Ask(lss(i, word), 0.05)
    while True:
        if n % 60 == 0:
            for i in ids:
                yield Ask(
                    lss(i, "D", rng.randint(-400, 400), "T", str(rng.choice((600, 900, 1500)))), 0
                )
        for i in ids:
            yield Ask(lss(i, kinds[(n + i) % len(kinds)]), 0.05)
        n += 1
        yield Sleep(every * rng.uniform(0.9, 1.3))


def lss_burst(bus: Any, ids: Sequence[int], hz: float = 25) -> Steps:
    """A gait: goals to all legs in one breath; one servo's current and volts each second."""
    n = 0
    while True:
        for i in ids:
            yield Ask(lss(i, "D", round(300 * math.sin(n / hz * 3 + i))), 0)
        if n % int(hz) == 0:
            i = ids[(n // int(hz)) % len(ids)]
            yield Ask(lss(i, "QC"), 0.05)
            yield Ask(lss(i, "QV"), 0.05)
            yield Ask(lss(i, "QD"), 0.05)
        n += 1
        yield Sleep(1 / hz - 0.0007 * len(ids))


def lss_teach(bus: Any, ids: Sequence[int]) -> Steps:
    """Limp, moved by hand and written down; then held and played back."""
    way: list[dict[int, float]] = []
    for s in bus.servos:
        s.hand = lambda t, s=s, a=s.pos: a + 0.2 * math.sin(t * 1.3)
    for i in ids:
        yield Ask(lss(i, "L"), 0)
    for _ in range(160):
        row: dict[int, float] = {}
        for i in ids:
            r = yield Ask(lss(i, "QD"), 0.05)
            if r:
                row[i] = int(r.split(b"QD")[1])
        way.append(row)
        yield Sleep(0.04)
    for i in ids:
        yield Ask(lss(i, "H"), 0)
    while True:
        for row in [*way, *way[::-1]]:
            for i, d in row.items():
                yield Ask(lss(i, "D", round(d)), 0)
            yield Sleep(0.04)
        for i in ids:
            yield Ask(lss(i, "Q"), 0.05)
            yield Ask(lss(i, "QT"), 0.05)


def lss_pick(bus: Any, ids: Sequence[int]) -> Steps:
    """Pick and place: a move, then the status is asked until all hold."""
    rng = random.Random(19)
    while True:
        for i in ids:
            yield Ask(lss(i, "P", rng.randint(1000, 2000), "S", str(rng.randint(300, 900))), 0)
        for _ in range(60):
            yield Sleep(0.05)
            hold = True
            for i in ids:
                r = yield Ask(lss(i, "Q"), 0.05)
                hold = hold and r is not None and r.endswith(b"Q6\r")
            if hold:
                break
        for i in ids:
            yield Ask(lss(i, "QD"), 0.05)
            yield Ask(lss(i, "QC"), 0.05)
            yield Ask(lss(i, "QV"), 0.05)
        yield Sleep(0.8)


def lss_there(bus: Any, ids: Sequence[int]) -> Steps:
    """Go there: the goal is said again before each look until the joint is there; then a rest."""
    rng = random.Random(23)
    while True:
        for i in ids:
            there = rng.randint(-700, 700)
            yield Ask(lss(i, "QD"), 0.1)
            yield Sleep(0.1)
            for _ in range(400):
                yield Ask(lss(i, "D", there), 0)
                yield Sleep(0.01)
                r = yield Ask(lss(i, "QD"), 0.1)
                if r is not None and abs(int(r.split(b"QD")[1]) - there) < 5:
                    break
            yield Sleep(1.5)


def lss_slider(bus: Any, ids: Sequence[int]) -> Steps:
    """A window with sliders: goals while a person moves one, else four looks a second."""
    rng, at = random.Random(29), dict.fromkeys(ids, 0)
    while True:
        i, there = rng.choice(ids), rng.randint(-800, 800)
        while abs(there - at[i]) > 15:
            at[i] += 15 if there > at[i] else -15
            yield Ask(lss(i, "D", at[i]), 0)
            yield Sleep(rng.uniform(0.015, 0.045))
        for _ in range(rng.randint(4, 16)):
            for k in ids:
                yield Ask(lss(k, "QD"), 0.05)
            yield Sleep(0.25)


# ---- wCK
def wck_moves(bus: Any, ids: Sequence[int], hz: float = 30) -> Steps:
    """Position commands, servo by servo, each of which is answered: the usual simple program."""
    n = 0
    while True:
        for i in ids:
            yield Ask(wck_move(i, 0.5 + 0.22 * math.sin(n / hz * 2 + i)), 0.05)
        n += 1
        yield Sleep(max(0.001, 1 / hz - 0.0013 * len(ids)))


def wck_scenes(bus: Any, ids: Sequence[int], hz: float = 40) -> Steps:
    """Scenes: all at once by synchronous moves, then a look at each, then a rest."""
    rng = random.Random(6)
    most = max(ids) + 1
    at = [0.5] * most
    for i in ids:
        yield Ask(wck_set(i, 0x0A, 0, 0), 0.05)
    while True:
        to = [rng.uniform(0.25, 0.75) for _ in range(most)]
        for n in range(int(hz) + 1):
            yield Ask(wck_sync([jerk(a, b, n / hz) for a, b in zip(at, to, strict=True)]), 0)
            yield Sleep(1 / hz)
        at = to
        for i in ids:
            yield Ask(wck_status(i), 0.05)
        yield Sleep(1.1)


def wck_teach(bus: Any, ids: Sequence[int]) -> Steps:
    """Passive and moved by hand, read with each passive command; then played."""
    way: list[list[float]] = []
    for s in bus.servos:
        s.hand = lambda t, s=s, a=s.pos: a + 0.2 * math.sin(t * 1.1)
    for _ in range(120):
        row = []
        for i in ids:
            r = yield Ask(wck_passive(i), 0.05)
            row.append(r[1] / 254 if r else 0.5)
        way.append(row)
        yield Sleep(0.03)
    while True:
        for row in [*way, *way[::-1]]:
            for i, share in zip(ids, row, strict=True):
                yield Ask(wck_move(i, share), 0.05)
            yield Sleep(0.03)


def wck_rover(bus: Any, ids: Sequence[int]) -> Steps:
    """Two wheels that turn, and an arm that is moved now and then."""
    rng = random.Random(2)
    while True:
        for i in ids[:2]:
            yield Ask(wck_wheel(i, rng.choice((3, 4)), rng.randint(3, 12)), 0.05)
        for i in ids[2:]:
            yield Ask(wck_move(i, rng.uniform(0.3, 0.7), 2), 0.05)
        for _ in range(rng.randint(5, 15)):
            yield Sleep(0.1)
            for i in ids[2:]:
                yield Ask(wck_status(i), 0.05)


# ---- RS30x
def rs_begin(ids: Sequence[int]) -> Steps:
    for i in ids:
        yield Ask(rs(i, 3, 0, 0, 1))
        yield Ask(rs(i, 0, 0x24, 1, 1, b"\x01"), 0)
        yield Sleep(0.002)


def rs_sync(bus: Any, ids: Sequence[int], hz: float = 50) -> Steps:
    """One long packet for all, and one servo's present values behind it, in turn."""
    n = 0
    yield from rs_begin(ids)
    while True:
        yield Ask(rs_long(0x1E, {i: s16(700 * math.sin(n / hz * 1.7 + i)) for i in ids}), 0)
        yield Sleep(0.0006)
        yield Ask(rs(ids[n % len(ids)], 9, 0, 0, 1))
        n += 1
        yield Sleep(1 / hz - 0.005)


def rs_script(bus: Any, ids: Sequence[int], rest: float = 1.5) -> Steps:
    """Goals with a time, a long rest, a look at each."""
    rng = random.Random(21)
    yield from rs_begin(ids)
    while True:
        time = rng.choice((40, 80, 120))
        yield Ask(rs_long(0x1E, {i: s16(rng.uniform(-800, 800)) + s16(time) for i in ids}), 0)
        for _ in range(int(time / 20)):
            yield Sleep(0.2)
            for i in ids:
                yield Ask(rs(i, 0xF, 0x2A, 12, 0))
        yield Sleep(rest * rng.uniform(0.5, 1.5))


def rs_acked(bus: Any, ids: Sequence[int], every: float = 0.02) -> Steps:
    """Each goal is acknowledged; now and then all there is to be known is read."""
    n = 0
    yield from rs_begin(ids)
    while True:
        for i in ids:
            yield Ask(rs_goal(i, 0.5 + 0.25 * math.sin(n * every * 2 + i), flg=1))
        if n % 25 == 0:
            i = ids[(n // 25) % len(ids)]
            yield Ask(rs(i, 5, 0, 0, 1))
            yield Ask(rs(i, 9, 0, 0, 1))
        n += 1
        yield Sleep(every)


SCRIPTS: dict[str, dict[str, Callable[..., Steps]]] = {
    "mz": {
        "walk": mz_walk,
        "burst": mz_burst,
        "fast": mz_fast_one,
        "states": mz_states,
        "staged": mz_staged,
    },
    "lss": {
        "many": lss_many,
        "burst": lss_burst,
        "teach": lss_teach,
        "pick": lss_pick,
        "there": lss_there,
        "slider": lss_slider,
    },
    "wck": {"moves": wck_moves, "scenes": wck_scenes, "teach": wck_teach, "rover": wck_rover},
    "rs": {"sync": rs_sync, "script": rs_script, "acked": rs_acked},
}
