"""``sniffer discover``: what is planted in bytes that no table names is found, and nothing else."""

from __future__ import annotations

import random
import tomllib
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sniffer
from sniffer.statistics.thinned import KEPT, Thinned
from tests.commands import Ran, within
from tests.golden import CAPTURES
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

FREE = 0xA0
"""Behind all addresses of the table."""


def planted(path: Path, cycles: int = 120, servos: Sequence[int] = (1,)) -> Path:
    """Write a log of servos that are read: their positions, and eight bytes that nobody names.

    A counter; 7; three times the position (little-endian); a clock (big-endian); flags of which
    bits 0 and 3 flip together; noise.
    """
    chance = random.Random(5)
    lines, now = [], 1_000_000
    for k in range(cycles):
        position, noise = 2000 + round(1500 * np.sin(k / 9)), chance.randrange(256)
        for servo in servos:
            flags = (0x09 if k % 10 < 4 else 0) | (0x02 if k % 7 < 2 else 0)
            hidden = bytes([k % 256, 7]) + (3 * position).to_bytes(2, "little")
            hidden += (200 + 10 * k).to_bytes(2, "big") + bytes([flags, noise])
            for ask, answer in (
                (packet(servo, 0xF2, b"\x8c\x02"), position.to_bytes(2, "little")),
                (packet(servo, 0xF2, bytes([FREE, len(hidden)])), hidden),
            ):
                for data in (ask, packet(servo, 0, answer)):
                    now += 3000
                    lines.append(f"({now / 1e6:.6f}) bus0 #{data.hex()}\n")
    path.write_text("".join(lines), encoding="ascii")
    return path


def lines_of(done: Ran) -> dict[str, str]:
    """Return what is said, by address."""
    assert done.status == 0, done.err
    told = [line.split(maxsplit=1) for line in done.out.splitlines() if line.startswith("  ")]
    return dict(told)


def test_what_is_planted_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    done = within(capsys, "discover", planted(tmp_path / "a.log"))
    told = lines_of(done)
    assert list(told) == ["0xA0", "0xA2", "0xA4", "0xA6", "0xA7", "0xA1"]
    assert "a counter: +1 each time" in told["0xA0"]
    assert "always 7" in told["0xA1"]
    assert told["0xA2"].startswith("u16le")
    assert "goes with present_position (r = 1.000" in told["0xA2"]
    assert told["0xA4"].startswith("u16be")
    assert "counts with the time" in told["0xA4"]
    assert "bits 0, 3 flip together" in told["0xA6"]
    assert "goes with" not in told["0xA7"]
    assert "a counter" not in told["0xA7"]


def test_the_table_that_comes_of_it_is_taken_and_names_the_bytes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = planted(tmp_path / "a.log")
    done = within(capsys, "discover", log, "--format", "toml", "--model-name", "my-zap")
    table = tmp_path / "my_zap.toml"
    table.write_text(done.out, encoding="utf-8")
    entries = {r["name"]: r for r in tomllib.loads(done.out)["register"]}
    assert entries["unknown_a2"]["type"] == "u16le"
    assert "unknown_a1" not in entries  # it never moved
    assert "present_position" in entries
    records: list[Any] = list(sniffer.decode(log, registers=[table], models={None: "my-zap"}))
    names = {row.register for row in records if row.type == "sample"}
    assert {"present_position", "unknown_a2", "unknown_a4"} <= names
    again = within(capsys, "discover", log, "--registers", table, "--model", "my-zap")
    assert list(lines_of(again)) == ["0xA1"]


