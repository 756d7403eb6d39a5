"""Sessions with phases: homed one by one, a gait, waiting, let go by one broadcast, on again."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from bench.other.rounds import FRAMES, ON
from bench.other.talk import lss, mz_write, rs, wck_passive
from bench.other.wire import Ask, Sleep

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bench.other.controllers import Steps
    from bench.other.wire import Bus

OFF: Final[dict[str, Callable[[Sequence[int]], list[bytes]]]] = {
    "mz": lambda ids: [mz_write(0xFE, 0x80, 0)],
    "rs": lambda ids: [rs(0xFF, 0, 0x24, 1, 1, b"\x00")],
    "lss": lambda ids: [lss(254, "L")],
    "wck": lambda ids: [wck_passive(i) for i in ids],
}
"""How all are let go: at once, where the protocol has that."""


def session(proto: str, bus: Bus, ids: Sequence[int], *, hz: float = 15) -> Steps:
    """Home, walk, look once a second, let go, switch on each, walk again; and so on."""
    find, look, send = FRAMES[proto]
    for i in ids:
        yield Ask(find(i), 0.03)
    for i in ids:
        if proto in ON:
            yield Ask(ON[proto](i))
        for step in range(12):
            yield Ask(send(i, 0.5 + step / 120), 0.003)
            yield Ask(look(i))
            yield Sleep(0.03)
        yield Sleep(0.3)
        yield Ask(look(i))
    while True:
        begin = bus.now
        while bus.now - begin < 8:
            since = bus.now
            for i in ids:
                way = min(1.0, (since - begin) / 2)
                yield Ask(send(i, 0.5 + 0.2 * way * math.sin(1.7 * (since - begin) + i)), 0.003)
                yield Ask(look(i))
            yield Sleep(max(1 / hz - (bus.now - since), 0.0003))
        for wait, times in ((1.0, 8), (0.2, 30)):
            for _ in range(times):
                since = bus.now
                for i in ids:
                    yield Ask(look(i))
                yield Sleep(max(wait - (bus.now - since), 0.0003))
            if wait == 1.0:
                for frame in OFF[proto](ids):
                    yield Ask(frame, 0.003)
        for i in ids:
            yield Ask(send(i, 0.5), 0.003)
            if proto in ON:
                yield Ask(ON[proto](i))
        yield Sleep(0.5)
