"""How a script names files: as text or as paths, one or several."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import pytest

import sniffer
from sniffer.decoding.rows import AnomalyRow
from sniffer.ground.model import InputError, SnifferError

if TYPE_CHECKING:
    from collections.abc import Callable

CAPTURE: Final = Path(__file__).parents[1] / "sample_captures" / "mightyzap_clean.log"
PART: Final = sniffer.Window(0.0, 0.5)

WRITES: Final[dict[str, Callable[[Any], object]]] = {
    "convert": lambda files: sniffer.convert(CAPTURE, files),
    "cut": lambda files: sniffer.cut(CAPTURE, files, PART),
    "split": lambda files: sniffer.split(CAPTURE, files, 10 * 10**9),
    "merge": lambda files: sniffer.merge([CAPTURE], files, together=True),
}


@pytest.mark.parametrize("job", WRITES)
@pytest.mark.parametrize("naming", ["text", "path", "texts"])
def test_outputs_are_named_as_text_or_as_paths(job: str, naming: str, tmp_path: Path) -> None:
    path = tmp_path / "x.log"
    named: dict[str, Any] = {"text": str(path), "path": path, "texts": [str(path)]}
    WRITES[job](named[naming])
    assert [file.stat().st_size > 1000 for file in tmp_path.glob("x*.log")] == [True]


READS: Final[dict[str, Callable[[Any], object]]] = {
    "diagnose": sniffer.diagnose,
    "stats": sniffer.stats,
    "query": lambda data: sniffer.query("SELECT 1", [data]),
}


@pytest.mark.parametrize("job", READS)
def test_bytes_in_place_of_a_name_are_refused_in_words(job: str) -> None:
    with pytest.raises(InputError, match="a path is needed, or several: bytes are for"):
        READS[job](CAPTURE.read_bytes())


@pytest.mark.parametrize("job", ["diagnose", "stats"])
def test_nothing_in_place_of_a_name_is_refused_in_words(job: str) -> None:
    with pytest.raises(InputError, match="a path is needed, or several, not None"):
        READS[job](None)


def test_captures_may_be_named_by_whatever_yields_them(tmp_path: Path) -> None:
    out = tmp_path / "x.log"
    other = tmp_path / "other.log"
    other.write_bytes(CAPTURE.read_bytes())
    sniffer.merge((path for path in (CAPTURE, other)), out)
    assert out.stat().st_size > 1000
    sniffer.merge(str(CAPTURE), tmp_path / "same.log")
    assert (tmp_path / "same.log").read_text().count("\n") == CAPTURE.read_text().count("\n")
    with pytest.raises(SnifferError, match="merge takes captures, one or more: there is none"):
        sniffer.merge([], out, overwrite=True)


def test_a_rule_may_be_named_alone() -> None:
    rows = [
        r for r in sniffer.decode(CAPTURE, alarms="voltage < 11.6") if isinstance(r, AnomalyRow)
    ]
    both = sniffer.decode(CAPTURE, alarms=["voltage < 11.6"])
    assert rows == [r for r in both if isinstance(r, AnomalyRow)]
    assert {row.code for row in rows} == {"alarm", "alarm-over"}


@pytest.mark.parametrize("speed", [-1.0, float("nan"), float("inf")])
def test_a_speed_at_which_nothing_can_be_played_is_refused(speed: float) -> None:
    with pytest.raises(SnifferError, match="a speed is 0 or more times real time, not "):
        sniffer.replay(CAPTURE, lambda: pytest.fail("it is shown"), speed=speed)


def test_parts_and_selections_in_words_say_how_they_are_made() -> None:
    wrong: Any = "@first-error"
    with pytest.raises(SnifferError, match=r"a window is made like Window\('@first-error'\)"):
        sniffer.diagnose(CAPTURE, window=wrong)
    with pytest.raises(SnifferError, match=r"is made like Selection\.parse\('servo_id = 3'\)"):
        sniffer.convert(CAPTURE, "x.csv", selection=cast("Any", "servo_id = 3"))


def test_a_part_may_be_from_a_moment_to_a_moment() -> None:
    """In the words of Python; one without a zone is of UTC, as the tables print it."""
    at = datetime.datetime(2026, 11, 20, 22, 55, 8)
    part = sniffer.Window(at, at.replace(second=10, tzinfo=datetime.UTC))
    words = sniffer.Window("2026-11-20 22:55:08", "2026-11-20 22:55:10")
    asked, told = ([*sniffer.read_batches(CAPTURE, "frames", window=w)] for w in (part, words))
    assert asked == told
    assert sum(batch.num_rows for batch in asked) > 300
    later = sniffer.Window(datetime.timedelta(seconds=2), datetime.timedelta(seconds=4))
    assert later.places() == sniffer.Window(2, 4).places()
    with pytest.raises(InputError, match="b'2' is no place in a capture: write it like 10, "):
        sniffer.stats(CAPTURE, window=sniffer.Window(cast("Any", b"2")))
