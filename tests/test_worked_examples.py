"""Worked examples in comments are what the code does with the bytes they are about."""

from __future__ import annotations

import re
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest

from sniffer import Chunk, Decoder
from sniffer.decoding import echo, matching, torn
from sniffer.decoding.pairing import Pairing
from sniffer.decoding.values import Scaling
from sniffer.ground.framing import Block, greedy, in_order, settle
from sniffer.ground.model import Clock
from sniffer.ground.timing import Stamps
from sniffer.protocols.lss import block as lss
from sniffer.protocols.lss import parsing
from sniffer.protocols.mightyzap import PROTOCOL as MIGHTYZAP
from sniffer.protocols.packets import survey
from sniffer.protocols.packets.columns import FamilyColumns
from sniffer.protocols.packets.direction import in_turn
from sniffer.protocols.packets.listed import listed
from sniffer.protocols.rs30x import block as rs30x_block
from sniffer.protocols.wck import block as wck
from sniffer.protocols.wck import controller
from tests.examples import agree, check, held, shown, tables
from tests.streams import mightyzap, rs30x
from tests.streams.members import example, packet, status
from tests.streams.wck import command, rbc

if TYPE_CHECKING:
    from collections.abc import Callable

    from sniffer.ground.model import Frames

READ: Final = command(0xA0, 0)
SERVO_READS: Final = [mightyzap.packet(i, 0xF2, bytes([0x8C, 2])) for i in (1, 2, 3)]
ANSWERS: Final = [mightyzap.packet(i, 0, bytes([16, i])) for i in (1, 2, 3)]


def number_row(function: Callable[..., Any], label: str, nth: int = 0) -> Any:
    """Return the whole numbers that a row of a function's example begins with."""
    cells = tables(function)[label][nth]
    stop = next((i for i, c in enumerate(cells) if not re.fullmatch(r"-?\d+", c)), len(cells))
    return np.array(cells[:stop], np.int64)


def decoded(protocol: str, data: bytes) -> Callable[[], object]:
    """Return what decodes bytes, the stream being still open behind them."""
    return lambda: Decoder(protocol).feed(Chunk(data))


def described(data: bytes) -> tuple[Block, Frames]:
    """Return bytes of mightyZAP that are all there is, and their frames."""
    block = Block(np.frombuffer(data, np.uint8), np.empty(0, np.int64), final=True)
    return block, MIGHTYZAP.describe(block, MIGHTYZAP.frame(block)[0])


def lines(text: str) -> Callable[[], object]:
    """Return what decodes lines of LSS, each behind a space."""
    return decoded("lss", "".join(f"{line}\r" for line in text.split()).encode())


def told(function: Callable[..., Any], label: str = "line") -> str:
    """Return the LSS lines that a function's example shows."""
    return " ".join(c for c in tables(function)[label][0] if c[0] in "#*")


def doubled_with_a_wrong_example(column: Any) -> Any:
    """Return twice a column.

    For example::

        twice    2  4  7
    """
    twice = column * 2
    return twice  # noqa: RET504  # the variable is what the example is about


def test_an_example_that_is_wrong_is_told() -> None:
    def run() -> object:
        return doubled_with_a_wrong_example(np.array([1, 2, 3]))

    with pytest.raises(AssertionError, match=r"says twice \['2', '4', '7'\], it was"):
        check(doubled_with_a_wrong_example, run, "twice")
    with pytest.raises(AssertionError, match="has no row thrice"):
        check(doubled_with_a_wrong_example, run, "thrice")


def test_rows_that_the_greedy_walk_keeps() -> None:
    start, end = number_row(greedy, "start"), number_row(greedy, "end")
    kept = greedy(start, end)
    assert kept is not None
    shows = tables(greedy)["kept"][0]
    assert shown(kept) == ["0", "2", "3"]
    assert [c for c in shows if c == "x"] == ["x"] * len(kept)


def test_a_candidate_in_a_row_that_is_kept_waits_for_nothing() -> None:
    cells = tables(settle)["start"][0]
    start, waiting = np.array(cells[:3], np.int64), np.array(cells[4:], np.int64)
    rows, until = settle(start, number_row(settle, "end"), waiting, 40)
    assert (shown(rows), until) == (["0", "1", "2"], 30)


def test_answers_in_a_row_are_of_the_last_requests_before_them() -> None:
    is_answer = np.array([c == "A" for c in tables(in_order)["kind"][0]])
    check(in_order, lambda: in_order(is_answer), "before", "behind", "asked")


