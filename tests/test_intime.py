"""Lines of several buses: in the order of time, however the capture was cut, and none lost."""

from __future__ import annotations

import io
import itertools
from typing import TYPE_CHECKING, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.options import Options
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.jobs import parts
from sniffer.jobs.session import run_source
from sniffer.jobs.telling import Teller
from sniffer.mcapfile.sink import McapSink
from sniffer.sinks import intime
from sniffer.sinks.intime import LIVE, READ, InTime
from sniffer.sinks.text import TextSink
from sniffer.sources import open_source
from sniffer.sources.stretches import Sizes
from tests.parted import Inline
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.sinks.intime import WaitTimes

MS: Final = 1_000_000
QUIET: Final = Teller(lambda line: None, quiet=True)


@given(
    said=st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 900 * MS)), max_size=40),
    passes=st.lists(st.integers(1, 9), max_size=12),
    behind=st.sampled_from([0, NS]),
)
def test_the_order_is_that_of_time_whatever_a_pass_has(
    said: list[tuple[str, int]], passes: list[int], behind: int
) -> None:
    said.sort(key=lambda one: one[1])
    it = InTime[int](intime.WaitTimes(behind, None))
    out: list[tuple[str, int]] = []
    rest = list(said)
    for size in passes:
        now, rest = rest[:size], rest[size:]
        for bus in "cab":
            it.add(bus, [(t, t) for b, t in now if b == bus])
        if now:
            out += it.until(now[-1][1], ())
    for bus in "bca":
        it.add(bus, [(t, t) for b, t in rest if b == bus])
    out += it.rest()
    assert out == sorted(said, key=lambda one: (one[1], one[0]))


def test_what_is_not_decided_on_one_bus_is_waited_for_as_long_as_is_said() -> None:
    for waits, due in ((READ, []), (LIVE, ["a"])):
        it = InTime[str](waits)
        it.add("b", [(0, "begun")])
        it.add("a", [(NS, "a")])
        told = it.until(9 * NS, {"b"})
        assert [what for _, what in told if what == "a"] == due
        assert [what for _, what in told + it.rest()] == ["begun", "a"]


def test_no_more_than_a_bound_waits_for_a_bus_that_says_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(intime, "MOST", 10)
    it = InTime[int](READ)
    it.add("a", [(n * NS, n) for n in range(30)])
    assert [n for _, n in it.until(30 * NS, {"b"})] == list(range(20))
    assert [n for _, n in it.rest()] == list(range(20, 30))


def recorded_on_two_buses(path: Path) -> list[Chunk]:
    """Record two buses whose exchanges lie over each other; return the chunks."""
    chunks = []
    for n in range(60):
        for bus, shift in (("leg", 0), ("arm", 3 * MS)):
            at = NS * 1_700_000_000 + n * 40 * MS + shift
            chunks.append(Chunk(packet(n % 5 + 1, 0xF1), at, Clock.READ, bus))
            chunks.append(Chunk(packet(n % 5 + 1, 0), at + 5 * MS, Clock.READ, bus))
    chunks.sort(key=lambda chunk: chunk.t_ns or 0)
    sink = McapSink(path, {"tool": "servo-sniffer test"})
    for n, chunk in enumerate(chunks):
        sink.raw(chunk.bus, [chunk])
        if n % 4 == 3:
            sink.flush()
    sink.close()
    return chunks


def table(path: Path, *, size: int | None = None, in_parts: bool = False) -> list[str]:
    """Return the lines of a capture, decoded in passes of so many chunks, or in parts."""
    out = io.StringIO()
    source, sinks = open_source(path, "mcap"), [TextSink(out, width=80, color=False)]
    options = Options(protocol="mightyzap")
    if in_parts:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(parts, "Crew", Inline)
            parts.decode_in_parts(
                *(source, options, sinks),
                jobs=2,
                name="it",
                tell=QUIET,
                folder=path.parent,
                sizes=Sizes(head=300, least=40, most=200, warm=100, block=1, first=0),
            )
    else:
        chunks = [chunk for group in source for chunk in group]
        groups = [chunks[n : n + (size or 9999)] for n in range(0, len(chunks), size or 9999)]
        run_source(source, options, sinks, name="it", tell=QUIET, groups=groups, ahead=chunks)
    return out.getvalue().partition("\n\n")[0].splitlines()


def test_the_text_of_two_buses_is_the_same_however_the_capture_is_cut(tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    recorded_on_two_buses(path)
    head, *lines = whole = table(path)
    assert head.split()[:3] == ["time", "bus", "id"]
    times = [line.split()[0] for line in lines]
    assert len(times) == 240
    assert times == sorted(times)
    assert sum(a.split()[1] != b.split()[1] for a, b in itertools.pairwise(lines)) > 200
    for size in (1, 3, 7, 50):
        assert table(path, size=size) == whole
    assert table(path, in_parts=True) == whole


@pytest.mark.parametrize(("waits", "shown"), [(LIVE, 2), (READ, 0)])
def test_what_is_live_is_shown_when_its_pass_is_over(waits: WaitTimes, shown: int) -> None:
    from sniffer.decoding.pipeline import Pipeline

    out = io.StringIO()
    sink = TextSink(out, width=80, color=False, waits=waits, buses=["arm", "leg"])
    pipeline = Pipeline(Options(protocol="mightyzap"), [sink], live=True)
    for n, code in enumerate((0xF1, 0)):
        pipeline.decode("arm", [Chunk(packet(1, code), NS + n * 5 * MS, Clock.READ, "arm")])
    pipeline.idle(NS + 150 * MS)
    lines = out.getvalue().splitlines()
    assert len(lines) == (shown + 1 if shown else 0)
    assert all("bus" in line.split() or "arm" in line.split() for line in lines)
