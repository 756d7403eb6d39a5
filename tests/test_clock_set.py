"""Captures whose clock was set meanwhile: back, as logs in local time are, or from 1970 to now."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest

import sniffer
from sniffer.ground.heard import SET_BACK_NS, HeardSpan, was_set
from sniffer.ground.model import NS
from sniffer.inside.index import CaptureIndex
from sniffer.inside.places import line_of
from tests.commands import within

if TYPE_CHECKING:
    from tests.test_convert import Capsys

CAPTURE: Final = Path(__file__).parents[1] / "sample_captures" / "mightyzap_damaged.log"
BEFORE: Final = 700
"""Lines in front of the moment at which the clock is set back by an hour."""


@pytest.fixture
def summer_ends(tmp_path: Path) -> Path:
    lines = CAPTURE.read_text().splitlines()
    later = [re.sub(r"^\((\d+)", lambda t: f"({int(t[1]) - 3600}", line) for line in lines[BEFORE:]]
    path = tmp_path / "october.log"
    path.write_text("\n".join([*lines[:BEFORE], *later]))
    return path


@pytest.fixture
def told_the_time(tmp_path: Path) -> Path:
    """A computer without a battery counts from 1970 until somebody tells it the time."""
    lines = CAPTURE.read_text().splitlines()
    first = int(lines[0][1:11])
    early = [
        re.sub(r"^\((\d+)", lambda t: f"({int(t[1]) - first}", line) for line in lines[:BEFORE]
    ]
    path = tmp_path / "booted.log"
    path.write_text("\n".join([*early, *lines[BEFORE:]]))
    return path


@pytest.mark.parametrize("which", ["summer_ends", "told_the_time"])
def test_a_capture_is_as_long_as_it_was_heard_though_its_clock_was_set(
    which: str, request: pytest.FixtureRequest, tmp_path: Path, capsys: Capsys
) -> None:
    capture: Path = request.getfixturevalue(which)
    want = sniffer.decode(CAPTURE).summary.buses["bus0"].seconds
    assert want is not None

    def ran(*command: str | Path) -> str:
        return within(capsys, *command).out

    (bus,) = json.loads(ran("stats", capture, "--format", "json"))["buses"]
    judged = sniffer.diagnose(capture).judged[0]["seconds"]
    runs = json.loads(ran("diff", CAPTURE, capture, "--format", "json"))
    for seconds in (
        sniffer.decode(capture).summary.buses["bus0"].seconds,
        *(bus["seconds"], judged, runs["a"]["seconds"], runs["b"]["seconds"]),
    ):
        assert seconds == pytest.approx(want, abs=0.01)
    low, _ = bus["longest_silence"]["value_ns"]
    assert low < 100_000_000
    ran("report", capture, "-o", tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text("utf-8")
    assert re.search(r", over (7\.99\d|8|8\.00\d) s, 18442 bytes", page)


def test_a_part_ends_where_its_end_comes_first(
    summer_ends: Path, tmp_path: Path, capsys: Capsys
) -> None:
    shown = within(capsys, "decode", summer_ends, "--to", "1", "--format", "jsonl")
    out = tmp_path / "first.log"
    assert within(capsys, "cut", summer_ends, "--to", "1", "-o", out).status == 0
    cut = sniffer.decode(out).summary.buses["bus0"].bytes
    assert cut == pytest.approx(json.loads(shown.out.splitlines()[-1])["bytes"], abs=100)


def _frames(capsys: Capsys, *command: str | Path) -> list[tuple[int, str]]:
    """Return which frames a command shows."""
    out = within(capsys, *command, "--protocol", "mightyzap", "--format", "jsonl").out
    rows = [json.loads(line) for line in out.splitlines()]
    return [(row["offset"], row["hex"]) for row in rows if row["type"] == "frame"]


@pytest.mark.parametrize("which", ["summer_ends", "told_the_time"])
@pytest.mark.parametrize(
    "part",
    [
        "--from 5 --to 5.5",
        "--from -500ms",
        "--from @byte:12175 --around 20ms",
        "--from @noise:20 --around 50ms",
    ],
)
def test_a_part_behind_a_clock_that_was_set_is_that_of_one_that_was_not(
    part: str, which: str, request: pytest.FixtureRequest, tmp_path: Path, capsys: Capsys
) -> None:
    """Second 5 was never reached, and -500ms lay before the clock was set."""
    capture: Path = request.getfixturevalue(which)
    words = part.split()
    shown = [_frames(capsys, "decode", path, *words) for path in (CAPTURE, capture)]
    assert shown[0]
    # as long as the silence was in which the clock was set what comes behind it is said earlier
    assert len({*shown[0]} ^ {*shown[1]}) <= 2
    cuts = []
    for path in (CAPTURE, capture):
        out = tmp_path / f"{path.stem}.bin"
        assert within(capsys, "cut", path, *words, "-o", out).status == 0
        cuts.append(out.read_bytes())
    assert abs(len(cuts[0]) - len(cuts[1])) <= 60
    assert cuts[0][100:150] in cuts[1]


@pytest.mark.parametrize(
    ("part", "first", "last"),
    [
        ("--from 21:55:10.5 --to 21:55:11", "21:55:10.5", "21:55:11"),
        ("--from 22:55:07 --to 22:55:08", "22:55:07", "22:55:08"),
        ("--from 22:55:06.5 --to 22:55:07", "22:55:06.5", "22:55:07"),
    ],
)
def test_a_time_of_day_is_what_the_stamps_say_where_the_clock_was_set_back(
    part: str, first: str, last: str, summer_ends: Path, tmp_path: Path, capsys: Capsys
) -> None:
    words = part.split()
    told = within(capsys, "decode", summer_ends, *words, "--protocol", "mightyzap")
    assert "second 0 to 0" not in told.err
    lines = re.findall(r"^(\d\d:\d\d:\d\d\.\d+) ", told.out, re.MULTILINE)
    assert lines[0].startswith(first[:8])
    assert lines[0] >= first
    assert lines[-1] <= last
    out = tmp_path / "part.log"
    assert within(capsys, "cut", summer_ends, *words, "-o", out).status == 0
    frames = sniffer.decode(out).summary.buses["bus0"].kinds
    shown = _frames(capsys, "decode", summer_ends, *words)
    assert sum(frames.values()) == pytest.approx(len(shown), abs=5)


def test_a_time_of_day_is_that_of_the_day_the_clock_was_set_to(
    told_the_time: Path, capsys: Capsys
) -> None:
    told = within(capsys, "decode", told_the_time, "--from", "22:55:11", "--to", "22:55:12")
    lines = re.findall(r"^(\d\d:\d\d:\d\d\.\d+) ", told.out, re.MULTILINE)
    assert lines[0].startswith("22:55:11.")
    assert lines[-1].startswith("22:55:11.")


@pytest.mark.parametrize("begin", [[], ["--from", "1"]])
def test_pieces_of_a_capture_whose_clock_was_set_are_as_long_as_was_asked_for(
    begin: list[str], summer_ends: Path, tmp_path: Path, capsys: Capsys
) -> None:
    split = within(capsys, "cut", summer_ends, *begin, "--split", "1s", "-o", tmp_path / "p.log")
    assert split.status == 0
    pieces = sorted(tmp_path.glob("p-*.log"))
    lengths = [sniffer.decode(piece).summary.buses["bus0"].seconds or 0 for piece in pieces]
    assert lengths[:-1] == pytest.approx([1.0] * (len(pieces) - 1), abs=0.05)
    assert sum(lengths) == pytest.approx(7 if begin else 8, abs=0.2)
    assert pieces[0].name == "p-0001.log"


def test_times_since_the_first_line_go_on_where_the_clock_was_set(
    summer_ends: Path, capsys: Capsys
) -> None:
    """They were -3595 s."""
    for times, most in (("rel", 8.1), ("delta", 0.2)):
        out = within(capsys, "decode", summer_ends, "--time", times).out
        seconds = [float(t) for t in re.findall(r"^ +(-?\d+\.\d+) ", out, re.MULTILINE)]
        assert len(seconds) > 1000
        assert min(seconds) >= -0.01
        assert max(seconds) <= most


@pytest.mark.parametrize("which", ["summer_ends", "told_the_time"])
def test_a_capture_is_opened_where_it_was_asked_for_though_its_clock_was_set(
    which: str, request: pytest.FixtureRequest
) -> None:
    """``g`` went to a line of before, or to none."""
    at = {}
    capture: Path = request.getfixturevalue(which)
    for path in (CAPTURE, capture):
        index = CaptureIndex()
        for bus, protocol, batch in sniffer.decode(path).batches:
            index.write(bus, protocol, batch)
        index.close()
        words = ("5", "-1", "@noise:20-500ms", "22:55:12" if which == "told_the_time" else "7")
        at[path] = [line_of(text, index) for text in words]
        if which == "summer_ends" and path != CAPTURE:
            begun = line_of("21:55:12", index)
            assert abs(begun - at[CAPTURE][-1] + 87) < 200
        index.discard()
    apart = np.array(at[CAPTURE]) - np.array(at[capture])
    assert np.abs(apart).max() <= 2


@pytest.mark.parametrize("which", ["summer_ends", "told_the_time"])
def test_rows_a_step_apart_go_on_where_the_clock_was_set(
    which: str, request: pytest.FixtureRequest, tmp_path: Path, capsys: Capsys
) -> None:
    rows = []
    for path in (CAPTURE, request.getfixturevalue(which)):
        out = tmp_path / f"{path.stem}.csv"
        assert within(capsys, "convert", path, out, "--wide", "--every", "100ms").status == 0
        rows.append(len(out.read_text().splitlines()))
    assert abs(rows[0] - rows[1]) <= 1


@pytest.mark.parametrize("which", ["summer_ends", "told_the_time"])
def test_slices_periods_and_pieces_go_on_where_the_clock_was_set(
    which: str, request: pytest.FixtureRequest, tmp_path: Path, capsys: Capsys
) -> None:
    """A period was an hour or 56 years, slices were none or too many, a capture was one piece."""
    capture: Path = request.getfixturevalue(which)
    slices, sent, sizes = [], [], []
    for path in (CAPTURE, capture):
        out = within(capsys, "stats", path, "--every", "2s", "--format", "json").out
        (bus,) = json.loads(out)["buses"]
        slices.append(bus["slices"]["bytes"])
        sent.append(
            {
                (c["servo_id"], c["op"]): c["period_ns"]["max"]
                for c in bus["commands"]
                if c["op"] == "load_data" and c["period_ns"]
            }
        )
        folder = tmp_path / path.stem
        folder.mkdir()
        assert within(capsys, "cut", path, "--split", "2s", "-o", folder / "x.log").status == 0
        pieces = [sniffer.decode(piece) for piece in sorted(folder.iterdir())]
        sizes.append([piece.summary.buses["bus0"].bytes for piece in pieces])
    assert sum(slices[1]) == sum(slices[0]) == sum(sizes[1]) == sum(sizes[0])
    assert len(sent[0]) == 3
    for command, longest in sent[0].items():
        assert sent[1][command] == pytest.approx(longest, rel=0.05)
    assert sizes[1][:3] == pytest.approx(sizes[0][:3], rel=0.05)
    begun = slices[1][0] + slices[1][1]
    assert which == "told_the_time" or begun == slices[0][0] + slices[0][1]


def test_stamps_that_overlap_are_no_clock_that_was_set_back() -> None:
    times = np.array([0, SET_BACK_NS, 1, 2, -SET_BACK_NS + 2, -SET_BACK_NS + 1], np.int64)
    assert was_set(times, SET_BACK_NS).tolist() == []
    assert was_set(times, SET_BACK_NS + 1).tolist() == [0]


def test_protocols_of_one_wire_are_told_one_behind_the_other_and_no_clock_was_set() -> None:
    (_, _, batch), *_ = sniffer.decode(CAPTURE).batches
    frames, heard = batch.frames, HeardSpan()
    half = len(frames) // 2
    heard.take("b", frames.take(slice(half, None)))
    heard.take("a", frames.take(slice(0, half)))
    heard.take("b", frames.take(slice(len(frames) - 1, None)))
    assert heard.ns == int(frames.t_end[-1] - frames.t_start[0])


def test_of_two_protocols_one_that_fell_silent_before_the_clock_was_set_counts_no_step() -> None:
    (_, _, batch), *_ = sniffer.decode(CAPTURE).batches
    frames, heard = batch.frames, HeardSpan()
    half = len(frames) // 2
    back = frames.take(slice(half, None))
    heard.take("a", frames.take(slice(0, half)))
    heard.take("b", frames.take(slice(0, half)))
    heard.take("b", back.having(t_end=back.t_end - 3600 * NS, t_start=back.t_start - 3600 * NS))
    assert 0 < heard.ns < int(frames.t_end[-1] - frames.t_start[0]) + 1


def test_what_is_heard_in_parts_was_heard_as_long_as_in_one(summer_ends: Path) -> None:
    batches = sniffer.decode(summer_ends).batches
    whole, joined = HeardSpan(), HeardSpan()
    for _, protocol, batch in batches:
        cut = len(batch.frames) // 2
        for frames in (batch.frames.take(slice(0, cut)), batch.frames.take(slice(cut, None))):
            whole.take(protocol.name, frames)
            part = HeardSpan()
            part.take(protocol.name, frames)
            joined.join(part)
    assert joined.ns == whole.ns > 0
