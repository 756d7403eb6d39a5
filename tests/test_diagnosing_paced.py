"""How often buses are judged while they are recorded: a share of the time, less if nobody looks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.tap import diagnosing
from sniffer.tap.diagnosing import Diagnosing
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    import pytest

    from sniffer.diagnosis.case import Case

ASKED: Final = packet(3, 0xF2, b"\x8c\x02")
"""Nobody answers: there is something wrong all the time."""

ANSWER: Final = packet(3, 0, b"\x10\x08")


class Ticking:
    """Stands for the module ``time``; it is put forward by hand."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s


def judged(
    monkeypatch: pytest.MonkeyPatch,
    *,
    is_followed: bool,
    took_s: float,
    seconds: int,
    buses: str = "abcd",
    wrong_from_s: float = 0.0,
) -> list[float]:
    """Record buses for some seconds; return when one was judged, which takes ``took_s``."""
    clock, when = Ticking(), list[float]()
    monkeypatch.setattr(diagnosing, "time", clock)

    def judge(case: Case) -> list[Any]:
        when.append(clock.now_s - 1000)
        clock.now_s += took_s
        return []

    monkeypatch.setattr(diagnosing, "incidents", judge)
    beside = Diagnosing(lambda: 0, is_followed=is_followed)
    pipeline = Pipeline(Options(protocol="mightyzap"), [beside], live=True)
    for half in range(2 * seconds):
        t_ns = half * NS // 2
        said = (ASKED, ASKED) if half / 2 >= wrong_from_s else (ASKED, ANSWER)
        for bus in buses:
            pipeline.feed(
                Chunk(data, t_ns + k * 2_000_000, Clock.READ, bus) for k, data in enumerate(said)
            )
        pipeline.idle(t_ns + NS // 3)
        clock.now_s = max(clock.now_s, 1000 + half / 2)
        if is_followed or half % 4 == 0:
            beside._round()
    return when


def test_a_bus_that_somebody_looks_at_is_judged_at_once_and_every_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    when = judged(monkeypatch, is_followed=True, took_s=0.001, seconds=10)
    assert when[0] < 0.5
    assert len(when) >= 4 * 8


def test_a_bus_on_which_something_goes_wrong_is_judged_at_once_however_sound_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Judging a busy bus takes a tenth of a second: while all is well it is done every three."""
    for wrong_from_s in (8.0, 8.5, 9.0, 9.5, 10.0):
        when = judged(
            monkeypatch,
            is_followed=True,
            took_s=0.1,
            seconds=14,
            buses="a",
            wrong_from_s=wrong_from_s,
        )
        assert sum(t < 8 for t in when) <= 4
        assert any(0 <= t - wrong_from_s <= 0.5 for t in when), wrong_from_s


def test_where_nobody_looks_a_bus_is_judged_after_some_seconds_and_every_seven(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    when = judged(monkeypatch, is_followed=False, took_s=0.001, seconds=30)
    assert 6.5 < when[0] < 9
    assert 4 * 2 <= len(when) <= 4 * 4


def test_where_nobody_looks_judging_busy_buses_takes_no_more_than_a_fiftieth_of_the_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    when = judged(monkeypatch, is_followed=False, took_s=0.1, seconds=120)
    assert len(when) >= 4 * 3
    assert 0.1 * len(when) <= 0.02 * 120 + 0.4, "beside the first time"
