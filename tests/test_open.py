"""A capture looked into, without a screen: its lines, filters, places, a line taken apart."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest

import sniffer
from sniffer.decoding.options import Options
from sniffer.decoding.rows import FrameRow, GapRow, SampleRow
from sniffer.ground.model import InputError
from sniffer.inside.columns import GAP
from sniffer.inside.detail import detail_of, raw_of
from sniffer.inside.figures import figures_of
from sniffer.inside.filters import completed, completions, filter_of
from sniffer.inside.index import CaptureIndex
from sniffer.inside.keys import KEYS, help_text
from sniffer.inside.moment import SHOWN, moment_of
from sniffer.inside.panes import figures_text
from sniffer.inside.places import line_of
from sniffer.inside.reading import Reading
from sniffer.inside.search import Search
from sniffer.inside.texts import SearchedTexts
from sniffer.inside.view import LineView
from sniffer.inside.words import line_words
from sniffer.sources import open_source
from tests.commands import sniffer as command
from tests.commands import two_buses
from tests.lists import in_turn

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT: Final = Path(__file__).parents[1]
CAPTURES: Final = sorted(
    p for p in (ROOT / "sample_captures").iterdir() if p.suffix in (".log", ".bin", ".hex")
)
DAMAGED: Final = ROOT / "sample_captures" / "mightyzap_damaged.log"


def indexed(path: Path) -> CaptureIndex:
    reading = Reading(open_source(path), Options(), CaptureIndex())
    reading.start()
    reading.wait()
    assert not reading.problem
    return reading.index


@pytest.fixture(scope="module")
def index() -> Iterator[CaptureIndex]:
    one = indexed(DAMAGED)
    yield one
    one.discard()


def judged(view: LineView) -> LineView:
    while view.steps():
        pass
    return view


@in_turn(4)
@pytest.mark.parametrize("path", CAPTURES, ids=lambda p: p.name)
def test_the_lines_are_the_frames_and_gaps_that_decoding_tells(path: Path) -> None:
    index = indexed(path)
    rows = [row for row in sniffer.decode(path) if isinstance(row, FrameRow | GapRow)]
    lines = index.lines
    assert lines["at"].tolist() == [row.offset for row in rows]
    assert lines["length"].tolist() == [row.length for row in rows]
    assert lines["t"].tolist() == [row.t_ns for row in rows]
    assert [k == GAP for k in lines["kind"].tolist()] == [row.type == "gap" for row in rows]
    for number in range(0, len(rows), 97):
        assert raw_of(index, number).hex() == rows[number].hex
        assert line_words(index, number).op
    index.discard()


def test_each_half_of_an_exchange_knows_the_other_and_findings_know_their_line(
    index: CaptureIndex,
) -> None:
    lines = index.lines
    paired = np.flatnonzero(lines["partner"] >= 0)
    assert len(paired) > 1000
    assert (lines["partner"][lines["partner"][paired]] == paired).all()
    assert (lines["servo"][lines["partner"][paired]] == lines["servo"][paired]).all()
    told = [row for row in sniffer.decode(DAMAGED) if row.type == "anomaly"]
    assert len(index.found) == len(told)
    assert (index.found["line"] >= 0).all()


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        ("servo=3,1", lambda w: w.servo in ("1", "3")),
        ("kind=response op=echo", lambda w: (w.kind, w.op) == ("<", "echo")),
        ("op!=load_data servo=254", lambda w: w.servo == "254" and w.op != "load_data"),
        ("servo_id = 2 AND kind = 'request'", lambda w: (w.servo, w.kind) == ("2", ">")),
        ("register = 'goal_position' AND value > 12", lambda w: "goal_position" in w.values),
        ("reason = 'truncated'", lambda w: w.verdict == "truncated"),
    ],
)
def test_a_filter_keeps_what_it_names(text: str, kept: object, index: CaptureIndex) -> None:
    assert callable(kept)
    view = LineView(index)
    view.choose(filter_of(text), exchanges=False)
    judged(view)
    assert 0 < view.count < len(index.lines)
    assert all(kept(line_words(index, n)) for n in view.shown().tolist())
    assert [view.position(n) for n in view.shown().tolist()] == list(range(view.count))


def test_words_and_expressions_say_the_same(index: CaptureIndex) -> None:
    for words, expression in (
        ("servo=3", "servo_id = 3"),
        ("code=no-response", "code = 'no-response'"),
        ("kind=response", "kind = 'response'"),
    ):
        both = []
        for text in (words, expression):
            view = LineView(index)
            view.choose(filter_of(text), exchanges=False)
            both.append(set(judged(view).shown().tolist()))
        frames = set(np.flatnonzero(index.lines["kind"] != GAP).tolist())
        assert both[0] & frames <= both[1], words


@pytest.mark.parametrize(
    "text", ["servo=x", "servo=²", "servo=256", "foo=3", "((", "kind=nobody", "servo_id ="]
)
def test_what_is_no_filter_is_told_in_a_line(text: str) -> None:
    with pytest.raises(InputError) as told:
        filter_of(text)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("typed", "whole"),
    [
        ("ser", "servo="),
        ("servo=3 op=sy", "servo=3 op=symmetric_store"),
        ("code!=no-r", "code!=no-response"),
        ("servo=1,", "servo=1,1"),
        ("response_t", "response_time_ns"),
        ("xyz", None),
    ],
)
def test_a_filter_line_is_completed_by_what_was_met(
    typed: str, whole: str | None, index: CaptureIndex
) -> None:
    assert completed(typed, completions(index)) == whole


@pytest.mark.parametrize(
    ("place", "line"),
    [
        ("#90", 90),
        ("@1051", 81),
        ("@byte:1052", 81),
        ("@first-error", 81),
        ("22:55:06.365", 81),
        ("@no-response", 81),
        ("@no-response:1", 81),
        ("@byte:bus0:1052", 81),
        ("@anomaly:1", 81),
        ("@first-error:servo=2", 90),
        ("0", 1),
        ("+0ms", 1),
    ],
)
def test_a_place_may_be_a_time_a_byte_or_a_line(place: str, line: int, index: CaptureIndex) -> None:
    assert line_of(place, index) == line - 1


def test_a_place_may_lie_before_or_behind_what_is_found(index: CaptureIndex) -> None:
    t_ns, there = index.lines["t"], line_of("@first-error", index)
    for place, shift_ns in (("@first-error-20ms", -20_000_000), ("@first-error+2s", 2 * 10**9)):
        line = line_of(place, index)
        assert int(t_ns[line - 1]) < int(t_ns[there]) + shift_ns <= int(t_ns[line])


def test_a_place_before_the_end_waits_until_the_end_was_read(index: CaptureIndex) -> None:
    lines = index.lines
    line = line_of("-2s", index)
    end = int(lines["t"].max())
    assert int(lines["t"][line - 1]) < end - 2_000_000_000 <= int(lines["t"][line])
    assert line_of("-1h", index) == 0
    with pytest.raises(InputError, match="-2s: the end was not read yet"):
        line_of("-2s", index, is_read=False)


@pytest.mark.parametrize("exchanges", [False, True])
def test_the_first_error_is_that_of_the_lines_shown(exchanges: bool, index: CaptureIndex) -> None:
    view = LineView(index)
    view.choose(filter_of("servo=2"), exchanges=exchanges)
    judged(view)
    first = line_of("@first-error:servo=2", index)
    assert line_of("@first-error", index, view=view) == first
    assert line_of("@anomaly:1", index, view=view) == 80, "it is one of the capture"
    with pytest.raises(InputError, match="none was found so far in the lines shown"):
        line_of("@first-error:servo=1", index, view=view)


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ("99999", "99999 is behind the end: the last line so far is of second 8.001"),
        ("@999999", "byte 999999 is not there: bus0 has 18442 so far"),
        ("#0", "behind the end"),
        ("#" + "9" * 5000, "is no place in a capture"),
        ("over there", "is no place in a capture: write it like 10"),
        ("@anomaly:99999", "anomalies were found so far"),
        ("@clock-step", "none was found so far"),
        ("@no-response:99", "9 were found so far"),
        ("@byte:arm:7", "there is no bus arm, only bus0"),
    ],
)
def test_a_place_that_is_not_there_is_told(place: str, told: str, index: CaptureIndex) -> None:
    with pytest.raises(InputError, match=told):
        line_of(place, index)


def test_a_byte_of_several_buses_is_of_the_one_that_is_looked_at_or_named(tmp_path: Path) -> None:
    index = indexed(two_buses(tmp_path / "two.log", DAMAGED))
    with pytest.raises(InputError, match="@byte:18: arm and leg have a byte 18: say of which bus"):
        line_of("@byte:18", index)
    for bus in ("arm", "leg"):
        line = line_of(f"@byte:{bus}:18", index)
        assert line == line_of("@18", index, index.buses.index(bus))
        assert index.buses[index.lines["bus"][line]] == bus
    assert line_of("@byte:12175", index) == line_of("@byte:arm:12175", index)
    told = figures_text(figures_of(index, np.arange(len(index.lines)))).plain.splitlines()
    assert told[1].startswith("bus  servo")
    assert {row.split()[0] for row in told[2 : 2 + len(index.buses)]} <= {"arm", "leg"}
    index.discard()


def test_a_search_goes_on_and_round_for_bytes_and_words(index: CaptureIndex) -> None:
    view = LineView(index)

    def found(text: str, since: int = 0) -> int | None:
        search = Search(view, since, text)
        while (at := search.steps()) is None:
            assert 0 <= search.done <= 1
        return at

    torn = found("F9 06 25 06")
    assert torn is not None
    assert line_words(index, torn).verdict == "truncated"
    assert found("F9 06 25 06", torn) == torn
    first = found("no response")
    assert first == 80
    again = found("NO RESPONSE", first)
    assert again is not None
    assert again > first
    assert found("nowhere at all") == -1
    assert found("F9 06 25 06 FF FF FF FF") == -1, "bytes of two lines are in none"
    answer = bytes(raw_of(index, 1)).hex(" ")
    assert found(answer) == 1
    view.choose(None, exchanges=True)
    assert found(answer, judged(view).count) == 0, "an exchange has the bytes of its answer"


@in_turn(4)
@pytest.mark.parametrize("exchanges", [False, True])
@pytest.mark.parametrize("path", CAPTURES, ids=lambda p: p.name)
def test_a_search_looks_at_what_the_lines_show(path: Path, exchanges: bool) -> None:
    index = indexed(path)
    view = LineView(index)
    view.choose(None, exchanges=exchanges)
    shown = judged(view).shown()
    words = [line_words(index, number, exchange=exchanges) for number in shown.tolist()]
    texts = SearchedTexts(index, exchanges=exchanges)
    told = [text for at in range(0, len(shown), 300) for text in texts.of(shown[at : at + 300])]
    assert told == [f"{w.op} {w.values} {w.verdict}" for w in words]
    index.discard()


def test_the_next_error_is_found_in_both_directions(index: CaptureIndex) -> None:
    view = LineView(index)
    going, at = [], -1
    while (at := view.next_wrong(at, 3)) >= 0:
        going.append(at)
    coming, at = [], view.count
    while (at := view.next_wrong(at, 3, back=True)) >= 0:
        coming.append(at)
    assert going == coming[::-1] == np.flatnonzero(index.lines["severity"] == 3).tolist()


def test_an_exchange_is_one_line_with_what_was_read(index: CaptureIndex) -> None:
    view = LineView(index)
    view.choose(None, exchanges=True)
    judged(view)
    lines = index.lines
    assert view.count == len(lines) - int(((lines["kind"] == 1) & (lines["partner"] >= 0)).sum())
    view.choose(filter_of("kind=response servo=2"), exchanges=True)
    asked = int(judged(view).shown()[0])
    words = line_words(index, asked, exchange=True)
    assert (words.kind, words.servo) == (">", "2")
    assert [part.drawn.title for part in detail_of(index, asked, exchange=True).parts] == [
        f"request: {words.op}, servo 2",
        f"response: {words.op}, servo 2",
    ]


def test_a_line_is_taken_apart_with_what_was_found_in_it(index: CaptureIndex) -> None:
    detail = detail_of(index, 80)
    (part,) = detail.parts
    spans = [f for f in detail.fields if f.length and not f.is_title and not f.severity]
    named = [f for f in spans if not f.text.startswith("  ")]
    assert sum(f.length for f in named) == len(part.drawn.raw)
    at = line_of("@970", index)
    fields = {f.text.partition(":")[0]: f for f in detail_of(index, at).fields}
    assert (fields["present_position"].offset, fields["present_position"].length) == (6, 2)
    assert (fields["present_temperature"].offset, fields["present_temperature"].length) == (13, 1)
    assert any(f.text.startswith("error no-response: servo 1 did not") for f in detail.fields)
    assert any(f.text.startswith("  try: ") for f in detail.fields)
    assert detail.fields[1].text.startswith("error no-response: "), "what is wrong comes first"


def test_bytes_that_the_last_like_frame_had_not_are_known(index: CaptureIndex) -> None:
    view = LineView(index)
    search = Search(view, 0, "speed -202")
    while (at := search.steps()) is None:
        pass
    assert at is not None
    (part,) = detail_of(index, at).parts
    assert "present_speed: raw 202 = -202" in [f.text for f in detail_of(index, at).fields]
    like = index.lines[part.like]
    for name in ("servo", "op", "kind", "length"):
        assert like[name] == index.lines[at][name]
    before, now = raw_of(index, part.like), raw_of(index, at)
    assert part.changed == {i for i, (a, b) in enumerate(zip(before, now, strict=True)) if a != b}
    assert part.changed


@pytest.mark.parametrize("line", [700, 960, 1100])
def test_the_servos_are_known_as_of_a_line(index: CaptureIndex, line: int) -> None:
    rows = [r for r in sniffer.decode(DAMAGED) if isinstance(r, SampleRow)]
    now = int(index.lines["t"][line])
    for row in moment_of(index, line):
        mine = [r for r in rows if r.servo_id == row.servo and r.t_ns <= now]
        last = [r for r in mine if r.quantity == "position" and not r.part][-1]
        assert last.value is not None
        assert row.cells["position"] == f"{last.value:.4g} mm"
        said = max(r.t_ns for r in mine if not r.part and r.quantity in SHOWN[:1] + SHOWN[2:])
        assert row.age_s == pytest.approx((now - said) / 1e9), "of what it said, not of its goal"
    assert [row.servo for row in moment_of(index, line)] == [1, 2, 3]


def test_the_help_has_every_key() -> None:
    text = help_text()
    for key in KEYS:
        assert f" {key.shown}  {key.told}" in text
    lines = text.splitlines()
    assert len(lines) + 2 <= 24, "with its frame it is on a small terminal as a whole"
    assert max(map(len, lines)) + 4 <= 80


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([DAMAGED], "this draws on a terminal, and there is none: `sniffer decode` prints"),
        (["-"], "keys are read from standard input: save the capture and give its name"),
        ([DAMAGED, "-o", "x.mcap"], "-o is where a port is recorded to: FILE is there already"),
    ],
)
def test_where_nobody_can_look_that_is_told_in_a_line(
    arguments: list[str | Path], told: str
) -> None:
    ran = command("open", *arguments)
    assert (ran.status, ran.complaint) == (2, told)


def test_a_place_that_is_not_there_yet_is_none_though_the_capture_grows_meanwhile(
    index: CaptureIndex,
) -> None:
    whole = index.lines

    class Growing:
        """Each look at its lines finds more of them."""

        has_clock = True
        looks = 0

        @property
        def lines(self) -> np.ndarray[Any, Any]:
            self.looks += 1
            there: np.ndarray[Any, Any] = whole[: 100 * self.looks]
            return there

    later = int(whole["t"][500] - whole["t"][0]) / 1e9
    with pytest.raises(InputError, match=r"the last line so far is of second 0\.497"):
        line_of(f"{later:.6f}s", Growing())  # type: ignore[arg-type]
