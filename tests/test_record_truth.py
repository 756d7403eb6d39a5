"""``sniffer record`` beside ``sniffer simulate --truth``: what is recorded is what happened."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from bench.truths import FAULTS, Compared, buses, complaints, play
from sniffer.simulation import BUSES
from tests.terminals import LINUX_ONLY

if TYPE_CHECKING:
    from collections.abc import Mapping

SECONDS = 3.0

pytestmark = LINUX_ONLY

EVERY_BUS = pytest.mark.parametrize("name", BUSES)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Compared]:
    """Every protocol, without faults and with all of them, heard by one recorder at once."""
    found = play(tmp_path_factory.mktemp("truth"), buses(), SECONDS)
    return {it.bus.name: it for it in found}


@EVERY_BUS
def test_a_clean_bus_is_recorded_frame_by_frame_as_it_was(
    name: str, recorded: Mapping[str, Compared]
) -> None:
    it = recorded[name]
    assert complaints(it) == []
    assert it.heard == it.said
    assert len(it.whole) > 100
    assert it.damaged == []
    assert (it.missed, it.recorded == it.decoded) == ([], True)
    claimed = sum(len(row.data) for row in it.recorded)
    assert len(it.said) - claimed <= sum(z - a for a, z in it.unasked)


@EVERY_BUS
def test_of_a_bus_with_faults_what_is_whole_is_recorded_and_what_is_damaged_is_not(
    name: str, recorded: Mapping[str, Compared]
) -> None:
    it = recorded[f"{name}-faults"]
    assert len(FAULTS) == 7
    assert len(it.faults) >= 4
    assert it.damaged
    assert complaints(it) == []
    assert it.heard == it.said
    assert len(it.missed) <= 0.005 * len(it.whole)
