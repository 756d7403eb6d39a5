"""The example protocols: vectors of their manuals, and the laws that every protocol holds."""

from __future__ import annotations

import dataclasses
import itertools
import json
import re
import tomllib
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from construct import (
    BitsInteger,
    BitStruct,
    Byte,
    Check,
    Flag,
    GreedyBytes,
    GreedyRange,
    Int8sb,
    Int16ub,
    Struct,
    Terminated,
)
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding import pairing
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.checksums import XOR8
from sniffer.ground.codes import OK, REQUEST
from sniffer.ground.framing import Block
from sniffer.ground.gaps import Gaps
from sniffer.ground.model import MALFORMED, UNUSUAL, Chunk
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols.base import view
from sniffer.protocols.packets import MUST, Command, Member
from sniffer.sinks.tables import frames_table
from tests.lists import in_turn
from tests.members import heard, outcomes, protocol, values
from tests.records import batches, gaps, records
from tests.streams import chunked
from tests.streams.members import (
    ALL,
    EXAMPLES,
    NAMES,
    conversation,
    example,
    loaded,
    number,
    packet,
    status,
    stream,
)

if TYPE_CHECKING:
    from pathlib import Path

EVERY: Final = pytest.mark.parametrize("name", NAMES)
VECTORS: Final = [
    (name, vector)
    for name in ALL
    for vector in json.loads((EXAMPLES / name / "vectors.json").read_text(encoding="utf-8"))
]


@pytest.mark.parametrize(
    ("name", "vector"), VECTORS, ids=[f"{name}-{v['name']}" for name, v in VECTORS]
)
def test_a_manuals_example_reads_as_the_manual_says(name: str, vector: dict[str, Any]) -> None:
    said = [bytes.fromhex(x) for x in vector["packets"]]
    batch = heard(name, *said)
    frames = batch.frames
    assert [int(n) for n in frames.length] == [len(x) for x in said], vector["source"]
    ops = [protocol(name).op_name(int(op)) for op in frames.op]
    assert ops == [vector["op"]] * len(said)
    asked = vector.get("requests", 1)
    assert [int(k) for k in frames.kind] == [REQUEST] * asked + [1] * (len(said) - asked)
    assert not frames.flags[frames.flags & (MALFORMED | UNUSUAL) > 0].any()
    told = [tuple(v) for v in vector["values"]]
    assert values(name, batch) == told
    if len(said) > 1:
        assert outcomes(batch) == ["ok"] * (len(said) - asked)


@EVERY
@given(data=st.data())
def test_columns_say_what_the_oracle_says(name: str, data: st.DataObject) -> None:
    p = protocol(name)
    chunks = data.draw(chunked(data.draw(stream(name)), byte_time_ns(p.baud), p.tail_ns))
    got, want = records(batches(Decoder(p), [chunks])), Reference(p).decode(chunks)
    assert got.frames == want.frames
    assert got.transactions == want.transactions
    assert got.samples == want.samples


@in_turn(2)
@EVERY
@pytest.mark.parametrize("chain", [pairing.CHAIN, 0], ids=["chain", "no_chain"])
@given(data=st.data())
def test_any_recut_gives_equal_records_and_gaps(name: str, chain: int, data: st.DataObject) -> None:
    p = protocol(name)
    talk = data.draw(st.one_of(stream(name), conversation(name)))
    chunks = data.draw(chunked(talk, byte_time_ns(p.baud), p.tail_ns))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pairing, "CHAIN", chain)
        one = batches(Decoder(p), [[c] for c in chunks])
    whole = batches(Decoder(p), [chunks])
    assert records(one) == records(whole)
    assert gaps(one) == gaps(whole)


@EVERY
@given(data=st.data())
def test_numbers_of_gaps_in_columns_are_those_of_their_objects(
    name: str, data: st.DataObject
) -> None:
    p = protocol(name)
    chunks = data.draw(chunked(data.draw(stream(name)), byte_time_ns(p.baud), p.tail_ns))
    for batch in batches(Decoder(p), [chunks]):
        found, objects = Gaps.of(batch.gaps), Gaps.of(tuple(batch.gaps))
        assert found.expected.tolist() == objects.expected.tolist()
        assert found.got.tolist() == objects.got.tolist()


