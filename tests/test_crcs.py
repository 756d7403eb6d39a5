"""CRCs: the check values that catalogues print, and columns beside single packets."""

from __future__ import annotations

from typing import Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.crc import OVERLAP, Crc8, Crc16

CHECKED: Final = b"123456789"
KINDS: Final = {
    "buypass": (Crc16(0x8005), 0xFEE8),
    "xmodem": (Crc16(0x1021), 0x31C3),
    "ibm-3740": (Crc16(0x1021, 0xFFFF), 0x29B1),
    "modbus": (Crc16(0x8005, 0xFFFF, reflected=True), 0x4B37),
    "kermit": (Crc16(0x1021, reflected=True), 0x2189),
    "ibm-sdlc": (Crc16(0x1021, 0xFFFF, reflected=True, out=0xFFFF), 0x906E),
    "riello": (Crc16(0x1021, 0xB2AA, reflected=True), 0x63D0),
    "smbus": (Crc8(0x07), 0xF4),
    "maxim": (Crc8(0x31, reflected=True), 0xA1),
    "sae-j1850": (Crc8(0x1D, 0xFF, out=0xFF), 0x4B),
}
"""Source: Greg Cook's catalogue of parametrised CRC algorithms, the "check" of each."""


@pytest.mark.parametrize("kind", KINDS)
def test_a_crc_is_what_the_catalogue_prints_for_the_nine_digits(kind: str) -> None:
    crc, check = KINDS[kind]
    assert crc(CHECKED) == check
    block = np.frombuffer(CHECKED + check.to_bytes(crc.width, "little"), np.uint8)
    assert crc.good(block, np.array([0]), np.array([9])).all()
    assert not crc.good(block, np.array([1]), np.array([9])).any()


@given(data=st.binary(max_size=600), cuts=st.lists(st.tuples(*[st.integers(0, 600)] * 3)))
def test_a_crc_of_parts_put_together_is_that_of_the_whole(
    data: bytes, cuts: list[tuple[int, int, int]]
) -> None:
    for crc, _ in KINDS.values():
        block = np.frombuffer(data, np.uint8)
        spans = np.sort(np.array(cuts, np.int64).reshape(-1, 3).clip(0, len(data)))
        first, between, last = spans.T
        whole = [crc(data[a:b]) for a, b in zip(first, last, strict=True)]
        assert crc.over(block, [(first, last)]).tolist() == whole
        assert crc.over(block, [(first, between), (between, last)]).tolist() == whole


def test_a_crc_of_packets_that_overlap_is_the_same_by_prefixes() -> None:
    rng = np.random.default_rng(8)
    data = rng.integers(0, 256, 700, np.uint8)
    first = rng.integers(0, 300, 40)
    last = first + rng.integers(0, 400, 40)
    assert (last - first).sum() > OVERLAP * len(data)
    for crc, _ in KINDS.values():
        one = [crc(data[a:b].tobytes()) for a, b in zip(first, last, strict=True)]
        assert crc.over(data, [(first, last)]).tolist() == one
