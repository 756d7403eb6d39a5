"""Lines around what is selected: as grep shows them, bus by bus, however the stream is cut."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.decoding.slicing import Narrowing
from sniffer.ground.model import Batch, Chunk
from sniffer.selection.selection import Selection
from tests.commands import frames_of, records, sniffer, talk, within
from tests.golden import CAPTURES
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from sniffer.protocols.base import BusProtocol

DAMAGED: Final = CAPTURES / "mightyzap_damaged.log"


def near(count: int, meant: Iterable[int], n: int) -> list[int]:
    """Return which of so many lines are among those meant, or within n of one."""
    return sorted({k for i in meant for k in range(max(i - n, 0), min(i + n + 1, count))})


class Seen:
    """A sink that keeps where the frames stand that are shown around a selection."""

    def __init__(self) -> None:
        self.at: dict[str, list[int]] = {}
        self.waits = 0

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        self.waits += len(chunks)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        assert batch.around is not None
        starts = batch.frames.start[batch.around[0]] + batch.base
        self.at.setdefault(bus, []).extend(starts.tolist())

    def close(self) -> None: ...


@settings(max_examples=30)
@given(st.integers(1, 9), st.lists(st.integers(1, 40), min_size=1, max_size=30), st.integers(1, 60))
def test_lines_around_are_the_same_however_the_stream_is_cut(
    n: int, sizes: list[int], servo: int
) -> None:
    """Passes of one frame and of many: what is selected next may be passes behind."""
    data = talk(20)
    frames = [frame for frame, _ in frames_of(data)]
    starts = [0, *itertools.accumulate(len(frame) for frame in frames)][:-1]
    meant = [k for k, frame in enumerate(frames) if k % 61 == servo]
    asked = f"offset IN ({', '.join(str(starts[k]) for k in meant)})" if meant else "offset = -1"
    seen = Seen()
    pipeline = Pipeline(Options("mightyzap"), [seen])
    pipeline.narrowing = Narrowing(None, Selection.parse(f"length > 0 AND ({asked})"
        .replace("offset", '"offset"')).rows, n)  # fmt: skip
    rest = [Chunk(frame) for frame in frames]
    for size in itertools.cycle(sizes):
        if not rest:
            break
        pipeline.feed(rest[:size])
        del rest[:size]
    pipeline.close()
    assert seen.at.get("bus0", []) == [starts[k] for k in near(len(frames), meant, n)]


@each_in_turn(2, "n", [1, 3, 200])
def test_a_table_with_lines_around_is_what_grep_shows_of_the_table(
    n: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)  # as into a pipe: nothing is left out

    def table(*asked: str) -> list[str]:
        return within(capsys, "decode", DAMAGED, *asked).out.partition("\n\n")[0].splitlines()[1:]

    whole, selected = table(), table("--op", "store_data", "--servo", "3")
    meant = [k for k, line in enumerate(whole) if line in selected]
    assert len(meant) == len(selected)
    want: list[str] = []
    last = -1
    for k in near(len(whole), meant, n):
        want += ["--"] if want and k > last + 1 else []
        want.append(f"{'*' if k in meant else ' '} {whole[k]}")
        last = k
    assert table("--op", "store_data", "--servo", "3", "--context", str(n)) == want


def test_json_lines_tell_what_stands_around_and_count_what_is_selected(
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked = ("decode", DAMAGED, "--format", "jsonl", "--code", "bad-checksum")
    rows = records(within(capsys, *asked, "-C", "2").out)
    assert rows[0]["context"] == rows[-1]["selection"]["context"] == 2
    around = [r for r in rows if r["type"] in ("frame", "gap")]
    assert all(r["context"] for r in around)
    plain = records(within(capsys, *asked).out)
    assert [r for r in rows if r["type"] == "anomaly"] == plain[1:-1]
    assert rows[-1]["selection"]["shown"] == plain[-1]["selection"]["shown"]
    bad = [r["evidence"][0][0] for r in plain[1:-1]]
    every = [r for r in records(within(capsys, *asked[:4]).out) if r["type"] in ("frame", "gap")]
    places = [k for k, r in enumerate(every) if r["offset"] in bad]
    # the anomaly is a line of its own behind that of its bytes
    want = sorted({k for at in places for k in range(at - 1, at + 3)})
    assert [r["offset"] for r in around] == [every[k]["offset"] for k in want]


def test_frames_whose_exchange_is_selected_stand_among_the_lines_around(
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked = ("--format", "jsonl", "--where", "outcome = 'no_response'", "-C", "1")
    rows = records(within(capsys, "decode", DAMAGED, *asked).out)
    missing = {r["request_offset"] for r in rows if r["type"] == "transaction"}
    assert missing <= {r["offset"] for r in rows if r["type"] == "frame"}


def test_lines_around_are_of_the_same_bus_and_buses_keep_the_order_of_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    text = DAMAGED.read_text(encoding="utf-8")
    path = tmp_path / "two.log"
    path.write_text(text + text.replace(" bus0 #", " arm #"), encoding="utf-8")

    def lines(*asked: str) -> list[str]:
        out = within(capsys, "decode", path, "--code", "no-response", "--time", "rel", *asked).out
        return out.partition("\n\n")[0].splitlines()[1:]

    of_arm = [line for line in lines("--bus", "arm", "-C", "2") if line != "--"]
    assert len(of_arm) > 30
    both = [line for line in lines("-C", "2") if line != "--"]
    assert [line for line in both if " arm " in line[:28]] == of_arm
    times = [float(line[2:].split()[0]) for line in both]
    assert times == sorted(times)


@pytest.mark.parametrize(
    ("asked", "why"),
    [
        (("--context", "3"), "--context N goes with a selection, such as --code no-response"),
        (
            ("--context", "3", "--servo", "1", "--jobs", "2"),
            "--jobs decodes piece by piece: leave --context out",
        ),
    ],
)
def test_lines_around_nothing_are_refused(asked: tuple[str, ...], why: str) -> None:
    done = sniffer("decode", DAMAGED, *asked)
    assert done.status == 2
    assert why in done.complaint
