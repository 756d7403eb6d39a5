"""What other people's programs and servos said, as they show it: sources, listings, forum posts.

Of each it is known what was meant. Every byte is in a frame or told as what it is, no frame is made
up, and a bus that was sound is reproached with nothing.
"""

from __future__ import annotations

import functools
import operator
from collections import Counter
from typing import Final, NamedTuple

import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.detect import UndecidedError, detect
from sniffer.ground.codes import OUTCOMES
from sniffer.ground.model import Chunk


class Talk(NamedTuple):
    """Bytes, where they are from, and what they are."""

    source: str
    protocol: str
    data: bytes
    ops: tuple[str, ...]
    outcomes: dict[str, int]
    codes: dict[str, int] = {}  # noqa: RUF012  # read only
    gaps: tuple[str, ...] = ()


def short(*body: int) -> bytes:
    """Return a short packet of RS30x with its sum."""
    return b"\xfa\xaf" + bytes([*body, functools.reduce(operator.xor, body)])


def said(text: str) -> bytes:
    return bytes.fromhex(text)


def lines(text: str, end: bytes = b"\r") -> bytes:
    return b"".join(line.encode() + end for line in text.split())


def set_of(first: int, mode: int, *data: int) -> bytes:
    """Return a command of wCK to set something, with its sum."""
    sum_ = functools.reduce(operator.xor, (first, mode, *data)) & 0x7F
    return bytes([0xFF, first, mode, *data, sum_])


def wck(first: int, second: int) -> bytes:
    return bytes([0xFF, first, second, (first ^ second) & 0x7F])


TALKS: Final = {
    "eight_bytes_that_a_servo_answered": Talk(
        "librsx, a measuring program: the listing has what an RS405CB answered",
        "rs30x",
        said("FAAF010F2A08002C FDDF01002A080128FF00003E000C00C7") * 3,
        ("read",) * 6,
        {"ok": 3},
    ),
    "telemetry_of_a_biped_behind_its_own_echo": Talk(
        "bam, tests of a Vstone bus behind a CP2110 that hears itself",
        "rs30x",
        said("FAAF010F2A120036 FDDF01002A12018403000000000600000000000000000000 00B9") * 3,
        ("read",) * 6,
        {"ok": 3},
    ),
    "an_ack_that_is_asked_for_at_the_last_address": Talk(
        "a script for RS405CB: FA AF 01 01 FF 00 00",
        "rs30x",
        (short(1, 1, 0xFF, 0, 0) + b"\x07") * 3,
        ("read",) * 6,
        {"ok": 3},
    ),
    "torque_and_angle_each_acknowledged": Talk(
        "a class for RS30x on a Raspberry Pi, with its examples in comments",
        "rs30x",
        short(1, 1, 0x24, 1, 1, 1)
        + b"\x07"
        + short(1, 1, 0x1E, 2, 1, 0xCE, 4)
        + b"\x07"
        + said("FAAF01001E020184039B FAAF01001E04018403F40168"),
        ("write",) * 6,
        {"ok": 2, "not_expected": 2},
    ),
    "three_servos_in_one_packet": Talk(
        "bam, test of its long packet",
        "rs30x",
        said("FAAF00001E030301640002640005F401ED") * 2,
        ("long_write",) * 2,
        {"not_expected": 2},
    ),
    "queries_of_a_driver_in_rust": Talk(
        "lss_driver, its tests of queries and answers",
        "lss",
        lines("#1D200 #5QD *5QD132 #5QDT *5QDT6783 #5QV *5QV11200 #2QV *2QV2 #1QV *1QV1"),
        ("D", *["QD"] * 2, *["QDT"] * 2, *["QV"] * 6),
        {"ok": 5, "not_expected": 1},
    ),
    "a_sketch_with_words_that_no_servo_knows": Talk(
        "BECOv2, a first test of a motor",
        "lss",
        lines("#1D900 #1MD0450 #1T09000500 #1MT04500500 #1RESET #1CLEAR #1LED3 #1Q *1Q1"),
        ("D", "MD", "T", "MT", "RESET", "CLEAR", "LED", "Q", "Q"),
        {"ok": 1, "not_expected": 7},
        {"unknown-command": 3},
    ),
    "a_terminal_that_ends_lines_with_two_bytes": Talk(
        "posts in the maker's forum: what terminals send behind a line",
        "lss",
        lines("#5QD *5QD132 #5QV *5QV11200", b"\r\n"),
        ("QD", "QD", "QV", "QV"),
        {"ok": 2},
        gaps=("noise",) * 4,
    ),
    "all_servos_asked_at_once_speak_over_each_other": Talk(
        "a post in the maker's forum: #254Q answered by garbage, #1Q by *1Q1",
        "lss",
        b"#254Q\r*1Q6\r*2*3Q6\rQ6\r*4Q6\r#1Q\r*1Q1\r",
        ("Q",) * 6,
        {"ok": 4},
        {"truncated-frame": 1, "noise": 1},
        ("truncated", "noise"),
    ),
    "an_angle_in_hundredths_of_a_pro": Talk(
        "LSS-PRO Communication Protocol, wiki, and its model string",
        "lss",
        lines("#5QMS *5QMSLSS-P-L1 #5D130000 #5QD *5QD132000"),
        ("QMS", "QMS", "D", "QD", "QD"),
        {"ok": 2, "not_expected": 1},
        {"model-evidence": 1},
    ),
    "a_version_asked_of_servo_30_of_a_controller": Talk(
        "robobuilderlib: DCMP answers a read of servo 30 by its version, 3.15",
        "wck",
        wck(0xBE, 0) + b"\x03\x0f" + wck(0xA1, 0) + b"\x00\x65",
        ("status_read",) * 4,
        {"ok": 2},
    ),
    "a_library_that_sets_gains_where_it_means_to_read": Talk(
        "robobuilderlib, wckPosRead10Bit: mode 09 for C9, which sets the gains of servo 0",
        "wck",
        b"".join(set_of(0xE0, 0x09, who, who) + bytes([who, who]) for who in (3, 4)),
        ("pd_gain_set",) * 4,
        {"ok": 2},
    ),
}


@pytest.mark.parametrize("name", TALKS)
def test_what_other_people_said_is_read_as_it_was_meant(name: str) -> None:
    talk = TALKS[name]
    decoder = Decoder(talk.protocol)
    parts = [decoder.feed(Chunk(talk.data)), decoder.close()]
    ops = [decoder.protocol.op_name(int(op)) for b in parts for op in b.frames.op]
    assert tuple(ops) == talk.ops, talk.source
    assert Counter(OUTCOMES[k] for b in parts for k in b.transactions.outcome) == talk.outcomes
    gaps = [gap for b in parts for gap in b.gaps]
    assert tuple(gap.reason for gap in gaps) == talk.gaps
    framed = sum(int(b.frames.length.sum()) for b in parts)
    assert framed + sum(gap.length for gap in gaps) == len(talk.data)
    codes = Counter(a.code for b in parts for a in b.anomalies if a.code != "capture-end")
    assert codes == talk.codes


def test_another_makers_servos_with_the_same_header_are_not_taken_for_rs30x() -> None:
    # UBTech's begin with FA AF, too: reads of sixteen servos and their answers, as users list them
    talk = b""
    for who in range(1, 17):
        for body in ((who, 2, 0, 0, 0, 0), (who, 0xAA, 0, 90, 0, 91)):
            talk += b"\xfa\xaf" + bytes([*body, sum(body) & 0xFF]) + b"\xed"
    with pytest.raises(UndecidedError, match="cannot tell the protocol"):
        detect([Chunk(talk * 5)])
