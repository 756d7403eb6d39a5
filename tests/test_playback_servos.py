"""``sniffer replay --as servos``: a controller talks to the servos of a recording."""

from __future__ import annotations

import json
import subprocess
import sys
from functools import cache
from typing import TYPE_CHECKING, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

import sniffer
from sniffer.decoding.options import Options
from sniffer.decoding.pipeline import Pipeline
from sniffer.decoding.rows import FrameRow
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.playback.exchanges import ExchangeSink, PlayedReply, RecordedExchange, RequestKey
from sniffer.playback.recollection import LATELY, Ground, Recollection
from sniffer.playback.servos import RecordedServos
from sniffer.protocols import PROTOCOLS
from sniffer.sources import open_source
from tests.commands import COMMAND, environment
from tests.lists import in_turn
from tests.playbacks import CLEAN, DAMAGED, playing, wait_for_recorder
from tests.simulations import DEADLINE_S, ear
from tests.streams.mightyzap import packet as zap

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from sniffer.playback.servos import ServoAnswers

ASKED: Final = 60
"""Requests that a controller asks in a row."""

SOME: Final = 450
"""Requests among which there are some of everything that can go wrong."""

CONTROLLER: Final = """
import json, sys
import serial

for port, talk in json.load(sys.stdin).items():
    with serial.Serial(port, 115200, timeout=60) as line:
        for request, answer in talk:
            line.write(bytes.fromhex(request))
            heard = line.read(len(answer) // 2)
            assert heard.hex() == answer, (request, heard.hex(), answer)
"""
"""A controller as people write them."""

EVERY_PROTOCOL = pytest.mark.parametrize("name", PROTOCOLS)


def exchanges_of(source: Path, name: str) -> ExchangeSink:
    sink = ExchangeSink()
    pipeline = Pipeline(Options(protocol=name), [sink])
    for group in open_source(source):
        pipeline.feed(group)
    pipeline.close()
    pipeline.finish()
    return sink


def answering(sink: ExchangeSink, name: str) -> RecordedServos:
    return RecordedServos(
        PROTOCOLS[name], sink.buses["bus0"], baud=sink.bauds["bus0"], carried=False, models={}
    )


def asked(servos: RecordedServos, requests: Iterable[bytes]) -> list[list[tuple[int, bytes]]]:
    """Ask a second apart; return what is said to each: how long after the request, and bytes."""
    out = []
    for nth, raw in enumerate(requests, 1):
        said = servos.hear(raw, nth * 10 * NS)
        (request,) = (s.frame for s in said if not s.ours)
        assert request.wire == raw
        replies = [s.frame for s in said if s.ours]
        out.append([(f.t_start_ns - request.t_end_ns, f.wire) for f in replies])
    return out


# --- a conversation ----------------------------------------------------------------------------


@cache
def frames_of(name: str) -> list[tuple[str, str]]:
    """Return the frames of a capture: kind and bytes."""
    rows = sniffer.decode(CLEAN[name], name)
    return [(row.kind, row.hex) for row in rows if isinstance(row, FrameRow)]


def talk_of(name: str) -> list[tuple[str, str]]:
    """Return the first requests of a capture, each with all that comes before the next."""
    out: list[tuple[str, str]] = []
    for kind, data in frames_of(name):
        if kind == "request":
            if len(out) == ASKED:
                break
            out.append((data, ""))
        else:
            out[-1] = (out[-1][0], out[-1][1] + data)
    return out


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """Have a controller of its own process ask the servos of all captures; record all of it."""
    path = tmp_path_factory.mktemp("talks") / "talks.mcap"
    talks = {name: talk_of(name) for name in PROTOCOLS}
    frames = sum(1 + bool(answer) for talk in talks.values() for _, answer in talk)
    with (
        playing(CLEAN["mightyzap"], "mightyzap") as zap_,
        playing(CLEAN["lss"], "lss") as lss,
        playing(CLEAN["wck"], "wck") as wck,
        playing(CLEAN["rs30x"], "rs30x") as rs30x,
    ):
        played = {"mightyzap": zap_, "lss": lss, "wck": wck, "rs30x": rs30x}
        taps = [f"{name}={one.names['tap']}={name}" for name, one in played.items()]
        recorder = subprocess.Popen(
            [*COMMAND, "record", "-q", *taps, "--frames", str(frames), "-o", str(path)],
            env=environment(),
        )
        try:
            for one in played.values():
                wait_for_recorder(one.names["tap"])
            subprocess.run(
                [sys.executable, "-c", CONTROLLER],
                input=json.dumps({one.names["bus"]: talks[n] for n, one in played.items()}),
                text=True,
                check=True,
                timeout=DEADLINE_S,
            )
            recorder.wait(DEADLINE_S)
        finally:
            recorder.kill()
            recorder.wait()
        for one in played.values():
            assert one.end().as_recorded
    out: dict[str, list[str]] = {name: [] for name in PROTOCOLS}
    for row in sniffer.decode(path):
        if isinstance(row, FrameRow):
            out[row.bus].append(row.hex)
    return out


