"""Forms of packets that a declaration may have: what none of the examples shows.

Each form is a small family whose columns are held to the oracle on damaged talk of its own.
"""

from __future__ import annotations

import itertools
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.drawing import draw_frame, draw_gap
from sniffer.ground.codes import OUTCOMES
from sniffer.ground.model import Chunk
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import view
from sniffer.protocols.explaining import pieces
from sniffer.statistics.collector import Collector
from sniffer.statistics.commands import CommandBook
from tests.records import held_to_the_oracle
from tests.streams import chunked, damaged
from tests.streams.forms import FORMS, SIZED, said
from tests.streams.formtalk import TALK


@pytest.mark.parametrize("name", FORMS)
@given(data=st.data())
def test_columns_say_what_the_oracle_says_of_every_form(name: str, data: st.DataObject) -> None:
    protocol = FORMS[name]
    talk = data.draw(st.lists(st.sampled_from(TALK[name]), max_size=8).map(b"".join))
    talk = data.draw(st.one_of(st.just(talk), damaged(talk)))
    chunks = data.draw(chunked(talk, byte_time_ns(115200), protocol.tail_ns))
    for b in held_to_the_oracle(protocol, chunks):
        for i in range(len(b.frames)):
            raw, row = b.data[int(b.frames.start[i]) : int(b.frames.end[i])], view(b.frames, i)
            json.dumps(protocol.fields(raw, row))
            ends = [*itertools.accumulate(s.length for s in protocol.dissect(raw, row))]
            assert ends[-1] == len(raw)
            for checksum, covered, sent in [protocol.checksum_of(raw)]:
                assert checksum(covered) == sent


def heard(name: str, data: bytes) -> Any:
    decoder = Decoder(FORMS[name])
    return decoder.feed(Chunk(data)), decoder.close()


def told(name: str, data: bytes) -> tuple[list[str], list[tuple[int, str, int]]]:
    """Return the outcomes of exchanges, and (servo, register, raw) of what became true."""
    out, values = [], []
    for b in heard(name, data):
        out += [OUTCOMES[k] for k in b.transactions.outcome]
        rows = zip(b.values.servo_id, b.values.register, b.values.raw, strict=True)
        values += [(int(s), FORMS[name].registers[r].name, int(x)) for s, r, x in rows]
    return out, values


def wrong(name: str, data: bytes) -> list[str]:
    """Return the codes of what is told to be wrong with talk."""
    return [a.code for b in heard(name, data) for a in b.anomalies]


def test_a_packet_without_a_length_is_as_long_as_all_others() -> None:
    # move 5 to 120 degrees in 2 s, then read 3: users' notes of the serial protocol
    move, ask = bytes.fromhex("FAAF0501786400 00E2ED"), bytes.fromhex("FAAF03020000000005ED")
    answer = said("ubtech", 0xAA, b"\x00\x5a\x00\x5a", 3)
    assert told("ubtech", move + ask + answer) == (
        ["not_expected", "ok"],
        [(5, "goal", 120), (5, "time", 100), (3, "target_angle", 90), (3, "actual_angle", 90)],
    )
    (gap,) = FORMS["ubtech"].explain(ask[:-1] + b"\xee", 0)
    assert (gap.reason, gap.length) == ("damaged", 10)


def test_a_crc_with_its_high_byte_first_holds_and_a_damaged_one_is_told_as_it_stands() -> None:
    # CubeMars AK Series Module Driver Manual 1.0.18, serial examples: position 180 and 90 degrees
    far, near = bytes.fromhex("0205090ABA95001EF703"), bytes.fromhex("020509055D4A807B2903")
    (batch, _) = heard("vesc", far + near)
    assert batch.frames.length.tolist() == [10, 10]
    (gap,) = FORMS["vesc"].explain(far[:-2] + b"\xf6\x03", 0)
    assert (gap.detail["checksum_expected"], gap.detail["checksum_got"]) == (0x1EF7, 0x1EF6)


