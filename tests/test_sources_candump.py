"""Log lines as candump writes them: a time each, and what is read of them."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pytest
from hypothesis import given
from hypothesis import strategies as st

import sniffer
from sniffer.decoding.rows import FrameRow, TransactionRow
from sniffer.ground.coarse import coarse
from sniffer.ground.limits import TIME_END_NS
from sniffer.ground.model import MS, NS, Chunk, Clock, Direction
from sniffer.ground.timing import byte_time_ns
from sniffer.sources import open_source
from sniffer.sources.candump import CandumpLog
from sniffer.sources.text import LineBlock
from tests.inputs import chunks, read, refusal, until_damage
from tests.streams.mightyzap import packet as zap

if TYPE_CHECKING:
    from pathlib import Path


def test_log_lines_keep_time_direction_and_bus_and_not_the_id() -> None:
    text = (
        b"(1795215306.000100) bus0 RX#FAAF\n(1795215306.123456789) bus1 TX#01\r\n"
        b"(1795215307) can0 123#02\n(1795215307.5) can0 00000343##1AABB T\n\n"
        b"(1795215308.1) can0 123#R\n(1795215308.2) can0 20000080#00\nbus0 #fd"
    )
    assert chunks(text) == [
        Chunk(b"\xfa\xaf", 1795215306_000100000, Clock.FILE, "bus0", Direction.RX),
        Chunk(b"\x01", 1795215306_123456789, Clock.FILE, "bus1", Direction.TX),
        Chunk(b"\x02", 1795215307_000000000, Clock.FILE, "can0", marks=coarse(1, 0)),
        Chunk(b"\xaa\xbb", 1795215307_500000000, Clock.FILE, "can0", Direction.TX, coarse(2, 1)),
        Chunk(b"\xfd"),
    ]


def test_a_bus_without_a_name_has_a_direction_in_its_place() -> None:
    text = b"# mine\n(1795215306.000100) TX#FAAF\n(1795215306.123456) rx#01\nTX#02\n"
    assert chunks(text) == [
        Chunk(b"\xfa\xaf", 1795215306_000100000, Clock.FILE, direction=Direction.TX),
        Chunk(b"\x01", 1795215306_123456000, Clock.FILE, direction=Direction.RX),
        Chunk(b"\x02", direction=Direction.TX),
    ]
    assert {c.bus for group in open_source(text, bus="arm") for c in group} == {"arm"}
    lss = b"(1.000) TX#5D1800\n(1.002) TX#5QD\n(1.004) RX*5QD1800\n"
    assert b"".join(c.data for c in chunks(lss)) == b"#5D1800\r#5QD\r*5QD1800\r"
    assert "no dump that is read" in refusal(b"(1.0) #FAAF\n(1.1) #FAAF00\n")


@pytest.mark.parametrize(("places", "unsure_ns"), [(0, NS), (1, NS // 10), (3, MS), (6, 0), (9, 0)])
def test_a_time_is_as_uncertain_as_its_last_digit_in_the_shortest_file(
    places: int, unsure_ns: int, tmp_path: Path
) -> None:
    """A request, its answer 3 ms later, and another one 2 s later that nobody answers."""
    said = ((0, zap(1, 0xF1)), (3 * MS, zap(1, 0)), (2 * NS, zap(1, 0xF1)))
    log = tmp_path / "short.log"
    true = [1795215306_987654321 + t for t, _ in said]
    stamps = [f"{t // NS}.{t % NS:09}"[: 11 + places].rstrip(".") for t in true]
    rows = zip(stamps, said, strict=True)
    log.write_text("".join(f"({t}) bus0 #{data.hex()}\n" for t, (_, data) in rows))
    decoded = [*sniffer.decode(log, "mightyzap")]
    frames = [row for row in decoded if isinstance(row, FrameRow)]
    first, last = (row for row in decoded if isinstance(row, TransactionRow))
    for row, was_ns in zip(frames, true, strict=True):
        assert row.uncertainty_ns is not None
        assert abs(row.t_ns - was_ns) <= row.uncertainty_ns <= unsure_ns + MS
    assert (first.outcome, last.outcome) == ("ok", "no_response")
    assert first.response_time_ns is not None
    assert first.uncertainty_ns is not None
    took = true[1] - true[0] - 7 * byte_time_ns(57600)
    assert abs(first.response_time_ns - took) <= first.uncertainty_ns
    again = tmp_path / "again.log"
    sniffer.convert(log, [again])
    written = again.read_text().splitlines()
    assert [line.split()[0] for line in written] == [
        f"({t})" if places < 6 else f"({t.ljust(20, '0')})" for t in stamps
    ]


@given(st.integers(0, TIME_END_NS - 1))
def test_a_time_is_exact_to_the_nanosecond(t_ns: int) -> None:
    text = f"({t_ns // 10**9}.{t_ns % 10**9:09d}) bus0 RX#00\n"
    assert chunks(text.encode())[0].t_ns == t_ns


@given(
    st.lists(st.tuples(st.integers(0, 10**12), st.binary(max_size=3)), min_size=1, max_size=6),
    st.lists(st.sampled_from(["b #", "b TX#", "b RX#"]), min_size=1, max_size=3),
    st.sampled_from(["", "c RX#", "b rx#", "b 123#"]),
    st.sampled_from([3, 6, 9]),
)
def test_lines_read_together_say_what_each_says_alone(
    said: list[tuple[int, bytes]], heads: list[str], odd: str, places: int
) -> None:
    lines = [
        f"({t_ns // 10**9}.{f'{t_ns % 10**9:09d}'[:places]}) {head}{data.hex()}"
        for (t_ns, data), head in zip(said, itertools.cycle([*heads, odd or heads[0]]))
    ]
    text = "\n".join(lines).encode()
    alone = [*CandumpLog("bus0").chunks(LineBlock(text, 1, 0, cut_off=False))]
    assert chunks(text + b"\n", "candump") == alone


def test_a_stamp_may_have_a_decimal_comma() -> None:
    text = b"(1795215306,000100) bus0 RX#FAAF\n(1795215306,000200) bus0 #01\n"
    assert chunks(text) == chunks(text.replace(b",", b"."))


@pytest.mark.parametrize(
    "line", ["(1.5) bus0 RX#FA AF", "(-1.5) b #FF", "(1795219199000.000) b #FF"]
)
def test_a_line_of_another_form_is_refused_with_the_form_that_is_read(line: str) -> None:
    assert "ten digits of seconds, bytes without blanks" in refusal(f"{line}\n".encode())


def test_a_name_that_no_bus_may_have_is_told_apart_from_a_line_of_another_form() -> None:
    told = refusal(b"(1732142106.5) arm#2 RX#FAAF01\n")
    assert "a bus with # or brackets in its name" in told
    assert {c.bus for c in chunks("(1.0) ärm*2 #FF\n".encode())} == {"ärm*2"}


def test_a_log_that_breaks_off_is_read_as_far_as_it_goes() -> None:
    text = b"(1.5) bus0 RX#FAAF01\n(2.5) bus0 TX#FAAF01"
    for cut in range(1, 20):
        assert b"\xfa\xaf\x01\xfa\xaf\x01".startswith(read(text[:-cut], "candump"))
    damaged = b"(1.5) bus0 RX#FA\n" * 20 + b"(1.5) bus0 RX:FA\n"
    assert until_damage(damaged)[0] == b"\xfa" * 20


def test_the_first_group_is_small_where_somebody_waits_for_it_and_nothing_else_changes() -> None:
    lines = "".join(f"(1732142106.{k:06d}) bus0 RX#FF{k % 256:02X}00\n" for k in range(3000))
    slow, hasty = (open_source(lines.encode(), "candump") for _ in range(2))
    hasty.hasten(600, 1000)
    whole, parts = list(slow), list(hasty)
    assert [len(group) for group in whole] == [3000]
    assert [len(group) for group in parts] == [200, 2800]
    assert [chunk for group in parts for chunk in group] == whole[0]
    hasty.hasten(1 << 20, 70)
    assert len(next(iter(hasty))) == 70
