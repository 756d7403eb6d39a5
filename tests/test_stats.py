"""``sniffer stats``: figures that a slow count of the JSON lines has, too, within honest bounds."""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
from collections import defaultdict
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import sniffer
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, Clock
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import ends_goal
from sniffer.simulation.buses import BUSES
from sniffer.statistics import Statistics
from sniffer.statistics.flat import COLUMNS, rows
from sniffer.statistics.told import as_dict
from tests.commands import Ran, within
from tests.golden import CAPTURES, captures
from tests.lists import each_in_turn, in_turn
from tests.recordings import talk
from tests.schemas import hold_to
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

DAMAGED = [path for path in captures() if "damaged" in path.name]

BIN = 2 ** (1 / 32) + 1e-6
"""A figure is known to so much, apart from what its stamps leave open."""

MS = 1_000_000


class Counting:
    """The command, within this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def says(self, *arguments: str | Path) -> Ran:
        return within(self._capsys, "stats", *arguments)

    def bus(self, *arguments: str | Path) -> dict[str, Any]:
        done = self.says(*arguments, "--format", "json")
        assert done.status == 0, done.err
        found: dict[str, Any] = json.loads(done.out)
        hold_to("stats", found)
        (bus,) = found["buses"]
        return dict(bus)


@pytest.fixture
def stats(capsys: pytest.CaptureFixture[str]) -> Counting:
    return Counting(capsys)


def counted(
    protocol: str,
    chunks: Sequence[Chunk],
    cuts: Sequence[int] = (),
    baud: int | None = None,
    every_ns: int | None = None,
) -> dict[str, Any]:
    """Return the figures of chunks that come in groups."""
    told = Statistics(every_ns=every_ns)
    pipeline = Pipeline(Options(protocol=protocol, baud=baud), [told], ahead=chunks)
    edges = sorted({0, len(chunks), *(c % len(chunks) for c in cuts)})
    for a, b in itertools.pairwise(edges):
        pipeline.feed(chunks[a:b])
    pipeline.close()
    pipeline.finish()
    assert pipeline.failure is None
    return as_dict(told)


def exchange(
    at_ms: float, value: int = 0, *, took_ms: float = 0.5, servo: int = 1, asked: int = 0x8C
) -> list[Chunk]:
    """Return a request for a position and its answer, on a line whose stamps are exact."""
    byte_ns = 10**10 // 57600
    ask = packet(servo, 0xF2, bytes([asked, 2]))
    answer = packet(servo, 0, value.to_bytes(2, "little"))
    t = round(at_ms * MS) + len(ask) * byte_ns
    then = t + round(took_ms * MS) + len(answer) * byte_ns
    return [Chunk(ask, t, Clock.SAMPLE), Chunk(answer, then, Clock.SAMPLE)]


@in_turn(2)
@pytest.mark.parametrize("capture", captures(), ids=lambda p: p.name)
def test_what_is_told_is_as_the_schema_has_it_and_every_byte_is_accounted_for(
    stats: Counting, capture: Path
) -> None:
    bus = stats.bus(capture)
    assert bus["bytes"] == bus["bytes_in_frames"] + bus["bytes_in_gaps"]
    assert sum(c["bytes"] for c in bus["commands"]) == bus["bytes_in_frames"]
    if bus["load"] is not None:
        on_the_line = sum(c["bus_time_share"] for c in bus["commands"])
        assert on_the_line == pytest.approx(
            bus["load"]["mean"] * bus["bytes_in_frames"] / bus["bytes"]
        )
    assert all(
        low <= high
        for c in bus["commands"]
        for q in (c["period_ns"], c["jitter_ns"], c["response_time_ns"])
        if q is not None
        for low, high in (q[name] for name in ("min", "p50", "p95", "p99", "max"))
    )


@each_in_turn(2, "protocol", BUSES)
@settings(max_examples=12)
@given(data=st.data())
def test_figures_do_not_depend_on_how_the_stream_was_cut(
    protocol: str, data: st.DataObject
) -> None:
    chunks = talk(protocol, 0.3, data.draw(st.integers(0, 3)))
    cuts = data.draw(st.lists(st.integers(1, 10**6), max_size=8))
    every_ns = data.draw(st.sampled_from([None, 20 * MS]))
    found = counted(protocol, chunks, cuts, every_ns=every_ns)
    assert found == counted(protocol, chunks, every_ns=every_ns)


def test_a_silence_behind_noise_is_as_long_where_the_noise_was_read_alone() -> None:
    chunks = talk("lss", 0.3, 0)
    assert counted("lss", chunks, [3, 4]) == counted("lss", chunks)


def told_of(path: Path) -> list[Any]:
    """Return all records, one by one."""
    return list(sniffer.decode(path))


def bounds(pairs: Sequence[tuple[int, int]], share: float) -> tuple[int, int]:
    """Return a quantile the slow way: that of the lower bounds, that of the upper ones."""
    place = max(math.ceil(share * len(pairs) - 1e-9) - 1, 0)
    return sorted(low for low, _ in pairs)[place], sorted(high for _, high in pairs)[place]


@each_in_turn(2, "capture", DAMAGED, ids=lambda p: p.name)
def test_commands_are_counted_as_a_slow_count_of_the_rows_has_it(
    stats: Counting, capture: Path
) -> None:
    sent: defaultdict[Any, int] = defaultdict(int)
    took: defaultdict[Any, list[tuple[int, int]]] = defaultdict(list)
    outcomes: defaultdict[Any, list[str]] = defaultdict(list)
    said: dict[int, str] = {}
    exchanges: list[Any] = []
    row: Any
    for row in told_of(capture):
        if row.type == "frame":
            said[row.offset] = row.hex
            if row.kind == "request" and "echo" not in row.flags:
                sent[row.servo_id, row.op] += 1
        elif row.type == "transaction" and row.request_offset is not None:
            who = row.servo_id, row.op
            outcomes[who].append(row.outcome)
            exchanges.append(row)
            if row.outcome == "ok" and row.response_time_ns is not None:
                t, u = row.response_time_ns, row.uncertainty_ns or 0
                took[who].append((max(t - u, 0), t + u))
    retries: defaultdict[Any, int] = defaultdict(int)
    last: dict[Any, Any] = {}
    for row in exchanges:
        before = last.get(row.servo_id)
        if before is not None and before.outcome in ("no_response", "damaged", "mismatched"):
            same = said[before.request_offset] == said[row.request_offset]
            retries[row.servo_id, row.op] += same
        last[row.servo_id] = row
    assert took
    assert retries or capture.name.startswith("lss")  # its controller asks nothing twice
    everyone = {None, *PROTOCOLS[capture.name.split("_")[0]].everyone}
    bus = stats.bus(capture)
    for c in bus["commands"]:
        who = c["servo_id"], c["op"]
        assert c["requests"] == sent[who]
        if c["servo_id"] in everyone:
            continue  # what is said to all is answered by each for itself
        wanted = [outcome for outcome in outcomes[who] if outcome != "not_expected"]
        assert c["asked"] == len(wanted)
        assert c["missing"] == wanted.count("no_response")
        assert c["failed"] == len(wanted) - wanted.count("ok")
        assert c["retries"] == retries[who]
        q = c["response_time_ns"]
        assert (q is None) == (not took[who])
        if q is None:
            continue
        assert q["count"] == len(took[who])
        for name, share in {"min": 0.0, "p50": 0.5, "p95": 0.95, "p99": 0.99, "max": 1.0}.items():
            low, high = bounds(took[who], share)
            told = q[name]
            assert low / BIN - 1 <= told[0] <= low
            assert high <= told[1] <= high * BIN + 1


@each_in_turn(2, "capture", DAMAGED, ids=lambda p: p.name)
def test_following_errors_and_extremes_are_those_of_the_samples(
    stats: Counting, capture: Path
) -> None:
    protocol = PROTOCOLS[capture.name.split("_")[0]]
    ends = {protocol.op_name(op) for op in ends_goal(protocol)}
    goals: dict[Any, float] = {}
    errors: defaultdict[Any, list[float]] = defaultdict(list)
    extremes: dict[Any, tuple[float, float]] = {}
    for row in told_of(capture):
        if row.type == "frame" and row.kind == "request" and row.op in ends:
            goals = {who: g for who, g in goals.items() if who[0] != row.servo_id}
        if row.type != "sample" or row.value is None or row.part:
            continue
        who = row.servo_id, row.unit
        if row.quantity:
            low, high = extremes.get((*who, row.quantity), (row.value, row.value))
            extremes[*who, row.quantity] = min(low, row.value), max(high, row.value)
        if row.quantity == "goal_position":
            goals = {g: v for g, v in goals.items() if g[0] != row.servo_id} | {who: row.value}
        elif row.quantity == "position" and who in goals:
            errors[who].append(goals[who] - row.value)
    assert errors
    for servo in stats.bus(capture)["servos"]:
        for value in servo["values"]:
            told = value["min"]["value"], value["max"]["value"]
            mine = servo["servo_id"], value["unit"], value["quantity"]
            assert told == pytest.approx(extremes[mine])
        for error in servo["following_error"]:
            slow = errors[servo["servo_id"], error["unit"]]
            assert error["size"]["count"] == len(slow)
            assert error["worst"]["value"] == pytest.approx(max(slow, key=abs))
            size = sorted(map(abs, slow))
            low, high = error["size"]["p50"]
            middle = size[math.ceil(len(size) / 2) - 1]
            assert low - 0.0011 <= middle <= high + 0.0011


def test_an_anomaly_is_told_by_code_and_servo_with_its_times(stats: Counting) -> None:
    path = CAPTURES / "mightyzap_damaged.log"
    times: defaultdict[Any, list[int]] = defaultdict(list)
    for row in told_of(path):
        if row.type == "anomaly":
            times[row.code, row.servo_id].append(row.t_ns)
    found = stats.bus(path)["anomalies"]
    assert {(a["code"], a["servo_id"]): a["count"] for a in found} == {
        who: len(when) for who, when in times.items()
    }
    for a in found:
        mine = times[a["code"], a["servo_id"]]
        assert (a["first_ns"], a["last_ns"]) == (min(mine), max(mine))
        assert sorted(a["t_ns"]) == sorted(mine)[: len(a["t_ns"])]
        assert sum(a["over_time"]["counts"]) == a["count"]
    worst = [a["severity"] for a in found]
    assert worst == sorted(worst, key=["error", "warn", "note"].index)


def test_the_slowest_answer_is_the_one_that_sql_finds(stats: Counting) -> None:
    pytest.importorskip("duckdb")
    capture = CAPTURES / "mightyzap_damaged.log"
    found = sniffer.query(
        "SELECT servo_id, op, max_by((response_time_ns, t_ns, response_offset), "
        "response_time_ns - uncertainty_ns) FROM transactions WHERE outcome = 'ok' AND "
        "response_time_ns > uncertainty_ns GROUP BY ALL",
        [capture],
    )
    told = {
        (c["servo_id"], c["op"]): tuple(c["slowest"][k] for k in ("value", "t_ns", "offset"))
        for c in stats.bus(capture)["commands"]
        if c["slowest"]
    }
    assert told == {(servo, op): tuple(slowest) for servo, op, slowest in found}


def test_no_response_time_is_a_point_that_the_stamps_do_not_carry(stats: Counting) -> None:
    bus = stats.bus(CAPTURES / "mightyzap_damaged.log", "--latency", "16")
    worst = max(c["response_time_ns"]["p50"][1] for c in bus["commands"] if c["response_time_ns"])
    assert worst >= 16 * MS
    done = stats.says(CAPTURES / "mightyzap_damaged.log", "--latency", "16")
    assert "<16" in done.out


def test_an_input_without_clock_has_no_rates_and_no_times(stats: Counting) -> None:
    bus = stats.bus(CAPTURES / "lss_clean.bin")
    assert bus["load"] is None
    assert all(c["rate_hz"] is None and c["response_time_ns"] is None for c in bus["commands"])
    assert sum(c["bytes_share"] for c in bus["commands"]) == pytest.approx(1)
    assert "no clock in the input" in stats.says(CAPTURES / "lss_clean.bin").out


def test_a_capture_with_times_and_no_frame_is_not_one_without_a_clock(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for command, told in (
        (("stats",), "no frame in it: no rates and no times"),
        (("decode", "--summary"), "no frame in it: nothing was timed"),
    ):
        path = CAPTURES / "mightyzap_damaged.log"
        out = within(capsys, *command, path, "--protocol", "rs30x").out
        assert told in out
        assert "no clock" not in out


def test_a_table_has_a_row_a_figure_and_all_figures_of_the_json(stats: Counting) -> None:
    path = CAPTURES / "rs30x_damaged.log"
    done = stats.says(path, "--format", "csv")
    table = list(csv.DictReader(io.StringIO(done.out)))
    assert tuple(table[0]) == COLUMNS
    told = json.loads(stats.says(path, "--format", "json").out)
    assert len(table) == len(list(rows(told)))
    (bus,) = told["buses"]
    p99 = {
        (row["servo_id"], row["name"]): [int(row["low"]), int(row["high"])]
        for row in table
        if row["figure"] == "response_time_ns.p99"
    }
    assert p99 == {
        ("" if c["servo_id"] is None else str(c["servo_id"]), c["op"]): c["response_time_ns"]["p99"]
        for c in bus["commands"]
        if c["response_time_ns"]
    }


@in_turn(3)
@pytest.mark.parametrize("width", [40, 80, 140])
@pytest.mark.parametrize("capture", DAMAGED, ids=lambda p: p.name)
def test_the_text_keeps_within_the_terminal_and_cuts_no_word(
    stats: Counting, capture: Path, width: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    done = stats.says(capture, "--all")
    assert done.status == 0
    lines = done.out.splitlines()
    assert max(map(len, lines)) <= max(width, 66), "below that no number is cut off"
    assert "…" not in done.out
    headings = [line for line in lines if line.startswith(" ") and not line.startswith("  ")]
    assert any("traffic" in line for line in headings)
    assert any("anomalies" in line for line in headings)


def test_the_worst_stands_first(stats: Counting) -> None:
    done = stats.says(CAPTURES / "wck_damaged.log")
    part = done.out.partition("worst first\n")[2].splitlines()
    shares = [float(line.split("%")[0].split()[-1]) for line in part[1:] if "%" in line]
    assert shares
    head = done.out.partition("slowest first\n")[2].splitlines()[1]
    assert "boundary_set" in head


def test_only_a_part_is_counted_where_one_is_asked_for(stats: Counting) -> None:
    path = CAPTURES / "mightyzap_clean.log"
    part = stats.bus(path, "--from", "1", "--to", "2")
    assert part["seconds"] == pytest.approx(1, abs=0.1)
    done = stats.says(path, "--from", "2", "--to", "1")
    assert done.status == 2
    assert "--to must lie behind --from" in done.err


def test_of_a_part_in_which_nothing_was_said_not_even_a_head_is_printed(stats: Counting) -> None:
    for form in ("text", "json", "csv"):
        done = stats.says(CAPTURES / "wck_clean.log", "--from", "99", "--format", form)
        assert (done.status, done.out) == (2, "")
        assert "nothing was said from second 99 to its end" in done.err


def test_a_file_that_is_not_there_is_a_line(stats: Counting) -> None:
    done = stats.says("nowhere.mcap")
    assert done.status == 2
    assert "nowhere.mcap" in done.complaint


def test_the_library_call_counts_what_the_command_does(stats: Counting) -> None:
    path = CAPTURES / "wck_clean.log"
    done = sniffer.stats(path)
    assert done.as_dict()["buses"] == [stats.bus(path)]
    assert np.isfinite([c.ok for c in done.statistics.lanes["bus0"].commands.figures()]).all()