def test_the_field_that_a_checksum_is_in_is_known_wherever_it_stands() -> None:
    for name, field in (
        ("vesc", "crc"),
        ("ubtech", "checksum"),
        ("behind", "sum"),
        ("some", "front"),
    ):
        talk = b"".join(TALK[name][:1])
        batch = next(b for b in heard(name, talk) if len(b.frames))
        drawn = [draw_frame(batch, FORMS[name], i) for i in range(len(batch.frames))]
        assert drawn[-1].sealed == field
    lss, bare = PROTOCOLS["lss"], Decoder("lss")
    batch = bare.feed(Chunk(b"#1D200\r"))
    assert draw_frame(batch, lss, 0).sealed == ""


def test_what_a_motor_sends_over_and_over_is_read_and_reproached_to_nobody() -> None:
    for name, code, back in (("vesc", 0x16, False), ("heads", 8, True)):
        says = said(name, code, b"\x00\x5a\x00\x5b", back=back)
        asks = said(name, {"vesc": 4, "heads": 6}[name], b"" if name == "vesc" else b"\x07")
        answers = said(name, {"vesc": 4, "heads": 6}[name], b"\x00\x01\x00\x02", back=back)
        outcomes, values = told(name, says + asks + says + answers + says)
        assert outcomes.count("ok") == 1
        assert [raw for _, register, raw in values if register == "actual_angle"] == [91, 91, 2, 91]
        assert wrong(name, says + asks + says + answers + says) == []
        frames = heard(name, says)[0].frames
        assert FORMS[name].op_name(int(frames.op[0])) in ("rotor_position", "stream")


def test_a_damaged_packet_is_drawn_field_by_field_wherever_its_check_stands() -> None:
    for name, talk in (("vesc", "0205090ABA95001EF603"), ("ubtech", "FAAF0501786400 00E1ED")):
        batch = next(b for b in heard(name, bytes.fromhex(talk)) if len(b.gaps))
        drawn = draw_gap(batch, FORMS[name], batch.gaps[0])
        assert drawn.wrong == {"vesc": "crc", "ubtech": "checksum"}[name]
        assert sum(span.length for span in drawn.spans) == 10


def test_an_answer_may_have_its_error_behind_the_data_and_a_space_of_its_own() -> None:
    outcomes, values = told("behind", TALK["behind"][0] + TALK["behind"][3])
    assert outcomes == ["ok", "ok"]
    assert values[0] == (7, "far", 0x2A)
    frames = heard("behind", TALK["behind"][3])[0].frames
    assert frames.status.tolist() == [-1, 2]


def test_a_code_with_a_bit_less_answers_and_each_target_is_read_as_it_stands() -> None:
    outcomes, values = told("apart", b"".join(TALK["apart"][:1]) + TALK["apart"][3])
    assert outcomes == ["ok", "not_expected"]
    assert values == [
        (1, "goal", 0x2A), (1, "goal", 7), (1, "time", 1), (2, "goal", 8), (2, "time", 2),
    ]  # fmt: skip


def test_a_header_of_their_own_tells_answers_and_torn_ones_are_told_by_it() -> None:
    ask, answer = said("heads", 2, b"\x10\x02"), said("heads", 2, b"\x07\x09", back=True)
    outcomes, values = told("heads", ask + answer)
    assert (outcomes, values) == (["ok"], [(1, "goal", 7), (1, "time", 9)])
    (gap,) = FORMS["heads"].explain(answer[:-1] + b"\x00", 0)
    assert (gap.reason, gap.length, gap.detail["fields"]["op"]) == ("damaged", len(answer), "read")


