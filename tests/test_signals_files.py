"""Logic captures in all forms that are read: the same bytes and times, from a file or a pipe."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest

from sniffer.ground.model import NS, Direction, InputError
from sniffer.ground.wiring import Wiring
from sniffer.sources import open_source
from sniffer.sources.digits import PAD, numbers
from tests.commands import sniffer, within
from tests.waves import (
    Wire,
    dsl,
    edges_of,
    saleae_0,
    saleae_1,
    saleae_csv,
    sampled,
    spoken,
    sr,
    vcd,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from sniffer.ground.model import U8, Chunk

ASK: Final = bytes.fromhex("FFFFFF0104F28C027A")
ANSWER: Final = bytes.fromhex("FFFFFF010400FF07F4")
RATE: Final = 1_000_000
BAUD: Final = 57_600


def controller_and_servo(times: int = 6, *, off: float = 0.018) -> tuple[Wire, Wire, Wire]:
    """Return a bus, and its two wires apart; the servo's clock is fast."""
    bus, tx, rx = Wire(0.001), Wire(), Wire()
    for _ in range(times):
        tx.now = bus.now
        bus.say(ASK, BAUD, after=0.002)
        tx.say(ASK, BAUD, after=0.002)
        rx.now = bus.now
        bus.say(ANSWER, BAUD * (1 + off), after=0.0005)
        rx.say(ANSWER, BAUD * (1 + off), after=0.0005)
    bus.now += 0.001
    return bus, tx, rx


BUS, TX, RX = controller_and_servo()
LEVELS: Final[dict[str, U8]] = {
    "TX": sampled(TX, RATE, BUS.now),
    "RX": sampled(RX, RATE, BUS.now),
}


def said(
    source: Path | bytes, wiring: Wiring | None = None, input_format: str = "auto"
) -> dict[str, bytes]:
    """Return the bytes of each bus."""
    out: dict[str, bytes] = {}
    with open_source(source, input_format, wiring=wiring) as opened:
        for chunk in (chunk for group in opened for chunk in group):
            out[chunk.bus] = out.get(chunk.bus, b"") + chunk.data
    return out


def chunks_of(source: Path | bytes, wiring: Wiring | None = None) -> list[Chunk]:
    with open_source(source, wiring=wiring) as opened:
        return [chunk for group in opened for chunk in group]


def microseconds(table: bytes) -> bytes:
    """Return a table of levels with another unit of time."""
    rows = [row.split(",", 1) for row in table.decode().splitlines()[1:]]
    lines = [f"{float(t) * 1e6:.3f},{levels}\n" for t, levels in rows]
    return "".join(["Time (us),TX,RX\n", *lines]).encode()


BOTH: Final = {"TX": ASK * 6, "RX": ANSWER * 6}

FORMS: Final[Mapping[str, Callable[[Path], bytes]]] = {
    "sr": lambda path: sr(path, LEVELS, RATE, chunk=1777).read_bytes(),
    "sr of two bytes": lambda path: sr(path, LEVELS, RATE, unit=2).read_bytes(),
    "sr of three bytes": lambda path: sr(path, LEVELS, RATE, unit=3).read_bytes(),
    "dsl": lambda path: dsl(path, LEVELS, RATE).read_bytes(),
    "vcd": lambda path: vcd(LEVELS, RATE),
    "vcd of us": lambda path: vcd(LEVELS, RATE, scale="1 us"),
    "csv": lambda path: saleae_csv(LEVELS, RATE),
    "csv with tabs": lambda path: saleae_csv(LEVELS, RATE).replace(b",", b"\t"),
    "csv in microseconds": lambda path: microseconds(saleae_csv(LEVELS, RATE)),
    "csv of a spreadsheet": lambda path: saleae_csv(LEVELS, RATE).translate(
        bytes.maketrans(b",.", b";,")
    ),
}


@pytest.mark.parametrize(
    ("levels", "says"),
    [
        (LEVELS["TX"] ^ np.uint8(1), "B says what A says, upside down: name one of them"),
        (np.roll(LEVELS["TX"], 1), "B says what A says: name one of them"),  # behind a buffer
        (LEVELS["RX"], ""),
    ],
)
def test_a_wire_that_is_there_twice_is_told(levels: U8, says: str, tmp_path: Path) -> None:
    path = sr(tmp_path / "x.sr", {"A": LEVELS["TX"], "B": levels}, RATE)
    with open_source(path) as opened:
        assert sum(len(chunk.data) for group in opened for chunk in group) > 0
        assert [note for note in opened.notes if " says what " in note] == [says] * bool(says)


