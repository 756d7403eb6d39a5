"""wCK values: what each command and reply states, and the two alignments of a 10-bit position."""

from __future__ import annotations

import functools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.wck.grammar import OPS, build
from tests import heard
from tests.records import batches, records
from tests.streams.wck import command

WCK = PROTOCOLS["wck"]
TABLE = WCK.models[0]
hear = functools.partial(heard.hear, "wck")

UNIT, UNIT_10BIT = 269 / 255, 333 / 1023
"""Unit control angles in degrees. Source: manual 1.07, 1-9."""


def raws(*parts: bytes) -> list[tuple[int | None, str, int]]:
    return [(s.servo_id, s.register, s.raw) for s in hear(*parts).samples]


def anomalies(*parts: bytes) -> list[str]:
    told = batches(Decoder("wck"), [[Chunk(p) for p in parts]])
    return [a.code for b in told for a in b.anomalies]


# ---- what each packet states


def test_load_comes_first_and_position_second() -> None:
    assert raws(command(0xA3, 0), b"\x11\x63") == [(3, "load", 0x11), (3, "position", 0x63)]


def test_a_position_move_states_torque_and_goal() -> None:
    told = hear(command(0x43, 100))
    assert told.values == {(3, "torque_level"): 2, (3, "goal_position"): round(100 * UNIT, 6)}
    assert told.frames[0].fields["torque_level"] == {"raw": 2, "name": "level 2"}


def test_a_synchronized_move_states_a_goal_for_each_module_from_0_on() -> None:
    told = hear(command(0x9F, 0x20 | 3, b"\x0a\x14\x1e"))
    goals = [(s.servo_id, s.raw) for s in told.samples if s.register == "goal_position"]
    assert goals == [(0, 10), (1, 20), (2, 30)]
    assert {s.raw for s in told.samples if s.register == "torque_level"} == {4}
    assert told.frames[0].servo_id is None
    fields = told.frames[0].fields
    assert (fields["count"], fields["last_id"]) == (3, 2)
    assert list(fields["targets"]) == ["0", "1", "2"]


def test_a_wheel_command_states_direction_and_speed() -> None:
    told = hear(command(0xC3, 0x4F), b"\x07\x63")
    assert told.frames[0].fields["wheel_direction"] == {"raw": 4, "name": "cw"}
    assert told.frames[0].fields["wheel_speed"] == {"raw": 15}
    assert raws(command(0xC3, 0x30), b"\x07\x63") == [
        (3, "wheel_direction", 3),
        (3, "wheel_speed", 0),
        (3, "rotation_count", 7),
        (3, "position", 0x63),
    ]


def test_passive_and_break_are_answered_with_the_position() -> None:
    assert raws(command(0xC3, 0x10), b"\x10\x63") == [(3, "position", 0x63)]
    assert raws(command(0xDF, 0x20), b"\x05\x63") == [(5, "position", 0x63)]


SETS = [
    (0x08, ("baud_rate",)),
    (0x09, ("p_gain", "d_gain")),
    (0x0B, ("runtime_p_gain", "runtime_d_gain")),
    (0x0C, ("servo_id",)),
    (0x0D, ("speed", "acceleration")),
    (0x0F, ("overload",)),
    (0x11, ("lower_boundary", "upper_boundary")),
    (0x15, ("i_gain",)),
    (0x18, ("runtime_i_gain",)),
]


@pytest.mark.parametrize(("code", "names"), SETS)
def test_a_set_command_and_its_reply_state_the_same_registers(
    code: int, names: tuple[str, ...]
) -> None:
    data = b"\x21\x22" if len(names) == 2 else b"\x21\x21"
    values = [(3, name, byte) for name, byte in zip(names, data, strict=False)]
    assert raws(command(0xE3, code, data), data) == values * 2


