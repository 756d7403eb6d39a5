"""Captures for Wireshark: what tshark sees in them, and that they read back to what they were."""

from __future__ import annotations

import io
import json
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, Clock, DamagedInputError, Direction, Mark, MarkKind
from sniffer.jobs.convert import convert
from sniffer.pcapfile.layout import PROTOCOLS, RtacFooter
from sniffer.pcapfile.sink import PcapngSink
from sniffer.pcapfile.source import PcapSource
from tests.commands import COMMAND, environment, within
from tests.inputs import chunks
from tests.lists import each_in_turn
from tests.pcaps import ANSWER, ASK, T0, WIRESHARK, fields, told, written

Capsys = pytest.CaptureFixture[str]

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
DAMAGED: Final = CAPTURES / "lss_damaged.log"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a capture for Wireshark, beside the JSON lines of the same decoding."""
    path = tmp_path_factory.mktemp("pcapng") / "lss.pcapng"
    convert(DAMAGED, [path, path.with_suffix(".jsonl")])
    return path


def rows(path: Path, *types: str) -> list[dict[str, object]]:
    lines = map(json.loads, path.read_text(encoding="utf-8").splitlines())
    return [line for line in lines if line["type"] in types]


@each_in_turn(3, "capture", sorted(CAPTURES.glob("*.[lhb]*")), ids=lambda path: path.name)
def test_a_sample_read_back_is_the_same_chunks(capture: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.pcapng"
    convert(capture, [out])
    assert chunks(out) == chunks(capture)


@each_in_turn(2, "capture", sorted(CAPTURES.glob("*_damaged.*")), ids=lambda path: path.name)
def test_every_record_is_the_same_when_it_is_read_back(capture: Path, tmp_path: Path) -> None:
    first, again, out = (tmp_path / name for name in ("a.jsonl", "b.jsonl", "x.pcapng"))
    convert(capture, [first, out])
    convert(out, [again])
    assert again.read_bytes() == first.read_bytes()


WHERE: Final = 'frame.comment contains "late-response"'

MARKS = st.lists(
    st.builds(
        Mark,
        st.sampled_from([kind for kind in MarkKind if kind != MarkKind.TUNED]),
        st.integers(-20, 40),
        st.integers(0, 9),
        st.integers(1, 10**9),
    ),
    max_size=2,
).map(tuple)

CHUNKS = st.lists(
    st.builds(
        Chunk,
        st.one_of(
            st.sampled_from([ASK, ANSWER, ASK + ANSWER[:4], ANSWER[4:], ANSWER + ASK]),
            st.binary(min_size=1, max_size=40),
        ),
        st.one_of(st.none(), st.integers(-(10**12), 10**12), st.integers(T0, T0 + 10**12)),
        st.sampled_from(Clock),
        st.sampled_from(["bus0", "left arm", "é"]),
        st.sampled_from(Direction),
        MARKS,
    ).map(lambda k: replace(k, clock=Clock.NONE) if k.t_ns is None else k),
    min_size=1,
    max_size=12,
)


def by_bus(told: list[Chunk]) -> dict[str, list[Chunk]]:
    return {bus: [k for k in told if k.bus == bus] for bus in {k.bus for k in told}}


@given(CHUNKS)
def test_a_capture_read_back_is_the_same_chunks(said: list[Chunk]) -> None:
    handed: list[Chunk] = []
    again = chunks(written(said, also=handed))
    assert by_bus(again) == by_bus(handed)


def test_a_capture_that_is_cut_within_a_chunk_keeps_its_clock() -> None:
    whole = written([Chunk(ASK * 9)])
    got: list[Chunk] = []
    with pytest.raises(DamagedInputError):
        got += PcapSource(io.BytesIO(whole[:-200]), "bus0")
    assert [(k.t_ns, k.clock) for k in got] == [(None, Clock.NONE)]
    assert (ASK * 9).startswith(got[0].data)
    assert len(got[0].data) > 3 * len(ASK)


def test_marks_behind_the_last_byte_come_back() -> None:
    ended = Chunk(b"", T0 + 5, Clock.READ, marks=(Mark(MarkKind.ENDED, 0),))
    told = [Chunk(ASK, T0, Clock.READ), ended]
    assert chunks(written(told)) == told


def test_more_marks_than_an_option_holds_are_all_kept() -> None:
    marks = tuple(Mark(MarkKind.FRAMING, n % 9, 1) for n in range(3000))
    again = chunks(written([Chunk(ASK, T0, Clock.READ, marks=marks)]))
    assert [k.data for k in again] == [b"", ASK]
    assert sum(len(k.marks) for k in again) == 3000
    assert b"".join(k.data for k in again) == ASK
    assert [m.start for k in again for m in k.marks] == [m.start for m in marks]


@pytest.fixture(scope="module")
def seen(made: Path) -> list[dict[str, str]]:
    """Return what tshark has of each packet of that capture."""
    names = ["frame.time_epoch", "frame.interface_name", "frame.comment", "frame.packet_flags"]
    names += ["rtacser.eventtype", "rtacser.timestamp", "rtacser.footer", "data.data"]
    return [dict(zip(names, line, strict=True)) for line in fields(made, *names)]


@WIRESHARK
def test_tshark_has_a_packet_a_frame_or_gap_with_wire_time_and_bytes(
    made: Path, seen: list[dict[str, str]]
) -> None:
    meant = rows(made.with_suffix(".jsonl"), "frame", "gap")
    assert len(seen) == len(meant) > 1500
    sent = {"request": ("0x01", "0x00000002"), "response": ("0x02", "0x00000001")}
    for packet, row in zip(seen, meant, strict=True):
        whole, fraction = packet["frame.time_epoch"].split(".")
        assert int(whole + fraction.ljust(9, "0")) == row["t_ns"]
        assert (packet["frame.interface_name"], packet["data.data"]) == (row["bus"], row["hex"])
        said = packet["rtacser.eventtype"], packet["frame.packet_flags"]
        assert said == sent.get(str(row.get("kind")), ("0x02", ""))


@WIRESHARK
def test_the_head_has_the_start_and_the_footer_says_whose_it_is(
    made: Path, seen: list[dict[str, str]]
) -> None:
    meant = rows(made.with_suffix(".jsonl"), "frame", "gap")
    for packet, row in zip(seen, meant, strict=True):
        footer = RtacFooter.of(int(packet["rtacser.footer"], 0))
        assert footer == RtacFooter(0, PROTOCOLS["lss"])
        if "t_start_ns" in row:
            start = round(float(packet["rtacser.timestamp"]) * 10**6)
            assert start - int(str(row["t_start_ns"])) // 1000 in (-1, 0, 1)


@WIRESHARK
def test_what_is_wrong_is_found_by_its_code_in_the_comments(
    made: Path, seen: list[dict[str, str]]
) -> None:
    found = rows(made.with_suffix(".jsonl"), "anomaly")
    comments = [packet["frame.comment"] for packet in seen if packet["frame.comment"]]
    assert len({row["code"] for row in found}) > 5
    for row in found:
        text = f"{row['code']}: {row['detail']}"
        assert any(text in comment for comment in comments)
    gaps = rows(made.with_suffix(".jsonl"), "gap")
    assert sum(comment.startswith("gap: ") for comment in comments) == len(gaps)
    assert "Comment" in told("tshark", "-r", made, "-q", "-z", "expert")


@WIRESHARK
def test_an_interface_says_what_the_bus_is(made: Path) -> None:
    said = told("capinfos", made)
    assert "Description = lss servo bus, 115200 baud, 8N1, rate assumed" in said
    assert "Speed = 115200" in said
    assert "Time precision = nanoseconds" in said


@WIRESHARK
def test_line_errors_are_events_of_the_line(tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    marks = (Mark(MarkKind.FRAMING, 3, 1), Mark(MarkKind.PARITY, 12, 1, 2), Mark(MarkKind.BREAK, 8))
    path.write_bytes(written([Chunk(ASK + ANSWER, T0, Clock.READ, marks=marks)]))
    seen = fields(path, "rtacser.eventtype", "frame.comment")
    events = [int(event, 0) for event, _ in seen]
    assert sorted(events) == [1, 2, 7, 8, 9]
    assert events.index(7) > events.index(1)
    assert events.index(8) > events.index(2)
    assert "tap: parity within 1 byte, 2 told" in seen[events.index(8)][1]


@WIRESHARK
def test_times_that_are_only_counted_are_said_to_be(tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    path.write_bytes(written([Chunk(ASK + ANSWER)]))
    assert ", no times" in told("capinfos", path)
    (time, comment), (later, _) = fields(path, "frame.time_epoch", "frame.comment")
    assert float(time) == pytest.approx(9 * 10 / 57600)
    assert float(later) == pytest.approx(18 * 10 / 57600)
    assert "no-times: the input has none" in comment


@WIRESHARK
def test_what_editcap_wrote_anew_has_the_same_frames_and_findings(tmp_path: Path) -> None:
    """It leaves out what is this tool's own, so each packet is a chunk by itself."""
    first, again = tmp_path / "a.jsonl", tmp_path / "b.jsonl"
    convert(CAPTURES / "wck_damaged.log", [tmp_path / "x.pcapng", first])
    told("editcap", "-F", "pcap", tmp_path / "x.pcapng", tmp_path / "y")
    convert(tmp_path / "y", [again])

    def of(path: Path) -> list[tuple[object, ...]]:
        keys = ("type", "offset", "hex", "kind", "reason", "outcome", "code", "evidence")
        return [tuple(row.get(k) for k in keys) for row in rows(path, "frame", "gap", "anomaly")]

    assert of(again) == of(first)