@pytest.mark.parametrize("form", FORMS)
def test_both_wires_are_read_with_the_times_of_their_edges(form: str, tmp_path: Path) -> None:
    path = tmp_path / "wave"
    data = FORMS[form](path)
    path.write_bytes(data)
    with open_source(path) as opened:
        chunks = [chunk for group in opened for chunk in group]
        assert opened.facts()["baud.TX"] == opened.facts()["baud.RX"] == str(BAUD)
    told = {bus: [c for c in chunks if c.bus == bus] for bus in BOTH}
    for bus, wire in (("TX", TX), ("RX", RX)):
        assert b"".join(c.data for c in told[bus]) == BOTH[bus]
        begin_ns = (told[bus][0].t_ns or 0) - 10 * NS // BAUD
        assert 0 <= begin_ns - wire.starts[0] * NS <= NS / RATE + 1
    assert said(data) == BOTH


def _dump(*changes: str) -> bytes:
    """Return a dump of one wire with what is in the parts, and the changes of ``TX``."""
    text = vcd({"TX": LEVELS["TX"]}, RATE).decode()
    for old, new in zip(changes[::2], changes[1::2], strict=True):
        assert old in text, old
        text = text.replace(old, new)
    return text.encode()


DIALECTS: Final = {
    "no first value": ("#0\n$dumpvars\nbxxxxxxxx zz\n1!\n$end\n", ""),
    "a first value at once": ("$dumpvars\nbxxxxxxxx zz\n1!\n$end", "1!"),
    "first values long after zero": ("#0\n$dumpvars", "#99\n$dumpvars"),
    "first value unknown": ("$dumpvars\nbxxxxxxxx zz\n1!", "$dumpvars\nbxxxxxxxx zz\nx!"),
    "high is floating": ("\n1!", "\nz!"),
    "written like a bus": ("\n1!", "\nb1 !", "\n0!", "\nb0 !"),
    "all of a time on one line": ("\n1!", " 1!", "\n0!", "  0!"),
    "a name for the short name": (
        " ! ",
        " uart_tx_line ",
        "1!",
        "1uart_tx_line",
        "0!",
        "0uart_tx_line",
    ),
    "an escaped name": ("! TX", "! \\TX "),
    "a time cut off at the end": ("b1010 zz\n", ""),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_dumps_of_other_writers_hold_the_same_bytes(dialect: str) -> None:
    dump = _dump(*DIALECTS[dialect])
    if "cut off" in dialect:
        dump += dump[dump.rindex(b"#") :][:4]  # it goes back, for digits are missing
    assert said(dump) == {"TX": BOTH["TX"]}


def test_numbers_are_those_of_their_digits_and_other_signs_are_told() -> None:
    told = [
        "7",
        "00000000",
        "123456789",
        "999999999999999999",
        "1234567812345678",
        "12",
        "x1",
        "1:",
    ]
    text = (" " * PAD + "#".join(told) + " ").encode()
    size = np.array([*map(len, told)])
    found, wrong = numbers(np.frombuffer(text, np.uint8), PAD + np.cumsum(size + 1) - 1, size)
    assert found[:6].tolist() == [*map(int, told[:6])]
    assert wrong.tolist() == [False] * 6 + [True] * 2


@pytest.mark.parametrize("version", [0, 1])
def test_raw_data_of_saleae_counts_from_its_trigger(version: int, tmp_path: Path) -> None:
    levels = LEVELS["TX"]
    path = tmp_path / "digital_0.bin"
    half = len(levels) // 2
    path.write_bytes(
        saleae_0(levels, RATE, trigger=0.5)
        if version == 0
        else saleae_1([(levels[:half], 0), (levels[half:], half)], RATE, trigger=0.5)
    )
    assert said(path) == {"digital_0": ASK * 6}
    first = chunks_of(path)[0]
    assert first.t_ns is not None
    assert 0 <= first.t_ns - 10 * NS // BAUD + NS // 2 - TX.starts[0] * NS <= NS / RATE + 1


def test_the_layout_of_saleae_is_that_of_its_page_byte_for_byte() -> None:
    # support.saleae.com: identifier, version, type; then for version 0 initial_state, begin_time,
    # end_time, num_transitions, and the transitions as doubles
    bit = 1 / 9600
    times = [nth * bit for nth in (1, 2, 3, 4, 5, 6, 7, 8, 9, 10)]  # 55: every bit is another one
    data = b"<SALEAE>" + bytes.fromhex("00000000 00000000 01000000")
    data += struct.pack("<2d", 0.0, 20 * bit) + (10).to_bytes(8, "little")
    data += struct.pack("<10d", *times)
    assert said(data, Wiring(channels={"bus0": ""}, baud=9600)) == {"bus0": b"\x55"}


def test_a_level_that_changed_in_a_gap_is_an_edge() -> None:
    wire = spoken(ASK * 3, BAUD, every=len(ASK))
    levels = sampled(wire, RATE)
    fall = int(edges_of(levels)[0])  # nobody looks when the first start bit begins
    parts = [(levels[: fall - 3], 0), (levels[fall + 3 :], fall + 3)]
    assert said(saleae_1(parts, RATE)) == {"bus0": ASK * 3}


def test_clocks_and_pwm_are_left_out_and_it_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    count = len(LEVELS["TX"])
    at = np.arange(count)
    rng = np.random.default_rng(5)
    noise = np.cumsum(rng.random(count) < 0.02) & 1
    others = {"CLK": at // 9 & 1, "PWM": at % 2000 < 700, "NOISE": noise, "IDLE": at >= 0}
    path = sr(
        tmp_path / "wave.sr", LEVELS | {n: v.astype(np.uint8) for n, v in others.items()}, RATE
    )
    ran = within(capsys, "decode", path, "--summary", "--format", "jsonl")
    assert ran.status == 0
    assert json.loads(ran.out)["buses"].keys() == {"TX", "RX"}
    for name in ("CLK", "PWM", "NOISE"):
        assert f"{name} is left out" in ran.err
    assert "IDLE" not in ran.err
    assert "has no date" in ran.err


def test_two_wires_of_one_bus_come_in_order_with_their_directions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = sr(tmp_path / "wave.sr", LEVELS, RATE, chunk=1000)
    chunks = chunks_of(path, Wiring(channels={"TX": "arm", "RX": "arm"}))
    assert {chunk.bus for chunk in chunks} == {"arm"}
    assert b"".join(chunk.data for chunk in chunks) == (ASK + ANSWER) * 6
    for way, wire in ((Direction.TX, "TX"), (Direction.RX, "RX")):
        assert b"".join(c.data for c in chunks if c.direction == way) == BOTH[wire]
    of_one = ("--channel", "TX=arm", "--channel", "RX=arm", "--summary", "--format", "jsonl")
    ran = within(capsys, "decode", path, *of_one)
    summary = json.loads(ran.out)
    assert summary["outcomes"] == {"ok": 6}
    assert summary["codes"].keys().isdisjoint({"direction-mismatch"})


@pytest.mark.parametrize("off", [-0.018, 0.0, 0.018])
def test_starts_and_response_times_are_true_within_what_is_stated(
    off: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bus, _, _ = controller_and_servo(off=off)
    path = sr(tmp_path / "wave.sr", {"BUS": sampled(bus, RATE)}, RATE)
    ran = within(capsys, "decode", path, "--format", "jsonl")
    lines = [json.loads(line) for line in ran.out.splitlines()]
    found = [line for line in lines if line["type"] == "frame"]
    assert bytes.fromhex("".join(line["hex"] for line in found)) == (ASK + ANSWER) * 6
    starts = bus.starts[::9]
    for line, start in zip(found, starts, strict=True):
        assert abs(line["t_start_ns"] - start * NS) <= NS / RATE + 1
        assert line["uncertainty_ns"] >= NS / RATE
    exchanges = [line for line in lines if line["type"] == "transaction"]
    assert len(exchanges) == 6
    for line in exchanges:
        assert abs(line["response_time_ns"] - 500_000) <= line["uncertainty_ns"]


def test_the_same_frames_as_of_the_bytes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = sr(tmp_path / "wave.sr", {"BUS": sampled(BUS, RATE)}, RATE)
    plain = tmp_path / "bus.bin"
    plain.write_bytes((ASK + ANSWER) * 6)

    def frames(*arguments: str | Path) -> list[tuple[str, str, str]]:
        ran = within(capsys, "decode", *arguments, "--format", "jsonl")
        lines = map(json.loads, ran.out.splitlines())
        return [(r["hex"], r["kind"], r["op"]) for r in lines if r["type"] == "frame"]

    assert frames(path) == frames(plain)
    converted = tmp_path / "whole.bin"
    assert within(capsys, "convert", path, converted).status == 0
    assert converted.read_bytes() == plain.read_bytes()
    recording = tmp_path / "whole.mcap"
    assert within(capsys, "convert", path, recording).status == 0
    assert frames(recording) == frames(plain)
    piped = sniffer("decode", "-", "--format", "jsonl", data=path.read_bytes())
    assert piped.out == within(capsys, "decode", path, "--format", "jsonl").out


def test_lines_that_idle_low_are_found_and_may_be_said(tmp_path: Path) -> None:
    path = sr(tmp_path / "wave.sr", {"D0": sampled(BUS, RATE, invert=True)}, RATE)
    assert said(path) == said(path, Wiring(invert=True)) == {"D0": (ASK + ANSWER) * 6}
    with open_source(path) as opened:
        list(opened)
        assert any("inverted" in note for note in opened.notes)


def test_too_few_samples_of_a_bit_are_refused_with_the_rate_that_is_needed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = sr(tmp_path / "slow.sr", {"D0": sampled(BUS, 150_000)}, 150_000)
    ran = within(capsys, "decode", path)
    assert ran.status == 2
    assert "capture it at 173 kHz or more" in ran.complaint
    slower = sr(tmp_path / "slower.sr", {"D0": sampled(BUS, 80_000)}, 80_000)
    ran = within(capsys, "decode", slower)
    assert ran.status == 2
    assert "capture it at" in ran.complaint


def test_mistakes_about_channels_are_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flat = np.ones(5000, np.uint8)
    clock = (np.arange(5000) // 9 & 1).astype(np.uint8)
    path = sr(tmp_path / "wave.sr", LEVELS | {"IDLE": flat}, RATE)
    quiet = sr(tmp_path / "quiet.sr", {"D0": flat}, RATE)
    ticking = sr(tmp_path / "clock.sr", {"D0": clock}, RATE)
    for arguments, says in (
        ((path, "--channel", "TY"), "there is no channel 'TY', but TX, RX and IDLE"),
        ((path, "--channel", "=x"), "write NAME, or NAME=BUS"),
        ((path, "--channel", "TX", "--channel", "TX=a"), "named twice"),
        ((path, "--channel", "IDLE"), "changes its level"),
        ((quiet,), "no channel (D0) changes its level"),
        ((ticking,), "no channel has serial bytes"),
    ):
        ran = within(capsys, "decode", *arguments)
        assert ran.status == 2
        assert says in ran.err
        assert "Traceback" not in ran.err


def test_a_stated_rate_reads_what_is_too_little_to_tell_one(tmp_path: Path) -> None:
    path = sr(tmp_path / "wave.sr", {"D0": sampled(spoken(b"\x0f", 9600), 96_000)}, 96_000)
    with pytest.raises(InputError, match="too few to tell a rate"):
        said(path)
    assert said(path, Wiring(channels={"D0": "arm"}, baud=9600)) == {"arm": b"\x0f"}


def test_a_sal_names_the_export_that_is_read() -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("meta.json", "{}")
    with pytest.raises(InputError, match="File > Export raw data"):
        open_source(out.getvalue())


def test_x_in_a_table_is_no_data_and_dates_are_unix_times() -> None:
    table = saleae_csv(LEVELS, RATE).split(b"\n")
    for nth in range(2, len(table) - 1):  # RX is without data where TX changes
        at, tx, rx = table[nth].split(b",")
        if rx == table[nth - 1].split(b",")[2]:
            table[nth] = b",".join((at, tx, b"X" if rx == b"1" else rx))
    assert said(b"\n".join(table)) == BOTH
    dated = [table[0]]
    for line in table[1:-1]:
        at, _, levels = line.partition(b",")
        dated.append(b"2026-11-22T13:00:%012.9f+01:00,%s" % (float(at), levels))
    data = b"\n".join([*dated, b""])
    assert said(data) == BOTH
    first = next(c for c in chunks_of(data) if c.bus == "TX")
    noon_ns = 1_795_348_800 * NS
    assert first.t_ns is not None
    assert abs(first.t_ns - noon_ns - (TX.starts[0] + 10 / BAUD) * NS) <= 2 * NS / RATE
    with open_source(data) as opened:
        list(opened)
        assert not any("no date" in note for note in opened.notes)


def test_changes_without_times_are_refused() -> None:
    rows = b"".join(b"%d\n" % (nth & 1) for nth in range(200))
    with pytest.raises(InputError, match="export it with times"):
        open_source(b"; CSV generated by libsigrok 0.5.2\n; Samplerate: 1 MHz\nlogic\n" + rows)
