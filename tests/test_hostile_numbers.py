"""Numbers, names and options that cannot be: one line, the right status, nothing lost."""

from __future__ import annotations

import struct
import sys
import warnings
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest
from mcap.opcode import Opcode

from tests import hostile
from tests.commands import conserved, within
from tests.hostile import ANSWER, ASK, PAIR, Answer, Victim, decoded, frame, sound
from tests.lists import each_in_turn
from tests.recordings import START_NS

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="limits memory as POSIX does")

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"


@pytest.mark.parametrize("every", [False, True])
@pytest.mark.parametrize("number", [2**63 - 1, 2**63 - 5, 2**63, 2**64 - 1, 2**62])
def test_an_index_that_leads_out_of_the_file_is_not_followed(
    number: int, every: bool, victim: Victim, base: bytes, tmp_path: Path
) -> None:
    data = bytearray(base)
    at = next(hostile.places(base, Opcode.MESSAGE_INDEX))
    length = struct.unpack_from("<Q", data, at + 1)[0] - 6
    for entry in range(at + 9 + 6, at + 9 + 6 + (length if every else 16), 16):
        struct.pack_into("<Q", data, entry + 8, number)
    answer, told = decoded(victim, tmp_path / "x.mcap", bytes(data), "--protocol", "mightyzap")
    assert answer.status == 0
    assert "its checksum over everything does not match" in told[0]
    assert conserved(answer.out) == (ASK + ANSWER) * 20


@pytest.mark.parametrize(
    ("facts", "status"),
    [
        ({"model.300": "mightyzap-l12"}, 0),
        ({f"model.{'9' * 5000}": "mightyzap-l12"}, 0),
        ({"model.1": "nonsense" * 20_000}, 2),
        ({"latency_ns.bus0": str(1 << 63)}, 0),
        ({"latency_ns.bus0": "9" * 5000}, 0),
        ({"baud.bus0": "0"}, 0),
        ({"baud.bus0": "9" * 5000}, 0),
        ({"protocol.bus0": "nonsense" * 20_000}, 2),
        ({"offset.bus0": "9" * 5000}, 0),
    ],
)
def test_facts_that_cannot_be_are_left_out_or_told(
    facts: dict[str, str], status: int, victim: Victim, tmp_path: Path
) -> None:
    path = tmp_path / "x.mcap"
    hostile.with_facts(path, facts)
    answer = victim.run("decode", path, "--format", "jsonl", "--baud", "57600")
    told = sound(answer)
    assert (answer.status, len(told)) == (status, 1 if status else 0)
    again = victim.run("replay", path, "--redecode")
    assert again.status in (0, 1, 2)
    sound(Answer(again.status, "", again.err, again.memory))


WHOLE: Final = (ASK + ANSWER) * 20
"""What the recordings here hold."""


@pytest.mark.parametrize(
    ("end", "kept"),
    [
        ({"offset.bus0": "30"}, 30),
        ({"offset.bus0": "30", "t_ns.bus0": "9" * 5000}, 30),
        ({"offset.bus0": "30", "t_ns.bus0": "0"}, 30),
        ({"offset.bus0": "30", "t_ns.bus0": "-1"}, 30),
        ({"offset.bus0": "0"}, 0),
        ({"offset.bus0": "-1"}, len(WHOLE)),
        ({"offset.bus0": "9" * 5000}, len(WHOLE)),
        ({"offset.bus0": str(1 << 55)}, len(WHOLE)),
        ({"offset.bus0": str(1 << 56)}, len(WHOLE)),
        ({"offset.bus0": "\u0661"}, 1),  # a digit is a digit
        ({"offset.bus0": ""}, len(WHOLE)),
        ({"offset": "3", "offset.": "3", "offset.bus0.more": "3", ".bus0": "3"}, len(WHOLE)),
        ({f"offset.bus{n}": "3" for n in range(1, 2_000)}, len(WHOLE)),
        ({"offset.bus0": "30", "more": "x" * (1 << 20)}, 30),
        ({"offset.bus0": "30", "more": "x" * (1 << 22)}, len(WHOLE)),  # longer than is believed
    ],
    ids=range(15),
)
@pytest.mark.parametrize("torn", [False, True])
def test_an_end_that_cannot_be_is_left_out(
    end: dict[str, str], kept: int, torn: bool, victim: Victim, tmp_path: Path
) -> None:
    path, whole = tmp_path / "x.mcap", tmp_path / "whole.mcap"
    data = hostile.with_facts(path, {}, end)
    path.write_bytes(data[: -1 if torn else None])
    mended = victim.run("recover", path, "-o", whole)
    assert (mended.status, mended.err) == (0, "")
    for recording in (path, whole):
        answer = victim.run("decode", recording, "--format", "jsonl", "--protocol", "mightyzap")
        sound(answer)
        assert answer.status == (0 if kept else 2)
        assert (conserved(answer.out) if kept else b"") == WHOLE[:kept]
        again = victim.run("replay", recording, "--redecode")
        assert again.status in (0, 1, 2)
        sound(Answer(again.status, "", again.err, again.memory))


