"""The terminal table: it fits, its columns stand under their titles, it says nothing false."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Final

import pytest

import sniffer
from sniffer.decoding.rows import FrameRow, GapRow
from sniffer.sinks.words import fit
from tests.commands import damaged, log, talk, within
from tests.lists import in_turn
from tests.streams.mightyzap import packet
from tests.streams.rs30x import long

Capsys = pytest.CaptureFixture[str]
Patch = pytest.MonkeyPatch

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
NAMES: Final = [f"{name}_damaged.log" for name in sniffer.PROTOCOLS]
WIDTHS: Final = (80, 140, 200)
ANSI: Final = re.compile(r"\x1b\[[0-9;]*m")


def shown(capsys: Capsys, monkeypatch: Patch, path: Path, width: int, *arguments: str) -> str:
    monkeypatch.setenv("COLUMNS", str(width))
    ran = within(capsys, "decode", path, *arguments)
    assert (ran.status, ran.content) == (0, True)
    return ran.out


_SAMPLES: dict[tuple[str, int], str] = {}


def sample(capsys: Capsys, monkeypatch: Patch, name: str, width: int) -> str:
    """Return how a sample capture is shown; it is decoded once for all tests."""
    if (name, width) not in _SAMPLES:
        _SAMPLES[name, width] = shown(capsys, monkeypatch, CAPTURES / name, width)
    return _SAMPLES[name, width]


@cache
def rows_of(name: str) -> list[FrameRow | GapRow]:
    return [r for r in sniffer.decode(CAPTURES / name) if isinstance(r, FrameRow | GapRow)]


def table_of(text: str) -> tuple[str, list[str]]:
    """Return the titles and the lines under them."""
    table = text.partition("\n\n")[0].splitlines()
    return table[0], table[1:]


@in_turn(4)
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", NAMES)
def test_no_line_is_wider_than_the_terminal(
    name: str, width: int, capsys: Capsys, monkeypatch: Patch
) -> None:
    lines = sample(capsys, monkeypatch, name, width).splitlines()
    assert max(map(len, lines)) <= width
    assert all(line == line.rstrip() for line in lines)
    assert not any("\x1b" in line for line in lines)


@in_turn(3)
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", NAMES)
def test_every_cell_stands_under_its_title(
    name: str, width: int, capsys: Capsys, monkeypatch: Patch
) -> None:
    head, lines = table_of(sample(capsys, monkeypatch, name, width))
    titles = head.split()
    assert titles[0] == "time"
    assert titles[-1] == "verdict"
    assert ("bytes" in titles) is (width == 200)
    assert ("bus" in titles) is (width > 80)
    at = {title: head.index(title) for title in titles}
    op_width = at["values"] - at["command"] - 1
    rows = rows_of(name)
    assert len(lines) == len(rows)
    for line, row in zip(lines, rows, strict=True):
        cells = line.ljust(width)
        assert all(cells[at[title] - 1] == " " for title in titles[1:] if title != "id")
        servo, mark = cells[at["id"] - 1 : at["id"] + 2], cells[at["id"] + 3]
        op = cells[at["command"] : at["values"] - 1]
        if isinstance(row, GapRow):
            assert (servo.strip(), mark, op.strip()) == ("", "!", "no frame")
        else:
            assert servo == str("-" if row.servo_id is None else row.servo_id).rjust(3)
            assert mark == {"request": ">", "response": "<"}[row.kind]
            assert op == fit(row.op, op_width)
        if "bytes" in at:
            data = bytes.fromhex(row.hex).hex(" ").upper()
            assert data.startswith(cells[at["bytes"] : at["verdict"]].split("…")[0].strip())


@pytest.mark.parametrize("width", WIDTHS)
def test_a_list_of_values_is_cut_between_two_of_them(
    width: int, capsys: Capsys, monkeypatch: Patch
) -> None:
    head, lines = table_of(sample(capsys, monkeypatch, "mightyzap_damaged.log", width))
    begin = head.index("values")
    end = head.index("bytes" if width == 200 else "verdict") - 1
    cells = {line.ljust(width)[begin:end].strip() for line in lines}
    assert any(cell.startswith("position ") for cell in cells)
    for cell in cells:
        if "position " in cell:
            assert "…" not in cell.removesuffix(", …")
    if width > 80:
        measured = [cell for cell in cells if cell.startswith("position ")]
        assert sum(cell.endswith("°C") for cell in measured) > 0.9 * len(measured)


def test_a_damaged_frame_shows_its_bytes_and_both_sums(
    tmp_path: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    path = tmp_path / "damaged.bin"
    path.write_bytes(packet(1, 0xF1) * 3 + b"\xff\xff\xff\x01\x02\xf1\x0c")
    text = shown(capsys, monkeypatch, path, 80)
    assert "! no frame        sum 0C not 0B: FF FF FF 01 02 …  bad checksum" in text
    text = shown(capsys, monkeypatch, path, 140)
    assert "! no frame            sum 0C not 0B: FF FF FF 01 02 F1 0C " in text


def test_large_numbers_keep_their_digits(
    tmp_path: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    path = tmp_path / "lss.bin"
    path.write_bytes(b"#5QN\r*5QN12345671\r")
    assert "serial_number 12345671" in shown(capsys, monkeypatch, path, 80)


def test_targets_of_two_registers_are_told_apart(
    tmp_path: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    path = tmp_path / "rs30x.bin"
    path.write_bytes(long(0x1E, (1, b"\x64\x00\x0a\x00"), (2, b"\xc8\x00\x14\x00")) * 3)
    text = shown(capsys, monkeypatch, path, 140)
    assert "goal_position 1: 10 deg, 2: 20 deg, goal_time 1: 0.1 s, 2: 0.2 s" in text


# --- buses -------------------------------------------------------------------------------------


@pytest.fixture
def two_buses(tmp_path: Path) -> Path:
    left = log(talk(2)).splitlines()
    right = [line.replace("bus0", "elbow") for line in left]
    path = tmp_path / "two.log"
    path.write_text("\n".join(sorted(left + right)))
    return path


def test_two_buses_are_told_apart_at_any_width_in_the_order_of_time(
    two_buses: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    for width in (80, 140):
        head, lines = table_of(shown(capsys, monkeypatch, two_buses, width))
        assert head.split()[1] == "bus"
        assert [line.split()[1] for line in lines] == ["bus0", "elbow"] * 14
        times = [line.split()[0] for line in lines]
        assert times == sorted(times)


def test_a_bus_that_is_heard_late_gets_a_column_from_then_on(
    tmp_path: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    early = log(talk(2)).splitlines()
    late = [line.replace("bus0", "elbow").replace("1700000000", "1700000009") for line in early]
    path = tmp_path / "late.log"
    path.write_text("\n".join(early + late))
    assert path.read_text().count("1700000009")
    head, lines = table_of(shown(capsys, monkeypatch, path, 80))
    assert "bus" not in head.split()
    assert lines[14].split()[:2] == ["time", "bus"]
    assert [line.split()[1] for line in lines[15:]] == ["elbow"] * 14


def test_names_of_buses_that_begin_alike_are_told_by_their_ends(
    two_buses: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    text = two_buses.read_text().replace("bus0", "left_arm").replace("elbow", "left_leg")
    two_buses.write_text(text)
    lines = table_of(shown(capsys, monkeypatch, two_buses, 80))[1]
    assert [line.split()[1] for line in lines[:2]] == ["…_arm", "…_leg"]


def test_the_name_of_a_bus_cannot_steer_the_terminal(
    tmp_path: Path, capsys: Capsys, monkeypatch: Patch
) -> None:
    path = tmp_path / "evil.jsonl"
    name = "\x1b[31m\nred"
    frames = [packet(1, 0xF1), packet(1, 0)] * 2
    path.write_text(
        "".join(
            json.dumps({"type": "frame", "bus": name, "offset": 7 * i, "hex": f.hex()}) + "\n"
            for i, f in enumerate(frames)
        )
    )
    for width in WIDTHS:
        text = shown(capsys, monkeypatch, path, width)
        assert "\x1b" not in text
        assert "\nred" not in text


# --- the summary -------------------------------------------------------------------------------


def summary(
    capsys: Capsys, monkeypatch: Patch, tmp_path: Path, data: bytes | str, *options: str
) -> list[str]:
    path = tmp_path / "in.bin"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return shown(capsys, monkeypatch, path, 80, "--summary", *options).splitlines()


def test_the_summary_counts_in_words(capsys: Capsys, monkeypatch: Patch, tmp_path: Path) -> None:
    lines = summary(capsys, monkeypatch, tmp_path, packet(1, 0xF1) + packet(1, 0) + b"\x01")
    assert lines[:4] == [
        "bus0: mightyzap",
        "  15 bytes = 14 in 2 frames (93.33 %) + 1 in 1 gap",
        "  no clock in the input: times are nominal",
        "  exchanges: 1 ok",
    ]
    assert "reply" not in "".join(lines)


def test_the_summary_of_a_clean_log_has_times_and_no_anomalies(
    capsys: Capsys, monkeypatch: Patch, tmp_path: Path
) -> None:
    quiet = (packet(1, 0xF1) + packet(1, 0)) * 5
    lines = summary(capsys, monkeypatch, tmp_path, log(quiet))
    assert lines == [
        "bus0: mightyzap",
        "  70 bytes = 70 in 10 frames (100.00 %) + 0 in 0 gaps",
        "  over 0.019 s",
        "  assumed to run at 57600 baud",
        "  exchanges: 5 ok",
        "",
        "  servo  frames  reply p50 ms    p99    max  commands sent/answered",
        "      1      10         <1.60  <1.60  <1.60  echo 5/5",
        "",
        "  no anomalies",
    ]


def test_a_hundred_percent_is_said_of_nothing_less(
    capsys: Capsys, monkeypatch: Patch, tmp_path: Path
) -> None:
    lines = summary(capsys, monkeypatch, tmp_path, talk(400) + b"\x01")
    assert lines[1] == "  36001 bytes = 36000 in 2800 frames (99.99 %) + 1 in 1 gap"


def test_a_verbose_summary_shows_the_level_and_the_first_of_each_anomaly(
    capsys: Capsys, monkeypatch: Patch, tmp_path: Path
) -> None:
    lines = summary(capsys, monkeypatch, tmp_path, damaged(talk(20)), "--verbose")
    head = next(line for line in lines if line.startswith("  level"))
    assert re.split(r"  +", head.strip()) == [
        "level",
        "anomaly",
        "count",
        "servos",
        "at byte",
        "the first one",
    ]
    assert any(
        re.match(r"  error  bad-checksum +\d+ +\d.* +90  checksum should be 5D", x) for x in lines
    )
    levels = [x.split()[0] for x in lines[lines.index(head) + 1 :] if x[:3].strip()]
    assert levels == sorted(levels, key=["error", "warn", "note"].index)
    assert len(levels) > 3


def test_the_summary_tells_an_incident_with_the_anomalies_that_it_explains(
    capsys: Capsys, monkeypatch: Patch, tmp_path: Path
) -> None:
    lines = summary(capsys, monkeypatch, tmp_path, damaged(talk(200)) * 3)
    head = next(line for line in lines if line.startswith("  level"))
    assert re.split(r"  +", head.strip()) == ["level", "incident", "sure", "explains"]
    told = "\n".join(lines[lines.index(head) + 1 :])
    assert re.search(r"^  (error|warn) +[a-z-]+: .* \d+ % ", told, re.MULTILINE)
    assert "bad-checksum" in told
    assert "`sniffer diagnose` says why, and what to do" in told


# --- colour ------------------------------------------------------------------------------------


@pytest.mark.parametrize("width", WIDTHS)
def test_a_code_is_not_cut_for_it_can_be_asked_for(
    width: int, capsys: Capsys, monkeypatch: Patch
) -> None:
    codes = "damaged-response,device-recovered"
    told = shown(
        capsys, monkeypatch, CAPTURES / "mightyzap_damaged.log", width, "--code", codes
    ).splitlines()
    assert all(len(line) <= width for line in told)
    assert sum(" damaged-response " in line for line in told) == 12
    assert sum(" device-recovered " in line for line in told) == 1
