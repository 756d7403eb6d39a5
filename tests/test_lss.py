"""LSS: each rule of the protocol, and each contradiction of its manual page, as a sentence."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.framing import Block
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import view
from sniffer.protocols.lss.grammar import (
    IDS,
    LONGEST,
    MODIFIERS,
    REGISTERS,
    WORDS,
    command,
    packed,
    reply,
    unpacked,
)
from sniffer.protocols.lss.lines import Line, read
from tests import heard
from tests.lists import thinned, walks_a_list
from tests.records import batches, records

LSS = PROTOCOLS["lss"]
hear = functools.partial(heard.hear, "lss")


def same_as_the_reference(stream: bytes) -> None:
    chunks = [Chunk(stream)]
    got = records(batches(Decoder("lss"), [chunks]))
    want = Reference(LSS).decode(chunks)
    assert got.frames == want.frames
    assert got.transactions == want.transactions
    assert got.samples == want.samples


def codes(*parts: bytes) -> list[str]:
    return [
        a.code for b in batches(Decoder("lss"), [[Chunk(p) for p in parts]]) for a in b.anomalies
    ]


def decided(held: bytes, *, final: bool = False) -> int:
    block = Block(np.frombuffer(held, np.uint8), np.empty(0, np.int64), final)
    return LSS.frame(block)[1]


# ---- framing


def test_a_line_ends_at_its_carriage_return_and_the_next_needs_no_pause() -> None:
    assert hear(b"#5QD\r*5QD132\r#5D-300\r").ops == ["QD", "QD", "D"]


@pytest.mark.parametrize("mark", [b"#", b"*"])
def test_a_mark_inside_a_line_begins_anew_and_what_stood_before_it_is_truncated(
    mark: bytes,
) -> None:
    found = hear(b"#5D12" + mark + b"5QD1\r")
    assert [(g.offset, g.length, g.reason) for g in found.gaps] == [(0, 5, "truncated")]
    assert found.gaps[0].detail["fields"] == {"servo_id": 5, "word": "D"}
    assert [f.offset for f in found.frames] == [5]


def test_the_star_of_the_pages_crc_table_is_no_value_but_begins_a_line() -> None:
    found = hear(b"#5CRC*\r")
    assert not found.frames
    assert [(g.hex, g.reason) for g in found.gaps] == [
        (b"#5CRC".hex(), "truncated"),
        (b"*\r".hex(), "damaged"),
    ]


def test_line_feeds_and_spaces_between_lines_are_blank_and_no_anomaly() -> None:
    found = hear(b"#5QD\r\n*5QD132\r\n  \n#5L\r")
    assert found.ops == ["QD", "QD", "L"]
    assert [g.detail for g in found.gaps] == [{"blank": True}] * 2
    assert codes(b"#5QD\r\n*5QD132\r\n  \n#5L\r") == []


@pytest.mark.parametrize(
    ("line", "column", "expected"),
    [
        (b"#\r", 2, "id"),
        (b"#D5\r", 2, "id"),
        (b"*QD5\r", 2, "id"),
        (b"#1234D5\r", 2, "id"),
        (b"#251D5\r", 2, "0..250"),
        (b"#5\r", 3, "word"),
        (b"#5 QD\r", 3, "word"),
        (b"#5D-\r", 4, "number"),
        (b"#5D1.5\r", 5, "modifier or the end"),
        (b"#5D1T\r", 6, "number"),
        (b"#5D1T-5\r", 6, "number"),
        (b"#5Q\x00D\r", 4, "number or the end"),
        (b"*5QD1\xff\r", 6, "the end"),
        (b"*5QD1T5\r", 6, "the end"),
        (b"*QID251\r", 5, "0..250"),
        (b"#5" + b"A" * 14 + b"\r", 3, "13 letters"),
        (b"#5D" + b"1" * 19 + b"\r", 4, "18 digits"),
        (b"#5D1" + b"T1" * 50 + b"\r", LONGEST, "carriage return"),
    ],
)
def test_a_damaged_line_says_at_which_column_what_should_stand(
    line: bytes, column: int, expected: str
) -> None:
    found = hear(line)
    assert not found.frames
    assert [(g.reason, g.detail["column"]) for g in found.gaps] == [("damaged", column)]
    assert expected in found.gaps[0].detail["expected"]
    assert "damaged-frame" in codes(line)


def test_every_id_is_taken_or_refused_as_the_page_says() -> None:
    for servo_id in range(1000):
        assert isinstance(read(b"#%dQD\r" % servo_id), Line) == (servo_id in IDS)


def test_a_silence_inside_a_line_cuts_it_in_two_fragments() -> None:
    t = 10 * NS
    halves = [Chunk(b"#5Q", t, Clock.READ), Chunk(b"D\r", t + 2 * LSS.tail_ns, Clock.READ)]
    parts = batches(Decoder("lss"), [halves])
    assert not sum(len(b.frames) for b in parts)
    assert [g.reason for b in parts for g in b.gaps] == ["idle_tail", "noise"]


def test_a_missing_carriage_return_holds_bytes_back_only_up_to_the_longest_line() -> None:
    line = b"#5D" + b"1" * (LONGEST - 4)
    assert decided(line) == 0
    assert decided(line + b"1") == len(line) + 1
    assert decided(line, final=True) == len(line)
    assert decided(b"#5QD\r*5Q") == 5


def test_neighbours_of_one_reason_are_one_gap() -> None:
    assert [(g.length, g.reason) for g in hear(b"#" * 1000).gaps] == [(1000, "noise")]
    assert len(hear(b"#\r" * 500).gaps) == 1
    cut = hear(b"#5Q" * 100 + b"#5QD\r").gaps
    assert [(g.length, g.detail.get("lines")) for g in cut] == [(297, 99), (3, None)]


# ---- words


def test_words_are_the_longest_runs_of_letters_so_that_none_hides_another() -> None:
    for word in ("D", "DEFAULT", "QD", "QDT", "CO", "CONFIRM", "SD", "CSD"):
        assert hear(b"#5%s\r" % word.encode()).ops == [word]


def test_commands_may_be_written_in_lower_case() -> None:
    found = hear(b"#5qd\r*5QD132\r")
    assert found.ops == ["QD", "QD"]
    assert found.flags == [(), ()]


def test_a_reply_in_lower_case_is_read_but_unusual() -> None:
    found = hear(b"#5QD\r*5qd132\r")
    assert found.flags == [(), ("unusual",)]
    assert found.values == {(5, "present_position"): 13.2}


@pytest.mark.parametrize(
    ("sent", "meant"), [("PD", "D"), ("CP", "CFP"), ("CD", "CFD"), ("RS", "RESET"), ("SCSL", "CSL")]
)
def test_other_spellings_of_a_word_are_the_same_command(sent: str, meant: str) -> None:
    line = b"#5%s%s\r" % (sent.encode(), b"" if meant == "RESET" else b"64")
    found = hear(line)
    assert found.ops == [meant]
    assert found.frames[0].fields["word"] == sent


def test_a_word_of_no_manual_is_a_frame_that_says_so_and_is_answered_if_it_asks() -> None:
    found = hear(b"#5QYX\r#5QXY\r*5QXY7\r#5XYZ\r#5ABCDEFGHIJKLM1\r")
    assert found.ops == ["QYX", "QXY", "QXY", "XYZ", "ABCDEFGHIJKLM"]
    assert found.flags == [("unknown",)] * 5
    assert found.outcomes == ["not_expected", "ok", "not_expected", "not_expected"]
    assert not found.samples


def test_every_word_survives_being_packed_into_a_number() -> None:
    for word in [*WORDS, "A", "Z", "Z" * 13, "QZA"]:
        assert unpacked(packed(word)) == word
        assert packed(word.lower()) == packed(word)
    assert packed("Z" * 13) < 2**63


def test_every_word_of_the_table_is_a_command_and_every_query_is_answered_under_its_word() -> None:
    for name, word in WORDS.items():
        found = hear(command(5, name) + reply(5, name, 7) if word.is_query else command(5, name, 7))
        assert set(found.ops) == {word.name}
        assert "unknown" not in found.flags[0]
        assert found.outcomes == (["ok"] if word.is_query else ["not_expected"])


def test_labels_of_values_do_not_collide_with_registers() -> None:
    names = {r.name for r in REGISTERS} | {"word", "value", "selector", "modifiers", "text"}
    assert not names & {r.label for r in REGISTERS if r.label}


# ---- people


def test_no_line_has_a_checksum() -> None:
    assert hear(b"#5QD\r").frames[0].checksum == "none"
    assert LSS.checksum_of(b"#5QD\r") is None


@pytest.mark.parametrize("talk", [b"#5P1456T1263S5\r", b"#254QID\r*QID5\r", b"#5QMS\r*5QMSLSS\r"])
def test_dissection_names_every_byte_of_a_line(talk: bytes) -> None:
    parts, at = batches(Decoder("lss"), [[Chunk(talk)]]), 0
    batch = next(b for b in parts if len(b.frames))
    i = len(batch.frames) - 1
    raw = talk[int(batch.frames.start[i]) :]
    for span in LSS.dissect(raw, view(batch.frames, i)):
        assert span.offset == at
        at += span.length
    assert at == len(raw)


# ---- the block decoder against the grammar, at every edge


@walks_a_list
def test_every_word_and_number_length_decodes_as_the_reference_says() -> None:
    words = [*WORDS, *MODIFIERS, "QZ", "Z" * 7, "Z" * 8, "Z" * 9, "QFDZ", "Z" * 13, "Z" * 14]
    numbers = (b"", b"-", b"-1", b"5", b"1234567", b"12345678", b"123456789", b"1" * 19)
    said = thinned([*itertools.product(words, numbers)], 3)
    for mark, tail in itertools.product(b"#*", (b"", b"T5", b"SD12345678", b"ABCDEFGHI1", b".1")):
        lines = (b"%c5%s%s%s\r" % (mark, word.encode(), number, tail) for word, number in said)
        same_as_the_reference(b"".join(lines))


@walks_a_list
def test_every_byte_at_every_place_decodes_as_the_reference_says() -> None:
    for line in (b"#5QD1\r", b"*12QD-34\r", b"#5P1T2\r", b"*5QFPDIS\r", b"*QID5\r"):
        spoilt = (
            line[:at] + bytes([byte]) + line[at + 1 :]
            for at in range(len(line))
            for byte in thinned(range(256), 7)
        )
        same_as_the_reference(b"".join(spoilt))
