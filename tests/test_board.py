"""The live board: it fits, it is true, and nothing on it steers the terminal."""

from __future__ import annotations

import dataclasses
import io
import pickle
import random
import re
from typing import TYPE_CHECKING, Final

import pytest
from rich.cells import cell_len

from sniffer.decoding.decoder import Decoder
from sniffer.diagnosis.tracking import Tracked
from sniffer.ground.codes import NO_RESPONSE
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import BUSES
from sniffer.tap.status import BusStatus
from sniffer.viewers.board.board import Board
from sniffer.viewers.board.cells import told_value
from sniffer.viewers.board.line import line, statistics
from sniffer.viewers.board.state import QUANTITIES
from sniffer.viewers.screen import LINE, Screen
from tests.happenings import finding, incident
from tests.lists import each_in_turn, in_turn
from tests.streams.mightyzap import packet
from tests.wires import START_NS, feed, lines_of, shown_by, status_of, wire

if TYPE_CHECKING:
    from collections.abc import Sequence

SIZES: Final = ((80, 24), (140, 40), (200, 50), (60, 12), (33, 5))


def row_of(lines: Sequence[str], servo: int) -> str:
    """Return the row of a servo, of the first bus that has one."""
    return next(one for one in lines if re.match(rf" *{servo} .*\d\.\d", one))


EIGHT: Final = tuple((f"bus{n}", name) for n, name in enumerate(tuple(BUSES) * 2))


@in_turn(6)
@pytest.mark.parametrize(("width", "height"), SIZES)
@pytest.mark.parametrize("servos", [3, 12])
@pytest.mark.parametrize("protocol", BUSES)
def test_a_board_fits(protocol: str, servos: int, width: int, height: int) -> None:
    w = wire("arm", protocol, servos)
    lines = lines_of(shown_by(w), status_of(w.status()), width, height)
    assert len(lines) <= height
    assert max(map(cell_len, lines)) <= width
    if width >= 80:
        assert lines[-1].endswith("Ctrl-C stops")
        for servo in range(1, servos + 1):
            assert row_of(lines, servo)


@each_in_turn(2, ("width", "height"), SIZES)
def test_what_does_not_fit_is_counted_and_what_is_in_trouble_comes_first(
    width: int, height: int
) -> None:
    wires = [wire(name, protocol, 8, 2) for name, protocol in EIGHT]
    board = shown_by(*wires)
    lines = lines_of(board, status_of(*(w.status() for w in wires)), width, height)
    assert len(lines) <= height
    assert max(map(cell_len, lines)) <= width
    if width < 80:
        return
    blocks: dict[str, list[str]] = {}
    for one in lines:
        if one.startswith("bus"):
            rows = blocks[one.split()[0]] = list[str]()
        elif one.startswith("..."):
            break
        elif blocks:
            rows.append(one.split()[0])
    assert list(blocks) == [w.name for w in wires]
    more = int(one.removeprefix("... and ").split()[0])
    there = {name: board.buses[name].servos for name in blocks}
    assert more + sum(map(len, blocks.values())) == sum(map(len, there.values()))
    silent = [
        name for name, servos in there.items() if servos.missing[list(servos.servo_id).index(1)]
    ]
    assert silent
    assert all("1" in blocks[name] for name in silent), "the servo that does not answer is shown"


def test_more_buses_than_lines_are_counted() -> None:
    wires = [wire(name, protocol, 8, 2) for name, protocol in EIGHT]
    buses = [w.status("away" if w.name == "bus6" else "listening") for w in wires]
    quiet = Board()
    lines = lines_of(quiet, status_of(*buses), 80, 7)
    assert len(lines) == 7
    assert any(one.startswith("bus6") for one in lines)
    assert any("more buses" in one for one in lines)


@in_turn(4)
@pytest.mark.parametrize("width", [80, 140])
@pytest.mark.parametrize("protocol", BUSES)
def test_the_last_values_are_shown_with_their_units(protocol: str, width: int) -> None:
    w = wire("arm", protocol)
    lines = lines_of(shown_by(w), status_of(w.status()), width, 40)
    registers = PROTOCOLS[protocol].registers
    last: dict[tuple[int, str], str] = {}
    for batch in w.batches:
        v = batch.samples
        for who, n, raw, value, part in zip(
            v.servo_id, v.register, v.raw, v.value, v.part, strict=True
        ):
            if registers[n].quantity in QUANTITIES and not part:
                last[int(who), registers[n].quantity] = told_value(
                    registers[n], int(raw), float(value)
                )
    for servo in (1, 2, 3):
        row = row_of(lines, servo)
        mine = {quantity: text for (who, quantity), text in last.items() if who == servo}
        assert {"goal_position", "position"} <= mine.keys()
        if "load" in mine:
            mine.pop("current", None)
        for quantity, text in mine.items():
            assert f" {text} " in row, quantity