def test_an_end_before_the_begin_of_a_file_leaves_nothing_of_the_bus(
    victim: Victim, tmp_path: Path
) -> None:
    from sniffer.mcapfile.sink import McapSink

    path = tmp_path / "x.mcap"
    sink = McapSink(path, {}, starts={"arm": 1000})
    for bus in ("arm", "leg"):
        sink.raw(bus, [replace(chunk, bus=bus) for chunk in hostile.conversation()])
    list(sink.closing({"offset.arm": "999", "offset.nobody": "0"}))
    answer = victim.run("decode", path, "--format", "jsonl", "--protocol", "mightyzap")
    sound(answer)
    assert answer.status == 0
    assert conserved(answer.out) == WHOLE, "of the other bus"


@pytest.mark.parametrize("number", [0, 1, 8, 2**31, 2**62, 2**63 - 1, 2**63, 2**64 - 1])
@pytest.mark.parametrize("place", range(6))
def test_an_index_that_leads_astray_is_not_followed_to_an_end(
    place: int, number: int, victim: Victim, tmp_path: Path
) -> None:
    """Whatever of it is changed: the mark is found in another way, or there is none."""
    path = tmp_path / "x.mcap"
    data = bytearray(hostile.with_facts(path, {}, {"offset.bus0": "30"}))
    footer = len(data) - 37
    offsets = struct.unpack_from("<Q", data, footer + 17)[0]
    groups = range(offsets, footer, 26)
    group = next(at for at in groups if data[at + 9] == Opcode.METADATA_INDEX)
    index = struct.unpack_from("<Q", data, group + 10)[0]
    while b"servo_sniffer.end" not in data[index : index + 60]:
        index += 9 + struct.unpack_from("<Q", data, index + 1)[0]
    changed = (footer + 1, footer + 17, group + 10, group + 18, index + 1, index + 9)
    struct.pack_into("<Q", data, changed[place], number)
    answer, _ = decoded(victim, path, bytes(data), "--protocol", "mightyzap")
    assert answer.status == 0
    assert conserved(answer.out) in (WHOLE, WHOLE[:30])


def raw_message(offset: int, *, start: int = 0, count: int = 1, t_ns: int = START_NS) -> bytes:
    """Return a record of a raw chunk with a HELD mark."""
    from sniffer.messages.recording_pb2 import Clock, Mark, RawChunk

    mark = Mark(kind=Mark.Kind.HELD, start=start, count=count)
    raw = RawChunk(t_ns=t_ns, clock=Clock.CLOCK_READ, offset=offset, data=ASK, marks=[mark])
    data = raw.SerializeToString()
    return struct.pack("<BQHIQQ", Opcode.MESSAGE, 22 + len(data), 1, 0, 0, 0) + data


@pytest.mark.parametrize(
    ("odd", "what"),
    [
        ({"count": 2**63}, "a chunk has a mark"),
        ({"count": 2**64 - 1}, "a chunk has a mark"),
        ({"start": -(2**63)}, "a chunk has a mark"),
        ({"start": 2**62}, "a chunk has a mark"),
        ({"t_ns": 2**63 - 1}, "a chunk has a time"),
        ({"t_ns": -(2**63)}, "a chunk has a time"),
    ],
)
def test_a_mark_or_a_time_beyond_all_time_is_damage(
    odd: dict[str, int], what: str, victim: Victim, base: bytes, tmp_path: Path
) -> None:
    content = hostile.unpacked(base)
    head = content[: next(at for at in _starts(content) if content[at] == Opcode.MESSAGE)]
    good, bad = head + raw_message(0), raw_message(len(ASK), **odd)
    data = hostile.with_chunk(base, good + bad, size=len(good + bad))
    answer, told = decoded(victim, tmp_path / "x.mcap", data, "--protocol", "mightyzap")
    assert len(told) == 1
    assert f"{what} that cannot be reckoned with" in told[0]
    assert conserved(answer.out) == ASK


def _starts(content: bytes) -> Iterator[int]:
    at = 0
    while at < len(content):
        yield at
        at += 9 + struct.unpack_from("<Q", content, at + 1)[0]


