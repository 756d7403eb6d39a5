"""The kit on requests that list whom they ask: each servo owes an answer of its own."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import pytest

from sniffer.testing import Exchange, Talk
from tests.streams.members import example, packet, status
from tests.test_conformance_kit import Changed, failing

if TYPE_CHECKING:
    from sniffer.ground.framing import Block
    from sniffer.ground.model import Frames

FEETECH: Final = example("feetech").PROTOCOL
LISTED: Final = "truth: one of several silent"


def told(who: int) -> bytes:
    """Return what a servo of the list answers: two bytes from 0x38 on."""
    return status("feetech", who, 0, bytes([who, 2]))


def listing(*servos: int) -> Exchange:
    """Ask several servos for two bytes from 0x38 on; each answers."""
    request = packet("feetech", 254, 0x82, b"\x38\x02" + bytes(servos))
    values = {(who, "present_position"): who | 2 << 8 for who in servos}
    return Exchange("sync_read", request, tuple(map(told, servos)), values, (), due=True)


READ: Final = Exchange(
    "read", packet("feetech", 1, 2, b"\x38\x02"), (told(1),), {"present_position": 0x201}, ()
)
TALK: Final = Talk([listing(1, 2, 3), READ])


class NamesAll(Changed):
    """Says of nobody that he is listed: as long as one answers, none is missed."""

    targets = None


class Shifted(Changed):
    """Takes the servo before the one that is listed."""

    def targets(self, block: Block, frames: Frames) -> Any:
        found = self.protocol.targets(block, frames)  # type: ignore[attr-defined]
        return found._replace(servo_id=found.servo_id - 1, by=found.by - 1)


@pytest.mark.parametrize(
    "arrangement",
    ["answered", "lost", "answered twice", "answer late", "answer cut", "silence inside"],
)
def test_whoever_is_listed_owes_an_answer_in_each_arrangement(arrangement: str) -> None:
    told = failing(FEETECH, TALK, f"truth: {arrangement}")
    assert f"{arrangement}: sync_read" not in told


def test_one_of_several_that_stays_silent_is_missed_by_its_id() -> None:
    assert failing(FEETECH, TALK, LISTED) == ""


def test_a_protocol_that_misses_nobody_is_told_where_the_talk_says_who_is_listed() -> None:
    talk = Talk([replace(listing(1, 2, 3), listed=(1, 2, 3)), READ])
    assert failing(FEETECH, talk, LISTED) == ""
    assert "sync_read: 3 differ" in failing(NamesAll(FEETECH), talk, LISTED)
    assert "of servo 2 no_response" in failing(NamesAll(FEETECH), talk, LISTED)


def test_lists_that_are_read_a_servo_off_are_told_where_all_answer() -> None:
    assert "differ from their labels" in failing(Shifted(FEETECH), TALK, "truth: answered")


def test_a_talk_that_lists_one_servo_at_a_time_shows_nobody_who_is_missed() -> None:
    small = Talk([listing(1), listing(2), READ])
    assert "arranged: one of several silent" in failing(FEETECH, small, "coverage")
    assert "arranged: one of several silent" not in failing(FEETECH, TALK, "coverage")
    assert "nobody who is listed is missed" not in failing(FEETECH, TALK, "faults")