@EVERY
@given(data=st.data())
def test_frames_and_gaps_joined_are_the_input(name: str, data: st.DataObject) -> None:
    talk = data.draw(stream(name))
    parts = batches(Decoder(protocol(name)), [[Chunk(talk)]])
    spans = sorted(
        [(f[0], f[1]) for f in records(parts).frames] + [(g[0], g[1]) for g in gaps(parts)]
    )
    ends = [0, *itertools.accumulate(length for _, length in spans)]
    assert [start for start, _ in spans] == ends[:-1]
    assert ends[-1] == len(talk)


@EVERY
@given(data=st.data())
def test_every_frame_has_fields_and_is_dissected_whole(name: str, data: st.DataObject) -> None:
    p = protocol(name)
    talk = data.draw(stream(name))
    for b in batches(Decoder(p), [[Chunk(talk)]]):
        for i in range(len(b.frames)):
            raw = b.data[int(b.frames.start[i]) : int(b.frames.end[i])]
            row = view(b.frames, i)
            json.dumps(p.fields(raw, row))
            spans = p.dissect(raw, row)
            ends = list(itertools.accumulate(s.length for s in spans))
            assert [s.offset for s in spans] == [0, *ends[:-1]]
            assert ends[-1] == len(raw)
            checksum, body, got = p.checksum_of(raw)
            assert checksum(body) == got


@pytest.mark.parametrize("name", ALL)
def test_a_package_says_what_the_program_looks_for(name: str) -> None:
    project = tomllib.loads((EXAMPLES / name / "pyproject.toml").read_text(encoding="utf-8"))
    entry = project["project"]["entry-points"]["sniffer.protocols"]
    assert entry == {name: f"sniffer_{name}:PROTOCOL"}
    p = protocol(name)
    assert p.interface == 1
    assert p.name == name
    assert p.models
    for table in p.models:
        assert (EXAMPLES / name / f"{table.model}.toml").is_file()


@EVERY
def test_a_bus_that_answers_is_paired_at_column_speed_however_long(name: str) -> None:
    address, size = (
        (132, 4) if name == "dynamixel2" else (36, 2) if name == "dynamixel1" else (56, 2)
    )
    ask = packet(name, 1, 2, number(name, address) + number(name, size))
    talk = b"".join(
        ask + status(name, 1, 0, (k % 4096).to_bytes(size, "little")) for k in range(2000)
    )
    parts = batches(Decoder(protocol(name)), [[Chunk(talk)]])
    told = records(parts)
    assert [t[2] for t in told.transactions] == [OK] * 2000
    assert [s[4] for s in told.samples] == [k % 4096 for k in range(2000)]


def test_a_servo_that_is_not_there_states_no_values() -> None:
    reads = [packet("dynamixel1", 1, 2, bytes([address, 2])) for address in (24, 26, 28, 30)]
    batch = heard("dynamixel1", *reads)
    assert values("dynamixel1", batch) == []
    answers = batch.frames.kind != REQUEST
    assert (batch.frames.flags[answers] & UNUSUAL).all()


def test_the_same_read_again_is_a_retry_and_not_its_own_answer() -> None:
    ask = packet("dynamixel1", 1, 2, b"\x24\x02")
    batch = heard("dynamixel1", ask, ask, status("dynamixel1", 1, 0, b"\x00\x08"))
    assert batch.frames.kind.tolist() == [0, 0, 1]
    assert values("dynamixel1", batch) == [(1, "present_position", 180.0)]


def test_an_answer_that_reports_an_error_like_a_ping_is_an_answer() -> None:
    ask = packet("dynamixel1", 1, 3, b"\x1e\x00\x02")
    batch = heard("dynamixel1", ask, status("dynamixel1", 1, 1))
    assert outcomes(batch) == ["ok"]
    assert int(batch.frames.status[1]) == 1


