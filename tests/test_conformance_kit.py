"""The kit itself: what is wrong about a protocol or a talk, it finds and tells."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pytest

from sniffer.ground.codes import IF_READ, NEVER, OPTIONAL, REQUEST, RESPONSE
from sniffer.ground.model import UNUSUAL, Frames, SnifferError
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import FieldSpan
from sniffer.testing import Exchange, Talk, check, checks
from tests.streams.forms import FORMS, SIZED, said
from tests.streams.members import example
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sniffer.ground.framing import Block
    from sniffer.ground.model import Spans
    from sniffer.protocols.base import BusProtocol, SlowFrame

ZAP = PROTOCOLS["mightyzap"]
ECHO, LOAD, STORE = 0xF1, 0xF2, 0xF3


def echo(who: int, by: int | None = None) -> Exchange:
    answer = packet(who if by is None else by, 0)
    return Exchange("echo", packet(who, ECHO), (answer,), {}, ())


def load(who: int, data: bytes = b"\x10\x02", **labels: int) -> Exchange:
    raw = packet(who, LOAD, bytes([0x8C, len(data)]))
    said = labels or {"present_position": int.from_bytes(data, "little")}
    return Exchange("load_data", raw, (packet(who, 0, data),), said, ())


SMALL = [echo(1), echo(2), load(1), load(2)]


class Changed:
    """A protocol of which some is done otherwise."""

    def __init__(self, protocol: BusProtocol) -> None:
        self.protocol = protocol

    def __getattr__(self, name: str) -> Any:
        return getattr(self.protocol, name)


def failing(protocol: object, talk: Talk | Iterable[Exchange], check_named: str) -> str:
    """Return what one check says of a protocol, empty where it holds."""
    one = next(c for c in checks(cast("BusProtocol", protocol), talk) if c.name == check_named)
    try:
        one()
    except AssertionError as error:
        return str(error)
    return ""


class WithoutRetries(Changed):
    """Reads a request that is said again as the answer to itself: in columns and one by one."""

    def describe(self, block: Block, spans: Spans) -> Frames:
        frames: Frames = self.protocol.describe(block, spans)
        kind, raws = (
            frames.kind.copy(),
            [block.data[a:b].tobytes() for a, b in zip(frames.start, frames.end, strict=True)],
        )
        stretch = block.segment(frames.start)
        for i in range(1, len(frames)):
            same = kind[i - 1] == kind[i] == REQUEST and stretch[i] == stretch[i - 1]
            if same and raws[i] == raws[i - 1]:
                kind[i] = RESPONSE
        again = kind != frames.kind
        return replace(
            frames,
            kind=kind,
            op=np.where(again, -1, frames.op),
            reply=np.where(again, NEVER, frames.reply).astype(np.uint8),
            token=np.where(again, -1, frames.token),
        )

    def slow_describe(self, raw: bytes, kind: int, before: SlowFrame | None) -> SlowFrame:
        frame: SlowFrame = self.protocol.slow_describe(raw, kind, before)
        if before is not None and before.kind == frame.kind == REQUEST and before.raw == raw:
            frame.kind, frame.op, frame.reply, frame.token = RESPONSE, -1, NEVER, -1
        return frame


def test_a_rule_that_columns_and_slow_form_lack_alike_is_found_by_the_labels() -> None:
    broken = WithoutRetries(ZAP)
    assert failing(broken, SMALL, "law: columns say what the slow form says, arranged") == ""
    told = failing(broken, SMALL, "truth: repeated")
    assert "repeated: echo: 2 differ from their labels, 0 declared" in told
    assert "FF FF FF 01 02 F1 0B FF FF FF 01 02 F1 0B FF FF FF 01 02 00 FC" in told
    assert "7+7 request echo" in told
    assert "7+7 response echo" in told


def test_columns_that_differ_from_the_slow_form_are_told_with_the_bytes() -> None:
    class Off(Changed):
        def slow_describe(self, raw: bytes, kind: int, before: SlowFrame | None) -> SlowFrame:
            frame: SlowFrame = self.protocol.slow_describe(raw, kind, before)
            frame.token += 1
            return frame

    told = failing(Off(ZAP), SMALL, "law: columns say what the slow form says, arranged")
    assert told.startswith("columns and slow form: frame 0: ")
    assert "FF FF FF 01 02 F1 0B" in told


def test_a_protocol_that_raises_is_told_with_the_bytes_it_raised_at() -> None:
    class Raises(Changed):
        def describe(self, block: Block, spans: Spans) -> Frames:
            if b"\x8c\x02" in block.data.tobytes():
                raise ValueError("no such address")
            frames: Frames = self.protocol.describe(block, spans)
            return frames

    broken = Raises(ZAP)
    told = failing(broken, SMALL, "truth: answered")
    assert "answered: load_data: 2 differ" in told
    assert "raises ValueError: no such address" in told
    assert failing(broken, SMALL, "truth: repeated") == "", "the others are held all the same"
    for law in ("every byte is claimed once", "a cut at every boundary changes nothing"):
        assert "ValueError: no such address\n  " in failing(broken, SMALL, f"law: {law}")


def test_what_depends_on_where_the_stream_is_cut_is_found() -> None:
    class First(Changed):
        def describe(self, block: Block, spans: Spans) -> Frames:
            frames: Frames = self.protocol.describe(block, spans)
            flags = np.where(frames.start == 0, frames.flags | UNUSUAL, frames.flags)
            return replace(frames, flags=flags.astype(np.uint8))

    told = failing(First(ZAP), SMALL, "law: a cut at every boundary changes nothing")
    assert told.startswith("byte by byte: frame ")
    assert failing(First(ZAP), SMALL, "law: any recut gives equal records").startswith("recut: ")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (replace(load(1), name="echo"), "decoded as 0+9 request load_data"),
        (load(1, present_position=5), "values 1.present_position = 5, decoded as 1.present_pos"),
        (replace(load(1), errors=("overload",)), "errors ['overload'], decoded as []"),
        (replace(load(1), answers=()), "decoded as 0 > -1"),
        (replace(echo(1), answers=(packet(2, 0),)), "0 > 7 mismatched"),
    ],
)
def test_a_wrong_label_is_told_as_what_it_was_decoded_as(wrong: Exchange, words: str) -> None:
    told = failing(ZAP, [*SMALL, wrong], "truth: answered")
    assert f"answered: {wrong.name}: 1 differ" in told
    assert words.replace("0 > -1", "0 > none") in told


def test_what_a_talk_does_not_reach_is_named() -> None:
    told = failing(ZAP, SMALL, "coverage").splitlines()
    assert "not shown: load_data one byte less" in told
    assert "not shown: an unknown command" in told
    assert "not shown: a request to id 254" in told
    assert "not shown: status bit 5 (overload)" in told
    assert "not shown: a status like symmetric_store" not in told, "the talk says no such command"
    assert "not shown: data that hold the header" in told
    assert "not shown: present_position, low byte" in told
    assert "not shown: present_position whole" not in told
    assert "not shown: a write over servo_id" in told


def test_of_a_status_that_is_a_number_each_number_is_asked_for_and_each_bit_beside_it() -> None:
    two = example("dynamixel2").PROTOCOL
    asked, alive = (bytes.fromhex(f"FFFFFD00010{x}") for x in ("30001194E", "7005500060426655D"))
    told = failing(two, [Exchange("ping", asked, (alive,), {}, ())], "coverage").splitlines()
    assert "not shown: status 3 (crc)" in told, "bits 0 and 1 are no result_fail and instruction"
    assert "not shown: status bit 7 (alert)" in told
    assert sum("shown: status " in line for line in told) == 8, "what has no name is not asked for"


def test_what_no_label_states_counts_as_not_shown() -> None:
    told = failing(ZAP, [*SMALL[:2], *(replace(e, values=None) for e in SMALL[2:])], "coverage")
    assert "not shown: present_position whole" in told
    assert "not shown: load_data with its values" in told


def test_an_excuse_counts_and_one_without_need_is_told() -> None:
    talk = Talk(SMALL, absent={"status bit *": "nothing goes wrong", "echo well-formed": "why not"})
    told = failing(ZAP, talk, "coverage")
    assert "status bit" not in told
    assert "said to be absent, and it is not: echo well-formed" in told


def test_a_command_that_must_be_answered_is_held_to_it_where_the_label_says_so() -> None:
    class Lenient(Changed):
        def describe(self, block: Block, spans: Spans) -> Frames:
            frames: Frames = self.protocol.describe(block, spans)
            reply = np.where(frames.reply == IF_READ, np.uint8(OPTIONAL), frames.reply)
            return replace(frames, reply=reply)

    for check_named in ("truth: lost", "truth: repeated, lost"):
        assert failing(Lenient(ZAP), SMALL, check_named) == "", "silence may mean either"
        due = [replace(e, due=True) for e in SMALL]
        assert failing(ZAP, due, check_named) == ""
        assert "not_expected" in failing(Lenient(ZAP), due, check_named)


def test_what_silence_means_is_asked_for_of_each_command_that_is_answered() -> None:
    store = Exchange("store_data", packet(1, STORE, b"\x86\x10\x02"), (packet(1, 0),))
    assert " due" not in failing(ZAP, [*SMALL, store], "coverage"), "it says nothing of silence"
    told = failing(ZAP, [*SMALL[:2], *(replace(e, due=True) for e in SMALL[2:]), store], "coverage")
    assert "not shown: echo due" in told
    assert "not shown: store_data unanswered, without fault" in told
    assert "store_data due" not in told, "a servo may have been told not to answer it"
    shown = Talk([*(replace(e, due=True) for e in SMALL), store], [[replace(store, answers=())]])
    told = failing(ZAP, shown, "coverage")
    assert " due" not in told
    assert "without fault" not in told


def test_an_ambiguity_is_counted_and_its_number_must_be_met() -> None:
    hard = Exchange(
        "load_data",
        packet(1, LOAD, b"\x86\x05"),
        (packet(1, 0x73, b"\x86\x02\x01\x10\x02"),),
    )
    assert "answer late: load_data: 1 differ" in failing(ZAP, [*SMALL, hard], "truth: answer late")
    for key in ("answer late: load_data", "answer late: *"):
        assert failing(ZAP, Talk([*SMALL, hard], ambiguous={key: 1}), "truth: answer late") == ""
    more = Talk([*SMALL, hard], ambiguous={"answer late: load_data": 2})
    assert "1 differ from their labels, 2 declared" in failing(ZAP, more, "truth: answer late")
    odd = Talk(SMALL, ambiguous={"answer late: ping": 1})
    assert "that are none: answer late: ping" in failing(ZAP, odd, "talk")


def test_a_fault_that_the_talk_does_not_show_survives_and_is_named() -> None:
    told = failing(ZAP, [*SMALL, echo(0)], "faults")
    assert told == "survives: echo: no other id may answer"
    assert failing(ZAP, [*SMALL, echo(0, by=2)], "faults") == ""
    excused = Talk([*SMALL, echo(0)], harmless={"echo: no other id may answer": "one servo only"})
    assert failing(ZAP, excused, "faults") == ""


def test_a_fault_said_to_be_harmless_that_is_found_or_is_none_is_told() -> None:
    talk = Talk(SMALL, harmless={"echo: token + 1": "so what", "ping: token + 1": "what is a ping"})
    told = failing(ZAP, talk, "faults")
    assert "said to be harmless, and it is not: echo: token + 1" in told
    assert "said to be harmless, and it is none: ping: token + 1" in told


def test_the_result_has_a_line_for_each_check_and_all_of_what_is_wrong(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("sniffer.testing.kit.EXAMPLES", 3)  # streams: what is held is not the point
    result = check(ZAP, SMALL)
    assert not result.ok
    assert [*result.failed] == ["coverage"]
    lines = str(result).splitlines()
    assert lines[0] == f"mightyzap: {len(result.seen)} hold, 1 do not"
    assert "  holds  truth: answered: 4 cases" in lines
    assert "  FAILS  coverage" in lines
    assert "         not shown: an unknown command" in lines


def test_one_seed_gives_one_stream_and_another_gives_another() -> None:
    name = "law: every byte is claimed once"
    told = [
        next(c for c in checks(ZAP, SMALL, seed=seed) if c.name == name).run() for seed in (1, 1, 2)
    ]
    assert told[0] == told[1]
    assert told[0] != told[2]


@pytest.mark.parametrize(
    ("talk", "words"),
    [
        ([], "a talk has at least one exchange"),
        ([b"\xff"], "a talk is made of exchanges"),
        ([Exchange("echo", b"")], "echo: a request and each answer have at least one byte"),
        (Talk(SMALL, model="ax-12"), "mightyzap has no model 'ax-12'"),
    ],
)
def test_a_talk_that_is_none_is_refused_in_one_line(talk: Any, words: str) -> None:
    with pytest.raises(SnifferError, match=words):
        check(ZAP, talk)


TRAVEL, STARTS, DONE = (
    said("sized", 0xFD, b"\x05"),
    said("sized", 0xFD, b"\x01", back=True),
    said("sized", 0xFD, b"\x02", back=True),
)
TRAVELS = [
    Exchange("travel", TRAVEL, (STARTS,), later=(DONE,)),
    Exchange("enable", said("sized", 0xF3, b"\x01"), (said("sized", 0xF3, b"\x01", back=True),)),
]


def test_an_answer_that_comes_once_more_when_it_is_done_is_held_to_its_label() -> None:
    assert failing(SIZED, TRAVELS, "truth: done later") == ""
    mislabelled = [replace(TRAVELS[0], answers=(STARTS, DONE), later=()), TRAVELS[1]]
    assert "decoded as" in failing(SIZED, mislabelled, "truth: answered")
    never = [replace(TRAVELS[0], later=(STARTS,)), TRAVELS[1]]
    assert "done later: travel: " in failing(SIZED, never, "truth: done later")


def test_a_talk_that_never_shows_what_is_said_once_it_is_done_is_told_so() -> None:
    told = failing(SIZED, TRAVELS, "coverage")
    assert "not shown: travel done later, status 3" in told, "one of the two is not both"
    assert "not shown: travel done later, status 2" not in told
    without = [replace(TRAVELS[0], later=()), TRAVELS[1]]
    assert "not shown: travel done later" in failing(SIZED, without, "coverage")
    assert "truth: done later" not in {one.name for one in checks(SIZED, without)}


def test_a_done_answer_that_fits_any_request_is_seen_by_a_talk_that_shows_it() -> None:
    assert "done later fits any request" not in failing(SIZED, TRAVELS, "faults")


def test_what_is_said_unasked_is_held_to_the_values_that_it_states() -> None:
    says = said("vesc", 0x16, b"\x00\x5a\x00\x5b")
    true = {"target_angle": 90, "actual_angle": 91}
    detect = Exchange("set_detect", said("vesc", 0x0B, b"\x03"), (), {}, (), (says,), true)
    assert failing(FORMS["vesc"], [detect], "truth: done later") == ""
    assert "actual_angle whole" not in failing(FORMS["vesc"], [detect], "coverage")
    wrong = replace(detect, later_values=true | {"actual_angle": 92})
    assert "decoded as 0.actual_angle = 91" in failing(FORMS["vesc"], [wrong], "truth: done later")
    silent = replace(detect, later_values=None)
    assert "not shown: actual_angle whole" in failing(FORMS["vesc"], [silent], "coverage")


def test_what_is_only_ever_said_unasked_is_shown_by_whom_it_was_told_to() -> None:
    vesc = FORMS["vesc"]
    says = said("vesc", 0x16, b"\x00\x5a\x00\x5b")
    detect = Exchange("set_detect", said("vesc", 0x0B, b"\x03"), (), {}, (), later=(says,))
    answer = said("vesc", 4, b"\x00\x01\x00\x05")
    values = Exchange("get_values", said("vesc", 4), (answer,), None, ())
    assert failing(vesc, [detect, values], "truth: done later") == ""
    assert "done later fits any request" not in failing(vesc, [detect, values], "faults")
    missing = failing(vesc, [detect, values], "coverage")
    assert "rotor_position" not in missing
    assert "not shown: set_pos well-formed" in missing


class Overlong(Changed):
    """Takes a frame apart into more bytes than it has."""

    def dissect(self, raw: bytes, row: Any) -> list[FieldSpan]:
        return [FieldSpan(0, len(raw) + 2, "all", "")]


def test_parts_that_lead_beyond_their_frame_are_told_as_that() -> None:
    told = failing(Overlong(ZAP), SMALL, "law: a frame says what it is")
    assert "dissect tells of 11 bytes, not 9: FF FF FF" in told
