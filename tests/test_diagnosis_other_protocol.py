"""Captures that are read by a protocol which nobody on the bus speaks."""

from __future__ import annotations

import pytest

import sniffer
from sniffer.decoding.options import Options
from tests.conversations import Conversation
from tests.diagnosed import diagnosed, verdicts
from tests.lists import in_turn
from tests.streams import mightyzap
from tests.transcripts import ROOT


@in_turn(2)
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


@pytest.mark.parametrize("named", ["lss", "rs30x", "wck"])
def test_a_bus_that_says_little_has_bits_alike_and_no_wrong_rate(named: str) -> None:
    """From end to end, and whether it moves there: all bytes have bit 6 as bit 5."""
    talk = Conversation("mightyzap")
    for k in range(2000):
        if k % 200 == 0:
            place = (k // 200 % 2 * 4095).to_bytes(2, "little")
            talk.write(mightyzap.packet(0, 0xF3, b"\x86" + place))
            talk.say(mightyzap.packet(0, 0xF2, b"\x8c\x02"))
            talk.rest(0.3)
            talk.say(mightyzap.packet(0, 0, place))
            talk.rest(1)
        talk.say(mightyzap.packet(0, 0xF2, b"\x96\x01"))
        talk.rest(0.3)
        talk.say(mightyzap.packet(0, 0, bytes([k % 200 < 150])))
        talk.rest(1)
    told = diagnosed(talk.chunks, named).incidents()
    assert verdicts(told) == [("mixed-protocols", ())]
