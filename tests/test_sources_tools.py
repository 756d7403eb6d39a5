"""Logs of other tools: the bytes, the times within what is stated, and damage in one line."""

from __future__ import annotations

import contextlib
import gzip
import io
import random
import sys
import time
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.pacing import pace
from sniffer.ground.codes import OK
from sniffer.ground.model import Batch, DamagedInputError, Direction, MarkKind, SnifferError
from sniffer.protocols import PROTOCOLS
from sniffer.sources import open_source
from sniffer.sources.text import LONGEST_LINE
from tests import toollogs
from tests.commands import within
from tests.inputs import BUS, SAMPLES, chunks, notes, read, until_damage
from tests.toollogs import BYTE_NS, FORMAT, MS, RX, TX, WRITERS, Said, conversation

if TYPE_CHECKING:
    from pathlib import Path

TALK: Final = conversation()
WHOLE: Final = b"".join(said.data for said in TALK)
LOGS: Final = {name: write(TALK) for name, write in WRITERS.items()}
EVERY: Final = pytest.mark.parametrize("name", WRITERS)


def decoded(log: bytes, baud: int | None = None) -> list[Batch]:
    """Return what comes of a log, timed as a command times it."""
    told = chunks(log)
    timed = pace(PROTOCOLS["mightyzap"], told, baud=baud)
    decoder = Decoder(
        "mightyzap",
        baud=timed.baud,
        latency_ns=timed.latency_ns,
        slowest=timed.slowest,
        doubtful=timed.doubtful,
    )
    return [decoder.feed(*told), decoder.close()]


# --- bytes ------------------------------------------------------------------------------------


@EVERY
def test_a_log_is_recognised_by_its_content_also_packed_and_in_a_pipe(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    log = LOGS[name]
    (tmp_path / "log.bin").write_bytes(log)
    for given_as in (log, gzip.compress(log), zstandard.compress(log), tmp_path / "log.bin"):
        source = open_source(given_as)
        assert source.format == FORMAT[name]
        assert b"".join(c.data for group in source for c in group) == WHOLE
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(log)))
    assert b"".join(c.data for group in open_source("-") for c in group) == WHOLE


@EVERY
def test_a_log_gives_the_frames_that_the_same_bytes_give_as_a_candump_log(name: str) -> None:
    def told(log: bytes) -> list[tuple[int, ...]]:
        f = decoded(log)[0].frames
        columns = (f.start, f.length, f.kind, f.servo_id, f.op, f.address)
        return list(zip(*(c.tolist() for c in columns), strict=True))

    assert told(LOGS[name]) == told(toollogs.candump(TALK))
    assert len(told(LOGS[name])) == len(TALK)


@EVERY
@given(st.lists(st.binary(min_size=1, max_size=40), min_size=1, max_size=8))
def test_any_bytes_come_back(name: str, said: list[bytes]) -> None:
    at, talk = toollogs.BEGUN_NS, []
    for n, data in enumerate(said):
        talk.append(Said(at, at + len(data) * BYTE_NS, data, RX if n % 2 else TX))
        at += 20 * MS
    for log in (WRITERS[name](talk), WRITERS[name](talk).replace(b"\n", b"\r\n")):
        assert read(log, FORMAT[name]) == b"".join(said)


@pytest.mark.parametrize("named", ["socat-x.txt", "pyserial-spy.txt"])
def test_a_sample_that_its_tool_wrote_is_read(named: str) -> None:
    got = read(SAMPLES / named)
    assert got == (BUS[28:] * 2 if "socat" in named else BUS[10:])


def test_what_is_none_of_the_log_between_its_lines_is_left_out_and_told() -> None:
    log = LOGS["socat -x -v"].replace(b"--\n", b"--\nmy program says hello\n", 3)
    talk = b"2026/11/20 22:55:15 socat[10135] W exiting on signal 15\n"
    assert read(talk + log + talk) == WHOLE
    assert "3 lines" in notes(talk + log + talk)
    lines = LOGS["spy"].splitlines(keepends=True)
    log = b"".join([lines[0], b"INFO: moving\n", *lines[1:]])
    assert read(log) == WHOLE
    assert "1 line between is none" in notes(log)


def test_what_a_program_says_before_spy_does_is_left_out() -> None:
    log = b"opening\nready.\n" + toollogs.spy(TALK, color=True)
    assert (open_source(log).format, read(log)) == ("spy", WHOLE)
    assert "2 lines" in notes(log)


