"""A loop over all servos, as most programs have one: with scans, waits and rests."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from bench.other.talk import (
    lss,
    mz,
    mz_goal,
    mz_read,
    mz_write,
    rs,
    rs_goal,
    wck_move,
    wck_status,
)
from bench.other.wire import Ask, Bus, Sleep

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.other.controllers import Steps

Frame = tuple["Callable[[int], bytes]", "Callable[[int], bytes]", "Callable[[int, float], bytes]"]

FRAMES: Final[dict[str, Frame]] = {
    "mz": (lambda i: mz(i, 0xF1), lambda i: mz_read(i, 0x8C, 8), mz_goal),
    "lss": (
        lambda i: lss(i, "QD"),
        lambda i: lss(i, "QD"),
        lambda i, x: lss(i, "D", round((x - 0.5) * 1800)),
    ),
    "rs": (lambda i: rs(i, 0xF, 0, 3, 0), lambda i: rs(i, 9, 0, 0, 1), rs_goal),
    "wck": (wck_status, wck_status, wck_move),
}
"""How a servo is looked for, looked at, and sent somewhere."""


ON: Final[dict[str, Callable[[int], bytes]]] = {
    "mz": lambda i: mz_write(i, 0x80, 1),
    "rs": lambda i: rs(i, 0, 0x24, 1, 1, b"\x01"),
}
"""How torque is switched on, where a goal alone does not."""


def rounds(
    proto: str,
    bus: Bus,
    ids: Sequence[int],
    *,
    hz: float = 20,
    goals: bool = True,
    steps: int = 0,
    rest: float = 0.0,
    idle: tuple[int, float] = (0, 0.0),
    looks: Sequence[int] = (),
    waits: bool = False,
) -> Steps:
    """Send all, look at all; before that look for ids, or wait for the first servo.

    ``rest`` is behind each so many ``steps``, ``idle`` once, behind so many cycles.
    """
    find, look, send = FRAMES[proto]
    wait = 0.05
    while waits and (yield Ask(find(ids[0]), 0.03)) is None:
        yield Sleep(wait)
        wait = min(1.4 * wait, 1.0)
    for i in looks:
        yield Ask(find(i), 0.03)
    for i in ids:
        if proto in ON:
            yield Ask(ON[proto](i))
    n = 0
    while True:
        since = bus.now
        for i in ids:
            if goals:
                yield Ask(send(i, 0.5 + 0.2 * math.sin(1.7 * since + i)), 0.003)
            yield Ask(look(i))
        n += 1
        yield Sleep(max(1 / hz - (bus.now - since), 0.0003))
        if steps and n % steps == 0:
            yield Sleep(rest * bus.rng.uniform(0.8, 1.2))
        if n == idle[0]:
            yield Sleep(idle[1])