@pytest.mark.parametrize("protocol", BUSES)
def test_missing_replies_are_counted(protocol: str) -> None:
    w = wire("arm", protocol)
    status = status_of(w.status())
    missing = {1: 0, 2: 0, 3: 0}
    for batch in w.batches:
        t = batch.transactions
        for request in t.request[t.outcome == NO_RESPONSE].tolist():
            missing[int(batch.frames.servo_id[request])] += 1
    assert missing[1] > 3
    lines = lines_of(shown_by(w), status, 80, 24)
    for servo, count in missing.items():
        assert re.search(rf"\b{count}( +<?\d+%)? *$", row_of(lines, servo).rstrip())
    assert f" missing={sum(missing.values())} " in line(status, shown_by(w))


def test_bytes_are_accounted_for_also_those_the_screen_left_out() -> None:
    w = wire("arm", "mightyzap")
    gaps = sum(g.length for batch in w.batches for g in batch.gaps)
    told = f"{w.bytes} bytes = {w.bytes - gaps} in frames + {gaps} in gaps"
    assert any(told in one for one in lines_of(shown_by(w), status_of(w.status()), 80, 24))
    lost = len(w.batches[20].data)
    less = dataclasses.replace(w, batches=[*w.batches[:20], *w.batches[21:]])
    lines = lines_of(shown_by(less), status_of(w.status()), 140, 24)
    assert lost
    assert any(f"{w.bytes} bytes = " in one and f"{lost} left out" in one for one in lines)


def test_the_load_is_that_of_the_line_and_nothing_when_it_is_silent() -> None:
    w = wire("arm", "rs30x")
    board, now_ns = shown_by(w), START_NS + 6 * NS
    recent = [k for group in w.groups for k in group if now_ns - (k.t_ns or 0) < 2 * NS]
    busy = 100 * 10 * sum(len(k.data) for k in recent) / BUSES["rs30x"].baud / 2
    status = status_of(w.status())
    assert board.load(status.buses[0], board.end_ns(status)) == pytest.approx(busy, rel=0.06)
    silent = status_of(w.status("silent"), late_ns=5 * NS)
    assert " load.arm=0.0 " in line(silent, board)
    assert any("silent" in one for one in lines_of(board, silent, 80, 24))


def test_more_bytes_than_a_line_can_carry_are_no_load() -> None:
    w = wire("arm", "rs30x")
    board, status = shown_by(w), status_of(w.status())
    slow = status_of(dataclasses.replace(status.buses[0], baud=9600))
    assert board.load(slow.buses[0], board.end_ns(slow)) > 105
    assert " load.arm=100.0 " in line(slow, board)
    assert any("load >100%  " in one for one in lines_of(board, slow, 120, 24))


def test_old_values_are_dimmed_and_rates_run_out() -> None:
    w = wire("arm", "mightyzap")
    board = shown_by(w)
    fresh = lines_of(board, status_of(w.status()), 80, 24, style=True)
    stale = lines_of(board, status_of(w.status("silent"), late_ns=15 * NS), 80, 24, style=True)
    dim = re.compile(r"\x1b\[2m +\d+\.\d\d mm\x1b")
    assert not any(map(dim.search, fresh))
    assert any(map(dim.search, stale))
    plain = lines_of(board, status_of(w.status("silent"), late_ns=15 * NS), 80, 24)
    assert row_of(plain, 2).split()[11:13] == ["0.0", "-"]


def test_an_alarm_is_red_and_goes_when_it_is_over() -> None:
    board, decoder = Board(), Decoder("mightyzap")
    for error, expected in ((0x20, True), (0, False)):
        for said in (packet(2, 0xF1, b""), packet(2, error, b"")):
            chunk = Chunk(said, START_NS, Clock.READ, "arm")
            board.write("arm", decoder.protocol, decoder.feed(chunk))
        board.write("arm", decoder.protocol, decoder.close())
        bus = BusStatus("arm", "p", 57600, "mightyzap", "listening", 0, 0, 0)
        status = dataclasses.replace(status_of(bus), now_ns=START_NS)
        lines = lines_of(board, status, 80, 24, style=True)
        assert any("\x1b[1;31moverload" in one for one in lines) is expected


