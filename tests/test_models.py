"""Which model a servo is taken for, what follows it to a new id, and what a reset forgets."""

from __future__ import annotations

import functools
import json
from typing import TYPE_CHECKING, Any

import pytest

import sniffer
from sniffer.decoding.decoder import Decoder
from sniffer.ground.clues import SURE, Clues
from sniffer.ground.codes import PROFILE
from sniffer.ground.model import Chunk
from sniffer.ground.registers import Identity, Register, RegisterMap
from sniffer.protocols import PROTOCOLS
from tests.commands import within
from tests.streams import rs30x
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from pathlib import Path

L12, FORCE = "mightyzap-l12", "mightyzap-12lf"
GOAL_SPEED_512 = bytes.fromhex("FFFFFF0105F3150002EF")  # 12Lf IR Protocol, 2.4.3, its text


def write(servo: int, *data: int) -> bytes:
    return packet(servo, 0xF3, bytes(data))


def send(servo: int, *data: int) -> bytes:
    return packet(servo, 0xF4, bytes(data))


def execute(servo: int) -> bytes:
    return packet(servo, 0xF5)


def ok(servo: int, status: int = 0) -> bytes:
    return packet(servo, status)


def read(servo: int, address: int, *data: int, by: int | None = None) -> bytes:
    answer = packet(servo if by is None else by, 0, bytes(data))
    return packet(servo, 0xF2, bytes([address, len(data)])) + answer


def position(servo: int, raw: int) -> bytes:
    return read(servo, 0x8C, raw & 0xFF, raw >> 8)


ACCELERATION = functools.partial(write, 1, 0x21, 0x20)
IS_12LF = GOAL_SPEED_512 + ACCELERATION()


def told(data: bytes, models: dict[int | None, str] | None = None) -> list[Any]:
    return list(sniffer.decode(data, "mightyzap", input_format="bin", models=models))


def samples(data: bytes, models: dict[int | None, str] | None = None) -> list[tuple[Any, ...]]:
    return [
        (r.servo_id, r.register, r.raw, r.value, r.scale)
        for r in told(data, models)
        if r.type == "sample"
    ]


def notes(data: bytes, models: dict[int | None, str] | None = None) -> list[Any]:
    return [r for r in told(data, models) if r.type == "anomaly" and r.code == "model-evidence"]


def outcomes(data: bytes, models: dict[int | None, str] | None = None) -> list[str]:
    return [r.outcome for r in told(data, models) if r.type == "transaction"]


# --- scales ------------------------------------------------------------------------------------


def test_a_write_across_an_unnamed_register_gives_no_scale() -> None:
    found = samples(GOAL_SPEED_512 + position(1, 2639))
    assert found[-1] == (1, "present_position", 2639, pytest.approx(19.333333), "assumed")


def test_a_staged_write_across_an_unnamed_register_gives_no_scale() -> None:
    found = samples(send(1, 0x15, 0, 2) + execute(1) + position(1, 2639))
    assert found[-1][3:] == (pytest.approx(19.333333), "assumed")


def test_a_write_of_the_resolution_alone_still_scales_what_follows() -> None:
    assert samples(write(1, 0x16, 2) + position(1, 2047))[-1][3:] == (30.0, "observed")


def test_a_dump_of_the_map_gives_the_scale_only_of_a_known_model() -> None:
    dump = read(1, 0x14, 0, 0, 2)  # 14 and 15 are named on no L12
    assert samples(dump + position(1, 2047))[-1][3:] == (14.996337, "assumed")
    assert samples(dump + position(1, 2047), {1: L12})[-1][3:] == (30.0, "observed")


def test_a_position_far_beyond_the_stroke_takes_the_trust_from_its_scale() -> None:
    data = read(1, 0x16, 2) + position(1, 2040) + position(1, 3000) + position(1, 1000)
    assert [s[2:] for s in samples(data)[1:]] == [
        (2040, pytest.approx(29.897411), "observed"),
        (3000, pytest.approx(21.978022), "assumed"),
        (1000, pytest.approx(7.326007), "assumed"),
    ]
    note = notes(data)[-1]
    assert "3000 would be 43.97 mm of 30.00 at resolution_factor 2" in note.detail
    assert "`--model 1=mightyzap-12lf`" in note.remedy


def test_a_position_a_little_beyond_the_stroke_is_no_contradiction() -> None:
    data = read(1, 0x16, 2) + position(1, 2060)
    assert samples(data)[-1][4] == "observed"
    assert not notes(data)


def test_a_contradicted_scale_is_doubted_once_and_believed_when_it_is_read_again() -> None:
    once = read(1, 0x16, 2) + position(1, 3000)
    data = once * 30 + read(1, 0x16, 2) + position(1, 2047)
    assert samples(data)[-1][3:] == (30.0, "observed")
    assert len([n for n in notes(data) if "would be" in n.detail]) == 1


