"""``sniffer.read_batches``: a table of a capture as a stream of Arrow record batches."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import sniffer
from sniffer.sinks.relations import RELATIONS
from tests.golden import CAPTURES

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.ground.model import Chunk

duckdb = pytest.importorskip("duckdb")
pa = pytest.importorskip("pyarrow")

LOG = CAPTURES / "mightyzap_damaged.log"
NAMED = sniffer.Options("mightyzap")


def rows_of(answer: sniffer.Answer) -> list[dict[str, Any]]:
    return [dict(zip(answer.columns, row, strict=True)) for row in answer]


@pytest.mark.parametrize("table", RELATIONS)
def test_the_batches_of_a_table_are_the_rows_that_a_query_has(table: str) -> None:
    batches = sniffer.read_batches(LOG, table, NAMED, rows=200)
    assert batches.schema.names == RELATIONS[table].schema.names
    assert not any(pa.types.is_dictionary(field.type) for field in batches.schema)
    made = list(batches)
    assert all(0 < batch.num_rows <= 200 for batch in made)
    rows = [row for batch in made for row in batch.to_pylist()]
    assert rows == rows_of(sniffer.query(f"SELECT * FROM {table}", [LOG], NAMED))


def test_other_libraries_take_the_batches_as_they_are() -> None:
    high = sniffer.Selection.parse("raw > 4000")
    with duckdb.connect() as connection:
        connection.register("high", sniffer.read_batches(LOG, "samples", NAMED, selection=high))
        (found,) = connection.execute("SELECT min(raw), count(*) FROM high").fetchall()
    sql = "SELECT min(raw), count(*) FROM samples WHERE raw > 4000"
    assert [found] == list(sniffer.query(sql, [LOG], NAMED))
    assert found[1] > 1


def test_a_part_of_a_capture_and_several_files_are_read_alike(tmp_path: Path) -> None:
    lines = LOG.read_text().splitlines(keepends=True)
    halves = [tmp_path / "2.log", tmp_path / "1.log"]
    for half, told in zip(halves, (lines[1000:], lines[:1000]), strict=True):
        half.write_text("".join(told))
    whole = sniffer.read_batches(LOG, "transactions", NAMED).read_all()
    assert sniffer.read_batches(halves, "transactions", NAMED).read_all() == whole
    window = sniffer.Window("@first-error", 2.0)
    part = sniffer.read_batches(LOG, "transactions", NAMED, window=window)
    asked = sniffer.query("SELECT * FROM transactions", [LOG], NAMED, window=window)
    assert part.read_all().to_pylist() == rows_of(asked)


def test_what_is_read_before_a_log_breaks_off_comes_before_that_is_raised(tmp_path: Path) -> None:
    torn = tmp_path / "torn.log"
    torn.write_text(LOG.read_text() + "no line of a log\n")
    batches = sniffer.read_batches(torn, "frames", NAMED)
    made: list[Any] = []
    with pytest.raises(sniffer.DamagedInputError, match="'no line of a log' is no line"):
        made.extend(batches)
    assert (
        sum(batch.num_rows for batch in made)
        == sniffer.read_batches(LOG, "frames", NAMED).read_all().num_rows
    )


def test_a_recording_that_was_not_finished_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    whole, torn = tmp_path / "whole.mcap", tmp_path / "torn.mcap"
    sniffer.convert(LOG, [whole])
    data = whole.read_bytes()
    torn.write_bytes(data[: len(data) * 3 // 4])
    rows = sniffer.read_batches(torn, "frames", NAMED).read_all().num_rows
    assert 0 < rows <= sniffer.read_batches(whole, "frames").read_all().num_rows


def test_a_capture_is_decoded_no_further_than_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fed: list[int] = []
    feed = sniffer.Decoder.feed

    def counting(decoder: sniffer.Decoder, *chunks: Chunk) -> sniffer.Batch:
        fed.append(len(chunks))
        return feed(decoder, *chunks)

    monkeypatch.setattr(sniffer.Decoder, "feed", counting)
    long = tmp_path / "long.log"
    long.write_text("(1.5) bus0 #FFFFFF0102F10B\n" * 40_000)
    batches = sniffer.read_batches(long, "frames", NAMED)
    assert not fed
    next(batches)
    assert 0 < sum(fed) < 40_000
    batches.close()


@pytest.mark.parametrize(
    ("data", "table", "why"),
    [
        (b"", "sample", "there is no table 'sample': did you mean samples?"),
        (None, "samples", "there is no such file"),
        (b"", "samples", "is empty: nothing to decode"),
        (b"\x00" * 4000, "samples", "cannot tell the protocol"),
    ],
)
def test_what_cannot_be_read_is_told_in_a_line(
    data: bytes | None, table: str, why: str, tmp_path: Path
) -> None:
    path = tmp_path / "capture.bin"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(sniffer.InputError, match=why.replace("?", "[?]")) as raised:
        sniffer.read_batches(path, table).read_all()
    assert "\n" not in str(raised.value)
