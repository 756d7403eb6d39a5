"""Keys of the live board: what they show, and a terminal that is given back as it was."""

from __future__ import annotations

import os
import re
import termios
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from rich.cells import cell_len

from sniffer.ground.codes import WHOLE
from sniffer.ground.model import NS, InputError
from sniffer.protocols import PROTOCOLS
from sniffer.selection.selection import Selection
from sniffer.viewers.board.board import STYLES, Board
from sniffer.viewers.board.controls import HELP, SORTED, Controls
from sniffer.viewers.board.watched import selection_in
from sniffer.viewers.keyboard import keys_in
from sniffer.viewers.screen import BOARD, Screen
from tests.commands import within
from tests.lists import in_turn
from tests.terminals import PATIENCE_S
from tests.test_screen import Terminal, end
from tests.test_screen_jobs import Shell, controlled
from tests.wires import Wire, feed, lines_of, status_of, wire

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SIZES: Final = ((80, 24), (140, 40), (60, 12), (33, 5))


class Watching:
    """Somebody who looks at a board and presses keys."""

    def __init__(self, *wires: Wire) -> None:
        self.wires = wires
        self.board = Board()
        self.board.controls = self.controls = Controls()
        self.hear()

    def hear(self) -> None:
        for w in self.wires:
            for chunks in w.groups:
                self.board.raw(w.name, chunks)
            for batch in w.batches:
                self.board.write(w.name, PROTOCOLS[w.protocol], batch)

    def press(self, *keys: str) -> list[str]:
        for key in keys:
            self.controls.press(key, self.board)
        return self.lines()

    def type(self, text: str) -> list[str]:
        return self.press("f", "clear", *("space" if c == " " else c for c in text), "enter")

    def lines(self, width: int = 140, height: int = 40, *, style: bool = False) -> list[str]:
        status = status_of(*(w.status() for w in self.wires))
        return lines_of(self.board, status, width, height, style=style)

    def ids(self) -> list[int]:
        self.lines()
        return [servo for _, servo in self.controls.rows]


@pytest.fixture
def watching() -> Watching:
    return Watching(wire("arm", "mightyzap", 4))


def test_keys_are_known_by_what_a_terminal_sends() -> None:
    sent = "s\x1b[A\x1bOB\r \x7f\x1b[5~\x1b[1;5Cö\x00\x1b"
    assert keys_in(sent) == ["s", "up", "down", "enter", "space", "backspace", "ö", "esc"]


@pytest.mark.parametrize("protocol", ["mightyzap", "lss"])
def test_the_error_is_the_last_goal_less_the_last_position(protocol: str) -> None:
    w = wire("arm", protocol)
    one = Watching(w)
    registers = PROTOCOLS[protocol].registers
    last: dict[tuple[int, str], tuple[float, str]] = {}
    for batch in w.batches:
        v = batch.samples
        for i in np.flatnonzero(v.part == WHOLE).tolist():
            register = registers[v.register[i]]
            told = float(v.value[i]), register.unit
            last[int(v.servo_id[i]), register.quantity] = told
    tally = one.board.buses["arm"]
    for servo, error in zip(tally.servos.servo_id.tolist(), tally.errors().tolist(), strict=True):
        goal, position = last.get((servo, "goal_position")), last.get((servo, "position"))
        if goal is None or position is None or goal[1] != position[1]:
            assert np.isnan(error)
        else:
            assert error == pytest.approx(goal[0] - position[0])
    shown = [row for row in one.lines() if re.match(r" *[123] .* [+-]\d", row)]
    assert shown


def test_servos_are_sorted_by_each_column_and_the_other_way_round(watching: Watching) -> None:
    assert watching.ids() == [1, 2, 3, 4]
    cells = watching.board.rows("arm", status_of(watching.wires[0].status()))
    assert cells is not None
    for column in SORTED[1:]:
        lines = watching.press("s")
        told = {cells.id(row): cells.measure(row, column) for row in cells.order}
        numbers = [told[servo] for servo in watching.ids()]
        known = [n for n in numbers if n == n]
        assert known == sorted(known, reverse=True), column
        assert numbers[: len(known)] == known, "what has no number stands last"
        assert any("greatest first" in line for line in lines)
        watching.press("r")
        numbers = [told[servo] for servo in watching.ids()]
        assert [n for n in numbers if n == n] == sorted(known), column
    watching.press("s")
    assert watching.ids() == [1, 2, 3, 4], "after the last column comes the first one"
    watching.press("r")
    assert watching.ids() == [4, 3, 2, 1]


