"""wCK framing: each rule of the protocol, and each contradiction of its manual, as a sentence."""

from __future__ import annotations

import functools
import itertools
from typing import Any

import numpy as np
import pytest
from construct import ConstructError

from sniffer.decoding.decoder import Decoder
from sniffer.ground.framing import Block
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.wck.block import KIND, NONE
from sniffer.protocols.wck.grammar import COMMANDS, FIRSTS, OPS, SECONDS
from tests import heard
from tests.records import batches
from tests.streams.wck import command
from tests.vectors import WCK_SET_OPS

WCK = PROTOCOLS["wck"]
hear = functools.partial(heard.hear, "wck")

MOVE = command(0x23, 100)
READ = command(0xA3, 0)
PASSIVE = command(0xC3, 0x10)
WHEEL = command(0xC3, 0x3F)
BREAK = command(0xDF, 0x20)
IO_WRITE = command(0xE3, 0x64, b"\xff\xff")
IO_READ = command(0xE3, 0x65, b"\0\0")
REPLY = bytes([17, 99])

TEN_BIT = {code: name for code, name in WCK_SET_OPS.items() if name.endswith("10bit")}
SET_CODES = {code: name for code, name in WCK_SET_OPS.items() if code not in TEN_BIT}
SIX = {2: "break", 1: "passive", 3: "wheel", 4: "wheel"}


def by_the_manual(data1: int, data2: int) -> str | None:
    """Name the command by table A-6, written down a second time, and the controller's own."""
    if (data1, data2) == (0xE0, 0xFB):
        return "rbc_direct_control_end"
    mode, module = data1 >> 5, data1 & 31
    if mode < 5:
        if module < 31:
            return "position_move" if data2 < 255 else None
        return "sync_position_move" if data2 & 31 else None
    if mode == 5:
        return "status_read" if module < 31 else None
    if mode == 6:
        name = SIX.get(data2 >> 4)
        return name if (module == 31) == (name == "break") else None
    if data2 in TEN_BIT:
        return TEN_BIT[data2]
    return SET_CODES.get(data2, "unknown" if data2 < 255 else None) if module < 31 else None


def decided(held: bytes, *, final: bool = False) -> int:
    block = Block(np.frombuffer(held, np.uint8), np.empty(0, np.int64), final)
    return WCK.frame(block)[1]


# ---- what begins a command


def test_every_data1_and_data2_begins_the_command_of_the_manuals_table() -> None:
    for data1, data2 in itertools.product(range(256), range(256)):
        kind = int(KIND[data2 << 8 | data1])
        assert (None if kind == NONE else OPS[kind].name) == by_the_manual(data1, data2)


@pytest.mark.parametrize("index", range(len(OPS)), ids=[op.name for op in OPS])
def test_the_grammar_of_a_command_takes_the_bytes_that_select_it_and_no_others(index: int) -> None:
    body = COMMANDS[index].body.subcon.subcon

    def taken(part: Any) -> set[int]:
        out = set()
        for value in range(256):
            try:
                part.parse(bytes([value]))
            except ConstructError:
                continue
            out.add(value)
        return out

    assert taken(body.data1) == FIRSTS[index]
    assert taken(body.data2) == SECONDS[index]


def test_data1_is_ff_in_10_bit_commands_only() -> None:
    assert hear(command(0xFF, 0xC9, b"\x07\x07")).ops == ["position_read_10bit"]
    assert hear(command(0xFF, 0x0A, b"\x07\x07")).ops == []


def test_a_target_of_255_is_the_next_header() -> None:
    assert hear(command(0x23, 0xFF)).ops == []
    assert hear(b"\xff\x23" + READ + REPLY).ops == ["status_read"] * 2


@pytest.mark.parametrize("count", [1, 16, 31])
def test_the_checksum_of_a_synchronized_move_takes_the_targets_only(count: int) -> None:
    targets = bytes(range(count))
    good = command(0x1F, 0xE0 | count, targets)
    assert hear(good).ops == ["sync_position_move"]
    whole = good[-1] ^ (0x1F ^ 0xE0 ^ count) & 0x7F
    assert hear(good[:-1] + bytes([whole])).ops == []