LINES: Final = {
    "a time of -2^63": frame(t_ns=-(2**63)),
    "a time of 2^63 - 1": frame(t_ns=2**63 - 1),
    "a time of 5000 digits": '{"type":"frame","hex":"00","offset":0,"t_ns":' + "9" * 5000 + "}\n",
    "an offset of 5000 digits": '{"type":"frame","hex":"00","offset":' + "9" * 5000 + "}\n",
    "an offset of 2^63": frame(offset=2**63),
    "a bus that is a number": frame(bus=5),
    "a clock that is a list": frame(clock=[1]),
    "hex that is a number": frame(hex=5),
    "the year 2262": f"(9223372036.8) bus0 #{PAIR}\n",
    "the year 2286": f"(9999999999.9) bus0 #{PAIR}\n",
    "a thousand brackets": "[" * 100_000 + "\n",
    "an object in an object": '{"a":' * 100_000 + "\n",
}


@pytest.mark.parametrize("name", LINES)
def test_a_line_that_says_what_cannot_be_is_one_line(
    name: str, victim: Victim, tmp_path: Path
) -> None:
    is_log = LINES[name].startswith("(")
    good = f"(1700000000.5) bus0 #{PAIR}\n" if is_log else frame(t_ns=START_NS)
    for text in (LINES[name], good * (1 if is_log else 0) + LINES[name], good + LINES[name]):
        answer, told = decoded(victim, tmp_path / "x", text.encode(), "--protocol", "mightyzap")
        assert answer.status in (2, 3)
        assert len(told) == 1


def test_half_a_surrogate_is_a_name_that_every_output_bears(victim: Victim, tmp_path: Path) -> None:
    outputs = [f"-o{tmp_path / f'x{suffix}'}" for suffix in (".mcap", ".csv", ".jsonl", ".rrd")]
    data = frame(bus="\ud800").encode()
    answer, told = decoded(victim, tmp_path / "in.jsonl", data, "--protocol", "mightyzap", *outputs)
    assert (answer.status, told) == (0, [])
    assert conserved(answer.out) == ASK + ANSWER
    assert "\\\\ud800" in answer.out
    assert conserved((tmp_path / "x.jsonl").read_text(encoding="utf-8")) == ASK + ANSWER


@pytest.mark.parametrize(
    "arguments",
    [
        ("--model", f"{'9' * 5000}=mightyzap-l12"),
        ("--model", "1=" + "x" * 5000),
        ("--baud", "9" * 5000),
        ("--latency", "9" * 5000),
        ("--latency", "nan"),
        ("--protocol", "x" * 100_000),
        ("--input-format", "x" * 100_000),
    ],
)
def test_an_option_that_cannot_be_is_one_short_line(
    arguments: tuple[str, str], victim: Victim
) -> None:
    answer = victim.run("decode", CAPTURES / "mightyzap_clean.log", *arguments)
    assert answer.status == 2
    assert len(sound(answer)) == 1
    assert len(answer.err) < 5000


@pytest.mark.parametrize(
    "arguments",
    [
        ("replay", "--from", "1e300"),
        ("replay", "--from", "0", "--to", "1e-300"),
        ("replay", "--speed", "1e300"),
        ("replay", "--from", "1e9", "--to", "1e300"),
        ("simulate", "--servos", "9" * 5000),
        ("simulate", "--rate", "9" * 5000),
        ("simulate", "--seed", "9" * 5000),
        ("simulate", "--fault", "flip:" + "9" * 5000),
        ("explain", "ff" * 100_000),
        ("explain", "x" * 100_000),
        ("registers", "x" * 100_000),
    ],
)
def test_other_commands_take_odd_numbers_as_calmly(
    arguments: tuple[str, ...], victim: Victim
) -> None:
    command, *options = arguments
    what = {"replay": [str(CAPTURES / "mightyzap_manual.hex")], "simulate": ["lss"]}
    answer = victim.run(command, *what.get(command, []), *options)
    sound(Answer(answer.status, "", answer.err, answer.memory))
    assert len(answer.err) < 5000


@each_in_turn(
    2,
    "command",
    [
        ("decode", "--summary"),
        ("stats",),
        ("diagnose",),
        ("query", "SELECT max(value) FROM samples"),
    ],
)
def test_a_number_of_many_digits_is_measured_and_no_warning_of_a_library_is_shown(
    command: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A torn answer in text may have any: it was told as less than nothing, in one of them."""
    path = tmp_path / "a.log"
    lines = []
    for n in range(80):
        place = "9" * 17 if n == 40 else str(10 * n)
        lines.append(f"({n}.000) bus0 #{b'#5QD'.hex()}0D\n({n}.002) bus0 #{b'*5QD'.hex()}")
        lines.append(f"{place.encode().hex()}0D\n")
    path.write_text("".join(lines))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        name, *options = command
        ran = within(capsys, name, *options, path, "--protocol", "lss")
    assert ran.status == 0, ran.err
    assert "-9" not in ran.out