def test_servos_of_which_the_same_is_said_are_told_together(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = planted(tmp_path / "a.log", 1, servos=(1, 2))
    done = within(capsys, "discover", log)
    assert "bytes of servos 1 and 2 that mightyzap-l12 does not name" in done.out


def test_noise_goes_with_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    chance = random.Random(1)
    lines, now = [], 1_000_000
    for _ in range(400):
        for address, size in ((0x8C, 2), (FREE, 32)):
            hidden = bytes(chance.randrange(256) for _ in range(size))
            hidden = hidden if size > 2 else chance.randrange(4096).to_bytes(2, "little")
            for data in (packet(1, 0xF2, bytes([address, size])), packet(1, 0, hidden)):
                now += 5000
                lines.append(f"({now / 1e6:.6f}) bus0 #{data.hex()}\n")
    log = tmp_path / "a.log"
    log.write_text("".join(lines), encoding="ascii")
    told = lines_of(within(capsys, "discover", log))
    assert len(told) == 32
    for line in told.values():
        assert line.startswith("u8")
        assert "goes with" not in line
        assert "counter" not in line
        assert "together" not in line


def test_what_was_heard_once_of_many_readings_counts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines: list[str] = []
    for k in range(2 * KEPT):
        once = k == KEPT + 1  # of so many readings only those with an even number are kept
        word = 5000 if once else 1000 + round(300 * np.sin(k / 50))
        said = word.to_bytes(2, "little") + bytes([0x80 if once else k // 9 % 2, 0])
        said += (0 if once else 200 + 3 * k).to_bytes(2, "big")
        for data in (packet(1, 0xF2, bytes([FREE, len(said)])), packet(1, 0, said)):
            lines.append(f"({1 + len(lines) * 3e-3:.6f}) bus0 #{data.hex()}\n")
    log = tmp_path / "a.log"
    log.write_text("".join(lines), encoding="ascii")
    told = lines_of(within(capsys, "discover", log))
    assert "700..5000" in told["0xA0"]
    assert "one of 0, 1, 128" in told["0xA2"]
    assert "bits that change: 0, 7" in told["0xA2"]
    assert "0..24773" in told["0xA4"]
    assert "counts with the time" not in told["0xA4"]


def test_a_protocol_without_addresses_is_told_in_a_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    done = within(capsys, "discover", CAPTURES / "wck_clean.log")
    assert done.status == 2
    assert done.complaint == "frames of wck carry no addresses here: there is nothing to discover"


def test_a_name_that_no_model_can_have_is_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    log = CAPTURES / "mightyzap_clean.log"
    done = within(capsys, "discover", log, "--format", "toml", "--model-name", 'a"b')
    assert done.status == 2
    assert done.complaint
    assert not done.out


@given(sizes=st.lists(st.integers(0, 3000), max_size=8), data=st.data())
def test_a_series_is_thinned_the_same_whatever_the_cut(
    sizes: list[int], data: st.DataObject
) -> None:
    whole, cut = Thinned(), Thinned()
    n = sum(sizes)
    if n:
        whole.add(np.arange(n), -np.arange(n))
    at = 0
    for size in sizes:
        part = np.arange(at, at + size)
        cut.add(part, -part)
        at += size
    assert cut.count == n
    if n:
        kept = whole.columns()[0]
        assert kept.tolist() == cut.columns()[0].tolist()
        assert len(kept) == n if n <= KEPT else KEPT // 2 <= len(kept) <= KEPT
        assert kept[0] == 0


def counting(path: Path, first: int, order: Literal["little", "big"]) -> Path:
    """Write a log of a servo: a number of two bytes that goes up by one, and a byte of noise."""
    chance, lines, now = random.Random(7), [], 1_000_000
    for k in range(700):
        told = (first + k).to_bytes(2, order, signed=first < 0) + bytes([chance.randrange(256)])
        for data in (packet(1, 0xF2, bytes([FREE, len(told)])), packet(1, 0, told)):
            now += 3000
            lines.append(f"({now / 1e6:.6f}) bus0 #{data.hex()}\n")
    path.write_text("".join(lines), encoding="ascii")
    return path


@pytest.mark.parametrize(
    ("first", "order", "kind"),
    [(0, "little", "u16le"), (0, "big", "u16be"), (-350, "little", "i16le")],
)
def test_a_counter_of_two_bytes_is_one_number_though_its_high_byte_hardly_moves(
    first: int,
    order: Literal["little", "big"],
    kind: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    told = lines_of(within(capsys, "discover", counting(tmp_path / "a.log", first, order)))
    assert told["0xA0"].startswith(kind)
    assert f"{first}..{first + 699}" in told["0xA0"]
    assert "a counter: +1 each time" in told["0xA0"]
    assert told["0xA2"].startswith("u8")


def test_bytes_that_move_for_themselves_are_no_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A byte that counts, beside one that moves twice, not where the first one wraps."""
    lines, now = [], 1_000_000
    for k in range(700):
        for data in (
            packet(1, 0xF2, bytes([FREE, 2])),
            packet(1, 0, bytes([k % 256, (k + 90) // 256])),
        ):
            now += 3000
            lines.append(f"({now / 1e6:.6f}) bus0 #{data.hex()}\n")
    (tmp_path / "a.log").write_text("".join(lines), encoding="ascii")
    told = lines_of(within(capsys, "discover", tmp_path / "a.log"))
    assert told["0xA0"].startswith("u8")
    assert told["0xA1"].startswith("u8")
