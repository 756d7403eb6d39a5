"""LSS values: numbers, modifiers, texts and who answers, each rule as a sentence."""

from __future__ import annotations

import functools
from typing import Any

import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.lss.grammar import BROADCAST, command, reply
from tests import heard
from tests.records import batches

LSS = PROTOCOLS["lss"]
hear = functools.partial(heard.hear, "lss")


def codes(*parts: bytes) -> list[str]:
    return [
        a.code for b in batches(Decoder("lss"), [[Chunk(p) for p in parts]]) for a in b.anomalies
    ]


def fields(*parts: bytes) -> dict[str, Any]:
    """Return what the last frame states, without the registers' own entries."""
    found = hear(*parts).frames[-1].fields
    own = {k: v for k, v in found.items() if not isinstance(v, dict) or k == "modifiers"}
    own.pop("data", None)  # the bytes of what no register names
    return own


# ---- values and modifiers


def test_modifiers_are_fields_and_values_of_their_own() -> None:
    assert fields(b"#5P1456T1263\r") == {
        "word": "P",
        "value": 1456,
        "position_us": 1456,
        "modifiers": {"T": 1263},
        "time_ms": 1263.0,
    }
    assert hear(b"#5P1456T1263\r").values == {
        (5, "goal_position_pulse"): 1456,
        (5, "move_time"): 1.263,
    }


@pytest.mark.parametrize(
    ("line", "modifiers"),
    [
        (b"#1D200T15000CL400\r", {"T": 15000, "CL": 400}),
        (b"#5P2334S750T2500\r", {"S": 750, "T": 2500}),
        (b"#12D1800SD600CH800\r", {"SD": 600, "CH": 800}),
        (b"#5D100S200\r", {"S": 200}),
        (b"#5WD100T5\r", {"T": 5}),
        (b"#5D1XYZ5\r", {"XYZ": 5}),
    ],
)
def test_modifiers_beyond_the_pages_are_accepted_and_flagged_unusual(
    line: bytes, modifiers: dict[str, int]
) -> None:
    found = hear(line)
    assert found.flags == [("unusual",)]
    assert found.frames[0].fields["modifiers"] == modifiers


@pytest.mark.parametrize("line", [b"#5P1500T2500\r", b"#5P1500S750\r", b"#5D10T5\r", b"#5MD1t5\r"])
def test_the_pages_modifiers_are_not_unusual(line: bytes) -> None:
    assert hear(line).flags == [()]


def test_the_setter_of_newer_firmware_is_one_word_not_a_modifier() -> None:
    found = hear(b"#5SCSL100\r")
    assert found.frames[0].fields == {"word": "SCSL", "value": 100}


def test_a_missing_number_or_one_too_many_is_unusual() -> None:
    assert hear(b"#5D\r#5CAS\r#5L3\r#5CFP\r#5CRC\r#5H\r").flags == [("unusual",)] * 3 + [()] * 3


def test_numbers_of_any_length_that_fits_are_read() -> None:
    for value in (0, -1, 2**31, -(2**31), 12_345_678, 123_456_789, 10**18 - 1, -(10**17)):
        assert [s.raw for s in hear(command(5, "D", value)).samples] == [value]
        assert [s.raw for s in hear(command(5, "D", 1, {"T": abs(value)})).samples][1] == abs(value)