def test_the_greatest_are_shown_where_not_all_servos_fit() -> None:
    """Those in trouble were, sorted: the greatest error was among those that are counted only."""
    w = wire("arm", "mightyzap", 20, 2)
    one = Watching(w)
    cells = one.board.rows("arm", status_of(w.status()))
    assert cells is not None
    everybody = [cells.id(row) for row in cells.order]
    troubled = [cells.id(row) for row in cells.order if cells.troubled(row)]
    assert troubled

    def seen() -> list[int]:
        lines = one.lines(80, 16)
        assert any(line.startswith("... and ") for line in lines)
        return [servo for _, servo in one.controls.rows]

    assert set(troubled) & set(seen()), "nobody asked for an order: those in trouble are kept"
    one.press("s")
    greatest = [cells.id(row) for row in cells.sorted("error", falls=True)]
    assert 0 < len(seen()) < len(everybody)
    assert seen() == greatest[: len(seen())]
    one.press("r")
    smallest = [cells.id(row) for row in cells.sorted("error", falls=False)]
    assert seen() == smallest[: len(seen())]


@pytest.mark.parametrize(
    ("text", "selection"),
    [
        ("servo=2,3 code=no-response", Selection.of(servos=[2, 3], codes=["no-response"])),
        ("value > 10 AND unit = 'V'", Selection.parse("value > 10 AND unit = 'V'")),
        ("op=store_data", Selection.of(ops=["store_data"])),
        ("   ", None),
    ],
)  # fmt: skip
def test_a_filter_is_words_or_an_expression(text: str, selection: Selection | None) -> None:
    found = selection_in(text)
    assert (found and found.text) == (selection and selection.text)


@pytest.mark.parametrize("text", ["servo=x", "servo_di = 3", "code=never", "nothing=3"])
def test_what_is_no_filter_is_told_and_can_be_mended(text: str, watching: Watching) -> None:
    with pytest.raises(InputError):
        selection_in(text)
    lines = watching.type(text)
    assert watching.controls.complaint
    assert lines[-1].startswith("only: ")
    assert "backspace" not in lines[-1]
    assert watching.board.watched is None
    assert watching.press("esc")[-1].endswith("Ctrl-C stops")


def test_of_a_filter_servos_and_anomalies_are_shown_of_which_something_is_selected(
    watching: Watching,
) -> None:
    watching.type("servo=2")
    assert watching.ids() == [], "what was before is not looked through again"
    watching.hear()
    lines = watching.lines()
    assert watching.ids() == [2]
    assert any("only servo_id = 2" in line for line in lines)
    watching.type("code=no-response")
    watching.hear()
    found = {
        anomaly.servo_id
        for w in watching.wires
        for batch in w.batches
        for anomaly in batch.anomalies
        if anomaly.code == "no-response"
    }
    assert set(watching.ids()) == found
    assert {one.last.code for one in watching.board.watched.troubles} == {"no-response"}  # type: ignore[union-attr]
    watching.type("")
    assert watching.ids() == [1, 2, 3, 4]


def test_a_servo_has_a_page_with_all_its_registers(watching: Watching) -> None:
    watching.lines()
    watching.press("down", "j")
    styled = watching.lines(style=True)
    assert any(re.search(r"\x1b\[7m +2\x1b", line) for line in styled), "the chosen one is lit up"
    lines = watching.press("enter")
    assert lines[0].startswith("servo 2 of arm")
    registers = PROTOCOLS["mightyzap"].registers
    batches = watching.wires[0].batches
    heard = {
        registers[n].name
        for batch in batches
        for n, servo in zip(batch.samples.register, batch.samples.servo_id, strict=True)
        if servo == 2
    }
    lines = watching.lines(140, 90)
    assert heard <= {line.split()[0] for line in lines if line}
    assert lines.index(next(one for one in lines if one.startswith("present_position"))) < 6
    assert watching.press("down")[0].startswith("servo 3 of arm"), "the next one, from its page"
    assert not watching.press("esc")[0].startswith("servo")
    assert watching.press("?")[0] == "keys"


@in_turn(2)
@pytest.mark.parametrize(("width", "height"), SIZES)
@pytest.mark.parametrize(
    "keys", [["?"], ["j", "enter"], ["s", "f", "x"], ["space"], ["f"] + ["ö"] * 300]
)
def test_every_page_fits(keys: list[str], width: int, height: int, watching: Watching) -> None:
    watching.press(*keys)
    lines = watching.lines(width, height)
    assert len(lines) <= height
    assert max(map(cell_len, lines)) <= width