def test_colours_of_spy_are_no_bytes() -> None:
    log = toollogs.spy(TALK, color=True)
    assert open_source(log).format == "spy"
    assert read(log) == WHOLE


# --- directions -------------------------------------------------------------------------------


@pytest.mark.parametrize("sides", ["><", "<>"])
def test_the_controllers_side_is_told_by_its_frames_whatever_the_log_calls_it(sides: str) -> None:
    log = toollogs.socat_x(TALK, sides)
    assert [c.direction for c in chunks(log)] == [s.wire for s in TALK]
    assert ("comes from the controller" in notes(log)) == (sides == "<>")
    assert not any("direction-mismatch" in a.code for b in decoded(log) for a in b.anomalies)


def test_where_frames_do_not_tell_the_sides_no_direction_is_claimed() -> None:
    odd = [said._replace(wire=TX if n % 4 in (0, 3) else RX) for n, said in enumerate(TALK)]
    log = toollogs.socat_x(odd)
    assert {c.direction for c in chunks(log)} == {Direction.UNKNOWN}
    assert "do not tell" in notes(log)


# --- times ------------------------------------------------------------------------------------


@EVERY
@pytest.mark.parametrize("took_ms", [0.3, 4])
def test_the_true_times_are_within_what_is_stated_and_no_servo_is_late(
    name: str, took_ms: float
) -> None:
    talk = conversation(20, round(took_ms * MS))
    first_ns = 0 if name.startswith(("socat", "jpnevulator", "docklight")) else toollogs.BEGUN_NS
    first_ns -= toollogs.BEGUN_NS % toollogs.DAY_NS if name in toollogs.OF_THE_DAY else 0
    truth_begun = np.array([s.begun_ns for s in talk]) - first_ns
    truth_over = np.array([s.over_ns for s in talk]) - first_ns
    for baud in (None, toollogs.BAUD):
        batches = decoded(WRITERS[name](talk), baud)
        f, t = batches[0].frames, batches[0].transactions
        assert len(f) == len(talk)
        known = f.uncertainty >= 0
        assert known.any() == (name not in toollogs.FIRST_ONLY)
        close = 50_000  # what the tools round to
        late = f.t_end - truth_over
        early = f.t_start - truth_begun
        for off in (late[known], early[known]):
            assert (np.abs(off) <= f.uncertainty[known] + close).all()
        told = t.uncertainty_ns >= 0
        wrong = t.response_time_ns - (truth_begun[1] - truth_over[0])
        assert (np.abs(wrong)[told] <= t.uncertainty_ns[told] + close).all()
        assert (t.outcome == OK).all()
        codes = {a.code for b in batches for a in b.anomalies}
        assert not codes & {"late-response", "clock-step", "no-response"}


@pytest.mark.parametrize("name", ["socat -x", "spy"])
def test_a_program_that_asked_bounds_the_rate_and_what_its_adapter_held_back(name: str) -> None:
    told = chunks(LOGS[name])  # an answer within a millisecond
    timed = pace(PROTOCOLS["mightyzap"], told)
    assert timed.baud == toollogs.BAUD
    assert timed.slowest >= (38400 if name == "spy" else 57600)  # of spy:// a millisecond is open
    held = pace(PROTOCOLS["mightyzap"], told, baud=toollogs.BAUD).latency_ns
    assert held is None or held <= 3 * MS
    far = pace(PROTOCOLS["mightyzap"], chunks(WRITERS[name](conversation(took_ns=15 * MS))))
    assert 15 * MS <= (far.latency_ns or 0) <= 19 * MS  # a timer of 16 ms may have done that


def test_nine_digits_of_socat_are_microseconds_and_six_are_too() -> None:
    t = [c.t_ns for c in chunks(LOGS["socat -x"])]
    assert t[0] == TALK[0].begun_ns // 1000 * 1000
    six = LOGS["socat -x"].replace(b".000", b".")
    assert [c.t_ns for c in chunks(six)] == t
    head = b"> 2026/11/20 22:55:17.%s  length=1 from=%d to=%d\n ff\n"
    log = head % (b"000158397", 0, 0) + head % (b"100158397", 1, 1)
    assert [(c.t_ns or 0) % 10**9 for c in chunks(log)] == [158_397, 100_158_397]