def test_rows_that_are_in_turn_a_request_and_its_answer() -> None:
    base, flips = (number_row(in_turn, label).astype(bool) for label in ("base", "flips"))
    check(in_turn, lambda: in_turn(base, flips), "last", "out")


def test_a_packet_is_looked_up_by_its_code_and_its_count() -> None:
    load, store = mightyzap.packet(1, 0xF2, b"\x8c\x02"), mightyzap.packet(2, 0xF3, b"\x86\xff\x0f")
    feedback, error = mightyzap.packet(1, 0, b"\xff\x07"), mightyzap.packet(2, 0x20)
    data = load + feedback + store + error + mightyzap.packet(1, 0xF2, b"\x8c\x02\x03")
    names = ("code", "count", "what", "request", "address", "data_length", "token")
    check(FamilyColumns.describe, decoded("mightyzap", data), *names)


def test_each_request_and_each_answer_is_told_in_one_row() -> None:
    short, other = mightyzap.packet(2, 0, b"\xff"), mightyzap.packet(3, 0, b"\xff\x07")
    data = SERVO_READS[0] + ANSWERS[0] + SERVO_READS[0] + SERVO_READS[1] + short + other
    block, frames, pairing = *described(data), Pairing(MIGHTYZAP)
    partner = pairing.match(frames, block, len(data), 0)[1]
    run = partial(pairing.pair, frames, frames, partner, block, len(data), 0)
    names = ("partner", "asked", "answer", "how", "request", "response", "keep")
    check(Pairing.pair, run, *names)


def test_an_acknowledgement_has_the_fields_of_its_request() -> None:
    acknowledged = rs30x.write(1, 0x24, b"\x01", flags=1) + b"\x07"
    read = rs30x.packet(1, 15, 0x2A, 2) + rs30x.returned(1, 0x2A, b"\x10\x01")
    data = acknowledged + read + rs30x.write(2, 0x1E, b"\x2c\x01")
    names = ("ack", "head", "op", "address", "token", "reply")
    check(rs30x_block.describe, decoded("rs30x", data), *names)


def test_slack_is_what_is_spared_above_the_highest_floor() -> None:
    stamps, lull = Stamps(10**8, 10**6), number_row(Stamps._reckoned, "lull")
    run = partial(stamps._reckoned, lull, np.full(5, 16))
    check(Stamps._reckoned, run, "lull", "spare", "floor", "slack")


def test_frames_are_laid_out_from_the_stamps_of_their_reads() -> None:
    stamps, data = Stamps(10**8, 10**6), SERVO_READS[0] + ANSWERS[0]
    stamps.add([Chunk(data[:4], 1000, Clock.READ), Chunk(data[4:], 5000, Clock.READ)])
    names = ("end", "behind", "t_end", "laid", "t_first", "whole", "t_start")
    check(Stamps.time, partial(stamps.time, described(data)[1], 0), *names)


def test_marks_and_carriage_returns_tell_all_lines() -> None:
    text = "#5QD.*5QD132.#5D-300.#5D18#6QV.xx*6QV7"
    run = decoded("lss", text.replace(".", "\r").encode())
    check(lss.frame, run, "edges", "line", "start", "end")


def test_lines_are_read_as_if_they_were_of_the_common_shape() -> None:
    names = ("start", "last", "letters", "value", "done", "rare", "good")
    check(parsing.parse, lines(told(parsing.parse)), *names)


def test_the_word_of_a_line_says_all() -> None:
    check(lss.describe, lines(told(lss.describe)), "entry", "selector")


def test_numbers_of_lines() -> None:
    run = lines("#5QD *5QD132 #5QSD1 *5QSD-300 #5P1500S750T20")
    check(lss.values, run, "at", "column", "raw", "behind")


def test_a_reply_of_two_bytes_is_part_of_its_command() -> None:
    wrong = READ[:-1] + bytes([READ[-1] ^ 1])
    moves = command(0x1F, 2, bytes([16, 32]))
    data = READ + b"\x07\x63" + moves + READ + READ + b"\x07\x63" + wrong + READ + b"\x01"
    check(wck.frame, decoded("wck", data), "start", "end", "good")


def test_replies_in_a_row_are_counted_to_the_last_command() -> None:
    run = decoded("wck", READ * 3 + bytes([1, 2, 3, 4]) + READ + bytes([5, 6]))
    check(wck._in_turn, run, "start", "end", "linked", "replies")
    assert agree(tables(wck._in_turn)["then"][0], ["0", "0", "2", "1"])