@pytest.mark.parametrize(
    ("code", "names"),
    [
        (0x0A, ("p_gain", "d_gain")),
        (0x0E, ("speed", "acceleration")),
        (0x10, ("overload",)),
        (0x12, ("lower_boundary", "upper_boundary")),
        (0x16, ("i_gain",)),
        (0x65, ("digital_output", "ad_input")),
        (0x97, ("motion_count",)),
    ],
)
def test_a_read_states_nothing_and_its_reply_the_registers(
    code: int, names: tuple[str, ...]
) -> None:
    data = b"\x02\x22" if len(names) == 2 else b"\x02\x02"
    values = [(3, name, byte) for name, byte in zip(names, data, strict=False)]
    assert raws(command(0xE3, code, b"\x55\x55"), data) == values


def test_a_runtime_speed_is_not_the_stored_speed() -> None:
    assert raws(command(0xE3, 0x17, b"\x1e\x64")) == [
        (3, "runtime_speed", 30),
        (3, "runtime_acceleration", 100),
    ]


def test_swapped_codes_in_the_manuals_programs_are_read_by_code() -> None:
    """GainRead of A-4 sends 0C, which sets the id; IdSet sends 0A, which reads the gains."""
    assert raws(command(0xE3, 0x0C, b"\0\0"), b"\0\0") == [(3, "servo_id", 0)] * 2
    assert "id-changed" in anomalies(command(0xE3, 0x0C, b"\0\0"), b"\0\0")
    assert raws(command(0xE3, 0x0A, b"\x1e\x1e"), b"\x14\x1e") == [
        (3, "p_gain", 20),
        (3, "d_gain", 30),
    ]


def test_an_id_change_is_answered_under_the_old_id() -> None:
    told = hear(command(0xE0, 0x0C, b"\x1e\x1e"), b"\x1e\x1e", command(0xBE, 0), b"\x01\x02")
    assert [f.servo_id for f in told.frames] == [0, 0, 30, 30]
    assert told.outcomes == ["ok", "ok"]


def test_an_id_above_30_is_reached_by_10_bit_commands() -> None:
    told = hear(command(0xE0, 0x0C, b"\xfd\xfd"), b"\xfd\xfd", command(0xE0, 0xC9, b"\xfd\xfd"))
    assert [f.servo_id for f in told.frames] == [0, 0, 253]


def test_gains_beyond_the_recommended_are_no_range_error() -> None:
    talk = [command(0xE3, 0x15, b"\x64\x64"), b"\x64\x64", command(0xE3, 0x09, b"\xfe\xfe")]
    assert "value-out-of-range" not in anomalies(*talk)
    assert "value-out-of-range" in anomalies(command(0x1F, 2, b"\xff\x10"))
    assert "value-out-of-range" in CATALOGUE


def test_only_two_bits_of_an_output_count() -> None:
    told = hear(command(0xE3, 0x64, b"\xf2\xf2"), b"\x02\x02")
    assert [s.raw for s in told.samples] == [2, 2]
    assert told.frames[0].fields["digital_output"]["names"] == ["output_2"]
    assert told.flags == [(), ()]


@pytest.mark.parametrize(("code", "current"), [(33, 400), (104, 1000), (199, 1800)])
def test_an_over_load_code_stands_for_a_current(code: int, current: int) -> None:
    fields = hear(command(0xE3, 0x0F, bytes([code, code]))).frames[0].fields
    assert fields["overload"] == {"raw": code, "name": f"{current} mA"}
    assert fields["overload_ma"] == current


def test_an_over_load_code_that_is_not_listed_has_no_current() -> None:
    assert "overload_ma" not in hear(command(0xE3, 0x0F, b"\x32\x32")).frames[0].fields


def test_a_motion_is_told_instruction_by_instruction() -> None:
    words = b"\x04\x11\x64\x30\x96\x23\x05\x80\x00"
    told = hear(command(0xE3, 0x96, words), b"\x04\x04")
    assert told.frames[0].fields["motion"] == [
        {
            "command": 0x11,
            "instruction": {"number": 1, "name": "position_control"},
            "sub": 1,
            "data": 100,
        },
        {
            "command": 0x30,
            "instruction": {"number": 3, "name": "delay_time"},
            "sub": 0,
            "data": 150,
        },
        {
            "command": 0x23,
            "instruction": {"number": 2, "name": "motion_type"},
            "sub": {"number": 3, "name": "wheel_ccw"},
            "data": 5,
        },
        {
            "command": 0x80,
            "instruction": {"number": 8, "name": "end_of_program"},
            "sub": 0,
            "data": 0,
        },
    ]
    assert [s.raw for s in told.samples] == [4, 4]


