"""Two taps on one bus whose controller asks all servos at once: the answers find their requests."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.model import NS
from sniffer.simulation import BUSES, TrueFrame
from tests.lists import in_turn
from tests.streams.mightyzap import packet as zap
from tests.streams.rs30x import packet, returned
from tests.taps import MS, RX, START_NS, TX, Bus, Pair, pairs, tap

if TYPE_CHECKING:
    from collections.abc import Callable

Exchange = tuple[bytes, bytes]


ASKS: Final[dict[str, Callable[[int, int], Exchange]]] = {
    "lss": lambda i, v: (b"#%dQD\r" % i, b"*%dQD%d\r" % (i, v)),
    "mightyzap": lambda i, v: (
        zap(i, 0xF2, b"\x8c\x02"),
        zap(i, 0, v.to_bytes(2, "little")),
    ),
    "rs30x": lambda i, v: (
        packet(i, 9),
        returned(i, 42, v.to_bytes(2, "little") + bytes(16)),
    ),
}
"""What a controller asks a servo, and what comes back."""

SERVOS: Final = 5
LATENCIES: Final = ((1, 1), (16, 16), (1, 16), (16, 1))


def all_at_once(
    name: str,
    latency: tuple[int, int],
    *,
    rounds: int = 60,
    pause_ns: int = 20 * MS,
    lost: float = 0.0,
    seed: int = 1,
) -> tuple[Bus, set[Pair]]:
    """Return a bus where all servos are asked in one go, and what belongs together."""
    rng, baud = random.Random(seed), BUSES[name].baud
    frames: list[TrueFrame] = []
    true: set[Pair] = set()
    now, at = START_NS, [0, 0]

    def say(data: bytes, kind: str) -> int:
        nonlocal now
        end = now + len(data) * 10 * NS // baud
        frames.append(TrueFrame(now, end, data, data, kind, 0, ""))
        now, wire = end, kind == "response"
        at[wire] += len(data)
        return at[wire] - len(data)

    for _ in range(rounds):
        turn = [(servo, rng.randrange(900)) for servo in range(1, SERVOS + 1)]
        exchanges = [ASKS[name](servo, value) for servo, value in turn]
        asked = [say(q, "request") for q, _ in exchanges]
        for begun, (_, r) in zip(asked, exchanges, strict=True):
            now += rng.randrange(100_000, 400_000)
            if rng.random() >= lost:
                true.add((begun, say(r, "response")))
        now += pause_ns + rng.randrange(MS)
    tx, rx = (
        tap(frames, wire, baud, ms * MS, rng.randrange(ms * MS))
        for wire, ms in zip((TX, RX), latency, strict=True)
    )
    return Bus(name, frames, tx, rx, max(latency) * MS), true


@in_turn(3)
@pytest.mark.parametrize("ms", LATENCIES, ids=str)
@pytest.mark.parametrize("name", ASKS)
@pytest.mark.parametrize("lost", [0.0, 0.05], ids=["all answer", "some are silent"])
def test_where_all_are_asked_at_once_every_answer_finds_its_request(
    name: str, ms: tuple[int, int], lost: float
) -> None:
    bus, true = all_at_once(name, ms, rounds=30, lost=lost)
    assert len(true) > (1 - 2 * lost) * 30 * SERVOS - 1
    found = pairs(name, bus.merged(), bus.latency_ns)
    if not lost:
        assert found == true
    # Where one is missing and stamps are slow, another round's answer may fit its request.
    assert len(found & true) >= 0.9 * len(true)


@in_turn(3)
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", ["lss", "mightyzap"])
def test_the_wire_whose_reads_come_faster_tells_a_round_from_the_next_though_an_answer_is_missing(
    name: str, seed: int
) -> None:
    """The latency stated is that of the slower one, by which the next round's answer fits, too."""
    bus, true = all_at_once(name, (1, 16), rounds=30, pause_ns=12 * MS, lost=0.05, seed=seed)
    found = pairs(name, bus.merged(), bus.latency_ns)
    assert len(found & true) >= 0.95 * len(true)


@pytest.mark.parametrize("name", ["lss", "rs30x"])
def test_rounds_that_follow_each_other_faster_than_stamps_tell_are_not_shifted_by_one(
    name: str,
) -> None:
    """Each answer would fit the next round's request as well, and stand nearer to its stamp."""
    bus, true = all_at_once(name, (1, 16), rounds=30, pause_ns=2 * MS)
    assert pairs(name, bus.merged(), bus.latency_ns) == true
