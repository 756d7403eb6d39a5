"""``sniffer cut``: a part of a capture says what the whole says there."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sniffer
from sniffer.anomalies.found import Anomalies
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.partends import PartEnds
from sniffer.decoding.parting import Slicer
from sniffer.decoding.spans import Span, sliced
from sniffer.ground.model import Batch, Chunk, MarkKind
from sniffer.ground.timing import byte_time_ns
from sniffer.mcapfile.source import session
from sniffer.protocols import PROTOCOLS
from tests.commands import within
from tests.inputs import chunks, read
from tests.lists import in_turn
from tests.recordings import START_NS, talk

Capsys = pytest.CaptureFixture[str]

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
LOG: Final = CAPTURES / "mightyzap_damaged.log"
EVERY: Final = pytest.mark.parametrize("name", PROTOCOLS)
TALK: Final = {name: talk(name, 0.7) for name in PROTOCOLS}
EDGES: Final = {"capture-start", "capture-end"}


def decoded(name: str, told: list[Chunk]) -> list[Batch]:
    decoder = Decoder(name, latency_ns=16_000_000)
    parts = [decoder.feed(*told[k : k + 20]) for k in range(0, len(told), 20)]
    return [*parts, decoder.close()]


def spans_of(batches: list[Batch], span: Span, moved: int) -> list[tuple[object, ...]]:
    """Return frames, gaps, pairs and raw values within a span, by offsets in the whole."""
    out: list[tuple[object, ...]] = []
    for b in batches:
        f, at = b.frames, b.base + moved
        out += (
            ("frame", s + at, n, kind, servo, op)
            for s, n, kind, servo, op in zip(
                *(c.tolist() for c in (f.start, f.length, f.kind, f.servo_id, f.op)), strict=True
            )
        )
        out += (("gap", g.start + at, g.length, g.reason) for g in b.gaps)
        t = b.transactions
        both = (t.request != -1) & (t.response >= 0)
        asked = b.asked(t.request[both]).start + at
        pairs = zip(asked.tolist(), (f.start[t.response[both]] + at).tolist(), strict=True)
        out += (("exchange", one, other) for one, other in pairs)
        v = b.values
        columns = (f.start[v.row] + at, v.servo_id, v.register, v.raw)
        out += (("value", *row) for row in zip(*(c.tolist() for c in columns), strict=True))
    return sorted(r for r in out if span.begin <= int(str(r[1])) < span.end)


def anomalies(batches: list[Batch]) -> set[str]:
    return {a.code for b in batches for a in Anomalies.of(b.anomalies)}


@in_turn(2)
@EVERY
@settings(max_examples=12)
@given(data=st.data())
def test_a_part_says_what_the_whole_says_there(name: str, data: st.DataObject) -> None:
    told = TALK[name]
    whole = decoded(name, told)
    slicer = Slicer()
    length = told[-1].t_ns - START_NS if told[-1].t_ns else 0
    from_ns = START_NS + data.draw(st.integers(0, length))
    ends = PartEnds(from_ns, from_ns + data.draw(st.integers(1_000_000, length)))
    slicer.find(lambda parts: lambda told_ns: ends)
    for batch in whole:
        slicer.write("bus0", PROTOCOLS[name], batch)
    found = slicer.spans()
    if not found:
        return
    span = found["bus0"]
    byte_ns = {"bus0": byte_time_ns(PROTOCOLS[name].baud)}
    part = [c for group in sliced([told], found, byte_ns) for c in group]
    assert b"".join(c.data for c in part) == b"".join(c.data for c in told)[span.begin : span.end]
    again = decoded(name, part)
    everything = Span(0, 1 << 60, None)
    assert spans_of(again, everything, span.begin) == spans_of(whole, span, 0)
    assert anomalies(again) <= anomalies(whole) | EDGES


def test_a_part_is_cut_between_exchanges_and_not_within_one() -> None:
    told = TALK["mightyzap"]
    whole = decoded("mightyzap", told)
    slicer = Slicer()
    torn = 0
    for batch in whole:
        t, f = batch.transactions, batch.frames
        paired = (t.request >= 0) & (t.response >= 0)
        torn = torn or int(f.t_end[t.request[paired][10]]) if paired.sum() > 10 else torn
    ends = PartEnds(torn + 1)  # behind a request, before its answer
    slicer.find(lambda parts: lambda told_ns: ends)
    for batch in whole:
        slicer.write("bus0", PROTOCOLS["mightyzap"], batch)
    part = [c for g in sliced([told], slicer.spans(), {"bus0": 1}) for c in g]
    first = decoded("mightyzap", part)[0]
    assert first.frames.kind[0] == 0
    assert first.transactions.response[0] >= 0


def test_a_silence_behind_a_part_is_no_cut_and_a_cut_is_no_silence(
    tmp_path: Path, capsys: Capsys
) -> None:
    """Servo 1 does not answer once, and 300 ms later the talk goes on."""
    ask = "FFFFFF0102F10B"
    answer = "FFFFFF010200FC"
    lines = [f"(1.{n:03}) bus0 #{ask}\n(1.{n + 2:03}) bus0 #{answer}\n" for n in range(0, 80, 10)]
    lines += [f"(1.100) bus0 #{ask}\n", f"(1.400) bus0 #{ask}\n(1.402) bus0 #{answer}\n"]
    source = tmp_path / "in.log"
    source.write_text("".join(lines))
    out = tmp_path / "x.mcap"
    ran = within(capsys, "cut", source, "--protocol", "mightyzap", "--to", "0.2", "-o", out)
    assert ran.status == 0
    last = chunks(out)[-1]
    assert (last.data, last.marks[0].kind) == (b"", MarkKind.ENDED)
    summary = sniffer.decode(out).summary.as_dict()
    assert summary["codes"] == {"no-response": 1}


def test_a_part_says_of_what_it_is_one(tmp_path: Path, capsys: Capsys) -> None:
    one, two = tmp_path / "one.mcap", tmp_path / "two.mcap"
    assert within(capsys, "cut", LOG, "--from", "2", "--to", "5", "-o", one).status == 0
    assert within(capsys, "cut", one, "--from", "1", "--to", "2", "-o", two).status == 0
    facts = session(two)
    assert facts["source"] == str(one)
    assert facts["cut.source"] == str(LOG)
    at = int(facts["cut.offset.bus0"])
    assert read(two) == read(LOG)[at : at + len(read(two))]
    began = chunks(LOG)[0].t_ns or 0
    assert (int(facts["cut.to_ns"]) - began) / 1e9 == pytest.approx(4, abs=0.1)
    ran = within(capsys, "decode", two, "--summary")
    assert f"sniffer: a part of {LOG}, from byte {at} of bus0 on\n" in ran.err


def test_two_buses_are_cut_at_one_time(tmp_path: Path, capsys: Capsys) -> None:
    source = tmp_path / "two.log"
    lines = LOG.read_text().splitlines(keepends=True)[:1500]
    source.write_text("".join(line + line.replace("bus0", "arm") for line in lines))
    out = tmp_path / "x.log"
    ran = within(capsys, "cut", source, "--from", "0.5", "--to", "1", "-o", out)
    assert ran.status == 0
    parts = {bus: [c for c in chunks(out) if c.bus == bus] for bus in ("bus0", "arm")}
    assert [c.data for c in parts["bus0"]] == [c.data for c in parts["arm"]] != []
    times = [c.t_ns for c in chunks(out) if c.data and c.t_ns is not None]
    assert times == sorted(times)


@pytest.mark.parametrize("part", [(), ("--from", "0.5", "--to", "1")], ids=["all", "part"])
def test_one_bus_of_several_is_cut_out(
    part: tuple[str, ...], tmp_path: Path, capsys: Capsys
) -> None:
    source = tmp_path / "two.log"
    lines = LOG.read_text().splitlines(keepends=True)[:1500]
    odd = f"{lines[0].split()[0]} odd #0102\n"  # nobody asks what is spoken there
    source.write_text("".join([odd, *(line + line.replace("bus0", "arm") for line in lines)]))
    one, both = tmp_path / "arm.mcap", tmp_path / "both.mcap"
    ran = within(capsys, "cut", source, *part, "--bus", "arm", "-o", one)
    assert (ran.status, "odd" in ran.err) == (0, False)
    assert {c.bus for c in chunks(one)} == {"arm"}
    assert within(capsys, "cut", source, "--bus", "arm,bus0", *part, "-o", both).status == 0
    told = [[c.data for c in chunks(out) if c.bus == "arm" and c.data] for out in (one, both)]
    assert told[0] == told[1] != []
    assert {c.bus for c in chunks(both)} == {"arm", "bus0"}


def test_a_capture_without_times_is_cut_by_the_pace_of_its_rate(
    tmp_path: Path, capsys: Capsys
) -> None:
    out = tmp_path / "x.bin"
    source = tmp_path / "in.bin"
    source.write_bytes(read(LOG))
    told = ("--protocol", "mightyzap", "--baud", "57600")
    assert within(capsys, "cut", source, *told, "--from", "1", "--to", "2", "-o", out).status == 0
    assert len(read(out)) == pytest.approx(5760, abs=60)
    assert read(out) in read(LOG)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--from", "3", "--to", "2"), "--to must lie behind --from"),
        ((), "say which part: --from, --to or both, --bus, or --split"),
        (("--bus", "leg"), "--bus: there is no bus leg, only bus0"),
        (("--from", "60"), "nothing was said from second 60 to its end: the capture has 8.0"),
    ],
)
def test_a_part_that_cannot_be_says_why(
    arguments: tuple[str, ...], told: str, tmp_path: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "cut", LOG, *arguments, "-o", tmp_path / "x.mcap")
    assert ran.status == 2
    assert ran.complaint.startswith(told)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("more", [(), ("--bus", "bus0")], ids=["all", "a bus"])
def test_nothing_is_cut_out_of_an_empty_capture(
    more: tuple[str, ...], tmp_path: Path, capsys: Capsys
) -> None:
    source = tmp_path / "in.bin"
    source.touch()
    ran = within(capsys, "cut", source, "--to", "1", *more, "-o", tmp_path / "x.mcap")
    assert ran.status == 2
    assert ran.complaint.startswith("nothing was said from its beginning to second 1")


def test_the_input_is_not_cut_into_itself(tmp_path: Path, capsys: Capsys) -> None:
    source = tmp_path / "in.log"
    source.write_bytes(LOG.read_bytes())
    ran = within(capsys, "cut", source, "--to", "1", "-o", source, "--force")
    assert ran.status == 2
    assert ran.complaint == f"{source} is the input: choose another output"
    assert read(source) == read(LOG)


def test_a_bus_whose_frames_nobody_knows_is_left_out_and_that_is_said(
    tmp_path: Path, capsys: Capsys
) -> None:
    source = tmp_path / "in.log"
    lines = LOG.read_text().splitlines(keepends=True)[:400]
    began = lines[0].split()[0]
    source.write_text("".join([f"{began} odd #0102\n", *lines]))
    out = tmp_path / "x.mcap"
    ran = within(capsys, "cut", source, "--to", "0.3", "-o", out)
    assert ran.status == 0
    assert {c.bus for c in chunks(out)} == {"bus0"}
    assert "odd: " in ran.err
    assert "; left out" in ran.err


def test_a_part_around_the_first_error_is_cut_out(tmp_path: Path, capsys: Capsys) -> None:
    out = tmp_path / "x.mcap"
    told = ("--from", "@first-error", "--around", "200ms")
    assert within(capsys, "cut", LOG, *told, "-o", out).status == 0
    facts = session(out)
    assert int(facts["cut.to_ns"]) - int(facts["cut.from_ns"]) == 400_000_000
    assert "error" in sniffer.decode(out).summary.as_dict()["severities"]
