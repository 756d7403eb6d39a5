"""LSS and LSS-PRO: the same lines, each model's own meaning of their numbers."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

import sniffer
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.decoding.rows import FrameRow, SampleRow
from sniffer.ground.model import Chunk
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.lss.grammar import MODELS, MODIFIERS, REGISTERS, WORDS
from tests.commands import sniffer as sniffer_command
from tests.records import batches, records
from tests.streams import chunked, stream

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

LSS = PROTOCOLS["lss"]
PRO: Final[Mapping[int | None, str]] = {5: "lss-pro"}


def told(talk: bytes, models: Mapping[int | None, str] | None = None) -> list[Any]:
    return list(sniffer.decode(talk, "lss", input_format="bin", models=models))


def values(talk: bytes, models: Mapping[int | None, str] | None = None) -> dict[str, float | None]:
    return {r.register: r.value for r in told(talk, models) if isinstance(r, SampleRow)}


def last_fields(
    talk: bytes, models: Mapping[int | None, str] | None = None
) -> Mapping[str, object]:
    frames = [r for r in told(talk, models) if isinstance(r, FrameRow)]
    return frames[-1].fields


@pytest.mark.parametrize(
    ("talk", "register", "as_lss", "as_pro"),
    [
        (b"#5D13000\r", "goal_position", 1300.0, 130.0),
        (b"#5QD\r*5QD-4505\r", "present_position", -450.5, -45.05),
        (b"#5SD600\r", "max_speed", 60.0, 6.0),
        (b"#5QWD\r*5QWD900\r", "present_speed", 90.0, 9.0),
        (b"#5D0SD600\r", "move_speed", 60.0, 6.0),
        (b"#5CAR36000\r", "configured_angular_range", 3600.0, 360.0),
        (b"#5QV\r*5QV24000\r", "present_voltage", 24.0, 24.0),
        (b"#5D0T1500\r", "move_time", 1.5, 1.5),
    ],
)
def test_an_lss_pro_counts_hundredths_of_degrees_where_an_lss_counts_tenths(
    talk: bytes, register: str, as_lss: float, as_pro: float
) -> None:
    assert values(talk)[register] == as_lss
    assert values(talk, PRO)[register] == pytest.approx(as_pro)
    assert values(talk, {6: "lss-pro"})[register] == as_lss


def test_the_fields_of_a_line_are_in_the_units_of_the_servos_model() -> None:
    talk = b"#5QD\r*5QD13000\r"
    assert last_fields(talk)["position_deg"] == 1300.0
    assert last_fields(talk, PRO)["position_deg"] == 130.0
    assert last_fields(b"#5D0SD600\r", PRO)["modifiers"] == {"SD": 600}
    assert last_fields(b"#5Q\r*5Q5\r")["status"] == "decelerating"
    assert last_fields(b"#5Q\r*5Q5\r", PRO)["status"] == "holding"


def test_an_error_is_an_alarm_of_the_lss_pro_only() -> None:
    def codes(models: Mapping[int | None, str] | None) -> list[str]:
        found = batches(Decoder("lss", models=models), [[Chunk(b"#5Q\r*5Q6\r")]])
        return [a.code for b in found for a in b.anomalies]

    assert codes(None) == []
    assert codes(PRO) != []


@pytest.mark.parametrize(
    ("talk", "register", "value"),
    [
        (b"#5QTP\r*5QTP350\r", "motor_temperature", 35.0),
        (b"#5QTM\r*5QTM401\r", "mcu_temperature", 40.1),
        (b"#5QTCW\r*5QTCW0\r", "driver_temperature_warning", 0.0),
        (b"#5QET\r*5QET1\r", "can_terminal", 1.0),
        (b"#5QUC\r*5QUC1\r", "usb_connection", 1.0),
        (b"#5QIX\r*5QIX-3\r", "linear_acceleration_x", -3.0),
        (b"#5QIG\r*5QIG44\r", "angular_acceleration_gamma", 44.0),
        (b"#5QEF\r*5QEF17\r", "error_flags", 17.0),
        (b"#203QA2\r*203QA210\r", "analog_distance", 210.0),
    ],
)
def test_a_word_that_one_model_has_says_itself_what_it_is(
    talk: bytes, register: str, value: float
) -> None:
    assert values(talk)[register] == pytest.approx(value)
    assert all(r.flags == () for r in told(talk) if isinstance(r, FrameRow))


def test_of_an_lss_pro_no_number_is_read_by_the_table_of_the_lss() -> None:
    assert values(b"#5P1500\r") == {"goal_position_pulse": 1500.0}
    assert values(b"#5P1500\r", PRO) == {}
    assert last_fields(b"#5P1500\r", PRO)["value"] == 1500


def test_the_model_string_of_each_model_is_in_its_table_and_read_as_a_text() -> None:
    assert last_fields(b"#5QMS\r*5QMSLSS-P-S1\r")["text"] == "LSS-P-S1"
    assert last_fields(b"#5QMS\r*5QMSLSS-P-S1\r")["value"] == "LSS-P-S1"


def test_a_number_that_the_models_read_differently_has_no_unit_where_none_was_read() -> None:
    mute = b"#5QV\r*5QSD600\r"  # which speed it is, only its query would say: it is not read
    assert last_fields(mute) == {"word": "QSD", "value": 600}


# --- what the wire tells -----------------------------------------------------------------------

IS_PRO, IS_LSS = b"#5QMS\r*5QMSLSS-P-S1\r", b"#5QMS\r*5QMSLSS-HS1\r"
POSITION = b"#5QD\r*5QD13000\r"


def notes(talk: bytes, models: Mapping[int | None, str] | None = None) -> list[Any]:
    return [r for r in told(talk, models) if r.type == "anomaly" and r.code == "model-evidence"]


def positions(talk: bytes, models: Mapping[int | None, str] | None = None) -> list[Any]:
    found = [r for r in told(talk, models) if isinstance(r, SampleRow)]
    return [(r.servo_id, r.value, r.scale) for r in found if r.register == "present_position"]


def test_a_model_string_says_from_its_row_on_in_which_unit_a_servo_counts() -> None:
    assert positions(POSITION + IS_PRO + POSITION) == [
        (5, 1300.0, "assumed"),
        (5, pytest.approx(130.0), "observed"),
    ]
    assert positions(POSITION + IS_LSS + POSITION)[-1] == (5, 1300.0, "observed")
    (note,) = notes(POSITION + IS_PRO + POSITION)
    assert "servo 5 is read as lss-pro from here on, not as lss (16 points to 0)" in note.detail
    assert "QMS LSS-P-S1 is a model string of lss-pro" in note.detail
    assert "`--model 5=lss-pro`" in note.remedy
    assert not notes(IS_LSS + POSITION)


def test_a_model_string_says_nothing_of_another_servo() -> None:
    assert positions(IS_PRO + POSITION.replace(b"5", b"6"))[-1][1:] == (1300.0, "assumed")


@pytest.mark.parametrize(
    ("text", "told_as"),
    [
        (b"LSS-P-L1", ("lss-pro", "observed")),
        (b"LSS-P-X9", ("lss-pro", "observed")),  # of the family, whatever it is
        (b"LSS-ST2", ("lss", "observed")),
        (b"LSS-2IO", ("lss", "assumed")),
        (b"LSS-", ("lss", "assumed")),
        (b"XLSS-P-S1", ("lss", "assumed")),
    ],
)
def test_a_text_counts_for_the_family_it_begins_like_and_else_for_none(
    text: bytes, told_as: tuple[str, str]
) -> None:
    value = 130.0 if told_as[0] == "lss-pro" else 1300.0
    talk = b"#5QMS\r*5QMS" + text + b"\r" + POSITION
    assert positions(talk) == [(5, pytest.approx(value), told_as[1])]


def test_a_named_model_is_kept_and_told_that_its_servo_says_otherwise() -> None:
    assert positions(IS_PRO + POSITION, {5: "lss"}) == [(5, 1300.0, "profile")]
    (note,) = notes(IS_PRO + POSITION, {5: "lss"})
    assert "is read as lss, as it was named, but looks like lss-pro" in note.detail
    (note,) = notes(IS_LSS + POSITION, PRO)
    assert "is read as lss-pro, as it was named, but looks like lss" in note.detail
    assert positions(IS_LSS + POSITION, PRO)[0][2] == "profile"


def test_two_model_strings_of_one_id_leave_it_undecided() -> None:
    assert positions(IS_PRO + IS_LSS + POSITION) == [(5, 1300.0, "assumed")]
    assert "is read as lss again" in notes(IS_PRO + IS_LSS + POSITION)[-1].detail


def test_words_that_one_model_answers_are_told_and_never_decide() -> None:
    words = [b"QIX", b"QIY", b"QIZ", b"QIA", b"QTCW", b"QEF", b"QUC"]
    talk = b"".join(b"#5" + w + b"\r*5" + w + b"3\r" for w in words)
    assert positions(talk + POSITION)[-1][1:] == (1300.0, "assumed")
    (note,) = notes(talk + POSITION)
    assert "servo 5 looks like lss-pro but is read as lss (2 points to 0" in note.detail
    assert "QIX, which is answered, is linear_acceleration_x of lss-pro" in note.detail


def test_a_word_that_is_only_asked_tells_nothing() -> None:
    assert not notes(b"#5QIX\r#5QIX\r#5QIY\r")


def test_a_new_id_takes_along_what_a_servo_said_of_itself() -> None:
    talk = IS_PRO + b"#5CID7\r" + POSITION.replace(b"5", b"7")
    assert positions(talk)[-1] == (7, pytest.approx(130.0), "observed")


def test_the_summary_names_the_models_that_were_told(tmp_path: Path) -> None:
    capture = tmp_path / "lss.bin"
    capture.write_bytes(IS_PRO + POSITION + IS_LSS.replace(b"5", b"6"))
    ran = sniffer_command("decode", capture, "--protocol", "lss", "--format", "jsonl")
    assert json.loads(ran.out.splitlines()[-1])["buses"]["bus0"]["models"] == {
        "5": {"model": "lss-pro", "scale": "observed"},
        "6": {"model": "lss", "scale": "observed"},
    }


def test_a_word_has_one_kind_and_one_name_in_all_tables() -> None:
    for name, word in WORDS.items():
        meant = {REGISTERS[r].name for r in word.registers if r >= 0}
        assert len(meant) <= 1, f"{name}: {meant}"
        for selector in word.selectors:
            meant = {REGISTERS[by[selector]].name for by in word.answers if selector in by}
            assert len(meant) == 1, f"{name}{selector}: {meant}"
    kinds: dict[str, set[str]] = {}
    for model in MODELS:
        for r in model.registers:
            for spelling in (r.word, *r.aliases) if r.kind != "modifier" else ():
                kinds.setdefault(spelling, set()).add(r.kind)
    assert {w: k for w, k in kinds.items() if len(k) > 1} == {}
    assert all(r >= 0 for m in MODIFIERS.values() for r in m.registers[:1])


@given(data=st.data())
def test_block_and_reference_read_both_models_alike(data: st.DataObject) -> None:
    s = data.draw(stream("lss"))
    ids = data.draw(st.lists(st.sampled_from([0, 1, 2, 5, 250, 254]), max_size=4))
    models: dict[int | None, str] = dict.fromkeys(ids, "lss-pro")
    if data.draw(st.booleans()):
        models = {None: "lss-pro"}
    chunks = data.draw(chunked(s, byte_time_ns(LSS.baud), LSS.tail_ns))
    got = records(batches(Decoder("lss", models=models), [chunks]))
    want = Reference(LSS, models=models).decode(chunks)
    assert got.frames == want.frames
    assert got.samples == want.samples
