"""Schunk's Motion Protocol, declared as a newcomer would: what an answer says has many forms.

    05 | ID | D-LEN | CMD | DATA ... | CRC        07 | ID | D-LEN | CMD | DATA ... | CRC

Source: Schunk Motion Protocol 1.41, examples MOVE POS 10 [mm], GET STATE 1 [s], CMD REFERENCE.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import pytest
from construct import (
    Byte,
    Bytes,
    Check,
    Const,
    Enum,
    FlagsEnum,
    Float32l,
    GreedyBytes,
    GreedyRange,
    Int16ub,
    Int16ul,
    Int32sb,
    Struct,
    Terminated,
    this,
)

import sniffer
from sniffer.decoding.decoder import Decoder
from sniffer.ground.crc import Crc16
from sniffer.ground.model import Chunk, DeclarationError
from sniffer.ground.registers import RegisterMap
from sniffer.protocols.base import view
from sniffer.protocols.packets import MUST, NEVER, Command, Member, Packet, PacketFamily, Seal

TABLE: Final = """
model = "smp"
protocol = "smp"
title = "A module"
source = "Schunk Motion Protocol 1.41"

[[register]]
name = "goal_position"
address = 0xB00
type = "u32"
source = "MOVE POS: a floating-point number"
"""
PACKET: Final = Packet(
    "header" / Const(b"\x05"),
    "servo_id" / Byte,
    "length" / Byte,
    Check((this.length >= 1) & (this.length <= 30)),
    "code" / Byte,
    "params" / Bytes(this.length - 1),
    "crc"
    / Seal(
        Int16ul,
        Crc16(0x8005, reflected=True),
        "header",
        "servo_id",
        "length",
        "code",
        "params",
    ),
)
MOVE: Final = Struct("position" / Float32l, Terminated)
FAMILY: Final = PacketFamily(
    name="smp",
    title="Schunk Motion Protocol",
    bauds=(9600,),
    baud=9600,
    packet=PACKET,
    commands={
        0x92: Command("reference", Struct(Terminated), MUST, answer=2),
        0xB0: Command(
            "move_pos", MOVE, MUST, at=0xB00, feedback=Struct("seconds" / Float32l, Terminated)
        ),
    },
    feedback=Struct("data" / GreedyBytes),
    answer_header=b"\x07",
    models=(RegisterMap.from_text(TABLE, "smp.toml"),),
    window_ns=20_000_000,
    most=30,
)
REFERENCE: Final = bytes.fromhex("050101 92 D131"), bytes.fromhex("070103 92 4F4B E9D9")
MOVE_POS: Final = bytes.fromhex("050105 B0 00002041 4880"), bytes.fromhex("070105 B0 EEEE5640 7BE4")


def fields_of(family: PacketFamily, said: bytes) -> list[dict[str, Any]]:
    """Return what each frame says beside registers."""
    capture = sniffer.decode(said, protocol=Member(family), input_format="bin")
    return [row.fields for row in capture if isinstance(row, sniffer.FrameRow)]


def answered(feedback: Any, params: bytes) -> dict[str, Any]:
    """Return what an answer to a move says whose grammar is another one."""
    move = replace(FAMILY.commands[0xB0], feedback=feedback)
    family = replace(FAMILY, commands={**FAMILY.commands, 0xB0: move})
    head = {"servo_id": 1, "length": 1 + len(params), "code": 0xB0, "params": params}
    return fields_of(family, MOVE_POS[0] + bytes(family.answering.build(head)))[1]


def labels(family: PacketFamily, raw: bytes) -> list[str]:
    """Return what the fields of a frame are called where it is taken apart."""
    protocol = Member(family)
    decoder = Decoder(protocol)
    heard = decoder.feed(Chunk(raw)), decoder.close()
    (row,) = [view(batch.frames, 0) for batch in heard if len(batch.frames)]
    return [span.name for span in protocol.dissect(raw, row)]


def test_the_code_of_an_answer_is_no_error_where_it_has_a_header_of_its_own() -> None:
    assert labels(FAMILY, REFERENCE[0]) == ["header", "servo_id", "length", "command", "crc"]
    assert labels(FAMILY, REFERENCE[1])[3:] == ["command", "data", "crc"]


def test_what_the_manual_calls_them_is_said_of_a_family_that_says_it() -> None:
    family = replace(FAMILY, words=("order", "reply", "replies"))
    assert (labels(family, REFERENCE[0])[3], labels(family, REFERENCE[1])[3]) == ("order", "reply")
    assert Member(family).op_name(-1) == "replies"


def test_a_constant_in_the_place_of_the_code_is_no_error_either() -> None:
    feedback = Struct("code" / Const(b"\x80"), "error" / Byte, "data" / GreedyBytes)
    assert replace(FAMILY, feedback=feedback, answer_header=b"").terms[1] == "instruction"
    feedback = Struct("error" / Byte, "data" / GreedyBytes)
    assert replace(FAMILY, feedback=feedback, answer_header=b"").terms[1] == "error"


def test_an_answer_says_a_number_of_any_form_as_its_grammar_reads_it() -> None:
    asked, told = fields_of(FAMILY, b"".join(MOVE_POS))
    assert asked["position"] == 10.0
    assert told == {"seconds": pytest.approx(3.358, abs=0.001)}
    assert answered(Struct("ms" / Int16ub, Terminated), b"\x01\x02") == {"ms": 0x102}
    assert answered(Struct("at" / Int32sb, "data" / GreedyBytes), b"\xff\xff\xff\xfe") == {"at": -2}


def test_a_goal_is_what_was_sent_and_no_number_that_answers_it() -> None:
    capture = sniffer.decode(b"".join(MOVE_POS), protocol=Member(FAMILY), input_format="bin")
    samples = [(row.register, row.raw) for row in capture if isinstance(row, sniffer.SampleRow)]
    assert samples == [("goal_position", 0x41200000)]
    pairs = [row.outcome for row in capture if isinstance(row, sniffer.TransactionRow)]
    assert pairs == ["ok"]


def test_flags_and_enumerations_whose_high_byte_is_the_first_have_their_names() -> None:
    state = Struct("state" / FlagsEnum(Int16ub, moving=0x100), Terminated)
    assert answered(state, b"\x01\x00") == {"state": {"number": 0x100, "names": ["moving"]}}
    mode = Struct("mode" / Enum(Int16ub, velocity=0x102), Terminated)
    assert answered(mode, b"\x01\x02") == {"mode": {"number": 0x102, "names": ["velocity"]}}


def test_a_number_that_is_none_is_told_as_a_word() -> None:
    assert answered(Struct("seconds" / Float32l, Terminated), b"\x00\x00\xc0\x7f") == {
        "seconds": "nan"
    }


@pytest.mark.parametrize(
    ("reports", "told"),
    [
        ({"overhaet": "overheating"}, r"what overhaet means.*: did you mean overheat\?"),
        ({"error_9": "overload"}, "what error_9 means, and no error of an answer and no value or"),
    ],
)
def test_what_a_fault_means_that_nothing_reports_is_refused(
    reports: dict[str, str], told: str
) -> None:
    feedback = Struct("error" / FlagsEnum(Byte, overheat=1, stall=2), "data" / GreedyBytes)
    with pytest.raises(DeclarationError, match=told):
        Member(replace(FAMILY, feedback=feedback, reports=reports))


def test_a_fault_may_be_one_of_a_register_or_a_bit_without_a_name() -> None:
    text = TABLE + 'bits = { "0" = "hot" }\nalarms = [0]\n'
    feedback = Struct("error" / FlagsEnum(Byte, stall=2), "data" / GreedyBytes)
    family = replace(
        FAMILY,
        feedback=feedback,
        models=(RegisterMap.from_text(text, "smp.toml"),),
        reports={"hot": "overheating", "bit3": "overload", "stall": "blocked"},
    )
    assert set(Member(family).reports) == {"hot", "bit3", "stall"}


@pytest.mark.parametrize("rest", [Bytes(4), GreedyBytes])
def test_bytes_of_one_of_several_targets_that_no_field_counts_are_to_be_numbers(rest: Any) -> None:
    each = Struct("servo_id" / Byte, "data" / rest)
    several = Command("several", Struct("targets" / GreedyRange(each)), NEVER, at=0xB00)
    with pytest.raises(DeclarationError, match='as "position" / Int16ul, and at= where they stand'):
        Member(replace(FAMILY, commands={0xB1: several}))
    each = Struct("servo_id" / Byte, "position" / Float32l)
    several = replace(several, params=Struct("targets" / GreedyRange(each)))
    assert Member(replace(FAMILY, commands={0xB1: several})).op_name(0xB1) == "several"


def test_the_field_that_tells_a_later_answer_is_a_short_number() -> None:
    move = replace(FAMILY.commands[0xB0], later={"seconds": (2,)})
    with pytest.raises(DeclarationError, match="later names seconds, which is no number in its"):
        Member(replace(FAMILY, commands={**FAMILY.commands, 0xB0: move}))
