"""Logic captures that are cut off, damaged, or claim more than they have."""

from __future__ import annotations

import contextlib
import struct
import zipfile
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.model import DamagedInputError, InputError, SnifferError
from tests.commands import within
from tests.test_signals_files import FORMS, LEVELS, RATE, chunks_of, said
from tests.waves import dsl, saleae_0, saleae_1, saleae_csv, sr, vcd

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("form", [*FORMS, "saleae-bin"])
def test_what_is_cut_off_is_read_so_far_and_told(
    form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "wave"
    whole = saleae_0(LEVELS["TX"], RATE) if form == "saleae-bin" else FORMS[form](path)
    for size in (len(whole) - 9, len(whole) // 2, 60, 31):
        path.write_bytes(whole[:size])
        ran = within(capsys, "decode", path, "--summary")
        assert ran.status in ((0, 2) if form.startswith(("csv", "vcd")) else (0, 2, 3))
        assert "Traceback" not in ran.err
        if size > 60 and form.startswith(("sr", "dsl", "saleae")):
            assert "cut off" in ran.err


@given(st.data())
def test_no_capture_raises_anything_but_our_own_errors(data: st.DataObject) -> None:
    form = data.draw(st.sampled_from(["vcd", "csv", "saleae-bin"]))
    whole = {
        "vcd": vcd(LEVELS, RATE)[:3000],
        "csv": saleae_csv(LEVELS, RATE)[:3000],
        "saleae-bin": saleae_1([(LEVELS["TX"], 0)], RATE),
    }[form]
    broken = bytearray(whole)
    for at in data.draw(st.lists(st.integers(0, min(len(whole), 400) - 1), max_size=4)):
        broken[at : at + 1] = data.draw(st.binary(max_size=9))
    with contextlib.suppress(SnifferError):
        said(bytes(broken))


@pytest.mark.parametrize("name", ["\x01\0\0\0\0\0\x80", "äöüäöüäö", "~" * 8], ids=ascii)
def test_a_wire_of_a_dump_may_have_any_name(name: str) -> None:
    dump = vcd(LEVELS, RATE)
    for code in ("latin-1", "utf-8"):
        broken = dump.replace(b"wire 1 ! TX", b"wire 1 " + name.encode(code) + b" TX")
        assert broken != dump
        with contextlib.suppress(SnifferError):
            said(broken)


@pytest.mark.parametrize("seed", range(12))
def test_a_damaged_archive_raises_nothing_but_our_own_errors(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    name = ("wave.sr", "wave.dsl")[seed & 1]
    path = (sr if seed & 1 == 0 else dsl)(tmp_path / name, LEVELS, RATE)
    broken = bytearray(path.read_bytes())
    for at in rng.integers(0, len(broken), 6):
        broken[at] = rng.integers(0, 256)
    path.write_bytes(bytes(broken))
    with contextlib.suppress(SnifferError):
        said(path)


def test_a_bomb_ends_in_one_line_before_it_is_unpacked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "bomb.sr"
    packed = 3 << 20
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("version", "2")
        archive.writestr(
            "metadata",
            "[device 1]\ncapturefile=logic-1\nsamplerate=1 MHz\nprobe1=D0\nunitsize=1\n",
        )
        archive.writestr("logic-1-1", bytes(packed))
    data = bytearray(path.read_bytes())
    # both headers of the entry claim that it unpacks to 4 GB, or not quite
    for signature, at in ((b"PK\x03\x04", 22), (b"PK\x01\x02", 24)):
        place = data.rindex(signature) + at
        data[place : place + 4] = struct.pack("<I", 0xFFFFFFF0)
    path.write_bytes(bytes(data))
    ran = within(capsys, "decode", path)
    assert ran.status == 2
    assert "nothing changes in it" in ran.complaint


@pytest.mark.parametrize(
    "claimed",
    [
        b"<SALEAE>" + struct.pack("<iiIddQ", 0, 0, 1, 0.0, 1.0, 1 << 60),
        b"<SALEAE>" + struct.pack("<iiQ", 1, 0, 1 << 60),
        b"<SALEAE>" + struct.pack("<iiIddQ", 0, 0, 1, 0.0, float("nan"), 1),
        b"<SALEAE>" + struct.pack("<iiIddQ", 0, 0, 7, 0.0, 1.0, 1),
    ],
)
def test_what_claims_more_than_it_has_is_damaged(claimed: bytes) -> None:
    with pytest.raises((DamagedInputError, InputError)):
        said(claimed + struct.pack("<d", 0.5))


def test_times_beyond_all_bounds_are_damage() -> None:
    head = b"$timescale 1 s $end\n$var wire 1 ! D0 $end\n$enddefinitions $end\n"
    with pytest.raises(DamagedInputError, match="beyond all bounds"):
        said(head + b"#0 1!\n#999999999999 0!\n")
    with pytest.raises(SnifferError, match="is no time, or before the last"):
        said(head + b"#5 1!\n#3 0!\n")
    with pytest.raises(SnifferError, match="is no time"):
        said(head + b"#" + b"9" * 30 + b" 1!\n")


@pytest.mark.parametrize(
    ("table", "why"),
    [
        (b"; libsigrok 0.5.2\n; Samplerate: 1 MHz\ntime,D0\n-what,1\n2,0\n", "not say the unit"),
        (b"; libsigrok 0.5.2\n; Samplerate: 1 MHz\ntime,D0\n1e999,1\n2,0\n", "not say the unit"),
        (
            b"; libsigrok 0.5.2\n; Samplerate: 1 MHz\nmicroseconds,D0\n" + b"5,1\n5,0\n" * 20,
            "fit no rate",
        ),
        (
            b"; libsigrok 0.5.2\n; Samplerate: 1 MHz\nseconds,D0\n"
            + b"".join(b"%d,%d\n" % (9 * n, n % 2) for n in range(400)),
            "fit no rate",
        ),
        (b"Time [s],RX\n2026-13-45T99:99:99,1\n2026-13-45T99:99:99,0\n", "there is no date"),
        (b"Time [s],RX\n9999-01-01T00:00:00,1\n9999-01-01T00:00:01,0\n", "there is no date"),
        (b"Time [s],RX\n2026-01-01T00:00:00,1\n2026-02-30T00:00:00,0\n", "a date is none"),
        (b"Time [s],RX\n2026-01-01T00:00:00,1\n9026-01-01T00:00:00,0\n", "far from the first"),
    ],
)
def test_a_time_of_a_table_that_is_none_ends_it_in_one_line(table: bytes, why: str) -> None:
    with pytest.raises(SnifferError, match=why):
        said(table, input_format="logic-csv")


def test_of_many_wires_those_that_change_are_read_and_the_others_cost_nothing() -> None:
    few = vcd(LEVELS, RATE)
    idle = b"".join(b"$var wire 1 i%d idle%d $end\n" % (n, n) for n in range(5000))
    blinks = b"".join(b"0i%d\n1i%d\n" % (n, n) for n in range(3))
    many = few.replace(b"$enddefinitions", idle + b"$enddefinitions")
    many = many.replace(b"$enddefinitions $end\n", b"$enddefinitions $end\n" + blinks)
    assert many != few
    assert said(many) == said(few)
    first, second = chunks_of(many), chunks_of(few)
    assert [(c.t_ns, c.data) for c in first] == [(c.t_ns, c.data) for c in second]