# --- models ------------------------------------------------------------------------------------


def test_one_write_that_fits_another_model_is_told_with_its_bytes_and_the_option() -> None:
    (note,) = notes(GOAL_SPEED_512 + position(1, 2639))
    assert note.severity == "note"
    assert note.servo_id == 1
    assert note.evidence == [[0, 10]]
    assert "0x15 00 02 is speed_limit of mightyzap-12lf, nothing on mightyzap-l12" in note.detail
    assert f"2 points to 0; taken from {SURE} ahead" in note.detail
    assert "`--model 1=mightyzap-12lf`" in note.remedy


def test_two_registers_that_only_one_model_has_make_it_sure_from_that_row_on() -> None:
    before, after = write(1, 0x88, 0, 1), read(1, 0x8E, 0x2C, 1)
    found = samples(before + IS_12LF + before + after)
    assert [(name, scale) for _, name, _, _, scale in found] == [
        ("moving_speed", "assumed"),
        ("resolution_factor", "assumed"),
        ("acceleration_ratio", "observed"),
        ("goal_speed", "observed"),
        ("present_current", "observed"),
    ]
    likely, sure = (n.detail.split(":")[0] for n in notes(before + IS_12LF + before))
    assert likely.startswith("servo 1 looks like mightyzap-12lf but is read as mightyzap-l12 (2 po")
    assert sure.startswith(
        "servo 1 is read as mightyzap-12lf from here on, not as mightyzap-l12 (4"
    )


def test_the_same_register_written_again_and_again_makes_nothing_sure() -> None:
    data = GOAL_SPEED_512 * 50 + write(1, 0x88, 0, 1)
    assert samples(data)[-1][1] == "moving_speed"
    assert len(notes(data)) == 1


def test_a_write_that_was_refused_is_no_evidence() -> None:
    refused = b"".join(w + ok(1, 0x08) for w in (GOAL_SPEED_512, ACCELERATION()))
    assert notes(refused) == []


def test_talk_that_fits_the_default_model_is_not_remarked_upon() -> None:
    data = write(1, 0x82, 4) + write(1, 0x83, 4) + write(1, 0x2A, 0x34, 8) + position(1, 4095)
    assert notes(data) == []
    assert samples(data)[-1][4] == "assumed"  # its resolution was not seen


def test_settings_at_the_defaults_of_one_model_tell_it() -> None:
    # feedback return mode 1, alarm LED and shutdown 33, and an acceleration: a 12Lf from the box
    data = read(1, 0x10, 1, 33, 33) + ACCELERATION() + write(1, 0x88, 0, 1)
    assert samples(data)[-1][1] == "goal_speed"


def test_a_measured_value_that_only_one_model_can_have_counts() -> None:
    (note,) = notes(read(1, 0x8E, 8, 7), {1: FORCE})  # 1800
    assert "1800 fits present_speed of mightyzap-l12 [0, 2047]" in note.detail
    assert "not present_current of mightyzap-12lf [0, 1600]" in note.detail


def test_evidence_against_takes_a_model_back_and_says_so() -> None:
    against = write(1, 0x82, 4) + write(1, 0x83, 4)
    data = IS_12LF + against + write(1, 0x88, 0, 1)
    assert samples(data)[-1][1] == "moving_speed"
    assert "servo 1 is read as mightyzap-l12 again" in notes(data)[-1].detail


def test_a_named_model_is_kept_and_the_contradiction_is_told_once() -> None:
    data = (IS_12LF + write(1, 0x22, 4) + write(1, 0x88, 0, 1)) * 3
    assert {s[4] for s in samples(data, {1: L12})} == {"profile"}
    assert samples(data, {1: L12})[-1][1] == "moving_speed"
    (note,) = notes(data, {1: L12})
    assert "servo 1 is read as mightyzap-l12, as it was named" in note.detail
    assert "`--model 1=mightyzap-12lf`" in note.remedy
    assert notes(data, {1: FORCE}) == []


def test_evidence_in_a_write_to_all_counts_for_each() -> None:
    data = write(254, 0x15, 0, 2) + write(254, 0x21, 9) + write(7, 0x88, 0, 1)
    assert samples(data)[-1][:2] == (7, "goal_speed")


def test_a_write_to_all_is_read_by_the_table_of_all_that_are_known() -> None:
    assert samples(IS_12LF + write(254, 0x88, 0, 1))[-1][:2] == (254, "goal_speed")
    data = IS_12LF + write(254, 0x88, 0, 1)
    assert samples(data, {2: L12})[-1][:2] == (254, "moving_speed")