# ---- the table


def test_every_name_of_the_table_is_a_name_of_a_packet() -> None:
    bits = {b.name for op in OPS for b in (*op.data1, *op.data2)}
    named = bits | {name for op in OPS for name in (*op.params, *op.reply)}
    composed = {"goal_position_10bit", "position_10bit"}
    assert {r.name for r in TABLE.registers} <= named | composed


def test_baud_codes_name_the_rates_of_the_bus() -> None:
    baud = TABLE.registers[TABLE.index["baud_rate"]]
    assert sorted(int(rate) for rate in baud.values.values()) == list(WCK.bauds)
    assert baud.values[baud.default or 0] == str(WCK.baud)


def test_defaults_lie_in_their_ranges() -> None:
    for r in TABLE.registers:
        if r.range is not None and r.default is not None:
            assert r.range[0] <= r.default <= r.range[1]


# ---- 10-bit positions


def move10(position: int, *, right: bool) -> bytes:
    l7 = position & 127 if right else (position & 127) << 1
    return build(
        "position_move_10bit",
        data1={"id": 0},
        data2={},
        id=40,
        torque_10bit=0,
        target_h3=position >> 7,
        target_l7=l7,
    )


def goals(*parts: bytes) -> list[int]:
    return [s.raw for s in hear(*parts).samples if s.register == "goal_position_10bit"]


def test_a_10_bit_position_stands_as_the_manual_draws_it() -> None:
    told = hear(bytes.fromhex("FFE0C8000007D07F"), b"\x07\xd0")
    assert told.values[0, "goal_position_10bit"] == pytest.approx(1000 * UNIT_10BIT, abs=1e-6)
    assert told.values[0, "position_10bit"] == pytest.approx(1000 * UNIT_10BIT, abs=1e-6)
    assert told.frames[0].fields["h3"] == 7
    assert told.frames[0].fields["l7"] == 0xD0


def test_a_bit_0_without_any_bit_7_proves_the_other_alignment() -> None:
    # 40 has neither bit and is read by default as 20; 41 proves itself and what follows
    assert goals(*(move10(p, right=True) for p in (40, 41, 40))) == [20, 41, 40]


def test_a_bit_7_disproves_the_other_alignment_for_good() -> None:
    assert goals(move10(41, right=True), move10(100, right=False), b"\x00\x29") == [41, 100]
    assert goals(move10(100, right=False), move10(41, right=True)) == [100, 20]


def test_the_proof_counts_replies_and_lasts_across_batches() -> None:
    read = command(0xE0, 0xC9, b"\x28\x28")
    told = hear(read, b"\x03\x29", read, b"\x03\x28", cuts=True)
    assert [s.raw for s in told.samples] == [3 << 7 | 41, 3 << 7 | 40]


def test_upper_bits_of_h3_are_arbitrary() -> None:
    read = command(0xE0, 0xC9, b"\x28\x28")
    assert [s.raw for s in hear(read, b"\xfb\x02").samples] == [3 << 7 | 1]


@given(
    l7=st.lists(st.integers(0, 255).filter(lambda b: b != 0xFF), min_size=1, max_size=12),
    cuts=st.booleans(),
)
def test_the_alignment_is_the_one_of_the_reference_however_the_stream_is_cut(
    l7: list[int], cuts: bool
) -> None:
    read = command(0xE0, 0xC9, b"\x28\x28")
    parts = [read + bytes([2, byte]) for byte in l7]
    groups = [[Chunk(p)] for p in parts] if cuts else [[Chunk(b"".join(parts))]]
    want = Reference(WCK).decode([Chunk(b"".join(parts))])
    assert [s[4] for s in records(batches(Decoder("wck"), groups)).samples] == [
        s[4] for s in want.samples
    ]
