"""Frames as protocols make them: what a protocol does not state has its column all the same."""

from __future__ import annotations

import numpy as np
import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.ground.columnar import column_names
from sniffer.ground.model import Frames
from sniffer.protocols.shapes import MANY
from tests.streams.mightyzap import packet


def test_frames_that_state_some_columns_are_blank_ones_that_have_those() -> None:
    told = {"start": np.array([0, 9]), "length": np.array([9, 15]), "servo_id": np.array([1, 2])}
    stated, blank = Frames.stating(**told), Frames.blank(2).having(**told)
    for name in column_names(Frames):
        one, other = getattr(stated, name), getattr(blank, name)
        np.testing.assert_array_equal(one, other, strict=True)
        assert one.flags.writeable


def test_a_column_that_frames_do_not_have_is_refused() -> None:
    with pytest.raises(TypeError, match="no servo"):
        Frames.stating(start=np.array([0]), servo=np.array([1]))


def test_a_value_out_of_range_is_found_among_many_as_among_few() -> None:
    one = packet(1, 0xF2, b"\x8c\x02") + packet(1, 0, b"\x34\x08")
    wrong = packet(1, 0xF2, b"\x8c\x02") + packet(1, 0, b"\x88\x13")  # 5000, of 4095
    stream = one * 2 * MANY + wrong + one * 100
    together, apart = Decoder("mightyzap"), Decoder("mightyzap")
    step = len(stream) // 40
    few = [apart.feed(stream[at : at + step]) for at in range(0, len(stream), step)]
    many = [together.feed(stream), together.close()]
    told = [a for batch in many for a in batch.anomalies]
    assert told == [a for batch in (*few, apart.close()) for a in batch.anomalies]
    assert [a.code for a in told if "5000" in a.detail] == ["value-out-of-range"]
