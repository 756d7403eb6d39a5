"""What is said where several processes decode one capture, and are no sooner done."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.decoding.options import Options
from sniffer.jobs import parts
from sniffer.jobs.telling import Teller
from sniffer.sinks.jsonl import JsonlSink
from sniffer.sinks.tables import TableSink
from sniffer.sources import open_source
from sniffer.sources.stretches import Sizes
from tests.commands import talk
from tests.parted import Inline

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.decoding.sink import Sink

WIDE: Final = Sizes(head=900, least=600, most=600, warm=500, block=1, first=0)


def told_of(sink: Sink, folder: Path, jobs: int) -> list[str]:
    """Decode a capture in parts; return what is said meanwhile."""
    capture, told = folder / "talk.bin", list[str]()
    capture.write_bytes(talk(250))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts, "Crew", Inline)
        parts.decode_in_parts(
            open_source(capture, "bin"), Options(protocol="mightyzap"), [sink], jobs=jobs,
            name="it", tell=Teller(told.append), folder=folder, sizes=WIDE,
        )  # fmt: skip
    return told


def test_one_parquet_file_says_that_several_processes_are_no_sooner_done(tmp_path: Path) -> None:
    path = tmp_path / "x.parquet"
    (told,) = told_of(TableSink(path), tmp_path, 2)
    assert told == (
        f"{path} is packed by one process, whoever decodes: `sniffer fleet CAPTURE -o FOLDER` has "
        "each of them pack files of its own"
    )


def test_outputs_that_gain_by_several_processes_and_one_process_say_nothing(tmp_path: Path) -> None:
    assert told_of(TableSink(tmp_path / "x.csv"), tmp_path, 2) == []
    assert told_of(JsonlSink(io.StringIO()), tmp_path, 2) == []
    assert told_of(TableSink(tmp_path / "x.parquet"), tmp_path, 1) == []
