"""A capture that a terminal, telnet or a text file has altered is known by what was done to it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

from sniffer.decoding.translations import translated
from sniffer.diagnosis.ledger.ledger import HEAD
from sniffer.ground.model import Chunk, Direction
from sniffer.protocols import PROTOCOLS
from tests.commands import within
from tests.conversations import TONGUES, Conversation, one_wire, robot, without_clock
from tests.diagnosed import codes, diagnosed, found, verdicts
from tests.lists import each_in_turn, in_turn
from tests.streams import rs30x
from tests.test_diagnosis_tap import holes

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    Alter = Callable[[bytes], bytes]

BINARY = tuple(name for name in TONGUES if name != "lss")
HEADED = ("mightyzap", "rs30x")
"""Protocols whose answers have a checksum: of others hardly a torn frame can be tried."""


def turned(data: bytes) -> bytes:
    """Write each byte with its bits in the other order."""
    return bytes(int(f"{value:08b}"[::-1], 2) for value in data)


def pairs(data: bytes) -> bytes:
    """Exchange the bytes of each pair."""
    even = np.frombuffer(data[: len(data) & ~1], "<u2")
    return even.byteswap().tobytes()


def without(*values: int) -> Alter:
    """Leave some values out."""
    return lambda data: bytes(v for v in data if v not in values)


def named(value: object) -> str:
    """Return what a case is called: its words, and nothing of its functions."""
    return value if isinstance(value, str) else ""


def with_parity(odd: int) -> Alter:
    """Set the eighth bit as a line of seven bits and a parity bit does."""
    return lambda data: bytes(v | (v.bit_count() + odd) % 2 << 7 for v in data)


WHOLE: dict[str, tuple[tuple[str, ...], Alter]] = {
    "written as text in UTF-8": (BINARY, lambda data: data.decode("latin-1").encode()),
    "every FF stands there twice": (BINARY, lambda data: data.replace(b"\xff", b"\xff\xff")),
    "a 0D stands before every 0A": (HEADED, lambda data: data.replace(b"\n", b"\r\n")),
    "every 0D came as 0A": (("lss", "rs30x"), lambda data: data.replace(b"\r", b"\n")),
    "the end of each line is sent as characters": (
        ("lss",),
        lambda data: data.replace(b"\r", b"\\r"),
    ),
    "the ends of lines (0D) were taken away": (("lss",), without(0x0D)),
    "the two bytes of each pair": (tuple(TONGUES), pairs),
    "the bits of each byte stand in the other order": (tuple(TONGUES), turned),
    "all bits of each byte are inverted": (tuple(TONGUES), lambda d: bytes(255 - v for v in d)),
    "is its even parity: the line is 7E1": (("lss",), with_parity(0)),
    "is its odd parity: the line is 7O1": (("lss",), with_parity(1)),
    "is set: the line is 7M1 or 7N2": (("lss",), lambda data: bytes(v | 128 for v in data)),
    "EF BF BD stands for each": (BINARY, lambda data: data.decode(errors="replace").encode()),
    "the eighth bit of each byte is lost": (BINARY, lambda data: bytes(v & 127 for v in data)),
    "bytes from 80 on are left out": (BINARY, lambda data: data.decode("ascii", "ignore").encode()),
    "the byte 00 is left out": (HEADED, without(0)),
    "the byte 0D is left out": (HEADED, without(0x0D)),
    "the bytes 11 and 13 are left out": (HEADED, without(0x11, 0x13)),
    "control characters are left out": (HEADED, without(0x03, 0x04, 0x1A, 0x1C)),
}  # fmt: skip
"""By what is said of it: how bytes are altered, and in which protocols it can be seen."""

WRITTEN = tuple(WHOLE)[:2] + tuple(WHOLE)[3:6]
"""What programs also do to bytes that they write."""

CASES = [(told, name, alter) for told, (names, alter) in WHOLE.items() for name in names]


def heard(protocol: str) -> list[Chunk]:
    """Return a few seconds of a sound bus, on one wire."""
    return one_wire(robot(protocol, 6))


def altered(chunks: list[Chunk], alter: Alter) -> list[Chunk]:
    """Return a capture as a program leaves it: all bytes at once, without times."""
    (first, *_) = without_clock(chunks)
    data = alter(b"".join(chunk.data for chunk in chunks))
    return [replace(first, data=data[k : k + 256]) for k in range(0, len(data), 256)]


@in_turn(3)
@pytest.mark.parametrize(("told", "protocol", "alter"), CASES, ids=named)
def test_what_altered_a_capture_is_named_and_nobody_else_is_accused(
    told: str, protocol: str, alter: Alter
) -> None:
    talk = robot(protocol, 6)
    diagnosis = talk.diagnosed(altered(one_wire(talk), alter))
    assert verdicts(diagnosis.incidents())[0] == ("tap-not-raw", ())
    (finding,) = (f for f in found(diagnosis) if f.code == "bytes-translated")
    assert told in finding.what
    assert diagnosis.incidents()[0].causes[0].confidence > 0.9


@pytest.mark.parametrize(
    ("before", "behind"),
    [
        (b"    ", b""),
        (b"\x1b[32m", b"\x1b[0m"),
        (b"- ", b"   // asked"),
        (b"", b"\n"),
        (b"> ", b""),
    ],
    ids=["indented", "coloured", "with notes", "with empty lines", "quoted"],
)
def test_lines_of_text_with_more_around_them_are_no_wrong_rate(
    before: bytes, behind: bytes
) -> None:
    def pasted(data: bytes) -> bytes:
        lines = (before + line + behind + b"\n" for line in data.split(b"\r") if line)
        return b"```\n" + b"".join(lines) + b"```\nWhat is wrong?\n"

    talk = robot("lss", 6)
    diagnosis = talk.diagnosed(altered(one_wire(talk), pasted))
    assert verdicts(diagnosis.incidents())[0] == ("tap-not-raw", ())
    (finding,) = (f for f in found(diagnosis) if f.code == "bytes-translated")
    assert "more stands around the lines" in finding.what
    assert "wrong-baud" not in {cause for cause, _ in verdicts(diagnosis.incidents())}


def test_an_answer_that_lacks_a_byte_does_not_take_the_next_request_with_it() -> None:
    """It counts the first byte of what follows for its last one: neither of the two is a frame."""
    talk = Conversation("rs30x")
    for cycle in range(120):
        talk.until(cycle / 20)
        goals = b"".join(
            bytes([servo]) + (40 + 3 * cycle + servo).to_bytes(2, "little") for servo in (1, 2)
        )
        talk.write(rs30x.packet(0, 0, 0x1E, 3, 2, goals))
        for servo in (1, 2):
            place = (40 + 3 * cycle).to_bytes(2, "little")
            talk.say(rs30x.packet(servo, 0x09, 0, 0, 1), Direction.TX)
            talk.rest(0.3)
            warmth = 0x1C if servo == 2 else 0x1D
            state = place + bytes([0, 0, 5, 0, 70, 0, warmth, 0, 0xD6, 2]) + bytes(6)
            talk.say(rs30x.returned(servo, 0x2A, state), Direction.RX)
    capture = altered(one_wire(talk), without(0x03, 0x1C))
    assert verdicts(talk.diagnosed(capture).incidents())[0] == ("tap-not-raw", ())


def test_a_value_that_is_rare_is_missed_all_over_a_capture_though_not_in_its_first_bytes() -> None:
    talk = robot(
        "rs30x", 16, path=lambda servo, t: 0.3 if t < 10 else 0.5 + 0.4 * math.sin(servo + t)
    )
    data = b"".join(chunk.data for chunk in one_wire(talk))
    assert b"\x0d" not in data[:HEAD]
    turned_ends = [replace(c, data=c.data.replace(b"\x0d", b"\x0a")) for c in one_wire(talk)]
    assert verdicts(talk.diagnosed(turned_ends).incidents()) == [("tap-not-raw", ())]


@pytest.mark.parametrize("protocol", TONGUES)
def test_a_capture_as_it_was_on_the_wire_was_not_altered(protocol: str) -> None:
    data = b"".join(chunk.data for chunk in heard(protocol))
    assert translated(data, PROTOCOLS[protocol]) is None


@each_in_turn(4, "protocol", TONGUES)
def test_lost_and_misread_bytes_are_no_translation(protocol: str) -> None:
    talk = robot(protocol, 6)
    lost = holes(one_wire(talk))
    rng = np.random.default_rng(3)
    noisy = []
    for chunk in one_wire(talk):
        hit = rng.random(len(chunk.data)) < 0.01
        bits = (1 << rng.integers(0, 8, len(chunk.data)) * hit) * hit
        noisy.append(replace(chunk, data=bytes(np.frombuffer(chunk.data, np.uint8) ^ bits)))
    for chunks in (lost, noisy, without_clock(lost), without_clock(noisy)):
        assert "bytes-translated" not in codes(talk.diagnosed(chunks))


def test_noise_on_a_bus_that_never_says_some_values_leaves_them_unsaid() -> None:
    """A short conversation has few values: what is torn in it does not hold by those it lacks."""
    talk = robot("mightyzap", 2, goals=False)
    data = bytearray(b"".join(chunk.data for chunk in one_wire(talk)))
    for at in range(20, len(data), 90):
        del data[at]
    assert translated(bytes(data), PROTOCOLS["mightyzap"]) is None


def test_one_command_that_is_always_sent_wrong_was_not_altered() -> None:
    """It lacks two bytes, and would hold with two of 0D, which is never said here."""
    talk = Conversation("rs30x")
    for cycle in range(180):
        talk.until(cycle / 30)
        for servo in (1, 2):
            talk.read(servo, 0.5 + 0.03 * (cycle % 4))
        if cycle % 6 == 0:
            talk.write(bytes.fromhex("FAAF00001E0302060000061F"))
    assert b"\x0d" not in b"".join(chunk.data for chunk in talk.chunks)
    told = talk.diagnosed(one_wire(talk))
    assert "bytes-translated" not in codes(told)
    assert verdicts(told.incidents()) == [("malformed-command", ())]


@pytest.mark.parametrize("told", ["written as text in UTF-8", "all bits of each byte"])
def test_who_cannot_tell_the_protocol_says_what_was_done_to_the_bytes(
    told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alter = next(alter for key, (_, alter) in WHOLE.items() if key.startswith(told) or told in key)
    file = tmp_path / "saved.bin"
    file.write_bytes(alter(b"".join(chunk.data for chunk in heard("mightyzap"))))
    done = within(capsys, "decode", str(file))
    assert done.status == 2
    assert "not as they were on a wire" in done.complaint
    assert told in done.complaint
    assert "100.0 % of the bytes are mightyzap frames" in done.complaint


@pytest.mark.parametrize(
    ("told", "protocol", "alter"),
    [case for case in CASES if case[0] in WRITTEN],
    ids=named,
)
def test_what_nobody_answers_was_altered_before_it_was_sent(
    told: str, protocol: str, alter: Alter
) -> None:
    """A controller writes bytes as text, or to a terminal that is not raw."""
    talk = Conversation(protocol)
    for n in range(200):
        talk.say(alter(talk.tongue.ask(1 + n % 5)))
        talk.rest(5)
        talk.say(alter(talk.tongue.goal(1 + n % 5, n % 50 / 50)))
        talk.rest(5)
    diagnosis = talk.diagnosed()
    first, second, *_ = diagnosis.incidents()[0].causes
    assert (first.cause, second.cause) == ("malformed-command", "tap-not-raw")
    (finding,) = (f for f in found(diagnosis) if f.code == "sent-translated")
    assert told in finding.what
    assert finding.what.endswith(" requests is answered")


def test_of_what_has_no_frame_nobody_says_by_whom_it_is_spoken() -> None:
    talk = Conversation("lss")
    for n in range(200):
        talk.say(talk.tongue.ask(1 + n % 5).replace(b"\r", b""))
        talk.rest(5)
    assert diagnosed(talk.chunks, "mightyzap").sentence() == "bus0: 800 bytes, in no frame"


def test_letters_alone_have_lost_no_eighth_bit() -> None:
    data = b"The quick brown fox jumps over the lazy dog 0123456789; " * 20
    assert "bytes-translated" not in codes(diagnosed([Chunk(data)], "lss"))
