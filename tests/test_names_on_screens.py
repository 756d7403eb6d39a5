"""Names of servos on screens: what ``sniffer open`` shows, its filter; the live board."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from rich.cells import cell_len
from rich.console import Console

from sniffer.cli.open import _arguments
from sniffer.decoding.called import ServoNames
from sniffer.decoding.options import Options
from sniffer.ground.model import InputError
from sniffer.inside.detail import detail_of
from sniffer.inside.figures import figures_of
from sniffer.inside.filters import completed, completions, filter_of
from sniffer.inside.moment import moment_of
from sniffer.inside.panes import figures_text
from sniffer.inside.places import line_of
from sniffer.inside.search import Search
from sniffer.inside.table import FrameList
from sniffer.inside.view import LineView
from sniffer.inside.words import line_words
from sniffer.sinks.consoles import GLUE, glued
from sniffer.sinks.tabulated import ServoCell, Tabulated
from tests.lists import each_in_turn
from tests.test_board_keys import Watching
from tests.test_names import two_buses
from tests.test_open import indexed, judged
from tests.wires import wire

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.inside.index import CaptureIndex

LONG: Final = "left_shoulder_pitch_"


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CaptureIndex]:
    told = ("--name", f"arm:1={LONG}", "--name", "2=wrist", "--name", "leg:2=ankle")
    one = indexed(two_buses(tmp_path_factory.mktemp("names"), *told))
    yield one
    one.discard()


def lines_of(index: CaptureIndex, bus: str, servo: int) -> list[int]:
    mine = (index.lines["bus"] == index.buses.index(bus)) & (index.lines["servo"] == servo)
    found: list[int] = np.flatnonzero(mine).tolist()
    return found


def test_lines_and_fields_have_the_names_of_their_bus(index: CaptureIndex) -> None:
    for bus, servo, who in (("arm", 1, f"1 {LONG}"), ("leg", 1, "1"), ("leg", 2, "2 ankle")):
        number = lines_of(index, bus, servo)[0]
        assert line_words(index, number).servo == who
        assert detail_of(index, number).fields[0].text.endswith(f", servo {who}")


def test_a_narrow_list_has_names_in_place_of_the_bus(index: CaptureIndex) -> None:
    lines = FrameList(LineView(index))
    head = lines.heading(80)
    for bus, servo, who in (
        ("arm", 1, "  1 left_shou… "),
        ("leg", 1, "  1 leg "),
        ("leg", 2, "ankle "),
    ):
        told = line_words(index, lines_of(index, bus, servo)[0])
        cells = (" ", told.bus, told.servo, told.kind, told.op, told.values, told.verdict, "0")
        text = lines._laid(cells, "22:55:06.001", 80, shift=0)
        assert who in text
        assert cell_len(text) == len(head) == 80
        assert text.index(told.op) == head.index("command")
        assert (told.bus in text) == (who == "  1 leg ")


def test_names_that_begin_alike_are_told_apart_by_their_ends(tmp_path: Path) -> None:
    """Of two buses both were "1 left_shou…", and nothing said which bus it was."""
    told = ("--name", "arm:1=left_shoulder_pitch", "--name", "leg:1=left_shoulder_roll")
    one = indexed(two_buses(tmp_path, *told))
    lines = FrameList(LineView(one))
    shown = set()
    for bus in ("arm", "leg"):
        row = line_words(one, lines_of(one, bus, 1)[0])
        cells = (" ", row.bus, row.servo, row.kind, row.op, row.values, row.verdict, "0")
        shown.add(lines._laid(cells, "22:55:06.001", 80, shift=0)[13:28].strip())
    one.discard()
    assert shown == {"1 …der_pitch", "1 …lder_roll"}


def test_what_was_found_in_a_line_names_the_servo(index: CaptureIndex) -> None:
    told = []
    for row in range(len(index.found)):
        line = int(index.found["line"][row])
        if index.buses[int(index.lines["bus"][line])] == "arm" and index.found["servo"][row] == 1:
            told += [field.text for field in detail_of(index, line).fields if field.severity]
    assert any(f"servo 1 {LONG} did not answer" in text for text in told)


def test_servos_of_a_moment_and_figures_are_told_by_name(index: CaptureIndex) -> None:
    for line in (lines_of(index, "arm", 1)[-1], lines_of(index, "leg", 1)[-1]):
        there = {(row.bus, row.servo): row.who for row in moment_of(index, line)}
        assert there["arm", 1] == f"1 {LONG}"
        assert there["leg", 1] == "1"
    text = figures_text(figures_of(index, np.arange(len(index.lines)))).plain
    assert f"arm  1 {LONG}  " in text
    assert "leg  2 ankle" in text
    titles, *rows = text.splitlines()[1:8]
    assert {row.index("  ", row.index(" ", 5) + 2) >= 0 for row in rows} == {True}
    assert titles.index("requests") == rows[0].index(LONG) + len(LONG) + 2
    found = text[text.index("found ") :].splitlines()
    assert any(f"  arm  1 {LONG}  " in row for row in found[1:])
    assert {row.index("#") for row in found[1:]} == {found[0].index("first in line")}


@pytest.mark.parametrize(
    ("text", "who"),
    [
        (f"servo={LONG}", {("arm", 1)}),
        ("servo=wrist,ankle", {("arm", 2), ("leg", 2)}),
        ("servo=ankle,3", {("leg", 2), ("arm", 3), ("leg", 3)}),
    ],
)
def test_lines_are_filtered_by_the_names_of_servos(
    text: str, who: set[tuple[str, int]], index: CaptureIndex
) -> None:
    view = LineView(index)
    view.choose(filter_of(text, index.names), exchanges=False)
    lines = index.lines[judged(view).shown()]
    pairs = zip(lines["bus"].tolist(), lines["servo"].tolist(), strict=True)
    assert {(index.buses[bus], servo) for bus, servo in pairs} == who
    assert len(lines) == sum(len(lines_of(index, *one)) for one in who)


def test_a_filter_by_a_name_that_nobody_has_tells_the_nearest(index: CaptureIndex) -> None:
    with pytest.raises(InputError, match="no servo is called 'anckle': did you mean ankle"):
        filter_of("servo=anckle", index.names)


@pytest.mark.parametrize("exchanges", [False, True])
def test_a_search_finds_lines_by_the_name_of_their_servo(
    exchanges: bool, index: CaptureIndex
) -> None:
    view = LineView(index)
    view.choose(None, exchanges=exchanges)
    judged(view)

    def found(text: str) -> int | None:
        search = Search(view, 0, text)
        while (at := search.steps()) is None:
            pass
        return None if at < 0 else view.line(at)

    shown = set(view.shown().tolist())
    for bus, servo, text in (("arm", 2, "wrist"), ("leg", 2, "Ankle"), ("arm", 1, LONG)):
        mine = [line for line in lines_of(index, bus, servo) if line in shown]
        assert found(text) == min(mine, default=None)
        words = [line_words(index, line, exchange=exchanges) for line in mine]
        at = next(k for k, told in enumerate(words) if "position" in told.values)
        assert found(f"{text} {words[at].op} {words[at].values}") == mine[at]
    assert found("wrist_") is None


def test_a_place_may_be_that_of_a_servo_by_its_name(index: CaptureIndex) -> None:
    assert line_of(f"@first-error:servo={LONG}", index) == line_of("@first-error:servo=1", index)
    with pytest.raises(InputError, match="did you mean wrist"):
        line_of("@first-error:servo=wirst", index)


def test_names_complete_a_filter(index: CaptureIndex) -> None:
    assert completed("servo=an", completions(index)) == "servo=ankle"


def test_the_servos_of_a_moment_are_those_of_all_buses_that_were_heard_by_then(
    index: CaptureIndex,
) -> None:
    quarter = len(index.lines) // 4
    line = quarter + int(np.flatnonzero(index.lines["bus"][quarter:] == 0)[0])
    ages = {row.bus: row.age_s for row in moment_of(index, line) if row.servo in (1, 2, 3)}
    assert set(ages) == {"arm", "leg"}
    assert max(ages.values()) < 0.5, "what was told last is not that of a page before"


def test_a_port_that_is_looked_at_is_recorded_with_the_names_that_are_told() -> None:
    options = Options(names={3: "knee", ("arm", 1): "left elbow"})
    called = _arguments("/dev/null", Path("x.mcap"), options)
    assert called[-2:] == ["--name=3=knee", "--name=arm:1=left elbow"]


@pytest.fixture
def watching() -> Watching:
    one = Watching(wire("arm", "mightyzap", 4), wire("leg", "mightyzap", 4))
    one.board.call(ServoNames({("arm", 2): LONG, 3: "knee joint", ("leg", 3): "toe"}))
    return one


@each_in_turn(2, "width", [80, 140])
def test_the_board_has_names_beside_ids_and_columns_stay_aligned(
    width: int, watching: Watching
) -> None:
    lines = watching.lines(width)
    assert max(map(cell_len, lines)) <= width
    titles = next(line for line in lines if line.startswith(" id servo"))
    rows = [line for line in lines if line[:3].strip().isdigit() and " mm" in line]
    assert len(rows) == 8
    end = titles.index("position") + len("position")
    assert {row[end - 2 : end] for row in rows} == {"mm"}
    named = LONG if width == 140 else f"{LONG[:9]}…"
    assert sum(row.startswith(f"  2 {named}") for row in rows) == 1
    assert [row[:14].rstrip() for row in rows if row.startswith("  3")] == [
        "  3 knee joint",
        "  3 toe",
    ]


def test_the_page_of_a_servo_and_what_is_wrong_with_it_have_its_name(watching: Watching) -> None:
    watching.lines()
    page = watching.press("down", "down", "enter")
    assert page[0].startswith(f"servo 2 {LONG} of arm")


def test_the_board_is_filtered_by_names(watching: Watching) -> None:
    watching.type(f"servo={LONG},toe")
    watching.hear()
    lines = watching.lines()
    assert "only ((bus = 'arm' AND servo_id = 2) OR (bus = 'leg' AND servo_id = 3))" in "\n".join(
        lines
    )
    assert watching.controls.rows == [("arm", 2), ("leg", 3)]


def test_a_name_on_the_board_that_nobody_has_can_be_mended(watching: Watching) -> None:
    lines = watching.type("servo=tow")
    assert any("no servo is called 'tow': did you mean toe?" in line for line in lines)


@pytest.mark.parametrize("width", range(38, 60))
def test_no_number_and_no_heading_is_cut_for_words_that_could_be_folded(width: int) -> None:
    table = Tabulated("servo", "command", "asked", "damaged", left=("servo", "command"))
    table.add_row(ServoCell("3", glued("3 left_knee")), "read", "643", "0 %")
    table.add_row("", "all others", "at most 5 %", "0 %")
    out = io.StringIO()
    Console(file=out, width=width).print(table.table(None, width))
    told = out.getvalue().replace(GLUE, " ").splitlines()
    assert told[0].split() == ["servo", "command", "asked", "damaged"]
    for whole in (" 3 ", "643", "at most 5 %", " 0 %"):
        assert any(whole in f" {line} " for line in told[1:]), "\n".join(told)