def test_each_target_of_a_symmetric_store_is_read_by_its_own_table() -> None:
    sync = packet(254, 0x73, bytes([0x88, 2, 1, 0, 1, 2, 0, 1]))
    assert [s[:2] for s in samples(IS_12LF + sync)[-2:]] == [(1, "goal_speed"), (2, "moving_speed")]
    assert [s[:2] for s in samples(sync, {2: FORCE})] == [(1, "moving_speed"), (2, "goal_speed")]


def test_the_summary_says_what_the_wire_showed_and_what_was_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capture = tmp_path / "bus.bin"
    capture.write_bytes(IS_12LF + position(3, 7))
    options = ("--protocol", "mightyzap", "--model", f"3={L12}")
    out = within(capsys, "decode", capture, *options, "--format", "jsonl").out
    summary = json.loads(out.splitlines()[-1])
    assert summary["buses"]["bus0"]["models"] == {
        "1": {"model": FORCE, "scale": "observed"},
        "3": {"model": L12, "scale": "profile"},
    }
    text = within(capsys, "decode", capture, *options, "--summary").out
    assert "models told by the wire: 1 mightyzap-12lf" in text


# --- the machinery, with tables of any protocol ------------------------------------------------


def table(model: str, *registers: Register) -> RegisterMap:
    return RegisterMap(model, registers)


def test_a_number_that_names_a_model_decides_alone() -> None:
    names = {0x3050: "rs305cr", 0x4050: "rs405cb"}
    register = Register("model_number", 0, "u16le")
    models = [
        RegisterMap(m, (register,), identity=Identity("model_number", (raw,)))
        for raw, m in names.items()
    ]
    (found,) = Clues(models).of(0, b"\x50\x40", written=False)
    assert found.clue.points[1] - found.clue.points[0] >= SURE
    assert Clues(models).of(0, b"\x50\x40", written=True) == []
    assert Clues(models).of(0, b"\x51\x40", written=False) == []


def test_a_code_that_only_one_sibling_has_counts_for_it() -> None:
    bauds = {7: "115200"}
    models = [
        table("old", Register("baud", 6, values=bauds)),
        table("new", Register("baud", 6, values={**bauds, 10: "460800"})),
        table("other", Register("speed", 6, range=(0, 5))),
    ]
    (found,) = Clues(models).of(6, b"\x0a", written=True)
    assert found.clue.points == (0, 1, 0)
    assert Clues(models).of(6, b"\xff", written=True) == []


def test_a_block_read_across_a_hole_tells_nothing_of_the_map() -> None:
    models = [
        table("a", Register("x", 0), Register("y", 1)),
        table("b", Register("x", 0)),
    ]
    assert Clues(models).of(0, b"\x00\x00", written=False) == []
    (found,) = Clues(models).of(0, b"\x00\x00", written=True)
    assert (found.clue.points, found.clue.address) == ((2, 0), 1)


@pytest.mark.parametrize("name", PROTOCOLS)
def test_all_models_of_a_protocol_have_the_id_and_the_return_mode_at_one_place(name: str) -> None:
    for effect in ("servo_id", "feedback"):
        places = [
            {(r.address, r.width, r.word) for r in m.registers if r.effect == effect}
            for m in PROTOCOLS[name].models
        ]
        assert all(p == places[0] for p in places)


# --- new ids, resets ---------------------------------------------------------------------------


def test_a_new_id_takes_a_named_model_along() -> None:
    data = write(1, 0x03, 2) + ok(2) + write(2, 0x88, 0, 1)
    assert samples(data, {1: FORCE})[-1] == (2, "goal_speed", 256, 256.0, "profile")


def test_a_new_id_that_is_named_itself_keeps_its_name() -> None:
    data = write(1, 0x03, 2) + ok(2) + write(2, 0x88, 0, 1)
    assert samples(data, {1: FORCE, 2: L12})[-1][1] == "moving_speed"
    assert samples(data, {1: FORCE, None: L12})[-1][1] == "goal_speed"


def test_a_new_id_takes_evidence_along() -> None:
    data = IS_12LF + write(1, 0x03, 2) + ok(2) + write(2, 0x88, 0, 1)
    assert samples(data)[-1][:2] == (2, "goal_speed")
    half = GOAL_SPEED_512 + write(1, 0x03, 2) + ok(2) + write(2, 0x21, 9) + write(2, 0x88, 0, 1)
    assert samples(half)[-1][:2] == (2, "goal_speed")