def test_packets_are_written_as_soon_as_they_are_decided() -> None:
    """Who reads a pipe sees them while the bus goes on."""
    file = io.BytesIO()
    sink = PcapngSink(file, {})
    sink.begin()
    head = file.getvalue()
    assert head.startswith(b"\x0a\x0d\x0d\x0a")
    pipeline = Pipeline(Options(protocol="mightyzap"), [sink], live=True)
    pipeline.feed([Chunk(ASK + ANSWER + ASK, T0, Clock.READ)])
    before = file.getvalue()
    assert [k.data for k in chunks(before)] == [ASK + ANSWER]
    pipeline.feed([Chunk(ANSWER, T0 + 10**7, Clock.READ)])
    assert file.getvalue().startswith(before)
    pipeline.close()
    pipeline.finish()
    assert [k.data for k in chunks(file.getvalue())] == [ASK + ANSWER + ASK, ANSWER]


@WIRESHARK
def test_decode_writes_into_a_pipe_that_tshark_reads() -> None:
    command = [*COMMAND, "decode", str(DAMAGED), "-o", "-", "--format", "pcapng"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment()) as decoder:
        reader = ["tshark", "-r", "-", "-T", "fields", "-e", "frame.comment", "-Y", WHERE]
        seen = subprocess.run(
            reader, stdin=decoder.stdout, capture_output=True, text=True, timeout=120, check=True
        )
    assert decoder.returncode == 0
    assert seen.stdout.count("late-response: ") > 1


def test_a_part_and_a_selection_are_packets_of_their_own(capsys: Capsys, tmp_path: Path) -> None:
    path = tmp_path / "x.pcapng"
    ran = within(capsys, "decode", DAMAGED, "--kind", "response", "-q", "-o", path)
    assert ran.status == 0
    whole = chunks(DAMAGED)
    some = chunks(path)
    assert 100 < len(some) < len(whole)
    assert all(k.data.startswith(b"*") for k in some)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("-o", "-"), "-o - writes to standard output what --format says: pcapng for"),
        (("-o", "-", "--format", "jsonl", "-q"), "-o - writes to standard output"),
        (("--format", "pcapng", "--summary"), "leave --summary or -q out"),
    ],
)
def test_a_format_that_is_not_said_for_a_pipe_is_asked_for(
    arguments: tuple[str, ...], says: str, capsys: Capsys
) -> None:
    ran = within(capsys, "decode", DAMAGED, *arguments)
    assert (ran.status, ran.out) == (2, "")
    assert says in ran.complaint
