"""The edges of a capture are no faults of the bus: its begin, its end, what it does not hear."""

from __future__ import annotations

import io
import random
from pathlib import Path
from typing import Final

import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.codes import REQUEST, RESPONSE
from sniffer.ground.model import Anomaly, Chunk, Clock, Direction
from sniffer.sources import open_source
from tests.commands import records, sniffer, within
from tests.lists import each_in_turn
from tests.streams.mightyzap import packet
from tests.streams.rs30x import packet as short
from tests.streams.rs30x import returned

Capsys = pytest.CaptureFixture[str]

MS: Final = 1_000_000
T0: Final = 1_700_000_000_000_000_000
CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
CLEAN: Final = tuple(sorted(p.name for p in CAPTURES.iterdir() if "_clean" in p.name))
EDGES: Final = {"capture-start", "capture-end"}

READ: Final = packet(1, 0xF2, bytes([0x8C, 2]))
REPLY: Final = packet(1, 0, b"\xff\x07")
"""An exchange of mightyZAP servo 1."""

EXCHANGE: Final = {
    "mightyzap": (READ, REPLY),
    "lss": (b"#1QD\r", b"*1QD10\r"),
    "rs30x": (short(1, 9, count=1), returned(1, 0x2A, bytes(18))),
    "wck": (bytes.fromhex("ffa90029"), b"\x00\x59"),
}
EVERY: Final = pytest.mark.parametrize("name", EXCHANGE)


def found(name: str, *chunks: Chunk) -> list[Anomaly]:
    decoder = Decoder(name)
    return [a for b in (decoder.feed(*chunks), decoder.close()) for a in b.anomalies]


def codes(name: str, *chunks: Chunk) -> list[str]:
    return [a.code for a in found(name, *chunks)]


def at(ms: float, data: bytes, wire: Direction = Direction.UNKNOWN, bus: str = "bus0") -> Chunk:
    return Chunk(data, T0 + int(ms * MS), Clock.FILE, bus, wire)


def capture(file: str) -> list[Chunk]:
    return [chunk for group in open_source(CAPTURES / file) for chunk in group]


# --- the end -----------------------------------------------------------------------------------


@EVERY
def test_a_dump_that_ends_behind_a_request_is_cut_there(name: str) -> None:
    request, reply = EXCHANGE[name]
    assert codes(name, Chunk(request + reply + request)) == ["capture-end"]
    assert codes(name, at(0, request), at(2, reply), at(9, request)) == ["capture-end"]


@EVERY
def test_a_dump_that_ends_within_a_frame_is_cut_there(name: str) -> None:
    request, reply = EXCHANGE[name]
    for size in range(1, len(request)):
        assert codes(name, Chunk(request + reply + request[:size])) == ["capture-end"], size
    for size in range(1, len(reply)):
        assert codes(name, Chunk(request + reply + request + reply[:size])) == ["capture-end"], size


def test_the_outcome_of_a_request_that_is_cut_stays_no_response() -> None:
    decoder = Decoder("mightyzap")
    parts = [decoder.feed(READ + REPLY + READ), decoder.close()]
    assert [int(o) for b in parts for o in b.transactions.outcome] == [0, 1]


def test_an_answer_that_is_there_but_damaged_is_not_cut() -> None:
    spoiled = REPLY[:-1] + bytes([REPLY[-1] ^ 1])
    assert codes("mightyzap", Chunk(READ + REPLY + READ + spoiled)) == [
        "damaged-response",
        "bad-checksum",
    ]


def test_a_scan_of_absent_servos_is_cut_at_its_last_one_only() -> None:
    """WCK commands in a row all wait for what follows, but by the clock most are over."""
    ask, answer = EXCHANGE["wck"]
    scan = [at(10 + 20 * k, bytes([0xFF, a := 0xA0 | k + 10, 0, a & 0x7F])) for k in range(12)]
    said = found("wck", at(0, ask), at(1, answer), *scan)
    assert [(a.code, a.servo_id) for a in said] == [
        *(("no-response", k + 10) for k in range(11)),
        ("capture-end", 21),
    ]


def lss(talk: str) -> bytes:
    """Return queries ("1") and answers ("1!") of LSS servos."""
    words = talk.split()
    return b"".join(
        b"*%sQD9\r" % w[:-1] if w[1:] else b"#%sQD\r" % w for w in map(str.encode, words)
    )