def test_evidence_that_a_new_id_takes_along_is_told_where_the_id_is_given() -> None:
    before = write(254, 0x15, 0, 2) + write(7, 0x80, 1) + ok(7, 0x20)
    data = before + write(1, 0x03, 2) + ok(2)
    note = next(note for note in notes(data) if note.servo_id == 2)
    assert note.evidence == [[len(before), 9], [0, 10]]
    found = [r for r in told(data) if r.type == "anomaly"]
    known = [max(r.evidence)[0] for r in found]
    assert known == sorted(known), "however the stream is cut, nothing is told before it is known"


def test_an_id_given_to_all_is_that_of_the_servo_that_answers() -> None:
    data = write(0, 0x03, 9) + ok(1) + write(9, 0x88, 0, 1)
    assert samples(data, {1: FORCE})[-1][:2] == (9, "goal_speed")


def test_a_staged_id_moves_with_the_execution() -> None:
    speed = write(2, 0x88, 0, 1)
    data = send(1, 0x03, 2) + speed + execute(1) + speed
    assert [s[1] for s in samples(data, {1: FORCE}) if s[0] == 2] == ["moving_speed", "goal_speed"]


def test_a_refused_id_moves_nothing() -> None:
    data = write(1, 0x03, 2) + ok(1, 0x08) + write(2, 0x88, 0, 1)
    assert samples(data, {1: FORCE})[-1][1] == "moving_speed"


ALL, READS, NONE = 2, 1, 0


def mode(servo: int, value: int) -> bytes:
    return read(servo, 0x10, value)


def test_a_new_id_takes_the_return_mode_along() -> None:
    goal = write(2, 0x86, 0, 1)
    assert outcomes(mode(1, ALL) + goal)[-1] == "not_expected"
    assert outcomes(mode(1, ALL) + write(1, 0x03, 2) + ok(2) + goal)[-1] == "no_response"


def test_a_factory_reset_forgets_the_return_mode() -> None:
    goal = write(1, 0x86, 0, 1)
    assert outcomes(mode(1, ALL) + goal)[-1] == "no_response"
    assert outcomes(mode(1, ALL) + packet(1, 0xF6, b"\x02") + ok(1) + goal)[-1] == "not_expected"
    asked = packet(1, 0xF2, b"\x8c\x02")
    assert outcomes(mode(1, NONE) + asked)[-1] == "not_expected"
    assert outcomes(mode(1, NONE) + packet(1, 0xF6, b"\x00") + asked)[-1] == "no_response"


def test_a_factory_reset_to_all_forgets_every_return_mode() -> None:
    data = mode(1, ALL) + mode(2, ALL) + packet(254, 0xF6, b"\x00")
    assert outcomes(data + write(1, 0x86, 0, 1) + write(2, 0x86, 0, 1))[-2:] == ["not_expected"] * 2


def test_a_refused_factory_reset_forgets_nothing() -> None:
    data = mode(1, ALL) + packet(1, 0xF6, b"\x02") + ok(1, 0x40) + write(1, 0x86, 0, 1)
    assert outcomes(data)[-1] == "no_response"


def test_a_staged_return_mode_counts_from_the_execution_on() -> None:
    goal = write(1, 0x86, 0, 1)
    data = mode(1, READS) + send(1, 0x10, ALL) + goal + execute(1) + goal
    assert outcomes(data)[-3:] == ["not_expected", "not_expected", "no_response"]


def test_a_factory_reset_of_the_id_takes_the_model_to_id_0() -> None:
    data = packet(1, 0xF6, b"\x01") + ok(1) + write(0, 0x88, 0, 1)
    assert samples(data, {1: FORCE})[-1][:2] == (0, "goal_speed")
    kept = packet(1, 0xF6, b"\x02") + ok(1) + write(0, 0x88, 0, 1)
    assert samples(kept, {1: FORCE, 2: L12})[-1][:2] == (0, "moving_speed")


def test_a_factory_reset_of_an_rs30x_takes_what_is_known_to_id_1() -> None:
    goal = rs30x.write(1, 0x1E, b"\x64\x00")
    for head in (b"", rs30x.reset_with_data(7)):
        decoder = Decoder("rs30x", models={7: "rs305cr"})
        values = [decoder.feed(Chunk(head + goal)).values, decoder.close().values]
        grounds = {p for v in values for p in v.provenance[v.servo_id == 1].tolist()}
        assert (PROFILE in grounds) == bool(head)


def test_an_lss_and_a_wck_take_their_model_to_a_new_id() -> None:
    for protocol, model, data in (
        ("lss", "lss", b"#5CID7\r#7D100\r"),
        ("wck", "wck", bytes.fromhex("FFE50C0707690707FF076463")),
    ):
        rows: list[Any] = list(
            sniffer.decode(data, protocol, input_format="bin", models={5: model})
        )
        last = [r for r in rows if r.type == "sample"][-1]
        assert (last.servo_id, last.scale) == (7, "profile"), protocol