def test_an_address_of_sixteen_bits_is_an_address() -> None:
    ask = packet("dynamixel2", 1, 2, b"\xff\xff\x02\x00")
    batch = heard("dynamixel2", ask, status("dynamixel2", 1, 0, b"\x01\x02"))
    assert batch.frames.address.tolist() == [0xFFFF, 0xFFFF]
    assert outcomes(batch) == ["ok"]
    table = frames_table("bus0", protocol("dynamixel2"), batch)
    assert table["address"].to_pylist() == [0xFFFF, 0xFFFF]


def test_spans_that_differ_by_a_multiple_of_512_are_read_apart() -> None:
    one = packet("dynamixel2", 1, 3, (132).to_bytes(2, "little") + bytes(4))
    other = packet("dynamixel2", 1, 3, (132 + 512).to_bytes(2, "little") + bytes(4))
    assert [v[1] for v in values("dynamixel2", heard("dynamixel2", one, other))] == [
        "present_position"
    ]


def test_a_length_that_is_not_believed_holds_nothing_back() -> None:
    false = b"\xff\xff\xfd\x00\x01\xff\xff\x02"
    ask = packet("dynamixel2", 1, 1)
    block = Block(np.frombuffer(false + ask, np.uint8), np.empty(0, np.int64), False)
    spans, decided = protocol("dynamixel2").frame(block)
    assert spans.start.tolist() == [len(false)]
    assert decided >= len(false) + len(ask) - 6


def test_stuffed_bytes_are_taken_out_of_values_and_left_in_frames() -> None:
    data = b"\xff\xff\xfd\x00"
    said = packet("dynamixel2", 1, 3, b"\x74\x00" + data)
    batch = heard("dynamixel2", said, packet("dynamixel2", 2, 3, b"\x74\x00\x01\x00\x00\x00"))
    assert int(batch.frames.length[0]) == len(said)
    assert batch.values.raw.tolist() == [0x00FDFFFF, 1]


def test_who_was_not_asked_answers_no_sync_read() -> None:
    ask = packet("feetech", 254, 0x82, b"\x38\x02\x01\x02")
    told = [status("feetech", i, 0, b"\x00\x08") for i in (1, 3)]
    batch = heard("feetech", ask, *told)
    assert values("feetech", batch) == [(1, "present_position", 180.0)]
    assert sorted(outcomes(batch)) == ["mismatched", "no_response", "ok"]


def test_each_answer_to_a_bulk_read_is_read_where_that_servo_was_asked() -> None:
    ask = packet("dynamixel2", 254, 0x92, b"\x01\x90\x00\x02\x00\x02\x92\x00\x01\x00")
    one, two = status("dynamixel2", 1, 0, b"\x77\x00"), status("dynamixel2", 2, 0, b"\x24")
    told = [(1, "present_input_voltage", 11.9), (2, "present_temperature", 36.0)]
    assert values("dynamixel2", heard("dynamixel2", ask, one, two)) == told
    assert values("dynamixel2", heard("dynamixel2", ask, two)) == told[1:]


def test_numbers_of_a_potentiometer_servo_have_the_high_byte_first() -> None:
    ask, answer = packet("feetech", 1, 2, b"\x38\x02"), status("feetech", 1, 0, b"\x02\x00")
    told = heard("feetech", ask, answer, models={None: "scs009"})
    assert values("feetech", told) == [(1, "present_position", 150.0)]
    half = heard(
        "feetech",
        packet("feetech", 1, 2, b"\x39\x01"),
        status("feetech", 1, 0, b"\x07"),
        models={None: "scs009"},
    )
    assert half.values.part.tolist() == [1]  # the low byte, which stands second


def test_an_alert_is_no_refusal() -> None:
    p = protocol("dynamixel2")
    assert p.refused(np.array([0, 0x80, 0x04, 0x84], np.int16)).tolist() == [
        False,
        False,
        True,
        True,
    ]
    assert p.status_names(0x84) == ("data_range", "alert")