@pytest.mark.parametrize(
    ("talk", "register", "value", "unit", "quantity", "role"),
    [
        (b"#1D-300\r", "goal_position", -30.0, "deg", "goal_position", "commanded"),
        (b"#5MD123\r", "relative_move", 12.3, "deg", "", "commanded"),
        (b"#5WR40\r", "wheel_speed_in_rpm", 240.0, "deg/s", "goal_speed", "commanded"),
        (b"#5CSR20\r", "configured_max_speed_in_rpm", 120.0, "deg/s", "", "config"),
        (b"#5QD\r*5QD1443\r", "present_position", 144.3, "deg", "position", "measured"),
        (b"#5QWD\r*5QWD-900\r", "present_speed", -90.0, "deg/s", "speed", "measured"),
        (b"#5QP\r*5QP2334\r", "present_position_pulse", 2334.0, "us", "position", "measured"),
        (b"#5QV\r*5QV11200\r", "present_voltage", 11.2, "V", "voltage", "measured"),
        (b"#5QT\r*5QT564\r", "present_temperature", 56.4, "degC", "temperature", "measured"),
        (b"#5QC\r*5QC140\r", "present_current", 140.0, "mA", "current", "measured"),
        (b"#5QDT\r*5QDT6783\r", "target_position", 678.3, "deg", "goal_position", "commanded"),
        (b"#5QN\r*5QN12345678\r", "serial_number", 12345678.0, "", "", "config"),
    ],
)
def test_a_number_has_register_unit_and_role(
    talk: bytes, register: str, value: float, unit: str, quantity: str, role: str
) -> None:
    (sample,) = hear(talk).samples
    assert (sample.register, sample.value, sample.unit) == (register, value, unit)
    assert (sample.quantity, sample.role) == (quantity, role)


def test_a_position_out_of_bounds_is_marked_and_no_number() -> None:
    found = hear(b"#5QP\r*5QP-500\r#5QP\r*5QP-2500\r").samples
    assert [(s.value, s.name) for s in found] == [(None, "below_500"), (None, "above_2500")]
    assert codes(b"#5QP\r*5QP-500\r") == []


def test_the_led_is_numbered_as_in_the_command_list_so_8_is_unknown() -> None:
    names = ["off", "red", "green", "blue", "yellow", "cyan", "magenta", "white", "unknown"]
    for number, name in enumerate(names):
        assert fields(b"#5LED%d\r" % number)["color"] == name
        assert fields(b"#5QLED\r*5QLED%d\r" % number)["color"] == name


def test_a_servo_whose_status_is_a_fault_is_reported() -> None:
    seen = {n: codes(b"#5Q\r*5Q%d\r" % n) for n in range(11)}
    assert [n for n, found in seen.items() if found] == [7, 8, 9, 10]


def test_a_new_id_and_a_new_baud_rate_are_reported() -> None:
    assert codes(b"#4CID5\r") == ["id-changed"]
    assert codes(b"#5CB9600\r") == ["baud-changed"]


# ---- replies


@pytest.mark.parametrize(
    ("query", "answer", "register", "value"),
    [
        (b"#5Q\r", b"*5Q3\r", "present_status", 3.0),
        (b"#5Q0\r", b"*5Q3\r", "present_status", 3.0),
        (b"#5Q1\r", b"*5Q3\r", "safe_mode_cause", 3.0),
        (b"#5QO0\r", b"*5QO-13\r", "origin_offset", -1.3),
        (b"#5QO1\r", b"*5QO-13\r", "configured_origin_offset", -1.3),
        (b"#5QSD\r", b"*5QSD1800\r", "max_speed", 180.0),
        (b"#5QSD1\r", b"*5QSD1800\r", "configured_max_speed", 180.0),
        (b"#5QSD2\r", b"*5QSD1800\r", "present_speed", 180.0),
        (b"#5QSD3\r", b"*5QSD1800\r", "target_speed", 180.0),
        (b"#5QSR\r", b"*5QSR4\r", "max_speed_in_rpm", 24.0),
        (b"#5QSR1\r", b"*5QSR20\r", "configured_max_speed_in_rpm", 120.0),
        (b"#5QSR2\r", b"*5QSR20\r", "present_speed_in_rpm", 120.0),
    ],
)
def test_the_selector_of_the_query_decides_what_a_reply_means(
    query: bytes, answer: bytes, register: str, value: float
) -> None:
    (sample,) = hear(query, answer).samples
    assert (sample.register, sample.value) == (register, value)


def test_a_selector_the_page_does_not_have_is_unusual_and_gives_no_value() -> None:
    for selector in (b"4", b"10", b"32767"):
        found = hear(b"#5QSD%s\r*5QSD1800\r" % selector)
        assert found.flags[0] == ("unusual",)
        assert found.outcomes == ["ok"]
        assert not found.samples


