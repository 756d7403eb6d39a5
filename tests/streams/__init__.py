"""Streams that properties draw from: talk built with the grammars, damage, cuts, arrival times.

One module a protocol: ``TALK`` draws one exchange (a request and perhaps its reply), ``ASKED`` a
request and its answers apart, of which ``bursts`` makes traffic with several requests in flight;
``BYTES`` are the byte values that mean something to it.
"""

from __future__ import annotations

import importlib
import itertools
from typing import Any, Final

from hypothesis import strategies as st

from sniffer.ground.model import Chunk, Clock

TAIL = 40

KEPT: Final = 1 << 14
"""Packets that are not built anew: talk says the same again and again, and a grammar is slow."""


def module(protocol: str) -> Any:
    """Return the protocol's stream module."""
    return importlib.import_module(f"tests.streams.{protocol}")


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """Flip, drop or insert a few bytes."""
    out = bytearray(data)
    for _ in range(draw(st.integers(0, 3))):
        if not out:
            break
        at = draw(st.integers(0, len(out) - 1))
        match draw(st.integers(0, 2)):
            case 0:
                out[at] ^= draw(st.integers(1, 255))
            case 1:
                del out[at : at + draw(st.integers(1, 9))]
            case _:
                out[at:at] = draw(st.binary(min_size=1, max_size=4))
    return bytes(out)


@st.composite
def bursts(draw: st.DrawFn, protocol: str, rounds: int = 4) -> bytes:
    """Draw several requests in flight: answers in and out of order, lost, doubled, late; retries.

    Answers that are due wait for later bursts, so that windows slide.
    """
    ask = module(protocol).ASKED
    out: list[bytes] = []
    due: list[bytes] = []
    for _ in range(draw(st.integers(1, rounds))):
        for request, answers in draw(st.lists(ask, min_size=1, max_size=6)):
            out += [request] * draw(st.sampled_from([1, 1, 1, 1, 1, 2]))
            due += list(answers) * draw(st.sampled_from([0, 1, 1, 1, 1, 1, 2]))
        for _ in range(draw(st.integers(0, len(due)))):
            out.append(due.pop(draw(st.sampled_from([0, 0, 0, len(due) - 1]))))
    return b"".join(out)


@st.composite
def stream(draw: st.DrawFn, protocol: str) -> bytes:
    """Draw talk, noise made of meaningful bytes, other protocols' talk, and damage to it all."""
    own = module(protocol)
    byte = st.one_of(st.sampled_from(own.BYTES), st.integers(0, 255))
    noise = st.lists(byte, max_size=12).map(bytes)
    other = st.sampled_from(OTHERS).flatmap(lambda name: module(name).TALK)
    talk = st.one_of(own.TALK, own.TALK, own.TALK, own.TALK, bursts(protocol, 2))
    part = st.one_of(talk, talk, talk, talk, noise, other)
    data = b"".join(draw(st.lists(part, max_size=10)))
    if draw(st.integers(0, 9)) == 0:
        data += draw(st.binary(max_size=40)) * 60
    if draw(st.integers(0, 4)) == 0:
        data = data[draw(st.integers(0, 8)) :]
    return draw(damaged(data))


@st.composite
def chunked(draw: st.DrawFn, data: bytes, byte_ns: int, tail_ns: int) -> list[Chunk]:
    """Cut a stream into reads with jitter, lulls and now and then a silence."""
    cuts = draw(st.lists(st.integers(1, max(1, len(data) - 1)), max_size=12, unique=True))
    edges = [0, *sorted(c for c in cuts if c < len(data)), len(data)]
    t, out = 1_700_000_000_000_000_000, []
    pause = st.one_of(
        st.just(0),
        st.integers(0, 3_000_000),
        st.sampled_from([tail_ns // 2, tail_ns + 1, 3 * tail_ns]),
    )
    for a, b in itertools.pairwise(edges):
        if b > a:
            t += (b - a) * byte_ns + draw(pause)
            out.append(Chunk(data[a:b], t, Clock.READ))
    return out


OTHERS = ["lss", "mightyzap", "rs30x", "wck"]


def recut(data: st.DataObject, chunks: list[Chunk], byte_ns: int) -> list[Chunk]:
    """Draw the same bytes in other chunks, each byte at its time."""
    out: list[Chunk] = []
    for c in chunks:
        assert c.t_ns is not None
        cuts = data.draw(st.lists(st.integers(1, max(1, len(c.data) - 1)), max_size=6, unique=True))
        edges = [0, *sorted(x for x in cuts if x < len(c.data)), len(c.data)]
        for a, b in itertools.pairwise(edges):
            out.append(Chunk(c.data[a:b], c.t_ns - (len(c.data) - b) * byte_ns, c.clock))
    return out
