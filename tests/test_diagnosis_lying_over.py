"""Second answers that lie over what servos asked later say: whose they are, what they are not."""

from __future__ import annotations

import pytest

from bench.diagnosis.catalogue import scenarios
from bench.diagnosis.judging import case_of

DRAW = 99202
"""Of the benchmark: a servo answers once more so late that it speaks into the next but one."""


@pytest.mark.parametrize("host", ["exact", "log"])
def test_second_answers_within_another_servos_are_neither_that_ones_nor_unasked(host: str) -> None:
    name = "duplicate-id-apart-mightyzap"
    (scenario,) = scenarios(DRAW, name)
    case = case_of(scenario, scenario.make(DRAW), host, DRAW)
    (said,) = (told for told in case.told if told.cause == "duplicate-id")
    assert said.servo_ids == (2,)
    assert "speaks-unasked" not in said.codes
