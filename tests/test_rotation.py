"""A recording in several files: nothing is missing between them, and each is whole in itself."""

from __future__ import annotations

import itertools
import random
import re
from typing import TYPE_CHECKING, Any

import pytest

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import NS, Chunk, Clock, Mark, MarkKind, OutputError
from sniffer.jobs.compare import compare
from sniffer.mcapfile.ends import End, ends
from sniffer.mcapfile.recover import recover
from sniffer.mcapfile.rotation import RotatingMcap
from sniffer.mcapfile.source import chunks, session
from sniffer.protocols import PROTOCOLS
from sniffer.sources import open_source
from tests.lists import each_in_turn
from tests.recorder import Collected
from tests.recordings import START_NS, heads, messages, talk
from tests.test_mcap import RERUN, rerun

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

BUSES = {"arm": "mightyzap", "leg": "wck", "hand": "rs30x", "head": "lss"}
FACTS = {"tool": "test", **{f"baud.{b}": str(PROTOCOLS[p].baud) for b, p in BUSES.items()}}
ROUND_NS = 50_000_000


class Wall:
    """The time, as the traffic has it."""

    def __init__(self) -> None:
        self.ns = START_NS

    def __call__(self) -> int:
        return self.ns


def spoken() -> list[list[Chunk]]:
    """Return what four buses say in two seconds, in groups of 50 ms; some of it is remarked on."""
    rng = random.Random(1)
    sent = []
    for seed, (bus, protocol) in enumerate(BUSES.items()):
        for chunk in talk(protocol, 2.0, seed, bus=bus):
            some = rng.random() < 0.1
            marks = (Mark(MarkKind.FRAMING, 0, len(chunk.data), 2),) if some else ()
            sent.append(Chunk(chunk.data, chunk.t_ns, Clock.READ, bus, marks=marks))
    sent.sort(key=lambda c: c.t_ns or 0)
    rounds = itertools.groupby(sent, lambda c: ((c.t_ns or 0) - START_NS) // ROUND_NS)
    return [list(group) for _, group in rounds]


@pytest.fixture(scope="module")
def traffic() -> list[list[Chunk]]:
    return spoken()


def record(
    path: Path,
    traffic: Sequence[Sequence[Chunk]],
    each: Callable[[RotatingMcap, int], None] = lambda file, number: None,
    **limits: Any,
) -> RotatingMcap:
    """Record and decode as a live recorder does; ``each`` is called once a round."""
    wall = Wall()
    file = RotatingMcap(path, FACTS, now=wall, flush_ns=0, **limits)
    pipeline = Pipeline(Options(protocols=BUSES), [file], live=True)
    for number, group in enumerate(traffic):
        wall.ns = max(c.t_ns or 0 for c in group)
        pipeline.feed(group)
        pipeline.idle(wall.ns)
        each(file, number)
        file.turn(pipeline.decided())
        file.flush()
    pipeline.close()
    pipeline.finish()
    return file


def ended(path: Path) -> dict[str, End]:
    """Return where a file says that it ends."""
    with path.open("rb") as stream:
        return ends(stream)


def joined(files: Sequence[Path]) -> dict[str, list[Any]]:
    """Return the messages of all files by topic."""
    out: dict[str, list[Any]] = {}
    for file in files:
        for topic, found in messages(file).items():
            out.setdefault(topic, []).extend(found)
    return out


def streams(files: Sequence[Path]) -> dict[str, tuple[bytes, list[tuple[int, ...]]]]:
    """Return what the buses said, and where in it the marks stand, over all files."""
    data: dict[str, bytearray] = {}
    marks: dict[str, list[tuple[int, ...]]] = {}
    for file in files:
        for chunk in chunks(file):
            at = len(data.setdefault(chunk.bus, bytearray()))
            data[chunk.bus] += chunk.data
            found = marks.setdefault(chunk.bus, [])
            found += ((at + m.start, at + m.start + m.length) for m in chunk.marks)
    return {bus: (bytes(said), _merged(marks[bus])) for bus, said in data.items()}


def gaps_recorded(recorded: dict[str, list[Any]], bus: str) -> list[tuple[int, int, str]]:
    return [(g.offset, g.length, g.reason) for g in recorded.get(f"/{bus}/gaps", [])]


def alone(path: Path) -> Collected:
    """Return what decoding a file alone finds."""
    source, found = open_source(path), Collected()
    pipeline = Pipeline(Options().with_facts(source.facts()), [found])
    for group in source:
        pipeline.feed(group)
    pipeline.close()
    return found


def frames_again(path: Path) -> dict[str, int]:
    """Return how many frames decoding a file alone finds on each bus."""
    found = alone(path).batches
    return {bus: sum(len(b.frames) for b in batches) for bus, batches in found.items()}


def gaps_again(found: Collected, bus: str, begin: int) -> list[tuple[int, int, str]]:
    """Return the gaps that decoding a file alone finds, by their place in the whole stream."""
    batches = found.batches.get(bus, [])
    return [(begin + b.base + g.start, g.length, g.reason) for b in batches for g in b.gaps]


def _merged(regions: list[tuple[int, ...]]) -> list[tuple[int, ...]]:
    out: list[tuple[int, ...]] = []
    for start, end in regions:
        if out and out[-1][1] == start:
            out[-1] = (out[-1][0], end)
        else:
            out.append((start, end))
    return out


def ask(file: RotatingMcap, number: int) -> None:
    if number in (5, 25):
        file.rotate()
        file.rotate()


LIMITS: dict[str, dict[str, Any]] = {
    "size": {"rotate_bytes": 160_000},
    "size, with a file in which somebody is silent": {"rotate_bytes": 150_000},
    "time": {"rotate_ns": 2 * NS // 5},
    "asked": {"each": ask},
}


@each_in_turn(2, "how", LIMITS)
def test_the_files_joined_are_the_recording_in_one_file(
    how: str, traffic: list[list[Chunk]], tmp_path: Path
) -> None:
    one = record(tmp_path / "one.mcap", traffic)
    file = record(tmp_path / "run.mcap", traffic, **LIMITS[how])
    assert one.files == (tmp_path / "one.mcap",)
    assert len(file.files) >= 3
    assert file.path == file.files[-1]
    assert file.size == sum(path.stat().st_size for path in file.files)
    assert streams(file.files) == streams(one.files)
    for bus in BUSES:
        said = b"".join(c.data for group in traffic for c in group if c.bus == bus)
        assert streams(file.files)[bus][0] == said
    wanted, found = joined(one.files), joined(file.files)
    assert found.keys() == wanted.keys()
    for topic in wanted:
        name = topic.rpartition("/")[2]
        if name in ("anomalies", "log"):  # of one time, they may stand in any order
            assert sorted(found[topic], key=str) == sorted(wanted[topic], key=str), topic
        elif name == "stats":
            assert sum(s.bytes for s in found[topic]) == sum(s.bytes for s in wanted[topic])
        elif name != "raw":
            assert found[topic] == wanted[topic], topic


@each_in_turn(2, "how", LIMITS)
def test_each_file_decodes_alone_to_what_was_recorded_in_it(
    how: str, traffic: list[list[Chunk]], tmp_path: Path
) -> None:
    file = record(tmp_path / "run.mcap", traffic, **LIMITS[how])
    ends = dict.fromkeys(BUSES, 0)
    for number, path in enumerate(file.files, 1):
        report = compare(path, Options(), say=pytest.fail)
        assert report.equal, f"{path.name}: {report}"
        assert sum(b.same for b in report.buses) > 20
        facts = session(path)
        recorded, again, heard = messages(path), alone(path), streams([path])
        assert facts["part"] == str(number)
        assert facts.get("previous") == (file.files[number - 2].name if number > 1 else None)
        for bus, protocol in BUSES.items():
            assert facts[f"protocol.{bus}"] == protocol
            assert facts.get(f"offset.{bus}", "0") == str(ends[bus])
            said = recorded.get(f"/{bus}/raw", [])
            assert said or "silent" in how
            assert all(first.offset == ends[bus] for first in said[:1])
            assert gaps_again(again, bus, ends[bus]) == gaps_recorded(recorded, bus)
            ends[bus] += len(heard.get(bus, (b"",))[0])
            assert ended(path).get(bus, End(ends[bus])).offset == ends[bus]
        assert (ended(path).keys() == BUSES.keys()) == (path != file.path)
        for topic, mine in itertools.groupby(
            sorted(heads(path), key=lambda m: m.channel_id), lambda m: m.channel_id
        ):
            times = [m.log_time for m in mine]
            assert times == sorted(times), topic
        if RERUN is not None:
            assert "PROBLEM" not in rerun("check", "--full", str(path))


def test_a_new_file_is_asked_for_and_the_first_keeps_its_name(
    traffic: list[list[Chunk]], tmp_path: Path
) -> None:
    (tmp_path / "run-0003.mcap").write_bytes(b"of somebody else")
    file = record(tmp_path / "run.mcap", traffic, ask)
    assert [p.name for p in file.files] == [*("run.mcap", "run-0002.mcap", "run-0004.mcap")], (
        "a name that is taken is passed over, and who asks twice at once gets one file"
    )
    assert (tmp_path / "run-0003.mcap").read_bytes() == b"of somebody else"


def test_files_that_are_there_are_replaced_only_where_allowed(
    traffic: list[list[Chunk]], tmp_path: Path
) -> None:
    there = tmp_path / "run-0005.mcap"
    there.write_bytes(b"precious")
    with pytest.raises(OutputError, match=r"run-0005\.mcap is there already"):
        RotatingMcap(tmp_path / "run.mcap", FACTS, rotate_bytes=1000)
    assert [p.name for p in tmp_path.iterdir()] == ["run-0005.mcap"]
    with pytest.raises(OutputError, match="no folder"):
        RotatingMcap(tmp_path / "none" / "run.mcap", FACTS, rotate_bytes=1000)
    (tmp_path / "run.mcap").write_bytes(b"precious")
    with pytest.raises(OutputError, match=r"run\.mcap is there already"):
        RotatingMcap(tmp_path / "run.mcap", FACTS)
    file = record(tmp_path / "run.mcap", traffic, rotate_ns=NS // 5, overwrite=True)
    assert there in file.files
    assert list(chunks(there))


def test_only_the_latest_files_are_kept_and_no_others_touched(
    traffic: list[list[Chunk]], tmp_path: Path
) -> None:
    def put_aside(file: RotatingMcap, number: int) -> None:
        first = tmp_path / "run-0001.mcap"
        if number == 7:
            first.rename(tmp_path / "first.mcap")
            first.write_bytes(b"of somebody else")

    file = record(tmp_path / "run.mcap", traffic, put_aside, rotate_ns=NS // 5, keep=2)
    assert len(file.files) == 2
    last = int(re.findall(r"\d+", file.path.name)[0])
    assert last > 4
    assert {p.name for p in tmp_path.iterdir()} == {
        *("run-0001.mcap", "first.mcap"),
        *(f"run-{n:04d}.mcap" for n in (last - 1, last)),
    }
    assert (tmp_path / "run-0001.mcap").read_bytes() == b"of somebody else"
    assert session(tmp_path / "first.mcap")["part"] == "1"


def test_bytes_that_are_undecided_stand_in_both_files_and_are_read_from_one(
    tmp_path: Path,
) -> None:
    wall = Wall()
    file = RotatingMcap(tmp_path / "run.mcap", {**FACTS, "baud.arm": "10000"}, now=wall)
    sent = [bytes([k]) * 10 for k in range(60)]
    for number, data in enumerate(sent):
        wall.ns += ROUND_NS
        marks = (Mark(MarkKind.FRAMING, 0, 10, 1),) if number == 2 else ()
        file.raw("arm", [Chunk(data, wall.ns, Clock.READ, "arm", marks=marks)])
        file.raw("leg", [Chunk(data, wall.ns, Clock.READ, "leg")])
        if number == 10:
            file.rotate()
        file.turn({"arm": 25})
        file.flush()
    file.close()
    first, second = file.files
    whole = b"".join(sent)
    assert streams([first, second]) == {"arm": (whole, [(20, 30)]), "leg": (whole, [])}
    before = streams([first])
    assert (len(before["arm"][0]), len(before["leg"][0])) == (25, 110)
    found = [messages(path)["/arm/raw"] for path in file.files]
    assert b"".join(m.data for m in found[0]) == whole[:110], "it was in the file before"
    assert b"".join(m.data for m in found[1]) == whole[25:]
    assert found[1][0].offset == 25
    cut_at = START_NS + 3 * ROUND_NS
    assert [c.t_ns for c in chunks(first) if c.bus == "arm"][-1] == cut_at - 5 * 1_000_000
    assert next(chunks(second)).t_ns == cut_at
    assert ended(first) == {"arm": End(25, cut_at - 5 * 1_000_000), "leg": End(110)}
    assert ended(second) == {}, "no file goes on with it"


def test_a_recovered_file_keeps_its_end_wherever_it_was_damaged(
    traffic: list[list[Chunk]], tmp_path: Path
) -> None:
    first = record(tmp_path / "run.mcap", traffic, ask).files[0]
    data, told = first.read_bytes(), ended(first)
    for size in (len(data) - 1, data.rindex(b"servo_sniffer.end") + 3, len(data) // 2):
        first.write_bytes(data[:size])  # without its index, torn within the mark, before it
        known = ended(first)
        assert recover(first, tmp_path / "whole.mcap").bytes_kept
        assert ended(tmp_path / "whole.mcap") == known
    assert known == {}, "of a file that breaks off nobody knows where it was to end"
    first.write_bytes(data[:-1])
    assert ended(first) == told, "without an index the mark is found, too"
    broken = bytearray(data)
    broken[len(data) // 2] ^= 1
    first.write_bytes(broken)
    assert recover(first, first).bytes_lost
    assert ended(first) == told


def test_what_is_carried_over_does_not_count_for_the_next_file(tmp_path: Path) -> None:
    """Else a bus of which much is undecided would begin a file with each look."""
    wall, rng = Wall(), random.Random(1)
    path = tmp_path / "run.mcap"
    file = RotatingMcap(path, FACTS, now=wall, rotate_bytes=60_000, rotate_ns=NS)
    file.raw("arm", [Chunk(rng.randbytes(200_000), wall.ns, Clock.READ, "arm")])
    for _ in range(20):
        file.flush()
        file.turn({"arm": 0})
        wall.ns += NS
    assert len(file.files) == 2, "nothing more was said"
    file.raw("arm", [Chunk(rng.randbytes(60_000), wall.ns, Clock.READ, "arm")])
    file.flush()
    file.turn({"arm": 0})
    file.close()
    assert len(file.files) == 3
    assert [len(said) for path in file.files for said, _ in streams([path]).values()] == [260_000]


def test_a_bus_that_is_understood_late_is_whole_in_the_file_where_it_is(tmp_path: Path) -> None:
    wall = Wall()
    file = RotatingMcap(tmp_path / "run.mcap", FACTS, now=wall)
    pipeline = Pipeline(Options(), [file], live=True)
    sent = talk("mightyzap", 1.0, rate=0, bus="arm")
    for number, chunk in enumerate(sent):
        wall.ns = chunk.t_ns or 0
        pipeline.feed([chunk])
        if number == 3:
            file.rotate()
        file.turn(pipeline.decided())
        file.flush()
    pipeline.close()
    pipeline.finish()
    first, second = file.files
    assert streams([second])["arm"][0] == b"".join(c.data for c in sent)
    assert streams([first]) == {}
    assert messages(first).keys() == {"/arm/raw"}, "it is there, for a recorder that is killed"
    assert compare(second, Options(), say=pytest.fail).equal


def test_every_part_is_an_input_like_any_other(traffic: list[list[Chunk]], tmp_path: Path) -> None:
    file = record(tmp_path / "run.mcap", traffic, rotate_ns=NS // 2)
    for path in file.files:
        source = open_source(path)
        pipeline = Pipeline(Options().with_facts(source.facts()), [])
        for group in source:
            pipeline.feed(group)
        pipeline.close()
        for bus, totals in pipeline.summary.buses.items():
            assert sum(totals.kinds.values()) == len(messages(path)[f"/{bus}/frames"])


def test_a_part_that_was_cut_off_is_compared_as_far_as_it_goes(
    traffic: list[list[Chunk]], tmp_path: Path
) -> None:
    file = record(tmp_path / "run.mcap", traffic, rotate_ns=NS // 2)
    path, said = file.files[1], list[str]()
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    report = compare(path, Options(), say=said.append)
    assert report.equal, report
    assert "cut recording" in said[0]
    assert recover(path, path).bytes_lost
    again = compare(path, Options(), say=pytest.fail)
    assert again.equal, "raw bytes are written first: the frames of the last ones are made anew"
    # not as many as before it was mended, as long as that made none anew: what its bytes are
    assert {it.bus: it.same for it in again.buses} == frames_again(path)
    assert all(it.same == len(messages(path)[f"/{it.bus}/frames"]) for it in again.buses)
