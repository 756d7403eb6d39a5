"""What `sniffer open` counts of the lines that are shown: by servo, by code, of exchanges."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
import pytest
from rich.console import Console

from sniffer.inside.figures import figures_of
from sniffer.inside.filters import filter_of
from sniffer.inside.moment import MomentRow
from sniffer.inside.panes import moment_table
from sniffer.inside.view import LineView
from sniffer.sinks.words import took_in_words
from tests.test_open import DAMAGED, indexed, judged

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.inside.index import CaptureIndex


@pytest.fixture(scope="module")
def index() -> Iterator[CaptureIndex]:
    one = indexed(DAMAGED)
    yield one
    one.discard()


def test_figures_count_what_is_shown(index: CaptureIndex) -> None:
    every = figures_of(index, np.arange(len(index.lines)))
    assert (every.frames, every.gaps, every.bytes) == (1448, 30, 18442)
    assert sum(c.count for c in every.codes) == len(index.found)
    missing = {s.servo: s.missing for s in every.servos}
    for s in every.servos:
        mine = index.lines[index.lines["servo"] == s.servo]
        asked = int((mine["kind"] == 0).sum())
        timed = mine[(mine["kind"] == 1) & (mine["took"] >= 0)]
        worst = max(timed, key=lambda one: one["took"] + max(one["spread"], 0), default=None)
        assert s.requests == asked
        if worst is not None:
            assert s.worst == took_in_words(int(worst["took"]), int(worst["spread"]), "")
    one = figures_of(index, np.flatnonzero(index.lines["servo"] == 1))
    assert {s.servo: s.missing for s in one.servos} == {1: missing[1]}


def test_figures_of_exchanges_count_both_halves(index: CaptureIndex) -> None:
    view = LineView(index)
    whole = figures_of(index, view.frames())
    assert whole == figures_of(index, np.arange(len(index.lines)))
    view.choose(None, exchanges=True)
    assert judged(view).count < len(index.lines)
    assert figures_of(index, view.frames()) == whole
    view.choose(filter_of("kind=response servo=2"), exchanges=True)
    (two,) = figures_of(index, judged(view).frames()).servos
    answers = index.lines[(index.lines["kind"] == 1) & (index.lines["servo"] == 2)]
    assert two.answers == len(answers)
    assert two.requests == int((answers["partner"] >= 0).sum())


@pytest.mark.parametrize(("width", "lacks"), [(80, ["speed"]), (40, ["speed", "current", "age"])])
def test_servos_of_a_moment_leave_out_what_has_no_room_and_cut_no_number(
    width: int, lacks: list[str]
) -> None:
    cells = {
        "position": "9.502 mm",
        "goal": "9.927 mm",
        "error": "+0.4249 mm",
        "speed": "-59.1 deg/s",
        "load": "-232",
        "current": "227 mA",
        "voltage": "11.55 V",
        "temp": "37.6 °C",
    }
    rows = [MomentRow(bus, 2, "2", cells, 0.024) for bus in ("arm", "leg")]
    console = Console(width=width, file=io.StringIO())
    with console.capture() as printed:
        console.print(moment_table(rows, width))
    head, *lines = printed.get().splitlines()
    assert "…" not in printed.get()
    assert [line.split()[:2] for line in lines] == [["arm", "2"], ["leg", "2"]]
    assert not set(lacks) & set(head.split())
    assert "position" in head
