"""Tables and logs that are read in columns, many lines at once: they say what each line says."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import sniffer.sources.saleae as saleae
import sniffer.sources.text as text
from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import (
    Chunk,
    Clock,
    DamagedInputError,
    Direction,
    Mark,
    MarkKind,
    SnifferError,
)
from sniffer.ground.runs import ChunkRun, joined
from sniffer.sources import open_source
from sniffer.sources.alike import TextLines, likenesses
from sniffer.testing.laws import equal
from tests.toollogs import conversation
from tests.waves import saleae_csv, sampled, spoken

if TYPE_CHECKING:
    from collections.abc import Iterator

HEADS: Final = (
    b"Time [s],Value,Parity Error,Framing Error\n",
    b'name,type,start_time,duration,"data","error"\n',
)


@pytest.fixture(scope="module", autouse=True)
def _small_blocks() -> Iterator[None]:
    """Let a block be a few lines, so that each test has several."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(text, "BLOCK", 1 << 10)
        patch.setattr(saleae, "_ROWS", 4)
        yield


def said(table: bytes) -> tuple[list[Chunk], list[str]]:
    with open_source(table) as source:
        return [chunk for group in source for chunk in group], source.notes


def row_1(whole: int, fraction: str, value: int, errors: str) -> bytes:
    return f"{whole}.{fraction},0x{value:02X},{errors}\n".encode()


def row_2(whole: int, fraction: str, value: int, error: str, name: str, lasts: str) -> bytes:
    return f'"{name}","data",{whole}.{fraction},{lasts},0x{value:02X},{error}\n'.encode()


ROWS_1 = st.builds(
    row_1,
    st.sampled_from([0, 7, 12, 999_999_999]),
    st.text("0123456789", min_size=9, max_size=15),
    st.integers(0, 255),
    st.sampled_from([",", ",", ",", "Error,", ",Error", "Error,Error"]),
)
ROWS_2 = st.builds(
    row_2,
    st.sampled_from([0, 7, 12, 999_999_999]),
    st.text("0123456789", min_size=1, max_size=9),
    st.integers(0, 255),
    st.sampled_from(["", "", "", '"parity"', "framing"]),
    st.sampled_from(["arm", "arm", "arm", "leg", "löffel", ""]),
    st.sampled_from(["8.5e-05", "8.5e-05", "0.000085", "8.55e-05"]),
)
TABLES: Final = st.one_of(
    st.tuples(st.just(HEADS[0]), st.lists(ROWS_1, min_size=60, max_size=120)),
    st.tuples(st.just(HEADS[1]), st.lists(ROWS_2, min_size=60, max_size=120)),
)


@settings(max_examples=25)
@given(TABLES)
@example((HEADS[0], [row_1(0, f"{n:015}", n % 256, ",") for n in range(120)]))
@example((HEADS[1], [row_2(n, "5", n, "", "arm", "8.5e-05") for n in range(120)]))
def test_rows_of_a_table_say_the_same_read_in_columns_and_one_by_one(
    table: tuple[bytes, list[bytes]],
) -> None:
    head, rows = table
    in_columns = said(head + b"".join(rows))
    one_by_one = said(head + b"\n".join(rows))  # a blank line is no row: each is looked at
    assert in_columns == one_by_one
    assert len(in_columns[0]) == len(rows)


def test_a_row_that_is_none_is_told_by_its_line_behind_all_that_came_before() -> None:
    rows = [row_1(0, f"{n:012}", n % 256, ",") for n in range(200)]
    rows[150] = b"0.000000000150,0xG0,,\n"
    heard: list[Chunk] = []
    with (
        open_source(HEADS[0] + b"".join(rows)) as source,
        pytest.raises(DamagedInputError, match="line 152: '0xG0' is no byte"),
    ):
        heard.extend(chunk for group in source for chunk in group)
    assert len(heard) == 150


