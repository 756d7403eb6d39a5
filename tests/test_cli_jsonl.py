"""JSON lines, the contract with other tools: keys, types, order, and nothing lost."""

from __future__ import annotations

import json
import tempfile
from functools import cache
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, Any, Final

import pytest

import sniffer
from sniffer.cli import run
from sniffer.decoding.rows import as_dict
from sniffer.ground.codes import KINDS, OUTCOMES, PROVENANCES, ROLES
from sniffer.ground.model import Severity
from sniffer.protocols import PROTOCOLS
from sniffer.sources import open_source
from tests.commands import damaged, log, records, talk, within
from tests.conversations import robot, through_usb
from tests.lists import each_in_turn

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

Capsys = pytest.CaptureFixture[str]
Record = dict[str, Any]

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
SAMPLES: Final = sorted(p.name for p in CAPTURES.iterdir() if p.suffix != ".md")

MAYBE_INT: Final = (int, NoneType)
CONTRACT: Final[Mapping[str, Mapping[str, tuple[type, ...]]]] = {
    "frame": {
        "bus": (str,),
        "t_ns": (int,),
        "offset": (int,),
        "length": (int,),
        "hex": (str,),
        "protocol": (str,),
        "kind": (str,),
        "servo_id": MAYBE_INT,
        "op": (str,),
        "checksum": (str,),
        "fields": (dict,),
    },
    "gap": {
        "offset": (int,),
        "length": (int,),
        "hex": (str,),
        "reason": (str,),
        "detail": (dict,),
    },
    "transaction": {
        "request_offset": MAYBE_INT,
        "response_offset": MAYBE_INT,
        "servo_id": MAYBE_INT,
        "op": (str,),
        "outcome": (str,),
        "response_time_ns": MAYBE_INT,
        "uncertainty_ns": MAYBE_INT,
    },
    "sample": {
        "t_ns": (int,),
        "servo_id": MAYBE_INT,
        "register": (str,),
        "quantity": (str,),
        "role": (str,),
        "raw": (int,),
        "value": (int, float, NoneType),
        "unit": (str,),
        "scale": (str,),
    },
    "anomaly": {
        "t_ns": (int,),
        "severity": (str,),
        "group": (str,),
        "code": (str,),
        "servo_id": MAYBE_INT,
        "detail": (str,),
        "evidence": (list,),
    },
    "summary": {"bytes": (int,), "kinds": (dict,), "outcomes": (dict,), "codes": (dict,)},
}
"""The keys that other tools rely on, and what stands behind them: section 4 of the design."""

WORDS: Final[Mapping[tuple[str, str], Iterable[str]]] = {
    ("frame", "kind"): KINDS,
    ("frame", "checksum"): ("ok", "none"),
    ("frame", "protocol"): PROTOCOLS,
    ("gap", "reason"): ("damaged", "truncated", "noise", "idle_tail"),
    ("transaction", "outcome"): OUTCOMES,
    ("sample", "role"): ROLES,
    ("sample", "scale"): PROVENANCES,
    ("anomaly", "severity"): [s.name.lower() for s in Severity],
}


@cache
def decoded(name: str) -> str:
    """Return the lines of a sample capture."""
    return lines_of(CAPTURES / name)


