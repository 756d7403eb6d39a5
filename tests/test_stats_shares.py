"""A share of few has an interval."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.jobs.stats import stats
from sniffer.selection.selection import Selection
from sniffer.statistics.commands import wilson
from tests.commands import within

CAPTURE: Final = Path(__file__).parents[1] / "sample_captures" / "mightyzap_damaged.log"


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    # R: binom::binom.wilson(k, n), rounded to six places
    [(0, 10, 0.0, 0.277533), (1, 10, 0.017876, 0.404150), (10, 10, 0.722467, 1.0)],
)
def test_a_share_has_the_interval_of_wilson(k: int, n: int, low: float, high: float) -> None:
    assert wilson(k, n) == pytest.approx((low, high), abs=1e-6)


@given(n=st.integers(0, 10**6), data=st.data())
def test_the_share_itself_lies_in_its_interval(n: int, data: st.DataObject) -> None:
    k = data.draw(st.integers(0, n))
    low, high = wilson(k, n)
    assert 0 <= low <= (k / n if n else 0) <= high <= 1 or not n


def test_requests_that_are_selected_by_what_came_of_them_have_no_share(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for text, is_shared in (("servo_id = 1", True), ("outcome = 'no_response'", False)):
        (bus,) = stats(CAPTURE, selection=Selection.parse(text)).as_dict()["buses"]
        (mine,) = [c for c in bus["commands"] if (c["servo_id"], c["op"]) == (1, "load_data")]
        assert mine["missing"] == 6
        assert (mine["missing_share"] is not None) == is_shared
        assert (mine["missing_interval"] is not None) == is_shared
    ran = within(capsys, "stats", CAPTURE, "--where", "outcome = 'no_response'")
    assert "100 %" not in ran.out.partition("answers that are missing")[2].partition("\n\n")[0]