def test_most_rows_of_a_table_come_as_a_run() -> None:
    rows = b"".join(row_1(0, f"{n:012}", n % 256, ",") for n in range(2000))
    told = list(saleae.read_saleae(text.Opened(io.BytesIO(HEADS[0] + rows), "table")))
    assert sum(len(one) for one in told if isinstance(one, ChunkRun)) > 1900


def run_of(chunks: list[Chunk]) -> ChunkRun:
    first = chunks[0]
    return ChunkRun(
        b"".join(chunk.data for chunk in chunks),
        np.cumsum([len(chunk.data) for chunk in chunks]),
        np.array([chunk.t_ns for chunk in chunks]),
        np.array([chunk.direction for chunk in chunks], np.uint8),
        first.clock,
        first.bus,
        {n: chunk.marks for n, chunk in enumerate(chunks) if chunk.marks},
    )


CHUNKS: Final = [
    Chunk(b"a", 3, Clock.SAMPLE, "arm", Direction.TX),
    Chunk(b"bc", 5, Clock.SAMPLE, "arm", Direction.RX, (Mark(MarkKind.PARITY, 0, 1),)),
    Chunk(b"def", 9, Clock.SAMPLE, "arm"),
    Chunk(b"g", 9, Clock.SAMPLE, "arm", marks=(Mark(MarkKind.FRAMING, 0, 1),)),
]


@given(st.slices(4), st.slices(4), st.integers(-4, 3))
def test_a_run_is_a_sequence_of_its_chunks(one: slice, other: slice, row: int) -> None:
    run = run_of(CHUNKS)
    assert list(run) == CHUNKS
    assert run[row] == CHUNKS[row]
    assert list(run[one]) == CHUNKS[one]
    parts = [part for part in (run[one], run[other]) if isinstance(part, ChunkRun) and part]
    if parts:
        assert list(joined(parts)) == [chunk for part in parts for chunk in part]


def test_a_run_is_decoded_as_its_chunks_are() -> None:
    chunks = [
        Chunk(said.data, said.over_ns, Clock.SAMPLE, "bus0", said.wire)
        for said in conversation(200)
    ]
    chunks[7] = replace(chunks[7], marks=(Mark(MarkKind.FRAMING, 0, 1),))
    as_chunks, as_run = Decoder("mightyzap"), Decoder("mightyzap")
    equal(
        "a run",
        [as_run.feed(run_of(chunks)), as_run.close()],
        [as_chunks.feed(*chunks), as_chunks.close()],
        chunks,
    )


@given(st.lists(st.from_regex(r"[0-9]{1,7}\.[0-9]{0,8}", fullmatch=True), min_size=1, max_size=60))
@example(["0.1"] * 20 + ["0.3"] * 20 + ["1.7"] * 20)
def test_fractions_read_in_columns_are_those_that_python_reads(texts: list[str]) -> None:
    lines = TextLines("\n".join(texts).encode())
    out = np.full(len(texts), np.nan)
    for some in likenesses(lines, re.compile(rb"([0-9]+)\.([0-9]*)"), (1, 2), ()):
        out[some.rows] = some.decimals(1, 2)
    assert out.tolist() == [float(one) for one in texts]


@pytest.mark.parametrize("trigger", [0.0, 0.004])
def test_rows_of_levels_say_the_same_read_in_columns_and_one_by_one(trigger: float) -> None:
    talk = b"".join(one.data for one in conversation(20))
    levels = sampled(spoken(talk, 57600), 1_000_000)
    table = saleae_csv(
        {"RX": levels, "EN": levels[:1].repeat(len(levels))}, 1_000_000, trigger=trigger
    )
    half = len(table) // 2  # what is read first tells what it is
    assert said(table) == said(table[:half] + table[half:].replace(b"\n", b"\n\n"))
    with pytest.raises(SnifferError, match="a level is neither 0 nor 1"):
        said(table[:half] + table[half:].replace(b",1,1\n", b",7,1\n"))