def test_a_synchronized_move_of_nobody_is_none() -> None:
    assert hear(b"\xff\x1f\x00\x00").ops == []


@pytest.mark.parametrize("servo_id", [0, 1, 30, 31, 200, 253])
def test_a_10_bit_read_may_leave_its_id_out_of_the_checksum(servo_id: int) -> None:
    rest = bytes([servo_id, servo_id])
    note5, text = command(0xE0, 0xC9, rest), command(0xE0, 0xC9, rest, text_sum=True)
    assert hear(note5).flags == [()]
    assert hear(text).ops == ["position_read_10bit"]
    assert hear(text).flags == [("unusual",) if note5 != text else ()]
    assert (note5 == text) == (servo_id in (0, 128))


def test_no_other_command_may_leave_a_byte_out_of_the_checksum() -> None:
    assert hear(command(0xE0, 0x97, b"\x05\x05", text_sum=True)).ops == []


def test_a_code_of_no_manual_is_taken_for_six_bytes_and_a_reply_of_two() -> None:
    told = hear(command(0xE3, 0x13, b"\x01\x01"), b"\x01\x01", READ, REPLY)
    assert told.ops == ["unknown_13", "unknown_13", "status_read", "status_read"]
    assert told.flags[0] == ("unknown",)
    assert told.outcomes == ["ok", "ok"]
    assert WCK.op_name(256 + 0x13) == "unknown_13"


def test_data4_that_does_not_repeat_data3_is_unusual() -> None:
    assert hear(command(0xE3, 0x0C, b"\x05\x06")).flags == [("unusual",)]
    assert hear(command(0xE3, 0x09, b"\x05\x06")).flags == [()]
    assert hear(command(0xE3, 0x0E, b"\x05\x06")).flags == [()]


# ---- what is a reply


def test_a_reply_is_the_two_bytes_behind_the_command() -> None:
    told = hear(MOVE, REPLY, READ, REPLY)
    assert [(f.offset, f.length, f.kind) for f in told.frames] == [
        (0, 4, "request"),
        (4, 2, "response"),
        (6, 4, "request"),
        (10, 2, "response"),
    ]
    assert [f.servo_id for f in told.frames] == [3] * 4
    assert told.outcomes == ["ok", "ok"]


@pytest.mark.parametrize("cut", range(1, 16))
def test_a_reply_torn_by_reads_is_whole(cut: int) -> None:
    talk = MOVE + REPLY + IO_READ + b"\x03\xff" + READ
    told = hear(talk[:cut], talk[cut:], cuts=True)
    assert told.outcomes == ["ok", "ok", "no_response"]


@pytest.mark.parametrize("asked", [MOVE, READ, PASSIVE, BREAK, command(0xE3, 0x0A, b"\0\0")])
def test_an_ff_behind_a_command_is_the_next_command(asked: bytes) -> None:
    told = hear(asked, READ, REPLY)
    assert told.outcomes == ["no_response", "ok"]
    assert not told.gaps


@pytest.mark.parametrize("asked", [command(0x1F, 2, b"\x10\x20"), command(0xE3, 0x17, b"\x1e\x64")])
def test_nothing_answers_a_synchronized_move_and_a_runtime_speed(asked: bytes) -> None:
    told = hear(asked, REPLY, READ, REPLY)
    assert told.outcomes == ["not_expected", "ok"]
    assert [(g.offset, g.reason) for g in told.gaps] == [(len(asked), "noise")]


def test_a_controller_that_polls_absent_ids_gets_no_response_each_time() -> None:
    polls = [command(0xE0 | k, 0x0C, bytes([k, k])) for k in range(31)]
    told = hear(*polls)
    assert told.ops == ["id_set"] * 31
    assert told.outcomes == ["no_response"] * 31