def test_a_value_that_has_just_changed_is_lit_and_one_that_stays_is_not() -> None:
    one = Watching(wire("arm", "mightyzap", 1))
    tally = one.board.buses["arm"]
    [goal, *_] = [
        h for h in tally.memory.of(0) if tally.protocol.registers[h.register].quantity == "position"
    ]
    now = status_of(one.wires[0].status()).now_ns
    assert goal.changed_ns
    fresh = status_of(one.wires[0].status(), late_ns=goal.changed_ns - now)
    late = status_of(one.wires[0].status(), late_ns=goal.changed_ns - now + NS)
    lit = re.compile(r"\x1b\[1m +\d+\.\d\d mm\x1b")
    assert any(map(lit.search, lines_of(one.board, fresh, 80, 24, style=True)))
    assert not any(map(lit.search, lines_of(one.board, late, 80, 24, style=True)))


def test_what_is_lit_can_be_read_on_a_white_ground_too() -> None:
    grounds = {"black", "white", "bright_black", "bright_white", "default"}
    named = {style.color.name for style in STYLES.values() if style.color is not None}
    assert named
    assert not named & grounds


def test_every_column_of_a_servo_s_page_has_its_title_in_80_columns(watching: Watching) -> None:
    watching.lines(80, 24)
    watching.press("j", "enter")
    (titles,) = (line for line in watching.lines(80, 24) if line.startswith("register"))
    assert titles.split() == ["register", "value", "raw", "heard", "s", "changed", "s"]


def test_the_help_is_whole_in_80_columns(watching: Watching) -> None:
    watching.press("?")
    shown = " ".join(" ".join(watching.lines(80, 24)).split())
    for _, what in HELP:
        assert what in shown


@pytest.mark.parametrize("wanted", ["", "code=no-response"])
def test_what_is_held_stands_still_and_the_board_goes_on(wanted: str, watching: Watching) -> None:
    watching.type(wanted)
    watching.hear()
    still = watching.board.still()
    before = lines_of(still, status_of(watching.wires[0].status()), 140, 40)
    watching.hear()
    assert lines_of(still, status_of(watching.wires[0].status()), 140, 40) == before
    assert watching.lines() != before
    assert still.buses["arm"].protocol is watching.board.buses["arm"].protocol


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    one = Terminal()
    yield one
    one.close()


def modes(fd: int) -> int:
    """Return whether lines are edited and echoed there."""
    return int(termios.tcgetattr(fd)[3]) & (termios.ICANON | termios.ECHO)


def test_keys_reach_the_board_and_the_terminal_is_given_back(terminal: Terminal) -> None:
    usual = modes(terminal.slave)
    assert usual
    w = wire("arm", "mightyzap")
    screen = Screen(BOARD, lambda: status_of(w.status()), stream=terminal.stream)
    feed(screen, w)
    terminal.read(until=lambda seen: b"? keys  Ctrl-C stops" in seen)
    assert not modes(terminal.slave)
    for sent, told in (
        (b"s", b"by error, greatest first"),
        (b"f", b"only: _"),
        (b"servo_di = 3", b"servo_di = 3_"),
        (b"\r", b"did you mean servo_id?"),
        (b"\x1b", b"by error, greatest first"),
        (b"j\r", b" of arm"),
        (b" ", b"held, Space goes on"),
    ):
        terminal.seen = b""
        os.write(terminal.master, sent)

        def is_told(seen: bytes, told: bytes = told) -> bool:
            return told in re.sub(rb"\x1b\[[0-9;]*m", b"", seen)

        assert is_told(terminal.read(until=is_told, wait_s=PATIENCE_S / 6)), told
    end(screen, terminal)
    assert screen.failure is None
    assert modes(terminal.slave) == usual


def test_a_shell_gets_its_terminal_back_as_it_was_when_the_board_is_stopped(tmp_path: Path) -> None:
    look = "stty -a | grep -o '.icanon'; echo HALF''WAY"
    script = f"set -m; {controlled(tmp_path)}; {look}; fg; echo OV''ER"
    with Shell(script) as shell:
        usual = modes(shell.master)
        shell.read(lambda seen: b"? keys  Ctrl-C stops" in seen.partition(b"said before")[2])
        assert not modes(shell.master)
        os.write(shell.master, b"\x1a")
        seen = shell.read(lambda seen: b"HALFWAY" in seen)
        assert b"-icanon" not in seen
        shell.read(lambda seen: b"Ctrl-C stops" in seen.partition(b"HALFWAY")[2])
        assert not modes(shell.master), "it has the keys again"
        (tmp_path / "stop").touch()
        shell.read(lambda seen: b"OVER" in seen)
        assert modes(shell.master) == usual


def test_where_nothing_is_shown_nothing_can_be_selected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ran = within(capsys, "record", "/dev/null", "--servo", "3", "-o", tmp_path / "x.mcap")
    told = "a selection is what --log prints and the board shows: a recording has everything"
    assert (ran.status, ran.complaint) == (2, told)
    ran = within(capsys, "record", "/dev/null", "--bus", "arm", "-o", tmp_path / "x.mcap")
    assert ran.complaint == f"{told}; a bus is named with its port: arm=PORT"