@pytest.mark.parametrize(
    ("talk", "silent", "cut"),
    [
        ("1 2 1! 3", [], 2),  # what came behind 2 is the answer to the one before it
        ("1 2 3 1! 4 2! 5", [], 3),
        ("1 2", [], 1),
        ("1 2 2!", [], 1),  # the answers may come in another order
        ("1 1! 2 3 3! 4", [2], 4),  # 3 was asked later and is answered; the controller went on
        ("1 2 1! 3 3! 4", [2], 4),
        ("1 2 3 1! 3! 4", [2], 4),
        ("1 1! 2 7! 3", [], 3),
    ],
)
def test_of_several_in_flight_those_whose_turn_has_not_come_are_cut(
    talk: str, silent: list[int], cut: int
) -> None:
    for size in (1, 1000):
        data = lss(talk)
        decoder = Decoder("lss")
        parts = [decoder.feed(data[k : k + size]) for k in range(0, len(data), size)]
        told = [a for b in (*parts, decoder.close()) for a in b.anomalies]
        assert [a.servo_id for a in told if a.code == "no-response"] == silent
        assert [a.servo_id for a in told if a.code == "capture-end"] == [cut]


def test_more_bytes_than_the_beginning_of_a_frame_are_noise_at_the_end_too() -> None:
    assert codes("mightyzap", Chunk(READ + REPLY + b"\x12\x34" * 4)) == ["noise"]


def test_a_bus_that_falls_silent_while_another_goes_on_is_not_cut() -> None:
    other = [at(ms, REPLY, bus="arm") for ms in range(0, 1000, 50)]
    asked = [at(ms, READ, bus="arm") for ms in range(-2, 998, 50)]
    for last, code in ((10, "no-response"), (955, "capture-end")):
        pipeline = Pipeline(Options(protocol="mightyzap"), [])
        leg = [at(0, READ, bus="leg"), at(2, REPLY, bus="leg"), at(last, READ, bus="leg")]
        pipeline.feed(sorted([*asked, *other, *leg], key=lambda c: c.t_ns or 0))
        pipeline.close()
        assert dict(pipeline.summary.buses["leg"].codes) == {code: 1}


# --- a part of a capture -----------------------------------------------------------------------


@each_in_turn(2, "file", CLEAN)
def test_a_part_of_a_good_capture_has_no_anomalies_but_its_edges(file: str) -> None:
    name, chunks = file.split("_")[0], capture(file)
    data = b"".join(chunk.data for chunk in chunks)
    rng = random.Random(file)
    for _ in range(40):
        begin = rng.randrange(len(data) - 800)
        part = Chunk(data[begin : begin + rng.randrange(100, 700)])
        told = {a.code for a in found(name, part) if a.severity}
        assert not told, data[begin : begin + 40].hex(" ")


def test_a_part_says_that_it_is_one_and_invents_no_anomalies(capsys: Capsys) -> None:
    path = CAPTURES / "mightyzap_clean.log"
    ran = within(capsys, "replay", path, "--speed", "0", "--from", "1.003", "--to", "2.5")
    assert ran.status == 0
    assert "a part of it: from second 1.003 to second 2.5" in ran.err
    assert "no anomalies" in ran.out
    assert ran.out.endswith("a part of the capture, from second 1.003 to second 2.5\n")


