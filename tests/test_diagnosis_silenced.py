"""Servos that were told to answer nothing, or to speak another protocol, and are asked still."""

from __future__ import annotations

import pytest

from tests.conversations import BAUD, Conversation, robot
from tests.diagnosed import codes, diagnosed, found, verdicts
from tests.streams import mightyzap

RETURN_MODE_AT, PROTOCOL_AT = 0x10, 0x0A
"""Addresses of mightyZAP, the second one of the 12Lf."""


def told(request: bytes, vain: int = 200) -> Conversation:
    """Write something to servo 2 of three that are polled; it answers no read since."""

    def silent(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or cycle < 100:
            return False
        if cycle == 100:
            talk.write(request)
        if cycle < 100 + vain:
            talk.ask_in_vain(servo, 5)
        return True

    return robot("mightyzap" if request[:1] == b"\xff" else "lss", 8, instead=silent)


def mode(address: int, value: int) -> bytes:
    return mightyzap.packet(2, 0xF3, bytes([address, value]))


@pytest.mark.parametrize("request_", [mode(RETURN_MODE_AT, 0), b"#2CRC1\r"])
def test_a_servo_that_was_told_to_fall_silent_did_not_die(request_: bytes) -> None:
    assert verdicts(told(request_).diagnosed().incidents()) == [("silenced", (2,))]


def test_a_servo_that_was_told_to_speak_modbus_did_not_die() -> None:
    chunks = told(mode(PROTOCOL_AT, 0)).chunks
    models = dict.fromkeys((1, 2, 3), "mightyzap-12lf")
    diagnosis = diagnosed(chunks, "mightyzap", baud=BAUD, models=models)
    assert verdicts(diagnosis.incidents()) == [("silenced", (2,))]


def test_all_servos_may_be_told_at_once() -> None:
    talk = robot("mightyzap", 4)
    talk.write(mightyzap.packet(0xFE, 0xF3, bytes([RETURN_MODE_AT, 0])))
    for _ in range(100):
        for servo in (1, 2, 3):
            talk.ask_in_vain(servo, 5)
    told = talk.diagnosed().incidents()
    assert {i.cause for i in told} == {"silenced"}
    assert {servo for i in told for servo in i.servo_ids} == {1, 2, 3}


def test_who_is_not_read_from_since_may_be_silent() -> None:
    assert not told(mode(RETURN_MODE_AT, 0), vain=0).diagnosed().incidents()


def test_a_mode_in_which_reads_are_answered_silences_nobody() -> None:
    found = codes(told(mode(RETURN_MODE_AT, 1)).diagnosed())
    assert "reads-unanswered-as-told" not in found
    assert "silent-since" in found


@pytest.mark.parametrize("word", [b"DEFAULT", b"UPDATE"])
def test_the_last_that_a_servo_was_told_is_named_where_it_never_answers_again(word: bytes) -> None:
    diagnosis = told(b"#2" + word + b"\r#2CONFIRM\r").diagnosed()
    (incident,) = diagnosis.incidents()
    assert [c.cause for c in incident.likely] == ["silenced", "servo-dead"]
    (finding,) = (f for f in found(diagnosis) if f.code == "silent-since-an-order")
    assert word.decode() in finding.what
    assert "CONFIRM" in finding.what


def test_a_servo_that_only_starts_anew_and_never_comes_back_is_dead() -> None:
    incidents = told(mightyzap.packet(2, 0xF8)).diagnosed().incidents()
    assert verdicts(incidents) == [("servo-dead", (2,))]


def test_a_servo_that_dies_in_its_loop_was_told_nothing_else() -> None:
    diagnosis = told(mightyzap.packet(2, 0xF3, b"\x86\x10\x00")).diagnosed()
    assert "silent-since-an-order" not in codes(diagnosis)
