"""Filters of a capture that is looked into while it is read."""

from __future__ import annotations

import asyncio
from itertools import chain, islice
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.decoding.called import Named, ServoNames
from sniffer.decoding.options import Options
from sniffer.decoding.pipeline import Pipeline
from sniffer.ground.runs import ChunkRun
from sniffer.inside.app import LookingGlass
from sniffer.inside.filters import completions, filter_of
from sniffer.inside.index import CaptureIndex
from sniffer.inside.places import line_of
from sniffer.inside.reading import Reading
from sniffer.inside.selecting import SelectionFilter
from sniffer.inside.view import LineView
from sniffer.sources import open_source
from tests.test_mixed import heard
from tests.test_open import DAMAGED, judged

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    import pytest

READS: Final = 700


def read_by_read(index: CaptureIndex) -> Iterator[None]:
    """Decode the begin of a capture as it comes on a line: yield after each read."""
    with open_source(DAMAGED) as source:
        pipeline = Pipeline(Options().with_facts(source.facts(), source.tables), [index], live=True)
        told = chain.from_iterable(source)
        each = chain.from_iterable(one if isinstance(one, ChunkRun) else [one] for one in told)
        for chunk in islice(each, READS):
            pipeline.feed([chunk])
            index.settle()
            yield
        pipeline.close()
        index.settle()
        yield


def view_of(index: CaptureIndex, text: str, *, exchanges: bool = False) -> LineView:
    view = LineView(index)
    view.choose(filter_of(text), exchanges=exchanges)
    return view


FILTERS = [("severity=error", False), ("code = 'no-response'", False), ("outcome=ok", True)]


def test_what_is_found_later_in_a_line_that_is_judged_is_shown() -> None:
    index = CaptureIndex()
    views = [view_of(index, text, exchanges=both) for text, both in FILTERS]
    for _ in read_by_read(index):
        for view in views:
            view.steps()
    for view, (text, both) in zip(views, FILTERS, strict=True):
        after = judged(view_of(index, text, exchanges=both))
        assert judged(view).shown().tolist() == after.shown().tolist(), text
        assert view.count
    index.discard()


def test_no_line_is_judged_before_what_was_found_in_it(monkeypatch: pytest.MonkeyPatch) -> None:
    index = CaptureIndex()
    view = view_of(index, "severity=error")
    known, settling = CaptureIndex._judge, []

    def judge(self: CaptureIndex, *args: Any) -> None:
        view.steps()  # as the screen does in its own thread
        settling.append((view.judged, len(self.lines)))
        known(self, *args)

    monkeypatch.setattr(CaptureIndex, "_judge", judge)
    for _ in read_by_read(index):
        settled = len(index.lines)
        view.steps()
        assert view.judged == settled
    assert all(seen <= there for seen, there in settling)
    assert any(seen < there for seen, there in settling)
    index.discard()


def test_the_cursor_stays_on_its_line_when_one_before_it_is_shown_later() -> None:
    index = CaptureIndex()

    async def steps() -> None:
        reading = Reading(open_source(DAMAGED), Options(), index)
        reading.start()
        reading.wait()
        app = LookingGlass(reading, name="run.log", wanted="severity=error")
        async with app.run_test(size=(80, 24)) as pilot:
            while app.view.is_behind or app._wanted is not None:
                await pilot.pause(0.01)
            app.list.go(8)
            line = app.list.line
            earlier = int(np.flatnonzero(index.lines["severity"][app.view.line(3) :] == 0)[0])
            earlier += app.view.line(3)
            position = app.view.position(earlier)
            index.lines["severity"][earlier] = 3
            index._changed.append([earlier])
            while app.view.line(position) != earlier:
                await pilot.pause(0.01)
            while app._wanted is not None:
                await pilot.pause(0.01)
            assert (app.list.cursor, app.list.line) == (9, line)

    asyncio.run(steps())
    index.discard()


def test_a_bus_of_two_protocols_is_known_by_its_own_name(tmp_path: Path) -> None:
    path = tmp_path / "two.bin"
    first, second = heard("mightyzap"), heard("rs30x")
    path.write_bytes(first + second + first)
    index = CaptureIndex()
    told: dict[Named, str] = {("bus0", 1): "knee"}
    options, names = Options(protocol="mightyzap+rs30x", names=told), ServoNames(told)
    reading = Reading(open_source(path), options, index)
    reading.start()
    reading.wait()
    assert index.buses == ["bus0.mightyzap", "bus0.rs30x"]
    every = len(index.lines)
    for text, count in (
        ("bus = 'bus0'", every),
        ("bus=bus0", every),
        ("bus=bus0.rs30x", int((index.lines["bus"] == 1).sum())),
    ):
        assert judged(view_of(index, text)).count == count, text
    assert 0 < count < every
    assert {"bus0", "bus0.rs30x"} <= set(completions(index)["bus"])
    knee = LineView(index)
    knee.choose(SelectionFilter("servo_name = 'knee'", names), exchanges=False)
    one = set(np.flatnonzero(index.lines["servo"] == 1).tolist())
    assert one < set(judged(knee).shown().tolist()) < set(range(every))
    for at in (0, len(first), len(first) + len(second)):
        lines = {line_of(place, index) for place in (f"@byte:bus0:{at}", f"@byte:bus0.rs30x:{at}")}
        lines |= {line_of(f"@{at}", index, bus) for bus in (None, 0, 1)}
        assert [index.lines["at"][line] for line in lines] == [at]
    index.discard()
