"""The edge list of the mightyZAP plan: every SIZE, the ids and codes at the edges, sums that hold.

Random streams seldom meet a length guard at its limit; this list meets them all.
"""

from __future__ import annotations

import itertools

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.checksums import COMPLEMENT_SUM
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.mightyzap.grammar import COMMANDS
from tests.lists import each_in_turn, in_turn, thinned, walks_a_list
from tests.records import batches, gaps, records
from tests.streams import module

IDS = (0, 1, 2, 253, 254, 255)
CODES = (0, 1, 0x20, 0x7F, 0x80, 0xF7, 0xFF, *COMMANDS)


def packet(servo_id: int, size: int, code: int, fill: int) -> bytes:
    """Build a packet by hand: the grammar would refuse the sizes that are of interest here."""
    factors = bytes((fill + k) & 0xFF for k in range(max(size - 2, 0)))
    body = bytes([servo_id, size, code]) + factors
    return b"\xff\xff\xff" + body + bytes([COMPLEMENT_SUM(body)])


@walks_a_list
@in_turn(2)
@pytest.mark.parametrize("servo_id", IDS)
@pytest.mark.parametrize("fill", [2, 0x86])
def test_every_size_at_the_edges_decodes_as_the_reference_says(servo_id: int, fill: int) -> None:
    stream = b"".join(
        packet(servo_id, size, code, fill)
        for size, code in itertools.product(thinned(range(256), 17), CODES)
    )
    for a in range(0, len(stream), 60_000):
        part = [Chunk(stream[a : a + 60_000])]
        got = records(batches(Decoder("mightyzap"), [part]))
        want = Reference(PROTOCOLS["mightyzap"]).decode(part)
        assert got.frames == want.frames
        assert got.transactions == want.transactions
        assert got.samples == want.samples


@each_in_turn(2, "name", PROTOCOLS)
@given(data=st.data())
def test_one_corrupt_byte_costs_only_the_frames_it_touches(name: str, data: st.DataObject) -> None:
    talk = data.draw(st.lists(module(name).TALK, min_size=1, max_size=8).map(b"".join))
    whole = records(batches(Decoder(name), [[Chunk(talk)]])).frames
    at = data.draw(st.integers(0, len(talk) - 1)) if talk else 0
    assume(talk)
    broken = bytearray(talk)
    broken[at] ^= data.draw(st.integers(1, 255))
    parts = batches(Decoder(name), [[Chunk(bytes(broken))]])
    left = records(parts).frames
    kept = {(f[0], f[1]) for f in left}
    untouched = {(f[0], f[1]) for f in whole if not f[0] <= at < f[0] + f[1]}
    # What the corrupt byte itself makes hold may cover others: the law leaves those out. So does a
    # request that is gone: a bare reply behind it is no frame without it.
    new = [f for f in left if (f[0], f[1]) not in {(g[0], g[1]) for g in whole}]
    shadow = any(f[0] <= at < f[0] + f[1] for f in new)
    bare = name in ("wck", "rs30x")
    assert shadow or bare or untouched <= kept
    assert sum(f[1] for f in left) + sum(g[1] for g in gaps(parts)) == len(broken)