def test_a_query_with_a_negative_number_or_a_modifier_is_malformed() -> None:
    assert hear(b"#5QD-1\r#5QD1T5\r#5QD32768\r").flags == [("malformed",)] * 3


def test_the_pages_reply_without_q_answers_the_pending_query() -> None:
    found = hear(b"#5QAR\r*5AR1800\r")
    assert (found.ops, found.outcomes) == (["QAR", "QAR"], ["ok"])
    assert found.values == {(5, "angular_range"): 180.0}
    assert fields(b"#5QAR\r*5AR1800\r")["word"] == "AR"


def test_a_reply_of_another_word_or_id_is_mismatched_and_says_itself_whose_number_it_is() -> None:
    for answer, stated in (
        (b"*5QV11200\r", {(5, "present_voltage"): 11.2}),
        (b"*6QD132\r", {(6, "present_position"): 13.2}),
    ):
        found = hear(b"#5QD\r", answer)
        assert found.outcomes == ["mismatched"]
        assert found.values == stated


@pytest.mark.parametrize(
    ("query", "answer", "stated"),
    [
        (b"#5QMS\r", b"*5QMSLSS-HS1\r", {"text": "LSS-HS1"}),
        (b"#5QMS\r", b"*5QMSDOG\r", {"text": "DOG"}),
        (b"#5QN\r", b"*5QNAB-12\r", {"text": "AB-12"}),
        (b"#5QF3\r", b"*5QF368.29.14\r", {"text": "368.29.14", "selector": 3}),
        (b"#5QN\r", b"*5QN" + b"7" * 30 + b"\r", {"text": "7" * 30}),
        (b"#5QFP\r", b"*5QFPDIS\r", {"disabled": True}),
        (b"#5QFD\r", b"*5QFDDIS\r", {"disabled": True}),
        (b"#5QDT\r", b"*5QDT\r", {"no_target": True}),
    ],
)
def test_a_reply_may_hold_a_text_which_is_no_sample(
    query: bytes, answer: bytes, stated: dict[str, Any]
) -> None:
    found = hear(query, answer)
    assert (found.outcomes, found.flags, found.samples) == (["ok"], [(), ()], [])
    word = answer[2:5].decode().rstrip("AB-3687.")
    behind = answer[2 + len(word) : -1].decode()
    value = {"value": behind} if behind else {}  # a number or a text: what stands behind the word
    assert fields(query, answer) == {"word": word, **value, **stated}


def test_another_text_than_dis_where_only_dis_may_stand_is_malformed() -> None:
    assert hear(b"#5QFP\r*5QFPX\r").flags[1] == ("malformed",)
    assert hear(b"#5QV\r*5QV\r").flags[1] == ("malformed",)


def test_queries_must_be_answered_and_actions_and_configurations_never_are() -> None:
    assert hear(b"#5QD\r#5D1\r#5CO-50\r").outcomes == [
        "no_response",
        "not_expected",
        "not_expected",
    ]
    assert hear(b"#5D1\r*5D1\r").outcomes == ["not_expected", "unsolicited"]


def test_every_servo_may_answer_a_broadcast_query() -> None:
    found = hear(b"#254QV\r", *(reply(i, "QV", 11000 + i) for i in range(40)), b"#5L\r")
    assert found.outcomes == ["ok"] * 40 + ["not_expected"]
    assert found.values[(39, "present_voltage")] == 11.039
    assert hear(b"#254QV\r").outcomes == ["no_response"]
    assert BROADCAST in LSS.everyone


def test_the_reply_to_qid_states_its_servo_behind_the_word() -> None:
    found = hear(b"#254QID\r*QID5\r")
    assert found.outcomes == ["ok"]
    assert found.frames[1].servo_id == 5
    assert found.values == {(5, "servo_id"): 5.0}


def test_a_servo_in_button_mode_answers_under_its_own_id() -> None:
    assert hear(b"#255QD\r*7QD1\r").outcomes == ["ok"]
    assert hear(b"#255QD\r*7QD1\r*8QD1\r").outcomes == ["ok", "unsolicited"]
