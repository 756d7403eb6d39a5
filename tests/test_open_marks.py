"""Marks with notes: beside a capture, and within a recording, whose data they leave as they are."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import pytest
from mcap.reader import make_reader

import sniffer
from sniffer.decoding.options import Options
from sniffer.ground.model import InputError, OutputError
from sniffer.inside import session
from sniffer.inside.app import LookingGlass
from sniffer.inside.index import CaptureIndex
from sniffer.inside.marks import (
    NotedMark,
    into_recording,
    marks_file,
    marks_of,
    read_marks,
    write_marks,
)
from sniffer.inside.notes import Notes
from tests.commands import sniffer as command

CAPTURE: Final = Path(__file__).parents[1] / "sample_captures" / "mightyzap_clean.log"
ONE: Final = NotedMark(1, "bus0", 9, "the knee gave way")
TWO: Final = NotedMark(2, "bus0", 18, "hörte auf ◆\u2028dann\x85nicht")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "run.mcap"
    sniffer.convert(CAPTURE, [path])
    return path


def mark(path: Path, *marks: NotedMark) -> None:
    write_marks(marks_file(path), list(marks))
    into_recording(path)


def test_marks_of_a_capture_stand_beside_it_and_go_with_the_last(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    path.write_bytes(CAPTURE.read_bytes())
    mark(path, ONE, TWO)
    assert marks_of(path) == read_marks(marks_file(path)) == [ONE, TWO]
    mark(path)
    assert not marks_file(path).exists()
    assert path.read_bytes() == CAPTURE.read_bytes()


def test_a_recording_takes_its_marks_and_no_byte_of_its_data_changes(recording: Path) -> None:
    before = recording.read_bytes()
    records = list(sniffer.decode(recording))
    for marks in ([ONE], [ONE, TWO], [TWO], []):
        mark(recording, *marks)
        assert marks_of(recording) == marks
        assert not marks_file(recording).exists()
    now = recording.read_bytes()
    with recording.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.metadata_count == len(summary.metadata_indexes)
        assert sum(1 for _ in reader.iter_messages()) == summary.statistics.message_count
        names = [m.name for m in reader.iter_metadata()]
    assert names.count("servo_sniffer.marks") == 4
    data = now.index(b"servo_sniffer.marks") - 13
    assert now[:data] == before[:data]
    assert list(sniffer.decode(recording)) == records
    ran = command("replay", recording, "--redecode")
    assert (ran.status, "the same as recorded" in ran.out) == (0, True)


def test_marks_outlive_a_repair(recording: Path) -> None:
    mark(recording, ONE)
    recording.write_bytes(recording.read_bytes()[:-20])  # as if somebody was killed just then
    assert command("recover", recording).status == 0
    mended = recording.with_name("run.recovered.mcap")
    assert marks_of(mended if mended.exists() else recording) == [ONE]


def test_a_recording_without_its_end_is_left_as_it_is_and_the_marks_beside(recording: Path) -> None:
    torn = recording.read_bytes()[:-30]
    recording.write_bytes(torn)
    with pytest.raises(OutputError, match="has no end"):
        mark(recording, ONE)
    assert recording.read_bytes() == torn
    assert marks_of(recording) == [ONE]


def test_a_file_that_is_none_of_marks_stays_as_it_is(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark = marks_file(recording)
    mark.write_text("the knee gave way\n", encoding="utf-8")
    notes = Notes(recording)
    with pytest.raises(InputError, match="line 1: this is no mark"):
        notes.load()
    index = CaptureIndex()
    monkeypatch.setattr("sniffer.inside.notes.mark_at", lambda *_: ONE)
    with pytest.raises(OutputError, match="no file to keep marks beside"):
        notes.add(index, 0, ONE.note)
    index.discard()
    monkeypatch.setattr(session, "need_terminal", lambda *_: None)
    monkeypatch.setattr(LookingGlass, "run", lambda _: None)
    session.look_inside(str(recording), Options())
    assert mark.read_text(encoding="utf-8") == "the knee gave way\n"