def test_a_bus_that_has_not_told_its_protocol_is_listened_to() -> None:
    bus = BusStatus("tail", "/dev/ttyUSB3", 115200, None, "listening", 340, 0, None)
    for width in (80, 140):
        text = "\n".join(lines_of(Board(), status_of(bus), width, 24))
        assert "listening for the protocol" in text
        assert "340 bytes read, none decoded yet" in text
        assert "errors unknown" in text
        assert "no anomalies" in text


def test_numbers_stand_under_each_other_and_do_not_move() -> None:
    w = wire("legs", "rs30x", 12)
    board = Board()
    edges = set()
    for n, batch in enumerate(w.batches):
        board.write(w.name, PROTOCOLS[w.protocol], batch)
        if n % 10 == 9:
            lines = lines_of(board, status_of(w.status()), 80, 24)
            edges |= {one.index("°") for one in lines if re.match(r" *\d+ +-?\d+\.\d°", one)}
    assert len(edges) == 1


HOSTILE: Final = "\x1b]0;owned\x07\x1b[2J\u202eevil\r\n"


@pytest.mark.parametrize("width", [80, 140])
def test_nothing_from_the_wire_or_from_names_steers_the_terminal(width: int) -> None:
    lss = b"#1QD\r*1QD\x1b[2J\r#5\x1b]0;x\x07\r" * 20 + b"#1QMS\r*1QMS\x9b31m\x1b[5n\r" * 20
    board, decoder = Board(), Decoder("lss")
    for part in (decoder.feed(Chunk(lss, START_NS, Clock.READ, HOSTILE)), decoder.close()):
        anomalies = tuple(a._replace(detail=a.detail + HOSTILE) for a in part.anomalies)
        board.write(HOSTILE, decoder.protocol, dataclasses.replace(part, anomalies=anomalies))
    assert board.troubles.severities
    bus = BusStatus(HOSTILE, HOSTILE, 115200, HOSTILE, HOSTILE, 100, 0, 0)
    status = dataclasses.replace(status_of(bus, bus), file=HOSTILE, now_ns=START_NS)
    for height in (24, 8):
        lines = lines_of(board, status, width, height, style=True)
        clean = [re.sub(r"\x1b\[[0-9;]*m", "", one) for one in lines]
        assert all(one.isprintable() for one in clean)
        assert max(map(cell_len, clean)) <= width
    assert line(status, board).isprintable()
    assert all(one.isprintable() for one in statistics(status, board).split("\n"))


def test_the_plain_line_is_keys_and_values_in_one_order() -> None:
    w, v = wire("arm", "mightyzap"), wire("left leg", "lss")
    status = status_of(w.status(), v.status("away"), waiting=7)
    text = line(status, shown_by(w, v))
    keys = [part.partition("=")[0] for part in text.split(" ")]
    expected = (
        "elapsed bytes frames frames_per_s load.arm load.left_leg missing errors warnings notes "
        "incidents lost line_errors silent away waiting not_shown size file"
    )
    assert " ".join(keys) == expected
    values = dict(part.split("=") for part in text.split(" "))
    assert values["bytes"] == str(w.bytes + v.bytes)
    assert values["frames"] == str(sum(len(b.frames) for x in (w, v) for b in x.batches))
    assert float(values["frames_per_s"]) > 10
    assert (values["line_errors"], values["away"], values["waiting"]) == ("unknown", "1", "7")
    assert "\n" not in text


def test_a_bus_that_two_ports_hear_is_one() -> None:
    w = wire("arm", "mightyzap")
    board, heard = shown_by(w), w.status()
    quiet = dataclasses.replace(heard, port="/dev/ttyUSB7", bytes=0, state="silent", line_errors=2)
    one, both = status_of(heard), status_of(heard, quiet)
    assert line(both, board) == line(one, board).replace("unknown", "2")
    for lines in (lines_of(board, both, 140, 24), statistics(both, board).split("\n")):
        assert sum(text.startswith("arm ") for text in lines) == 1
        assert sum(" mm " in text and text.startswith("  2 ") for text in lines) == 1
        assert any("/by-id/arm+ttyUSB7 " in text for text in lines)
    away = dataclasses.replace(quiet, state="away")
    assert " silent=0 away=1 " in line(status_of(heard, away), board)
    still = dataclasses.replace(heard, state="silent")
    assert " silent=1 away=0 " in line(status_of(still, quiet), board)