def test_a_lone_byte_before_the_next_header_is_a_truncated_reply() -> None:
    told = hear(READ, b"\x11", READ, REPLY)
    assert told.outcomes == ["damaged", "ok"]
    assert [(g.offset, g.length, g.reason) for g in told.gaps] == [(4, 1, "truncated")]
    assert told.gaps[0].detail == {"have": 1, "need": 2, "fields": {"reply": "11"}}


def test_a_rotation_count_of_255_is_a_count_and_no_header() -> None:
    told = hear(WHEEL, b"\xff\x10", READ, REPLY)
    assert told.outcomes == ["ok", "ok"]
    assert told.samples[2].register == "rotation_count"
    assert told.samples[2].raw == 255


def test_a_command_that_holds_behind_a_wheel_command_is_no_rotation_count() -> None:
    assert hear(WHEEL, READ, REPLY).outcomes == ["no_response", "ok"]


def test_an_ff_that_may_be_a_count_waits_until_the_command_behind_it_is_known() -> None:
    assert decided(WHEEL + READ[:3]) == 0
    assert decided(WHEEL + READ[:3] + b"\x55") == 8
    assert decided(WHEEL + READ) == 0  # in a row: replies behind the second may be for both
    assert decided(WHEEL + b"\xff") == 0
    assert decided(IO_READ + b"\x03" + READ[:3]) == 0
    assert decided(IO_READ + b"\x03" + READ) == len(IO_READ) + 1


def test_an_ad_value_of_255_is_a_value_and_no_header() -> None:
    told = hear(IO_READ, b"\x03\xff", READ, REPLY)
    assert told.outcomes == ["ok", "ok"]
    assert (told.samples[1].register, told.samples[1].raw) == ("ad_input", 255)


def test_a_command_that_holds_behind_one_byte_of_an_io_reply_truncates_it() -> None:
    told = hear(IO_READ, b"\x03", READ, REPLY)
    assert told.outcomes == ["damaged", "ok"]
    assert [g.reason for g in told.gaps] == ["truncated"]


def test_an_io_write_of_ff_is_echoed_with_ff() -> None:
    assert hear(IO_WRITE, b"\xff\xff", READ, REPLY).outcomes == ["ok", "ok"]
    assert hear(IO_WRITE, READ, REPLY).outcomes == ["no_response", "ok"]


def test_an_echo_outweighs_a_10_bit_command_that_holds_by_chance() -> None:
    ten = command(0xFF, 0xC9, b"\x21\x21")
    assert hear(IO_WRITE, ten).outcomes == ["ok"]
    assert hear(command(0xE3, 0x64, b"\x01\x01"), ten).ops == ["io_write", "position_read_10bit"]