def test_a_read_may_leave_it_to_the_table_how_many_bytes_answer() -> None:
    # the addresses of these packets count registers: 1 is the table's 0x10, 2 its 0x20
    one = said("heads", 4, b"\x01") + said("heads", 4, b"\x01\x2a", back=True)
    two = said("heads", 4, b"\x02") + said("heads", 4, b"\x02\x00\x5a", back=True)
    assert told("heads", one + two) == (["ok", "ok"], [(1, "goal", 42), (1, "target_angle", 90)])
    other = said("heads", 4, b"\x02") + said("heads", 4, b"\x01\x2a", back=True)
    assert told("heads", other)[0] == ["mismatched"]


def test_a_move_may_be_answered_by_what_stands_elsewhere_in_the_table() -> None:
    for name, back in (("heads", True), ("some", False)):
        code = {"heads": 6, "some": 0xA1}[name]
        answer = said(name, code, b"\x00\x5a\x00\x5b", back=back)
        assert told(name, said(name, code, b"\x07") + answer) == (
            ["ok"],
            [(1, "goal", 7), (1, "target_angle", 90), (1, "actual_angle", 91)],
        )


def test_a_check_of_the_data_is_not_there_where_there_are_none() -> None:
    ask, answer = said("some", 0x9C), said("some", 0x9C, b"\x00\x5a\x00\x5b")
    assert (ask, len(answer)) == (bytes.fromhex("3E9C0100DB"), 10)
    assert told("some", ask + answer)[0] == ["ok"]
    (gap,) = FORMS["some"].explain(ask[:-1] + b"\xdc", 0)
    assert (gap.length, gap.detail["checksum_expected"], gap.detail["checksum_got"]) == (
        5,
        219,
        220,
    )
    (gap,) = FORMS["some"].explain(answer[:-1] + b"\xdc", 0)
    assert (gap.length, gap.detail["checksum_expected"]) == (10, 0xB5)
    assert len(heard("some", answer[:-1])[0].frames) == 0


def test_a_packet_that_comes_once_more_is_the_answer_to_itself() -> None:
    off, other = said("some", 0x80), said("some", 0x80, who=2)
    assert told("some", off + off)[0] == ["ok"]
    assert told("some", off + off + off + off)[0] == ["ok", "ok"]
    assert told("some", off + other + other)[0] == ["no_response", "ok"]
    assert told("some", said("some", 0xA2, b"\x09") * 2)[0] == ["not_expected"] * 2


def test_where_only_the_code_tells_the_length_requests_and_answers_have_their_own() -> None:
    ask, answer = said("sized", 0x30), said("sized", 0x30, b"\x00\x5a\x00\x5b", back=True)
    assert (ask.hex(), answer.hex()) == ("fa01302b", "fb0130005a005be1")
    assert told("sized", ask + answer) == (
        ["ok"],
        [(1, "target_angle", 90), (1, "actual_angle", 91)],
    )
    explain = FORMS["sized"].explain
    (gap,) = explain(answer[:-1] + b"\x00", 0)
    assert (gap.reason, gap.length, gap.detail["checksum_expected"]) == ("damaged", 8, 0xE1)
    (gap,) = explain(answer[:-2], 0)
    assert (gap.reason, gap.detail["need"]) == ("truncated", 8)
    unknown, rest = explain(b"\xfa\x01\x77\x00\x72", 0)
    assert (unknown.length, unknown.detail, rest.reason) == (3, {"code": 0x77}, "noise")