def test_who_is_silent_at_the_end_of_a_part_is_known_from_what_comes_behind_it(
    tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "pause.log"
    talk = ((0, READ), (2, REPLY), (10, READ), (4000, READ), (4002, REPLY))
    path.write_text("".join(f"({1000 + ms / 1000:.6f}) b #{d.hex()}\n" for ms, d in talk))
    arguments = ("replay", path, "--protocol", "mightyzap", "--speed", "0", "--to")
    assert "no-response" in within(capsys, *arguments, "2").out
    assert "no-response" in within(capsys, *arguments, "0.05").out
    assert "no anomalies" in within(capsys, *arguments, "0.001").out, "the answer comes later"


# --- the beginning -----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["mightyzap", "lss", "rs30x"])
def test_answers_to_what_was_asked_before_the_capture_are_its_beginning(name: str) -> None:
    request, reply = EXCHANGE[name]
    assert codes(name, Chunk(reply + request + reply)) == ["capture-start"]
    assert codes(name, Chunk(reply + reply[:-1] + reply[-1:] + request + reply)) == [
        "capture-start"
    ]
    assert codes(name, Chunk(request + reply + request + reply + reply))[-1] == "duplicate-response"


def test_an_answer_behind_a_damaged_request_is_no_beginning_however_it_was_fed() -> None:
    """Live, the request that broke was told in a batch of its own before the answer came."""
    broken, reply = at(0, READ[:-1] + b"\0"), at(300, REPLY)
    assert codes("mightyzap", broken, reply)[1:] == ["unsolicited-response"]
    decoder = Decoder("mightyzap")
    live = (decoder.feed(broken), decoder.idle(T0 + 200 * MS), decoder.feed(reply), decoder.close())
    assert [a.code for b in live for a in b.anomalies] == codes("mightyzap", broken, reply)


# --- one side only -----------------------------------------------------------------------------


def one_side(file: str, kind: int, wire: Direction = Direction.UNKNOWN) -> list[Chunk]:
    """Return the frames of one kind of a capture, each with its time."""
    name, chunks = file.split("_")[0], capture(file)
    decoder = Decoder(name)
    out = []
    for batch in (decoder.feed(*chunks), decoder.close()):
        f = batch.frames
        for start, end, what, t in zip(f.start, f.end, f.kind, f.t_end, strict=True):
            if what == kind:
                t_ns = int(t) if chunks[0].t_ns is not None else None
                out.append(Chunk(batch.data[start:end], t_ns, chunks[0].clock, "bus0", wire))
    return out


@pytest.mark.parametrize("file", CLEAN)
def test_the_controllers_wire_alone_is_told_once_and_nothing_else(file: str) -> None:
    told = found(file.split("_")[0], *one_side(file, REQUEST))
    assert [a.code for a in told if a.code not in EDGES] == ["no-answer-heard"]
    assert "the tap hears only the controller's wire, or no servo answers" in told[0].detail


@pytest.mark.parametrize("file", [file for file in CLEAN if not file.startswith(("wck", "rs30x"))])
def test_the_servos_wire_alone_is_told_once_and_nothing_else(file: str) -> None:
    """Not of wck, rs30x: answers without a header are no frames without their request."""
    told = codes(file.split("_")[0], *one_side(file, RESPONSE))
    assert [code for code in told if code not in EDGES] == ["no-request-heard"]


def test_an_input_that_names_its_only_wire_is_quoted() -> None:
    told = found("mightyzap", *one_side("mightyzap_clean.log", REQUEST, Direction.TX))
    assert "(all of it is marked TX)" in told[0].detail


def asked(*servos: int) -> list[Chunk]:
    return [at(150 * k, packet(who, 0xF2, bytes([0x8C, 2]))) for k, who in enumerate(servos)]


def test_a_silent_servo_among_others_that_answer_is_still_one() -> None:
    first = [at(-20, READ), at(-17, REPLY)]
    assert codes("mightyzap", *first, *asked(2, 3, 2, 3, 2, 3, 2, 3, 2, 3)) == [
        *["no-response"] * 9,
        "capture-end",
    ]


def test_an_answer_after_some_requests_shows_that_the_others_are_silent() -> None:
    last = [at(900, READ), at(903, REPLY)]
    told = found("mightyzap", *asked(2, 3, 2, 3), *last)
    assert [(a.code, a.servo_id) for a in told] == [("no-response", who) for who in (2, 3, 2, 3)]


def test_from_the_first_answer_on_silence_counts_again() -> None:
    first = asked(*range(1, 21))
    last = [at(4000, READ), at(4003, REPLY), at(4200, packet(2, 0xF1)), at(4500, READ)]
    told = codes("mightyzap", *first, *last, at(4503, REPLY))
    assert told == ["no-answer-heard", "no-response"]


def test_the_only_servo_that_is_asked_is_silent_and_that_is_said_once() -> None:
    told = found("mightyzap", *asked(*[7] * 50), at(9000, b""))
    assert [(a.code, a.servo_id) for a in told if a.code not in EDGES] == [("no-response", 7)]
    assert "nor the 7 requests behind it" in told[0].detail
    assert codes("mightyzap", *asked(7, 7, 7)) == ["no-response", "no-response", "capture-end"]


@pytest.mark.parametrize("size", [1, 3, 10_000])
def test_what_is_held_back_does_not_depend_on_how_the_stream_is_cut(size: int) -> None:
    for chunks in (
        asked(*range(1, 21)),
        asked(2, 3, 2),
        one_side("mightyzap_clean.log", RESPONSE)[:30],
        [*asked(2, 3, 2, 3), at(900, READ), at(903, REPLY), *asked()],
    ):
        decoder = Decoder("mightyzap")
        parts = [decoder.feed(*chunks[k : k + size]) for k in range(0, len(chunks), size)]
        told = [a for b in (*parts, decoder.close()) for a in b.anomalies]
        assert told == found("mightyzap", *chunks)


# --- stray bytes -------------------------------------------------------------------------------

STRAY: Final = [b"\xff", b"\xfe", b"\x00", b"\xff\xff", b"\xfa", b"\xfd", b"#", b"*"]


@EVERY
@pytest.mark.parametrize("stray", STRAY, ids=bytes.hex)
def test_a_stray_byte_between_exchanges_is_noise_whatever_value_it_has(
    name: str, stray: bytes
) -> None:
    request, reply = EXCHANGE[name]
    assert codes(name, Chunk(request + reply + stray + request + reply)) == ["noise"]


# --- another protocol than was named -----------------------------------------------------------


def test_a_few_frames_by_chance_do_not_hide_that_another_protocol_was_named() -> None:
    ran = sniffer("decode", CAPTURES / "mightyzap_clean.log", "--protocol", "wck", "--summary")
    assert ran.status == 0
    assert "of the bytes are frames of wck: it looks like mightyzap (sure" in ran.err
    assert "decode it with --protocol mightyzap" in ran.err
    assert "this looks like mightyzap: decode it as mightyzap" in ran.out


@pytest.mark.parametrize("file", sorted(p.name for p in CAPTURES.iterdir() if p.suffix != ".md"))
def test_who_names_the_right_protocol_is_not_contradicted(file: str, capsys: Capsys) -> None:
    ran = within(
        capsys, "decode", CAPTURES / file, "--protocol", file.split("_")[0], "--summary",
        *("--format", "jsonl"),
    )  # fmt: skip
    assert ran.err == ""
    assert "looks_like" not in records(ran.out)[-1]["buses"]["bus0"]


# --- anomalies by servo ------------------------------------------------------------------------


def test_the_summary_tells_which_servos_an_anomaly_is_about(tmp_path: Path, capsys: Capsys) -> None:
    late = packet(2, 0xF2, bytes([0x8C, 2])), packet(2, 0, b"\xff\x07")
    talk = [(0, late[0]), (40, late[1])]
    talk += [(100 * k + d, one) for k in range(1, 6) for d, one in ((0, READ), (40, REPLY))]
    path = tmp_path / "late.log"
    path.write_text("".join(f"({1000 + ms / 1000:.6f}) b #{d.hex()}\n" for ms, d in talk))
    ran = within(capsys, "decode", path, "--protocol", "mightyzap", "--summary")
    line = next(line for line in io.StringIO(ran.out) if "late-response" in line)
    assert "1×5 2×1" in line
    ran = within(capsys, "decode", path, "--protocol", "mightyzap", "--format", "jsonl")
    assert records(ran.out)[-1]["buses"]["b"]["codes_by_servo"] == {
        "late-response": {"1": 5, "2": 1}
    }


@pytest.mark.parametrize(("begins", "is_early"), [("22:50", True), ("22:55:07", False)])
def test_a_part_that_begins_before_the_capture_says_so(
    begins: str, is_early: bool, capsys: Capsys
) -> None:
    path = CAPTURES / "mightyzap_clean.log"
    ran = within(capsys, "decode", path, "--from", begins, "--to", "22:55:08", "--summary")
    assert ran.status == 0
    assert ("its first byte came after that" in ran.err) == is_early


def test_of_a_capture_without_a_frame_nothing_is_said_to_stand_before_the_first() -> None:
    (told,) = found("wck", Chunk(bytes(range(1, 100))))
    assert (told.code, told.evidence) == ("capture-start", ((0, 99),))
    assert told.detail.startswith("99 bytes at the start that no frame claims: 01 02")
