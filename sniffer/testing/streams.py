"""Streams made of a talk by chance that can be repeated: bursts, noise, damage, cuts, silences."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

from sniffer.ground.model import Chunk, Clock
from sniffer.ground.timing import byte_time_ns
from sniffer.testing.truth import BEGIN_NS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from random import Random

    from sniffer.protocols.base import BusProtocol
    from sniffer.testing.talk import Exchange


def stream(rng: Random, exchanges: Sequence[Exchange]) -> bytes:
    """Return some of a talk as a bad line has it: retries, losses, bursts, noise, damage."""
    out = b""
    for _ in range(rng.randint(1, 8)):
        e = rng.choice(exchanges)
        match rng.choice(("said", "said", "said", "again", "lost", "burst", "noise", "part")):
            case "said":
                out += e.said
            case "again":
                out += e.request * rng.randint(2, 3) + b"".join(e.replies)
            case "lost":
                out += e.request
            case "burst":
                out += burst(rng, exchanges)
            case "noise":
                out += noise(rng, e.data)
            case "part":
                out += e.data[rng.randrange(len(e.data)) :]
    return damaged(rng, out)


def burst(rng: Random, exchanges: Sequence[Exchange]) -> bytes:
    """Return several requests, and their answers in and out of order, lost or doubled."""
    some = rng.choices(exchanges, k=rng.randint(2, 5))
    answers = [raw for e in some for raw in e.replies * rng.choice((0, 1, 1, 1, 2))]
    if rng.random() < 0.3:
        rng.shuffle(answers)
    return b"".join(e.request for e in some) + b"".join(answers)


def noise(rng: Random, like: bytes) -> bytes:
    """Return bytes of nothing, many of them such as mean something elsewhere."""
    return bytes(
        rng.choice((rng.choice(like), rng.randrange(256))) for _ in range(rng.randint(1, 9))
    )


def damaged(rng: Random, data: bytes) -> bytes:
    """Flip, drop or insert a few bytes, or none."""
    out = bytearray(data)
    for _ in range(rng.choice((0, 0, 1, 2, 3))):
        at = rng.randrange(len(out)) if out else 0
        match rng.choice(("flip", "drop", "insert")):
            case "flip" if out:
                out[at] ^= rng.randint(1, 255)
            case "drop":
                del out[at : at + rng.randint(1, 9)]
            case _:
                out[at:at] = rng.randbytes(rng.randint(1, 4))
    return bytes(out)


def chunked(rng: Random, protocol: BusProtocol, data: bytes) -> list[Chunk]:
    """Cut a stream into reads with jitter, lulls and now and then a silence."""
    byte_ns, tail_ns = byte_time_ns(protocol.baud), protocol.tail_ns
    cuts = rng.sample(range(1, len(data)), min(rng.randint(0, 8), max(len(data) - 1, 0)))
    edges = [0, *sorted(cuts), len(data)]
    t, out = BEGIN_NS, []
    for a, b in itertools.pairwise(edges):
        if b > a:
            pause = rng.choice(
                (0, 0, rng.randint(0, 3_000_000), tail_ns // 2, tail_ns + 1, 3 * tail_ns)
            )
            t += (b - a) * byte_ns + pause
            out.append(Chunk(data[a:b], t, Clock.READ))
    return out


def recut(rng: Random, protocol: BusProtocol, chunks: Sequence[Chunk], most: int) -> list[Chunk]:
    """Return the same bytes in other chunks, each byte at its time; ``most`` cuts a chunk."""
    byte_ns = byte_time_ns(protocol.baud)
    out: list[Chunk] = []
    for c in chunks:
        n, end = len(c.data), c.t_ns or 0
        edges = [0, *sorted(rng.sample(range(1, n), min(most, n - 1))), n]
        for a, b in itertools.pairwise(edges):
            out.append(Chunk(c.data[a:b], end - (n - b) * byte_ns, c.clock))
    return out
