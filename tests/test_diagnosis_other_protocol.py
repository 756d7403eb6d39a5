"""Captures that are read by a protocol which nobody on the bus speaks."""

from __future__ import annotations

import pytest

import sniffer
from sniffer.decoding.options import Options
from tests.transcripts import ROOT


@pytest.mark.parametrize("named", ["mightyzap", "lss", "rs30x", "wck"])
@pytest.mark.parametrize("spoken", ["mightyzap_clean.log", "lss_clean.bin", "rs30x_clean.hex"])
def test_a_bus_read_by_a_protocol_that_nobody_speaks_is_told_as_that_alone(
    named: str, spoken: str
) -> None:
    told = sniffer.diagnose(ROOT / "sample_captures" / spoken, Options(protocol=named))
    if spoken.startswith(named):
        assert told.incidents == ()
        return
    (incident,) = told.incidents
    assert incident.cause == "mixed-protocols"
    assert f"{spoken.partition('_')[0]} is spoken, not {named}" in incident.story
    assert incident.next.startswith("Decode it as the protocol that is spoken")