def test_no_reply_is_heard_across_a_silence() -> None:
    def silent(pause_ns: int) -> list[str]:
        first, second = Chunk(READ, NS, Clock.READ), Chunk(REPLY, NS + pause_ns, Clock.READ)
        pairs = [b.transactions.outcome for b in batches(Decoder("wck"), [[first, second]])]
        return [("ok", "no_response")[int(o)] for o in np.concatenate(pairs)]

    assert silent(WCK.tail_ns // 2) == ["ok"]
    assert silent(WCK.tail_ns + NS) == ["no_response"]


def test_a_break_of_all_modules_is_answered_by_whoever_it_is() -> None:
    told = hear(BREAK, b"\x05\x64", READ, REPLY)
    assert [f.servo_id for f in told.frames] == [None, 5, 3, 3]
    assert told.outcomes == ["ok", "ok"]
    assert told.frames[1].fields["id"] == 5


def test_more_answers_to_a_break_are_bytes_of_no_frame() -> None:
    told = hear(BREAK, b"\x05\x64\x06\x65\x07\x66", READ, REPLY)
    assert told.outcomes == ["ok", "ok"]
    assert [(g.offset, g.length, g.reason) for g in told.gaps] == [(6, 4, "noise")]


ECHOES = [
    (PASSIVE, b"\x10\x55", b"\x11\x55"),
    (BREAK, b"\x1e\x55", b"\x1f\x55"),
    *((command(0xE3, c, b"\x07\x07"), b"\x07\x07", b"\x03\x03") for c in (8, 12, 15, 21, 24)),
    *((command(0xE3, c, b"\x07\x09"), b"\x07\x09", b"\x07\x08") for c in (9, 11, 13, 17)),
    *((command(0xE3, c, b"\x00\x00"), b"\x07\x07", b"\x07\x08") for c in (0x16, 0x10, 0x97)),
    (command(0xE3, 0x64, b"\xf3\xf3"), b"\x03\x03", b"\x02\x02"),
    (command(0xE3, 0x96, b"\x01\x10\x52"), b"\x01\x01", b"\x02\x02"),
    (command(0xE3, 0xC8, b"\x04\x00\x03\x10"), b"\x07\x10", b"\x08\x10"),
    (command(0xE3, 0xC9, b"\x04\x04"), b"\x07\x10", b"\x08\x10"),
]


@pytest.mark.parametrize(("asked", "echo", "other"), ECHOES)
def test_a_reply_that_does_not_repeat_what_it_should_is_accepted_and_flagged(
    asked: bytes, echo: bytes, other: bytes
) -> None:
    assert hear(asked, echo).flags == [(), ()]
    told = hear(asked, other)
    assert told.flags == [(), ("echo_differs",)]
    assert told.outcomes == ["ok"]


@pytest.mark.parametrize("code", [0x0A, 0x0E, 0x12, 0x65, 0x13])
def test_replies_that_repeat_nothing_are_never_flagged(code: int) -> None:
    assert hear(command(0xE3, code, b"\0\0"), b"\x50\x20").flags[1] == ()


# ---- a stray FF, and how long a command is waited for


@pytest.mark.parametrize("asked", [command(0xC8, 0x10), command(0xC9, 0x3F), command(0xC9, 0x40)])
@pytest.mark.parametrize("reply", [b"", b"\x10\x55"])
@pytest.mark.parametrize("more", [b"", READ + REPLY])
def test_a_stray_ff_before_a_command_to_module_8_or_9_hides_nothing(
    asked: bytes, reply: bytes, more: bytes
) -> None:
    told = hear(b"\xff", asked, reply, more)
    assert told.frames[0].offset == 1
    assert told.ops == [*[told.ops[0]] * (2 if reply else 1), *["status_read"] * (len(more) // 3)]
    assert [(g.offset, g.length, g.reason) for g in told.gaps] == [(0, 1, "noise")]


def test_a_10_bit_command_that_holds_wins_over_what_begins_at_its_second_byte() -> None:
    told = hear(command(0xFF, 0xC8, b"\x10\x58\x03\x10"), b"\x03\x10")
    assert told.ops == ["position_move_10bit"] * 2
    assert told.frames[0].servo_id == 0x10


def test_a_command_is_waited_for_as_long_as_it_can_be() -> None:
    ten = b"\xff\xff\xc8\x10\x58"
    assert decided(ten + b"\x00\x00") == 0
    assert decided(ten + b"\x00\x00\x7e") == 8
    assert decided(ten, final=True) == 5
    assert decided(command(0x1F, 31, bytes(31))[:-1]) == 0


@pytest.mark.parametrize("asked", [MOVE, READ, PASSIVE, BREAK, IO_READ, command(0x1F, 1, b"\0")])
def test_a_header_is_waited_for_where_a_long_gap_is_given_up(asked: bytes) -> None:
    for cut in range(1, len(asked)):
        told = hear(bytes(1024 - cut) + asked[:cut], asked[cut:] + READ, cuts=True)
        assert told.frames[0].offset == 1024 - cut
        assert decided(asked[:cut]) == 0


def test_a_motion_of_more_than_eight_words_is_rejected_at_once() -> None:
    assert decided(b"\xff\xe3\x96") == 0
    assert decided(b"\xff\xe3\x96\x08") == 0
    assert decided(b"\xff\xe3\x96\x09") == 4
    assert hear(command(0xE3, 0x96, b"\x09" + bytes(18))).ops == []
