"""Scenarios of the tap's own: what was on the line was well, or what the tap made of it is not."""

from __future__ import annotations

import random
from bisect import bisect_left
from typing import TYPE_CHECKING

from bench.diagnosis.dialect import US
from bench.diagnosis.ear import tapped
from bench.diagnosis.hosts import TwoWires
from bench.diagnosis.making import Plan, bench_of, episode, plan, talked
from bench.diagnosis.scenario import Heard, Scenario, Truth
from bench.diagnosis.troubles import Noise
from bench.diagnosis.wires import PROTOCOLS
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from bench.diagnosis.line import Trouble


def scenarios(draw: int = 0) -> Iterator[Scenario]:
    """Yield all of these, drawn anew for each number."""
    for protocol in PROTOCOLS:
        yield echo(protocol, draw)
        yield echo_that_differs(protocol, draw)
        yield lost(protocol, draw, told=True)
        yield lost(protocol, draw, told=False)
        yield swapped(protocol, draw)
        yield one_way(protocol, draw, requests=True)
        if protocol != "wck":  # whose answers are two bytes of anything: no frame without a request
            yield one_way(protocol, draw, requests=False)


def sound(it: Plan, seed: int, troubles: Sequence[Trouble] = ()) -> list[Heard]:
    """Return what a good tap hears."""
    return tapped(talked(it, seed, bench_of(it, seed, troubles=troubles)))


def echoed(meant: Sequence[Heard], heard: Sequence[Heard]) -> list[Heard]:
    """Return the log of an adapter that notes what it sends and hears it once more.

    What was sent is noted as it was meant, when the first bit went out.
    """
    out: list[Heard] = []
    requests = iter([h for h in meant if h.tx])
    for h in heard:
        if h.tx:
            sent = next(requests)
            note_ns = max(h.t_start_ns - 2 * US, out[-1].t_end_ns + 1 if out else 0)
            # noted at once, whatever time the bytes take on the wire
            out.append(Heard(note_ns - 1, note_ns, sent.wire, True))
        out.append(h)
    return out


def echo(protocol: str, draw: int) -> Scenario:
    """An adapter hears what it sends."""
    it = plan("echo", protocol, draw, seconds=(8, 14))

    def make(seed: int) -> list[Heard]:
        heard = sound(it, seed)
        return echoed(heard, heard)

    return Scenario(it.name, protocol, (Truth("echo", (), 0.0, it.seconds),), it.baud, make)


def echo_that_differs(protocol: str, draw: int) -> Scenario:
    """The same on a line with noise: now and then what comes back is not what was sent."""
    it = plan("echo-differs", protocol, draw, seconds=(10, 18), retries=0)
    (a, b), rate = episode(it), it.rng.uniform(8, 25)

    def make(seed: int) -> list[Heard]:
        bench = bench_of(it, seed, troubles=[Noise([(a, b)], rate, low_share=0.4)])
        heard = tapped(talked(it, seed, bench))
        sent = {int(s.t_ns): s.data for s in bench.said if s.sender < 0}
        # where noise tore a row, what was sent goes in front of its first part
        starts = sorted(sent)
        out: list[Heard] = []
        for h in heard:
            while starts and starts[0] <= h.t_start_ns + 2 * US:
                begin = starts.pop(0)
                note_ns = max(begin, out[-1].t_end_ns + 1 if out else 0)
                out.append(Heard(note_ns, note_ns + 1, sent[begin], True))
            out.append(h)
        return out

    truths = (Truth("echo", (), 0.0, it.seconds), Truth("bus-noise", (), a, b))
    return Scenario(it.name, protocol, truths, it.baud, make)


def _without(
    heard: Sequence[Heard], holes: Sequence[tuple[int, int]], *, told: bool, byte_ns: float
) -> list[Heard]:
    """Return what is left when all bytes that ended within the holes are gone."""
    out: list[Heard] = []
    k = 0
    for h in heard:
        kept = bytearray()
        begin = h.t_start_ns
        for n, value in enumerate(h.wire):
            end = h.t_end_ns - (len(h.wire) - 1 - n) * byte_ns
            while k < len(holes) and end >= holes[k][1]:
                if told:
                    if kept:
                        out.append(Heard(begin, int(end - byte_ns), bytes(kept), h.tx))
                        kept.clear()
                    out.append(Heard(int(end - byte_ns), int(end - byte_ns), b"", h.tx))
                k += 1
            if k < len(holes) and holes[k][0] <= end:
                if kept:
                    out.append(Heard(begin, int(end - byte_ns), bytes(kept), h.tx))
                    kept.clear()
                continue
            if not kept:
                begin = int(end - byte_ns)
            kept.append(value)
        if kept:
            out.append(Heard(begin, h.t_end_ns, bytes(kept), h.tx))
    return out


def with_holes(
    heard: Sequence[Heard],
    it: Plan,
    seed: int,
    *,
    window: tuple[float, float],
    size: tuple[int, int],
    every_s: float,
    told: bool,
) -> list[Heard]:
    """Return what is left when a buffer runs over now and then, each time for so many bytes."""
    own = random.Random(f"{it.name} holes {seed}")
    byte_ns = 10 * NS / it.baud
    ends = [h.t_end_ns - (len(h.wire) - 1 - n) * byte_ns for h in heard for n in range(len(h.wire))]
    holes, t = [], window[0] * NS
    while (t := t + own.expovariate(1 / every_s) * NS) < window[1] * NS:
        # it runs over when bytes come, and what is lost are bytes, not time
        first = bisect_left(ends, t)
        last = min(first + own.randint(*size), len(ends) - 1)
        if first < last:
            holes.append((int(ends[first]), int(ends[last])))
            t = ends[last]
    return _without(heard, holes, told=told, byte_ns=byte_ns)


def lost(protocol: str, draw: int, *, told: bool) -> Scenario:
    """The tap has no room for some bytes, across frames of all; its driver tells, or does not."""
    it = plan("tap-loss-told" if told else "tap-loss", protocol, draw, seconds=(12, 25))
    rng, (a, b) = it.rng, episode(it)
    size, every_s = rng.choice(((8, 40), (30, 120), (60, 300))), rng.uniform(0.12, 0.5)

    def make(seed: int) -> list[Heard]:
        heard = sound(it, seed)
        return with_holes(heard, it, seed, window=(a, b), size=size, every_s=every_s, told=told)

    return Scenario(it.name, protocol, (Truth("tap-loss", (), a, b),), it.baud, make)


def swapped(protocol: str, draw: int) -> Scenario:
    """Of a tap on two wires the names are swapped: requests are said to be the servos'."""
    it = plan("tap-swapped", protocol, draw, seconds=(6, 14))

    def make(seed: int) -> list[Heard]:
        return [h._replace(tx=not h.tx) for h in sound(it, seed)]

    return TwoWires(it.name, protocol, (Truth("tap-swapped", (), 0.0, it.seconds),), it.baud, make)


def one_way(protocol: str, draw: int, *, requests: bool) -> Scenario:
    """The tap hears one wire only: the controller's, or the servos'."""
    name = "tap-one-way-requests" if requests else "tap-one-way-answers"
    it = plan(name, protocol, draw, seconds=(6, 14), servos=(3, 7), retries=0)

    def make(seed: int) -> list[Heard]:
        return [h for h in sound(it, seed) if h.tx == requests]

    truth = Truth("tap-one-way", (), 0.0, it.seconds)
    return Scenario(it.name, protocol, (truth,), it.baud, make)