@in_turn(2)
@EVERY_PROTOCOL
def test_a_controller_hears_what_was_recorded_and_so_does_a_tap(
    recorded: dict[str, list[str]], name: str
) -> None:
    frames = [data for _, data in frames_of(name)]
    assert len(recorded[name]) > ASKED
    assert recorded[name] == frames[: len(recorded[name])]


# --- what is said to what ----------------------------------------------------------------------


@in_turn(2)
@EVERY_PROTOCOL
def test_a_damaged_recording_answers_as_it_did_with_all_that_was_torn_and_missing(
    name: str,
) -> None:
    sink = exchanges_of(DAMAGED[name], name)
    every = sink.buses["bus0"] = sink.buses["bus0"][:SOME]
    servos = answering(sink, name)
    torn = missing = 0
    for one, replies in zip(every, asked(servos, (one.raw for one in every)), strict=True):
        assert [data for _, data in replies] == [reply.data for reply in one.replies]
        for (delay, _), reply in zip(replies, one.replies, strict=True):
            assert delay >= reply.delay_ns
        missing += one.waits and not one.replies
        torn += any(len(r.data) < 2 for r in one.replies) or len(one.replies) > 1
    assert missing
    assert torn
    told = servos.answers
    assert told.missing == missing
    assert told.answered + told.missing + told.unanswerable == len(every)
    assert not told.unknown


def one(raw: bytes, *replies: bytes, key: int = 0, delay_ns: int = 0) -> RecordedExchange:
    said = [PlayedReply(delay_ns, reply) for reply in replies]
    return RecordedExchange(raw, RequestKey(1, key, -1, 0), "op", True, 0, 0, said)


def answers_to(recorded: Sequence[RecordedExchange], *requests: bytes) -> list[bytes | None]:
    """Return what is recalled to requests of one key."""
    recollection = Recollection(recorded)
    found = (recollection.find(raw, RequestKey(1, 0, -1, 0)) for raw in requests)
    return [None if f is None else b"".join(r.data for r in f.exchange.replies) for f in found]


@given(st.lists(st.sampled_from([b"a", b"b", b"c"]), min_size=1, max_size=20), st.integers(1, 3))
def test_whoever_asks_in_the_recorded_order_is_told_what_was_told_lap_after_lap(
    asked_: list[bytes], laps: int
) -> None:
    recorded = [one(raw, b"%d" % nth) for nth, raw in enumerate(asked_)]
    expected = [b"%d" % nth for nth in range(len(asked_))] * laps
    assert answers_to(recorded, *asked_ * laps) == expected


AB: Final = [one(b"a", b"a0"), one(b"b", b"b1"), one(b"a", b"a2"), one(b"b", b"b3")]


def test_who_leaves_requests_out_goes_on_at_the_same_place_in_time() -> None:
    assert answers_to(AB, b"a", b"a", b"b") == [b"a0", b"a2", b"b3"]


def test_the_first_request_may_stand_anywhere_in_the_recording() -> None:
    assert answers_to(AB, b"b", b"a", b"b") == [b"b1", b"a2", b"b3"]


def test_who_asks_one_thing_only_gets_its_answers_round_and_round() -> None:
    assert answers_to(AB, *[b"b"] * 5) == [b"b1", b"b3", b"b1", b"b3", b"b1"]


def test_what_was_asked_once_at_the_start_is_answered_later_and_moves_nothing() -> None:
    recorded = [one(b"id", b"7"), *(one(b"p", b"%d" % nth) for nth in range(9))]
    said = answers_to(recorded, b"p", b"p", b"id", b"id", b"p", b"id", b"p")
    assert said == [b"0", b"1", b"7", b"7", b"2", b"7", b"3"]