@EVERY
def test_what_is_torn_is_said_with_what_can_be_read(name: str) -> None:
    p = protocol(name)
    whole = packet(name, 1, 2, number(name, 36) + number(name, 2))
    spoiled = whole[:-1] + bytes([whole[-1] ^ 0x11])
    (gap,) = p.explain(spoiled, 100)
    assert (gap.start, gap.length, gap.reason) == (100, len(whole), "damaged")
    assert gap.detail["checksum_expected"] != gap.detail["checksum_got"]
    assert gap.detail["fields"]["op"] == "read"
    (gap,) = p.explain(whole[:-2], 0)
    assert (gap.reason, gap.detail["need"]) == ("truncated", len(whole))
    assert [g.reason for g in p.explain(b"\x01\x02" + whole[:3], 0)] in (
        ["noise", "truncated"],
        ["noise"],
    )


def test_the_designs_example_is_a_protocol(tmp_path: Path) -> None:
    guide = (EXAMPLES.parents[1] / "docs" / "design.md").read_text(encoding="utf-8")
    guide = guide.partition(". Adding a protocol\n")[2]
    blocks = dict(re.findall(r"^```(toml|py)\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL))
    (tmp_path / "tin.toml").write_text(blocks["toml"], encoding="utf-8")
    file = tmp_path / "sniffer_tin.py"
    file.write_text(blocks["py"], encoding="utf-8")
    tin = loaded(file).PROTOCOL

    def packet(servo_id: int, code: int, params: bytes) -> bytes:
        body = bytes([servo_id, len(params) + 1, code]) + params
        return b"\xa5\x5a" + body + bytes([XOR8(body)])

    ask = packet(7, 2, b"\x12\x02")
    assert f"explain {ask.hex(' ').upper()} --protocol sniffer_tin.py" in guide
    told = packet(7, 0x80, b"\x00\x2c\x01")
    goals = packet(255, 6, b"\x10\x02\x07\x64\x00\x08\x65\x00")
    parts = batches(Decoder(tin), [[Chunk(ask + told + goals)]])
    assert (
        records(parts).transactions
        == Reference(tin).decode([Chunk(ask + told + goals)]).transactions
    )
    samples = [
        (int(who), round(float(x), 3))
        for b in parts
        for who, x in zip(b.values.servo_id, b.values.value, strict=True)
    ]
    assert samples == [(7, 30.0), (7, 10.0), (8, 10.1)]


@pytest.mark.parametrize(
    "params",
    [
        Struct("address" / Byte, Check(lambda x: x.address > 3), Terminated),
        Struct("address" / Int16ub, "data" / GreedyBytes),
        Struct("address" / Int8sb, "data" / GreedyBytes),
        Struct("option" / Byte, "address" / Byte, Terminated),
        Struct("data" / GreedyBytes, "option" / Byte),
        Struct("address" / Byte, "targets" / GreedyRange(Struct("servo_id" / Byte))),
        Struct("targets" / GreedyRange(Struct("address" / Byte, "length" / Byte))),
        Struct("flags" / BitStruct("a" / Flag, "b" / BitsInteger(7))),
    ],
)
def test_what_columns_have_no_form_for_is_refused_when_the_protocol_is_made(params: Any) -> None:
    family = example("dynamixel1").FAMILY
    commands = {**family.commands, 0x30: Command("odd", params, MUST)}
    with pytest.raises(TypeError, match="dynamixel1: command odd: "):
        Member(dataclasses.replace(family, commands=commands))


def test_a_protocol_knows_the_models_that_a_user_brings() -> None:
    p = protocol("feetech")
    table = p.models[0]
    more = p.with_models((type(table)("mine", table.registers, title="mine"),))
    assert [m.model for m in more.models] == ["sts3215", "scs009", "mine"]
    assert len(more.registers) == len(p.registers) + len(table)