def test_only_the_first_byte_of_a_block_of_jpnevulator_has_a_time_and_pauses_are_not_drawn() -> (
    None
):
    got = chunks(LOGS["jpnevulator"])
    assert [(c.t_ns is not None, len(c.data)) for c in got] == [(True, 1), (False, len(WHOLE) - 1)]
    late = [s._replace(begun_ns=s.begun_ns + n // 2 * MS * 200) for n, s in enumerate(TALK)]
    apart = [s._replace(begun_ns=s.begun_ns + n * MS * 150) for n, s in enumerate(late)]
    batches = decoded(toollogs.jpnevulator(apart, ascii_too=False))
    assert (batches[0].transactions.outcome == OK).all()


def test_a_port_of_jpnevulator_is_a_bus() -> None:
    log = LOGS["jpnevulator"]
    log += b"2027-01-01 00:00:00.000001: /dev/ttyS1\nFF FF\n"
    assert [c.bus for c in chunks(log)] == ["bus0", "bus0", "/dev/ttyS1", "/dev/ttyS1"]


def test_a_byte_count_of_jpnevulator_is_no_byte_and_betrays_a_missing_line() -> None:
    head = b"2027-01-01 00:00:00.000001:\n"
    rows = [b"00000000\t41 42\tAB\n", b"00000002\t43\tC\n", b"00000003\t44\tD\n"]
    assert read(head + b"".join(rows)) == b"ABCD"
    got, message = until_damage(head + rows[0] + rows[2])
    assert (got, "00000002 is due" in message) == (b"AB", True)


def test_a_write_that_pyserial_shows_on_several_lines_is_one_chunk() -> None:
    data = bytes(range(256)) * 2
    said = Said(toollogs.BEGUN_NS, toollogs.BEGUN_NS, data, TX)
    log = toollogs.spy([said])
    assert [c.data for c in chunks(log)] == [data]
    got, message = until_damage(log.replace(b"0100  ", b"0110  "), "spy")
    assert got == data[:256]
    assert "offset 0110 does not go on from 0100" in message


def test_a_break_is_a_mark_and_an_emptied_input_is_told() -> None:
    lines = LOGS["spy"].splitlines(keepends=True)
    lines.insert(2, b"000000.030 BRK  send_break 0.25s\n000000.031 Q-RX reset_input_buffer\n")
    log = b"".join(lines)
    assert next(m.kind for m in chunks(log)[2].marks) == MarkKind.BREAK
    assert "emptied its input once" in notes(log)


# --- what is lost, damaged or claimed ---------------------------------------------------------


def test_bytes_that_socat_counted_and_the_log_has_not_are_a_hole() -> None:
    blocks = LOGS["socat -x"].split(b"> ")
    log = b"> ".join([*blocks[:5], *blocks[7:]])  # two questions and their answers
    got = chunks(log)
    assert b"".join(c.data for c in got) == WHOLE[: 8 * 9] + WHOLE[12 * 9 :]
    lost = [m.count for c in got for m in c.marks if m.kind == MarkKind.OVERRUN]
    assert lost == [18, 18]
    assert "36 bytes are missing in 2 places" in notes(log)


def test_a_lost_answer_is_not_laid_to_the_servo() -> None:
    lines = LOGS["socat -x"].splitlines(keepends=True)
    log = b"".join(lines[:22] + lines[24:])
    batches = decoded(log)
    codes = [a.code for b in batches for a in b.anomalies]
    assert codes.count("bytes-lost") == 1
    assert "no-response" not in codes


@EVERY
def test_a_log_is_read_as_far_as_it_goes_wherever_it_is_cut_off(name: str) -> None:
    log = LOGS[name][:500]
    for end in range(len(log) // 2, len(log), 7):
        try:
            got = read(log[:end], FORMAT[name])
        except DamagedInputError as error:
            pytest.fail(f"cut at {end}: {error}")
        assert WHOLE.startswith(got), end


@EVERY
def test_a_line_of_nonsense_further_in_is_damage_and_what_came_before_is_kept(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = LOGS[name].splitlines(keepends=True)
    at = len(lines) * 3 // 4
    at += name == "socat -x -v" and lines[at].startswith(b"-")
    lines[at] = toollogs.NONSENSE.get(name, b"   \xff12 what is this\n")
    (tmp_path / "log").write_bytes(b"".join(lines))
    ran = within(capsys, "decode", tmp_path / "log", "--protocol", "mightyzap")
    assert ran.status == 3
    assert f"line {at + 1}" in ran.err
    assert "Traceback" not in ran.err
    got, _ = until_damage(b"".join(lines))
    assert WHOLE.startswith(got)
    assert len(got) > len(WHOLE) // 2


@EVERY
@given(st.integers(0, 2**32))
def test_random_harm_never_ends_in_anything_but_our_own_errors(name: str, seed: int) -> None:
    rng = random.Random(seed)
    log = bytearray(LOGS[name])
    for _ in range(rng.choice((1, 1, 3, 8))):
        at = rng.randrange(len(log))
        log[at : at + rng.choice((0, 1, 20))] = rng.choice(
            (rng.randbytes(3), b"9" * 30, b"\n", b"\t", b'"', b"-", b"0000-00-00 99:99:99", b"\xc3")
        )
    with contextlib.suppress(SnifferError):
        read(bytes(log), rng.choice(("auto", FORMAT[name])))


@EVERY
def test_what_stands_in_front_of_an_endless_line_is_kept(name: str) -> None:
    got, message = until_damage(LOGS[name] + b"x" * (LONGEST_LINE + 1))
    assert got == WHOLE
    assert "is no dump" in message


def test_quotes_that_make_no_sense_are_damage() -> None:
    table = LOGS["saleae 2"] + b'"A","data",1.0,8e-5,"0x\r01",\n'
    assert until_damage(table)[0] == WHOLE


@pytest.mark.parametrize(
    "claim",
    [
        b"> 2026/11/20 22:55:17.000158  length=99999999999 from=0 to=99999999998\n ff\n" * 2,
        b"> 2026/11/20 22:55:17.000158  length=1 from=%d to=%d\n ff\n" * 2 % (0, 0, 9**17, 9**17),
        b"000000.003 TX   0000  FF \n000000.003 TX   FFFFFFFFFF  FF \n",
        b"2027-01-01 00:00:00.000001:\n00000000\t41 42\nFFFFFFFFFFFF\t43\n",
        b"name,type,start_time,duration,data\nA,data,1e300,1e300,0x01\n",
        b"name,type,start_time,duration,data\nA,data,0.1,1e9,0x01\n",
        b"Time [s],Value,Parity Error,Framing Error\n9999999999,0x01,,\n",
    ],
)
def test_what_a_log_claims_costs_nothing(
    claim: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "log").write_bytes(claim)
    begun = time.process_time()
    ran = within(capsys, "decode", tmp_path / "log", "--protocol", "mightyzap")
    assert time.process_time() - begun < 1
    assert ran.status in (2, 3)
    assert len([x for x in ran.err.splitlines() if "line " in x]) == 1


def at_night(form: str, *times: str) -> bytes:
    """Return a log with a byte at each time of the night in which summer time ends."""
    lines = {
        "socat": "> 2026/10/25 {t}.000250000  length=1 from={n} to={n}\n ff\n",
        "jpnevulator": "2026-10-25 {t}.250000:\nFF\n",
        "docklight": "25.10.2026 {t}.250 [TX] - FF\n",
    }
    return "".join(lines[form].format(t=t, n=n) for n, t in enumerate(times)).encode()


@pytest.mark.parametrize("form", ["socat", "jpnevulator", "docklight"])
def test_times_go_on_where_summer_time_ends(form: str) -> None:
    log = at_night(form, "02:59:58", "02:59:59", "02:00:00", "02:00:00", "02:59:59", "03:00:00")
    begun = chunks(log)[0].t_ns or 0
    after = [((chunk.t_ns or 0) - begun) // (1000 * MS) for chunk in chunks(log)]
    assert after == [0, 1, 2, 2, 3601, 3602]
    assert "goes back an hour at a full hour, as summer time ends" in notes(log)


@pytest.mark.parametrize("form", ["socat", "jpnevulator", "docklight"])
@pytest.mark.parametrize(
    "times", [("02:50:00", "01:50:00"), ("02:59:59", "01:30:00"), ("02:59:59", "02:30:00")]
)
def test_a_clock_that_was_set_back_is_taken_at_its_word(form: str, times: tuple[str, str]) -> None:
    log = at_night(form, *times)
    first, second = (chunk.t_ns or 0 for chunk in chunks(log))
    assert second < first
    assert "summer time" not in notes(log)