def lines_of(path: Path, *arguments: str) -> str:
    """Return what decoding a file writes."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "x.jsonl"
        assert run(["decode", str(path), "-o", str(out), "--quiet", *arguments]) == 0
        return out.read_text(encoding="utf-8")


def of(rows: list[Record], *types: str) -> list[Record]:
    return [row for row in rows if row["type"] in types]


def captured(name: str) -> bytes:
    return b"".join(c.data for group in open_source(CAPTURES / name) for c in group)


@each_in_turn(2, "name", SAMPLES)
def test_every_record_has_its_keys_and_types(name: str) -> None:
    for row in records(decoded(name)):
        assert next(iter(row)) == "type"
        for key, types in CONTRACT[row["type"]].items():
            assert type(row[key]) in types, (row["type"], key, row[key])
            assert row[key] in WORDS.get((row["type"], key), [row[key]])


def test_the_samples_hold_records_of_every_type_and_outcome() -> None:
    rows = [row for name in SAMPLES for row in records(decoded(name))]
    assert {row["type"] for row in rows} == set(CONTRACT)
    assert {row["outcome"] for row in of(rows, "transaction")} == set(OUTCOMES) - {"mismatched"}
    assert {row["protocol"] for row in of(rows, "frame")} == set(PROTOCOLS)


@pytest.mark.parametrize("name", SAMPLES)
def test_frames_and_gaps_are_the_input(name: str) -> None:
    at, data = 0, b""
    for row in of(records(decoded(name)), "frame", "gap"):
        assert row["offset"] == at
        assert row["length"] * 2 == len(row["hex"]) > 0
        data += bytes.fromhex(row["hex"])
        at += row["length"]
    assert data == captured(name)


@pytest.mark.parametrize("name", SAMPLES)
def test_a_frame_comes_before_its_samples_and_those_before_its_transaction(name: str) -> None:
    rows = records(decoded(name))
    written: dict[int, int] = {}
    last: dict[int, int] = {}
    for line, row in enumerate(rows):
        match row["type"]:
            case "frame" | "gap":
                written[row["offset"]] = line
            case "sample":
                assert written[row["offset"]] < line
                last[row["offset"]] = line
            case "transaction":
                asked, answered = row["request_offset"], row["response_offset"]
                assert asked is not None or answered is not None
                for offset in (asked, answered):
                    if offset is not None:
                        assert last.get(offset, written[offset]) < line
                        last[offset] = len(rows)  # no sample may follow
            case "anomaly":
                for offset, length in row["evidence"]:
                    assert length > 0
                    assert offset >= 0


@pytest.mark.parametrize("name", SAMPLES)
def test_the_summary_stands_last_and_counts_the_lines(name: str) -> None:
    rows = records(decoded(name))
    summary = rows.pop()
    assert summary["type"] == "summary"
    assert "summary" not in {row["type"] for row in rows}
    frames, gaps = of(rows, "frame"), of(rows, "gap")
    assert summary["frames"] == len(frames)
    assert summary["gaps"] == len(gaps)
    assert summary["bytes_in_frames"] == sum(f["length"] for f in frames)
    assert summary["bytes_in_gaps"] == sum(g["length"] for g in gaps)
    assert summary["bytes"] == summary["bytes_in_frames"] + summary["bytes_in_gaps"]
    for total, kind, key in (
        ("kinds", "frame", "kind"),
        ("reasons", "gap", "reason"),
        ("outcomes", "transaction", "outcome"),
        ("codes", "anomaly", "code"),
        ("severities", "anomaly", "severity"),
    ):
        counted: dict[str, int] = {}
        for row in of(rows, kind):
            counted[row[key]] = counted.get(row[key], 0) + 1
        assert summary[total] == counted
    assert summary["transactions"] == len(of(rows, "transaction"))
    assert summary["samples"] == len(of(rows, "sample"))
    assert summary["anomalies"] == len(of(rows, "anomaly"))


def derived_from_reads(row: Record) -> Record:
    """Leave out what is known from where one read of the adapter ended and the next began."""
    gone = {"t_start_ns", "uncertainty_ns", "response_time_ns", "buses", "detail"}
    return {k: v for k, v in row.items() if k not in gone or (row["type"], k) == ("gap", "detail")}


@each_in_turn(3, "name", SAMPLES)
def test_decoding_its_own_lines_gives_the_same_records_again(name: str, tmp_path: Path) -> None:
    path = tmp_path / "again.jsonl"
    path.write_text(decoded(name), encoding="utf-8")
    protocol = name.partition("_")[0]
    again = lines_of(path, "--protocol", protocol)
    if again != decoded(name):
        # a line a frame: the ends of the adapter's reads are not in it, all else is
        assert name in ("mightyzap_damaged.log", "lss_damaged.log")
        want, got = records(decoded(name)), records(again)
        assert [derived_from_reads(r) for r in got] == [derived_from_reads(r) for r in want]


@pytest.mark.parametrize("timed", [True, False])
def test_decoding_its_own_lines_gives_the_same_text_again(
    timed: bool, tmp_path: Path, capsys: Capsys
) -> None:
    path, again = tmp_path / "in.log", tmp_path / "again.jsonl"
    path.write_text(log(talk(30)) if timed else damaged(talk(30)).hex(" "))
    first = within(capsys, "decode", path, "--format", "jsonl").out
    again.write_text(first)
    assert within(capsys, "decode", again, "--format", "jsonl").out == first
    assert (records(first)[0]["clock"] == "file") is timed


def test_a_file_holds_what_standard_output_shows(tmp_path: Path, capsys: Capsys) -> None:
    out = tmp_path / "x.jsonl"
    path = CAPTURES / "mightyzap_damaged.log"
    ran = within(capsys, "decode", path, "--format", "jsonl", "-o", out)
    assert out.read_text(encoding="utf-8") == ran.out == decoded(path.name)


def test_the_lines_are_the_rows_of_the_api() -> None:
    path = CAPTURES / "wck_damaged.log"
    rows = [as_dict(row) for row in sniffer.decode(path)]
    assert records(decoded(path.name))[:-1] == [
        {k: list(v) if isinstance(v, tuple) else v for k, v in row.items()} for row in rows
    ]


def test_the_summary_alone_can_be_json_too(capsys: Capsys) -> None:
    path = CAPTURES / "wck_damaged.log"
    ran = within(capsys, "decode", path, "--format", "jsonl", "--summary")
    assert records(ran.out) == records(decoded(path.name))[-1:]


def test_lines_that_are_read_again_are_as_uncertain_as_what_they_are_of(
    tmp_path: Path, capsys: Capsys
) -> None:
    """The chunks are lost, by which it was told how long an adapter held the bytes."""
    log, lines = tmp_path / "held.log", tmp_path / "held.jsonl"
    log.write_text(
        "".join(
            f"({chunk.t_ns / 1e9:.6f}) arm #{chunk.data.hex()}\n"
            for chunk in through_usb(robot("mightyzap", 6, rate_hz=37).chunks, 19)
            if chunk.t_ns is not None
        ),
        encoding="ascii",
    )
    ran = within(capsys, "decode", log, "--baud", "115200", "-q", "-o", lines)
    assert ran.status == 0, ran.err

    def unsure(path: Path) -> list[int]:
        told = within(capsys, "decode", path, "--baud", "115200", "--format", "jsonl").out
        rows = map(json.loads, told.splitlines())
        return [row["uncertainty_ns"] for row in rows if row["type"] == "frame"]

    before, again = unsure(log), unsure(lines)
    assert max(before) > 10_000_000
    assert all(b >= a for a, b in zip(before, again, strict=True))
    assert within(capsys, "diagnose", lines, "--baud", "115200").out.startswith("nothing is wrong")
