"""One capture decoded in parts is what it is decoded in one go, to the last byte."""

from __future__ import annotations

import io
import json
import sys
from typing import TYPE_CHECKING, Any, Final

import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.decoding.options import Options
from sniffer.ground.timing import byte_time_ns
from sniffer.jobs import parts
from sniffer.jobs.asked import Extract
from sniffer.jobs.crew import Crew, LostWorkerError
from sniffer.jobs.session import Ending, Patience, run_source
from sniffer.jobs.telling import Teller
from sniffer.mcapfile.sink import McapSink
from sniffer.protocols import PROTOCOLS
from sniffer.selection.selection import Selection
from sniffer.simulation.buses import simulate
from sniffer.sinks.jsonl import JsonlSink
from sniffer.sinks.tables import TableSink
from sniffer.sinks.text import TextSink
from sniffer.sources import open_source
from sniffer.sources.stretches import Sizes
from tests.commands import within
from tests.lists import in_turn
from tests.parted import Inline, recorded
from tests.streams import chunked, stream

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sniffer.decoding.sink import Sink

EVERY = pytest.mark.parametrize("name", PROTOCOLS)
SMALL: Final = Sizes(head=300, least=40, most=200, warm=100, block=1, first=0)
FEW: Final = settings(max_examples=max(settings().max_examples // 10, 2))
"""Each example decodes a capture twice and writes files; `make fuzz` takes hundreds."""
QUIET: Final = Teller(lambda line: None, quiet=True)


Lines = dict[tuple[str, str], list[str]]


def both_ways(
    path: Path,
    options: Options,
    sizes: Sizes = SMALL,
    *,
    asked: Extract | None = None,
    crew: Any = None,
) -> tuple[Lines, Lines]:
    """Return what JSON lines say of a capture, decoded in one go and in parts.

    Each kind of record and each bus by itself, and anomalies in any order: where among the lines
    another bus stands, and what was held back, depends on how bytes are grouped.
    """
    whole, split = io.StringIO(), io.StringIO()
    told: list[dict[str, Any]] = []
    said: list[list[str]] = []
    for out, how in ((whole, False), (split, True)):
        sinks: list[Sink] = [JsonlSink(out)]
        said.append([])
        tell = Teller(said[-1].append)
        source = open_source(path, {".mcap": "mcap", ".log": "candump"}.get(path.suffix, "bin"))
        if how:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(parts, "Crew", crew or Inline)
                summary, _ = parts.decode_in_parts(
                    *(source, options, sinks),
                    jobs=3,
                    name="it",
                    tell=tell,
                    asked=asked,
                    folder=path.parent,
                    sizes=sizes,
                )
        else:
            summary, _ = run_source(source, options, sinks, name="it", tell=tell, asked=asked)
        told.append(summary.as_dict())
    assert told[0] == told[1]
    assert said[0] == said[1]
    return _by_kind(whole.getvalue()), _by_kind(split.getvalue())


def _by_kind(text: str) -> Lines:
    out: Lines = {}
    for line in text.splitlines():
        row = json.loads(line)
        if "bus" in row:  # the summary is compared as a whole
            out.setdefault((row["type"], row["bus"]), []).append(line)
    for (kind, _), lines in out.items():
        if kind == "anomaly":
            lines.sort()
    return out


@in_turn(2)
@EVERY
@FEW
@given(data=st.data())
def test_raw_bytes_in_parts_give_the_lines_of_the_whole_whatever_they_are(
    name: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    raw = b"".join(data.draw(st.lists(stream(name), min_size=3, max_size=8))) or b"\0"
    sizes = Sizes(
        head=data.draw(st.sampled_from([1, 64, 400])),
        least=data.draw(st.sampled_from([9, 70, 300])),
        most=300,
        warm=data.draw(st.sampled_from([0, 1, 7, 64, 400])),
        block=1,
        first=0,
    )
    path = tmp_path_factory.mktemp("raw") / "x.bin"
    path.write_bytes(raw)
    whole, split = both_ways(path, Options(protocol=name), sizes)
    assert split == whole


@in_turn(2)
@EVERY
@FEW
@given(data=st.data())
def test_recordings_in_parts_give_the_lines_of_the_whole(
    name: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    p = PROTOCOLS[name]
    raw = b"".join(data.draw(st.lists(stream(name), min_size=3, max_size=6))) + b"\0\1"
    chunks = data.draw(chunked(raw, byte_time_ns(p.baud), p.tail_ns))
    path = recorded(tmp_path_factory.mktemp("recorded") / "x.mcap", chunks)
    sizes = Sizes(head=1, least=1, most=data.draw(st.sampled_from([1, 30])), warm=30, first=0)
    whole, split = both_ways(path, Options(protocol=name), sizes)
    assert split == whole


@in_turn(2)
@EVERY
@FEW
@given(data=st.data())
def test_logs_in_parts_give_the_lines_of_the_whole(
    name: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    p = PROTOCOLS[name]
    places = data.draw(st.sampled_from([9, 6, 3, 1, 0]), "decimal places of a second")
    lines = []
    for bus in ("bus0", "bus1"):
        raw = b"".join(data.draw(st.lists(stream(name), min_size=2, max_size=4))) + b"\0\1"
        for chunk in data.draw(chunked(raw, byte_time_ns(p.baud), p.tail_ns)):
            assert chunk.t_ns is not None
            second, rest = divmod(chunk.t_ns, 1_000_000_000)
            time = f"{second}.{rest:09d}"[: places - 9 or None].rstrip(".")
            lines.append((chunk.t_ns, f"({time}) {bus} #{chunk.data.hex().upper()}"))
    lines.sort(key=lambda line: line[0])
    path = tmp_path_factory.mktemp("logged") / "x.log"
    path.write_text(
        "# a comment\n" * 9
        + "\n".join(line for _, line in lines)
        + data.draw(st.sampled_from(["", "\n", "\nnonsense"]))
    )
    sizes = Sizes(head=60, least=20, most=40, warm=data.draw(st.sampled_from([0, 30])), first=0)
    options = Options(protocol=name, baud=p.baud, latency_ns=1_000_000)
    whole, split = both_ways(path, options, sizes)
    assert split == whole


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Raw bytes of a simulated bus, and noise between."""
    wire = b"".join(frame.wire for frame in simulate("wck", seed=4, duration_s=2))
    path = tmp_path_factory.mktemp("capture") / "x.bin"
    path.write_bytes(wire + bytes(range(200)) + wire)
    return path


WIDE: Final = Sizes(head=900, least=600, most=600, warm=500, block=1, first=0)


def test_a_bus_that_changes_little_is_joined_without_decoding_anything_twice(
    capture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[parts.JoinedParts] = []
    usual = parts.JoinedParts.run

    def run(self: parts.JoinedParts, folder: Path) -> None:
        made.append(self)
        usual(self, folder)

    monkeypatch.setattr(parts.JoinedParts, "run", run)
    whole, split = both_ways(capture, Options(protocol="wck"), WIDE)
    assert split == whole
    assert made[0].joined >= 5
    assert made[0].repeated <= 2


def test_processes_of_their_own_say_what_one_says(capture: Path) -> None:
    whole, split = both_ways(capture, Options(protocol="wck"), WIDE, crew=Crew)
    assert split == whole


@pytest.mark.parametrize("where", ["servo_id = 3", "code = 'noise'"])
def test_a_selection_is_the_same_in_parts(capture: Path, where: str) -> None:
    asked = Extract.of(Selection.parse(where), None)
    whole, split = both_ways(capture, Options(protocol="wck"), WIDE, asked=asked)
    assert split == whole


@pytest.mark.parametrize(
    ("spoken", "said"),
    [("mightyzap", ["looks_like"]), ("lss", ["models"]), ("lss", [])],
    ids=["what it looks like", "a model", "a model that is refuted"],
)
def test_a_summary_in_parts_tells_what_it_looks_like_and_models_as_of_the_whole(
    spoken: str, said: list[str], tmp_path: Path
) -> None:
    models = ("lss-pro", "lss-pro" if said else "lss") if spoken == "lss" else ("mightyzap-l12",)
    path, named = tmp_path / "x.bin", "lss" if spoken == "lss" else "wck"
    path.write_bytes(
        b"".join(
            frame.wire
            for model in models
            for frame in simulate(spoken, seed=4, duration_s=1, models={None: model})
        )
    )
    whole, split = both_ways(path, Options(protocol=named), WIDE)
    assert split == whole
    summary, _ = run_source(open_source(path, "bin"), Options(protocol=named), [], name="it",
                            tell=QUIET)  # fmt: skip
    (bus,) = summary.as_dict()["buses"].values()
    assert sorted(bus.keys() & {"looks_like", "models"}) == said


def _as_text(path: Path, tmp: Path, make: Callable[[Path], Sink], *, split: bool) -> None:
    sinks = [make(tmp)]
    source = open_source(path, "bin")
    options = Options(protocol="wck")
    if not split:
        run_source(source, options, sinks, name="it", tell=QUIET)
        return
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts, "Crew", Inline)
        parts.decode_in_parts(
            source, options, sinks, jobs=2, name="it", tell=QUIET, folder=tmp, sizes=WIDE
        )


class _Text(TextSink):
    def __init__(self, path: Path) -> None:
        self._out = path.open("w", encoding="utf-8")
        super().__init__(self._out)

    def close(self) -> None:
        super().close()
        self._out.close()


@pytest.mark.parametrize("suffix", [".txt", ".parquet", ".csv", ".mcap"])
def test_every_kind_of_output_is_the_same_in_parts(
    capture: Path, tmp_path: Path, suffix: str
) -> None:
    made = []
    kinds: dict[str, Callable[[Path], Sink]] = {
        ".txt": _Text,
        ".mcap": lambda path: McapSink(path, {"tool": "servo-sniffer test"}),
    }
    for split in (False, True):
        folder = tmp_path / str(split)
        folder.mkdir()
        out = folder / f"out{suffix}"
        make = kinds.get(suffix, TableSink)
        _as_text(capture, folder, lambda _, o=out, m=make: m(o), split=split)  # type: ignore[misc]
        made.append(out)
        assert sorted(p.suffix for p in folder.iterdir()) == [suffix] * (
            2 if suffix in (".parquet", ".csv") else 1
        )
    whole, parted = made
    if suffix == ".parquet":
        for one in (".parquet", ".frames.parquet"):
            tables = [pq.read_table(path.with_suffix(one)) for path in made]
            assert tables[0].to_pydict() == tables[1].to_pydict()
    elif suffix == ".mcap":
        lines = []
        for path in made:
            text = io.StringIO()
            run_source(open_source(path), Options(), [JsonlSink(text)], name="it", tell=QUIET)
            lines.append(text.getvalue())
        assert lines[0] == lines[1]
    elif suffix == ".txt":
        assert parted.read_text(encoding="utf-8") == whole.read_text(encoding="utf-8")
    else:
        assert parted.read_bytes() == whole.read_bytes()


def test_an_interruption_keeps_what_is_joined_and_says_so(
    capture: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    patience, lines = Patience(), list[str]()
    monkeypatch.setattr(parts, "Crew", Inline)
    usual = parts.JoinedParts._join

    def join(self: parts.JoinedParts, folder: Path) -> None:
        usual(self, folder)
        patience.asked |= self.joined >= 3

    monkeypatch.setattr(parts.JoinedParts, "_join", join)
    out = io.StringIO()
    summary, ending = parts.decode_in_parts(
        open_source(capture, "bin"),
        Options(protocol="wck"),
        [JsonlSink(out)],
        jobs=2,
        name="it",
        tell=Teller(lines.append),
        patience=patience,
        folder=tmp_path,
        sizes=WIDE,
    )
    assert ending == Ending.INTERRUPTED
    assert lines[-1] == "interrupted: what was decoded is kept"
    total = summary.as_dict()["bytes"]
    assert 900 + 3 * 600 <= total < capture.stat().st_size
    rows = [json.loads(line) for line in out.getvalue().splitlines()]
    assert sum(r["length"] for r in rows if r["type"] in ("frame", "gap")) == total
    assert not list(tmp_path.iterdir())


DIES: Final = "__import__('os').kill(__import__('os').getpid(), 9)"


def test_a_process_that_is_killed_is_told_and_another_one_takes_its_place() -> None:
    with Crew(1, eval) as crew:
        became = []
        for task in ("'one'.upper()", DIES, "'two'.upper()"):
            crew.give(task)
            while not (now := crew.wait(10)):
                continue
            became += now
    assert [b.result for b in became] == ["ONE", None, "TWO"]
    assert isinstance(became[1].error, LostWorkerError)
    assert "killed by SIGKILL" in str(became[1].error)


ORPHANS: Final = f"{DIES.replace('getpid', 'getppid')} or __import__('time').sleep(60)"


@pytest.mark.skipif(sys.platform == "win32", reason="needs a fork server")
def test_where_the_process_is_killed_that_begins_the_others_they_are_begun_by_another() -> None:
    with Crew(1, eval) as crew:
        became = []
        for task in (ORPHANS, "'two'.upper()"):
            crew.give(task)
            while not (now := crew.wait(10)):
                continue
            became += now
    assert became[-1].result == "TWO"


def test_a_task_whose_process_cannot_be_begun_is_told_as_lost_and_nothing_has_begun(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refused(*_: object) -> None:
        raise EOFError("unexpected EOF")

    monkeypatch.setattr("sniffer.jobs.crew._CrewMember", refused)
    monkeypatch.setattr("sniffer.jobs.crew.AGAIN_S", (0.0, 0.0))
    with Crew(1, eval) as crew:
        crew.give("1")
        assert crew.is_busy
        ((task, result, error),) = crew.wait()
        assert not crew.is_busy
    assert (task, result) == ("1", None)
    assert isinstance(error, LostWorkerError)
    assert str(error) == "no process can be begun (unexpected EOF)"
    assert not error.had_begun


def test_decode_takes_jobs_and_says_where_one_process_does_it(
    capture: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "x.hex"
    log.write_text(capture.read_bytes()[:600].hex(" "))
    ran = within(
        capsys, "decode", log, "--protocol", "wck", "--jobs", "2", "-q", "-o", tmp_path / "x.jsonl"
    )
    assert ran.status == 0
    ran = within(capsys, "decode", log, "--protocol", "wck", "--jobs", "2", "--summary")
    assert "decoded by one process: only raw bytes, candump logs and recordings" in ran.err
    refused = within(capsys, "decode", "-", "--jobs", "2")
    assert refused.status == 2
    assert refused.complaint == "--jobs needs a file: save standard input first"
    refused = within(capsys, "decode", capture, "--jobs", "2", "--from", "1")
    assert refused.status == 2
    assert refused.complaint == "--jobs decodes a whole capture: leave --from and --to out"