def test_an_ff_in_a_reply_and_one_that_begins_a_command() -> None:
    wheel, write, ends = command(0xC0, 0x30), command(0xE0, 100, b"\x7f\x7f"), command(0xA1, 0)
    data = wheel + b"\xff\x05" + write + b"\xff\xff" + wheel + ends + b"\x08\x09"
    check(wck._replies, decoded("wck", data + READ + b"\xff\x05"), "start", "plain")


def test_packets_of_the_controller_take_turns() -> None:
    begin, version = rbc(10, b"\0"), rbc(12, b"\0")
    data = begin * 2 + READ + b"\x07\x63" + version * 3
    check(controller.answers, decoded("wck", data), "follows", "first")


def test_a_reply_of_two_bytes_is_described_by_its_command() -> None:
    data = READ + b"\x07\x63" + command(0x1F, 2, bytes([16, 32]))
    names = ("start", "command", "kind", "servo_id", "reply", "token")
    check(wck.describe, decoded("wck", data + READ), *names)


def test_answers_left_over_are_matched_in_runs_of_one_key() -> None:
    asked = SERVO_READS[0] + SERVO_READS[1] + SERVO_READS[0]
    data = asked + ANSWERS[1] + ANSWERS[0] * 2
    names = ("servo", "back", "order", "first", "middle", "rank", "mirror", "step", "hit")
    check(matching._Rows.by_key, decoded("mightyzap", data), *names)


def test_a_torn_packet_and_a_wrong_one_are_judged_each_by_its_header() -> None:
    wrong = ANSWERS[0][:-1] + bytes([ANSWERS[0][-1] ^ 1])
    decoder = Decoder("mightyzap")
    decoder.feed(Chunk(SERVO_READS[0] + wrong + SERVO_READS[1][:5] + SERVO_READS[2] + ANSWERS[2]))
    names = ("at", "stop", "onward", "cut", "until", "expected", "got")
    check(survey.survey, decoder.close, *names)


def test_a_value_that_no_mode_explains_ends_the_mode_of_its_servo() -> None:
    def exchange(servo_id: int, address: int, answer: bytes) -> bytes:
        ask = mightyzap.packet(servo_id, 0xF2, bytes([address, len(answer)]))
        return ask + mightyzap.packet(servo_id, 0, answer)

    def position(servo_id: int, raw: int) -> bytes:
        return exchange(servo_id, 0x8C, raw.to_bytes(2, "little"))

    mode = exchange(1, 0x16, b"\x02")
    data = position(1, 2040) + mode + position(1, 2040) + position(2, 1000)
    data += position(1, 3000) + position(1, 1000)
    names = ("mine", "servo", "raw", "k", "column", "over", "seen")
    check(Scaling._apply_modes, decoded("mightyzap", data), *names)


def test_answers_of_those_whom_a_read_lists_meet_their_own_servo() -> None:
    ask = packet("dynamixel2", 254, 0x82, b"\x84\x00\x04\x00\x01\x02\x03")
    said = [(2, bytes(4)), (1, bytes(4)), (5, bytes(4)), (3, bytes(2))]
    data = ask + b"".join(status("dynamixel2", who, 0, brought) for who, brought in said)
    names = ("servo_id", "asked", "length", "first", "last", "at", "right", "left", "address")
    check(listed, lambda: Decoder(example("dynamixel2").PROTOCOL).feed(Chunk(data)), *names)


def test_torn_bytes_where_an_answer_should_stand() -> None:
    wrong = ANSWERS[1][:-1] + bytes([ANSWERS[1][-1] ^ 1])
    data = b"".join(SERVO_READS) + ANSWERS[0] + wrong + ANSWERS[2]
    decoder = Decoder("mightyzap")
    decoder.feed(Chunk(data))
    check(torn.TornAnswers.find, decoder.close, "torn", "turn", "answered", "latest")


def test_an_echo_is_proved_within_a_stretch() -> None:
    exchange = SERVO_READS[0] * 2 + ANSWERS[0]
    rest = exchange + SERVO_READS[0] + ANSWERS[0] + exchange
    chunks = Chunk(exchange * 7, 0), Chunk(rest, 10**10)
    were = held(echo.Echoes.find, lambda: Decoder("mightyzap").feed(*chunks))
    rows = tables(echo.Echoes.find)
    from_row = int(rows["row"][0][0])
    for name in ("second", "single", "run", "total", "stretch"):
        for cells in rows[name]:
            assert any(agree(cells, c[from_row:]) for c in were[name]), (name, cells, were[name])