def test_the_statistics_of_a_bus_that_two_protocols_share_have_the_servos_of_both() -> None:
    board, w = Board(), wire("arm", "mightyzap")
    for batch in w.batches:
        board.write("arm", PROTOCOLS["mightyzap"], dataclasses.replace(batch, is_shared=True))
    status = status_of(w.status())
    told = statistics(status, board).split("\n")
    assert any(text.startswith("arm.mightyz…") for text in told)
    assert row_of(told, 1)


@pytest.mark.parametrize("width", [80, 140])
def test_an_incident_has_a_line_with_its_cause_and_comes_before_what_it_explains(
    width: int,
) -> None:
    board, decoder = Board(), Decoder("mightyzap")
    asked = packet(3, 0xF2, b"\x8c\x02") * 9 + packet(1, 0xF1) + packet(1, 0) + packet(2, 0xF2)
    for part in (decoder.feed(Chunk(asked, START_NS, Clock.READ, "bus0")), decoder.close()):
        board.write("bus0", decoder.protocol, part)
    bus = BusStatus("bus0", "p", 57600, "mightyzap", "listening", 0, 0, 0)
    status = dataclasses.replace(status_of(bus), now_ns=START_NS)
    before = lines_of(board, status, width, 24)
    assert any("the capture ends" in one for one in before)
    told = incident(findings=(finding("no-answer-heard", None), finding("no-response", 3)))
    board.incidents = (Tracked(told, told.cause),)
    lines = lines_of(board, status, width, 24)
    (place,) = (n for n, one in enumerate(lines) if "servo-dead" in one)
    assert "  3  " in lines[place]
    assert "×4" in lines[place]
    assert "87 %" in lines[place]
    assert width < 140 or "silent since" in lines[place]
    assert any("1 open incident" in one for one in lines)
    others = [n for n, one in enumerate(lines) if "the capture ends" in one]
    assert all(n > place for n in others)
    assert "incidents=1 " in line(status, board)
    board.incidents = (*(Tracked(told, told.cause) for _ in range(3)),)
    low = lines_of(board, status, width, 8)
    assert sum("servo-dead" in one for one in low) == 3
    assert not any("the capture ends" in one for one in low), "anomalies give way"
    board.incidents = (Tracked(told, told.cause, is_over=True),)
    assert any("0 open incidents" in one for one in lines_of(board, status, width, 24))


def test_without_a_file_the_board_says_so() -> None:
    w = wire("arm", "mightyzap")
    status = status_of(w.status(), file="", size=0)
    assert "not recorded" in lines_of(shown_by(w), status, 80, 24)[-1]
    assert line(status, shown_by(w)).endswith(" size=0 file=")


def test_a_stream_without_a_file_is_written_to_as_it_is() -> None:
    w, stream = wire("arm", "mightyzap"), io.StringIO()
    with Screen(LINE, lambda: status_of(w.status()), stream=stream) as screen:
        feed(screen, w)
        screen.say("hello")
    assert "sniffer: hello\n" in stream.getvalue()
    assert stream.getvalue().splitlines()[-1].startswith("elapsed=6.0 ")


def test_statistics_have_all_servos() -> None:
    wires = [wire(name, protocol, 8, 2) for name, protocol in EIGHT]
    text = statistics(status_of(*(w.status() for w in wires)), shown_by(*wires))
    rows = [one for one in text.split("\n") if re.match(r" {0,2}\d+ +\S+", one) and ":" not in one]
    assert len(rows) >= 64
    assert "more servo" not in text


def test_memory_does_not_grow_with_time() -> None:
    """Every id there is is asked and only one answers: a tap hears both sides."""
    board, decoder = Board(), Decoder("lss")
    rng = random.Random(1)

    sizes = []
    for n in range(60):
        asked = "".join(f"#{rng.randrange(256)}QD\r" for _ in range(100))
        chunk = Chunk(f"#1QD\r*1QD0\r{asked}".encode(), START_NS + n * NS, Clock.READ, "arm")
        board.raw("arm", [chunk])
        board.write("arm", decoder.protocol, decoder.feed(chunk))
        tally = board.buses["arm"]
        sizes.append(len(pickle.dumps((vars(tally.answers), tally.servos, tally.value))))
    assert len(board.buses["arm"].servos) <= 256
    assert len(board.troubles) <= 64
    assert sum(board.troubles.severities.values()) > 1000
    assert sizes[-1] < 1.05 * sizes[30]
