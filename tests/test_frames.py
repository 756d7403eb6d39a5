"""Frames as protocols make them: what a protocol does not state has its column all the same."""

from __future__ import annotations

import numpy as np
import pytest

from sniffer.ground.columnar import column_names
from sniffer.ground.model import Frames


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