def test_an_answer_that_comes_once_the_move_is_done_is_no_fault_and_answers_nobody() -> None:
    move, starts = said("sized", 0xFD, b"\x05"), said("sized", 0xFD, b"\x01", back=True)
    done = said("sized", 0xFD, b"\x02", back=True)
    read, angle = said("sized", 0x30), said("sized", 0x30, b"\x00\x5a\x00\x5b", back=True)
    # behind its own first answer, between others' question and answer, and before that of the next
    for talk, outcomes in (
        (move + starts + done, ["ok", "unsolicited"]),
        (move + starts + read + done + angle, ["ok", "ok", "unsolicited"]),
        (move + starts + move + done + starts, ["ok", "ok", "unsolicited"]),
        (done + read + angle, ["unsolicited", "ok"]),
    ):
        assert sorted(told("sized", talk)[0]) == sorted(outcomes)
        assert wrong("sized", talk) == []
    assert wrong("sized", move + done + (read + angle) * 40) == ["no-response"]
    assert wrong("sized", move + starts + starts) == ["duplicate-response"]
    other = said("sized", 0x30, who=2) + said("sized", 0x30, b"\x00\x5a\x00\x5b", 2, back=True)
    assert wrong("sized", other + starts) == ["unsolicited-response"]


def test_what_is_only_ever_said_unasked_has_a_size_where_packets_have_no_length() -> None:
    said_so = said("sized", 0xF8, b"\x00\x5a\x00\x5b", back=True)
    assert told("sized", said_so * 2)[1] == [(1, "target_angle", 90), (1, "actual_angle", 91)] * 2
    assert wrong("sized", said_so * 2) == []


def test_what_was_measured_when_the_move_was_done_is_read() -> None:
    done = said("sized", 0xFE, b"\x02\x00\x5a\x00\x5b", back=True)
    assert told("sized", done) == (
        ["unsolicited"],
        [(1, "target_angle", 90), (1, "actual_angle", 91)],
    )
    # an error and four bytes of data: as many as answer= says, and the error beside them
    starts = said("sized", 0xFE, b"\x00\x00\x5a\x00\x5b", back=True)
    assert told("sized", starts) == (["unsolicited"], [])


@pytest.mark.parametrize("name", FORMS)
@given(data=st.data())
def test_damage_of_every_form_is_told_alike_in_columns_and_in_words(
    name: str, data: st.DataObject
) -> None:
    protocol = FORMS[name]
    torn = st.builds(lambda raw, n: raw[:n], st.sampled_from(TALK[name]), st.integers(1, 20))
    run = data.draw(st.lists(torn, min_size=1, max_size=5).map(b"".join).flatmap(damaged))
    if not run:
        return
    whole = np.frombuffer(run, np.uint8)
    got = pieces(protocol, whole, np.array([0]), np.array([len(run)]))
    told = [(g.start, g.length, g.detail.get("fields", {})) for g in protocol.explain(run, 0)]
    assert [*zip(got.start, got.end - got.start, strict=True)] == [(s, n) for s, n, _ in told]
    assert [max(int(s), -1) for s in got.servo_id] == [f.get("servo_id", -1) for _, _, f in told]


def test_a_header_of_one_byte_that_ends_a_run_is_told_though_the_next_run_begins_with_one() -> None:
    first, second = b"\x05\x3e", said("some", 0x9C)[:-1] + b"\x3e"
    protocol, data = FORMS["some"], np.frombuffer(first + second, np.uint8)
    got = pieces(protocol, data, np.array([0, 2]), np.array([2, 7]))
    told = protocol.explain(first, 0) + protocol.explain(second, 2)
    assert [*zip(got.start, got.end - got.start, strict=True)] == [
        (g.start, g.length) for g in told
    ]


def test_an_answer_that_comes_once_the_move_is_done_is_not_counted_as_unasked() -> None:
    book, collector = CommandBook(SIZED), Collector()
    move, starts = said("sized", 0xFD, b"\x05"), said("sized", 0xFD, b"\x01", back=True)
    done = said("sized", 0xFD, b"\x02", back=True)
    for batch in heard("sized", (move + starts + done) * 5 + starts):
        book.add(batch, batch)
        collector.write("bus", SIZED, batch)
    rows = book.figures()
    assert sum(row.responses for row in rows) == 11
    assert sum(row.unasked for row in rows) == 1
    ((_, _, servo),) = collector.servos()
    assert (servo.responses, servo.outcomes["unsolicited"]) == (11, 1)
