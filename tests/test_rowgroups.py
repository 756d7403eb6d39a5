"""Parquet files that are joined as they are: what a reader finds in them, and what is refused."""

from __future__ import annotations

import io
import struct

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import sniffer
from sniffer.ground.model import OutputError
from sniffer.sinks.relations import RELATIONS
from sniffer.sinks.rowgroups import MAGIC, RowGroups, footer_of
from sniffer.sinks.tables import FRAMES, parquet_writer
from tests.golden import CAPTURES


def packed(*groups: pa.Table) -> io.BytesIO:
    """Return a Parquet file of frames."""
    file = io.BytesIO()
    with parquet_writer(file, FRAMES, len(groups[0]) if groups else 0) as writer:
        for group in groups:
            writer.write_table(group)
    return file


def joined(*files: io.BytesIO) -> io.BytesIO:
    """Return a Parquet file that holds those of others."""
    out = io.BytesIO(MAGIC)
    out.seek(0, io.SEEK_END)
    growing = RowGroups(out)
    for file in files:
        growing.append(file)
    growing.close()
    return out


def test_a_reader_finds_the_rows_of_all_files_and_what_each_group_tells_of_itself() -> None:
    (told,) = sniffer.decode(CAPTURES / "wck_damaged.log").batches
    frames = RELATIONS["frames"].build(*told)
    parts = [frames.slice(100 * nth, 100) for nth in range(19)]  # a long list from 15 on
    out = pq.ParquetFile(joined(packed(*parts[:2]), packed(), *map(packed, parts[2:])))
    assert out.read().to_pydict() == frames.slice(0, 1900).to_pydict()
    assert (out.metadata.num_rows, out.num_row_groups) == (1900, 19)
    at = FRAMES.get_field_index("offset")
    for nth, part in enumerate(parts):
        assert out.read_row_group(nth).to_pydict() == part.to_pydict()
        statistics = out.metadata.row_group(nth).column(at).statistics
        assert [statistics.min, statistics.max] == [
            part["offset"][0].as_py(),
            part["offset"][-1].as_py(),
        ]


def test_a_file_that_is_joined_with_nothing_is_the_same_to_the_byte() -> None:
    alone = packed(FRAMES.empty_table())
    assert joined(alone).getvalue() == alone.getvalue()


@pytest.mark.parametrize(
    "data",
    [b"", MAGIC, MAGIC + b"rows" + struct.pack("<I", 99) + MAGIC],
    ids=["nothing", "no footer", "a footer longer than the file"],
)
def test_what_is_no_whole_file_is_refused(data: bytes) -> None:
    with pytest.raises(OutputError, match="no whole file"):
        footer_of(io.BytesIO(data))