def test_a_request_that_is_asked_no_more_lets_the_recording_go_round() -> None:
    recorded = [one(b"p", b"0"), one(b"p", b"1"), one(b"q", b"q"), one(b"q", b"q")]
    said = answers_to(recorded, b"p", b"q", *[b"p"] * (LATELY + 2))
    assert said[:3] == [b"0", b"q", b"1"]
    assert said[-2:] in ([b"0", b"1"], [b"1", b"0"])


def test_other_contents_get_the_reply_that_was_the_last_one_by_then() -> None:
    recorded = [one(b"w1", b"x"), one(b"w2"), one(b"w3", b"y"), one(b"p", b"p", key=1)]
    assert answers_to(recorded, b"w9", b"w3", b"w9") == [b"x", b"y", b"y"]
    recollection = Recollection(recorded)
    found = recollection.find(b"w9", RequestKey(1, 0, -1, 0))
    assert found is not None
    assert found.ground == Ground.ALIKE
    assert recollection.find(b"w9", RequestKey(2, 0, -1, 0)) is None


# --- what is told ------------------------------------------------------------------------------


LOAD_9: Final = "FF FF FF 09 04 F2 8C 02 72"
RESET_1: Final = "FF FF FF 01 03 F6 03 02"


def listened(*requests: bytes) -> ServoAnswers:
    servos = answering(exchanges_of(CLEAN["mightyzap"], "mightyzap"), "mightyzap")
    asked(servos, requests)
    return servos.answers


def test_what_was_never_asked_is_told_by_its_kind_and_left_without_answer() -> None:
    unheard = zap(9, 0xF2, b"\x8c\x02")
    told = listened(unheard, zap(1, 0xF1), unheard, zap(1, 0xF6, b"\x03"))
    assert told.lines() == [
        "1 request answered as recorded",
        f"never asked in the recording: load_data of servo 9 at 0x8c: 2 times, as {LOAD_9}",
        f"never asked in the recording: factory_reset of servo 1: 1 times, as {RESET_1}",
    ]


def test_a_write_of_another_value_is_answered_and_one_to_all_needs_no_answer() -> None:
    goals = zap(254, 0x73, b"\x86\x02\x01\x0a\x00\x02\x0b\x00\x03\x0c\x00")
    speed = zap(1, 0xF3, b"\x15\x39\x30")
    told = listened(zap(1, 0xF3, b"\x80\x00"), goals, speed)
    assert (told.alike, told.unanswerable, len(told.unknown)) == (1, 1, 1)


def test_bytes_of_nobody_are_counted_and_frames_behind_them_answered() -> None:
    servos = answering(exchanges_of(CLEAN["mightyzap"], "mightyzap"), "mightyzap")
    said = servos.hear(b"\x01\x02" + zap(1, 0xF1), NS)
    assert [s.frame.wire for s in said if s.ours] == [zap(1, 0)]
    assert servos.answers.noise_bytes == 2


def test_a_request_may_come_in_pieces() -> None:
    servos = answering(exchanges_of(CLEAN["mightyzap"], "mightyzap"), "mightyzap")
    request = zap(1, 0xF1)
    assert servos.hear(request[:4], NS) == []
    said = servos.hear(request[4:], NS + 1000)
    assert [s.frame.wire for s in said] == [request, zap(1, 0)]


def test_with_echo_the_controller_hears_itself_and_the_tap_both_once() -> None:
    request, answer = zap(1, 0xF1), zap(1, 0)
    with (
        playing(CLEAN["mightyzap"], "mightyzap", echo=True) as it,
        ear(it.names["tap"]) as tap,
        ear(it.names["bus"]) as controller,
    ):
        assert controller.ask(request, answer=len(request + answer)) == request + answer
        assert tap.listen(until=len(request + answer)) == request + answer


def test_an_echo_in_the_recording_is_no_request_of_its_own() -> None:
    request, answer = zap(1, 0xF1), zap(1, 0)
    data = (request + request + answer) * 12
    sink = ExchangeSink()
    pipeline = Pipeline(Options(protocol="mightyzap"), [sink])
    pipeline.feed([Chunk(data, 10 * NS, Clock.FILE)])
    pipeline.close()
    assert sink.echoes == {"bus0": 12}
    assert [e.raw for e in sink.buses["bus0"]] == [request] * 12
    assert all([r.data for r in e.replies] == [answer] for e in sink.buses["bus0"])
