"""Inputs that are none, wrong, or break off: one line that helps, and nothing is lost."""

from __future__ import annotations

import random
import sys
from pathlib import Path

import pytest

from sniffer.ground.devices import is_port
from sniffer.protocols import PROTOCOLS
from tests.commands import (
    conserved,
    forbidden,
    log,
    records,
    sniffer,
    talk,
    within,
)
from tests.terminals import Terminal

Capsys = pytest.CaptureFixture[str]
NOISE = random.Random(5).randbytes(5000)


def test_an_empty_file_is_a_mistake(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "empty"
    path.write_bytes(b"")
    ran = within(capsys, "decode", path)
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint == f"{path} is empty: nothing to decode"


def test_an_empty_standard_input_is_a_mistake() -> None:
    ran = sniffer("decode", "-", data=b"")
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint == "standard input is empty: nothing to decode"


def test_of_noise_it_is_told_that_no_protocol_explains_any(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "noise.bin"
    path.write_bytes(NOISE)
    ran = within(capsys, "decode", path)
    assert (ran.status, ran.out) == (2, "")
    assert "(none explains any of them)" in ran.complaint
    assert "--protocol" in ran.complaint


def test_of_several_files_of_noise_all_are_named(tmp_path: Path, capsys: Capsys) -> None:
    paths = [tmp_path / name for name in ("a.bin", "b.bin")]
    for path in paths:
        path.write_bytes(b"\x00" * 300)
    ran = within(capsys, "decode", *paths)
    told = f"{paths[0]} {paths[1]}: cannot tell the protocol of these 600 bytes"
    assert (ran.status, ran.complaint[: len(told)]) == (2, told)


def test_standard_input_is_judged_once_and_noise_on_it_is_not_called_empty() -> None:
    ran = sniffer("diagnose", "-", data=NOISE)
    assert (ran.status, ran.out) == (2, "")
    assert "(none explains any of them)" in ran.complaint


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_noise_of_a_named_protocol_is_all_gaps(
    protocol: str, tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "noise.bin"
    path.write_bytes(NOISE)
    ran = within(capsys, "decode", path, "--protocol", protocol, "--format", "jsonl")
    assert (ran.status, ran.err) == (0, "")
    assert conserved(ran.out) == NOISE
    summary = records(ran.out)[-1]
    assert summary["bytes_in_frames"] < 0.01 * len(NOISE)


def test_the_wrong_protocol_is_told_with_the_right_one_and_is_all_gaps(
    good: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "decode", good, "--protocol", "rs30x", "--format", "jsonl")
    assert ran.status == 2
    assert ran.complaint.startswith("bus0: no frame of rs30x is in there")
    assert "mightyzap (sure" in ran.complaint
    assert conserved(ran.out) == good.read_bytes()
    assert records(ran.out)[-1]["frames"] == 0


def test_lss_lines_as_a_terminal_shows_them_lack_their_ends(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "copied.txt"
    path.write_text("#1QD\n*1QD132\n#1QV\n*1QV11850\n")
    ran = within(capsys, "decode", path)
    assert ran.status != 0
    assert r"put them back: `tr '\n' '\r' < FILE | sniffer decode -`" in ran.complaint


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("Dear diary,\nnothing was on the bus today.\n", "this is text, but no dump"),
        ("FF FF FF 00 02 F1 0\nFF FF\n", "line 1, column 19: '0' has an odd number of hex digits"),
        # Serial.print(b, HEX) of an Arduino leaves zeros out
        ("FF FF FF 1 4 F2 8C 2 7A\n", r"with two (`sed -E 's/\b[0-9A-Fa-f]\b/0&/g'` does"),
        ("FFFFFF0002F10\n", "'FFFFFF0002F10' has an odd number of hex digits"),
        ("\n\n\n", "only blank lines"),
    ],
)
def test_text_that_is_no_dump_says_so(
    content: str, told: str, tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "text.txt"
    path.write_text(content)
    ran = within(capsys, "decode", path)
    assert (ran.status, ran.out) == (2, "")
    assert str(path) in ran.complaint
    assert told in ran.complaint


def test_a_directory_is_no_input(tmp_path: Path, capsys: Capsys) -> None:
    ran = within(capsys, "decode", tmp_path)
    assert ran.status == 2
    assert ran.complaint == f"{tmp_path} is a directory: give the file in it"


@pytest.mark.skipif(sys.platform != "linux", reason="known by its device number on Linux")
def test_a_port_is_no_input_and_is_not_opened(tmp_path: Path, capsys: Capsys) -> None:
    link = tmp_path / "port"
    with Terminal() as line:
        link.symlink_to(line.path)
        for name in (line.path, link):
            ran = within(capsys, "decode", name)
            assert ran.status == 2
            assert ran.complaint == f"{name} is a port: `sniffer record {name}` listens to it"


@pytest.mark.skipif(sys.platform == "win32", reason="has no character devices")
@pytest.mark.parametrize(
    ("name", "is_one"),
    [
        ("/dev/ttyUSB7", True),
        ("/dev/cu.usbserial", True),
        ("/dev/rfcomm0", True),
        ("/dev/null", False),
    ],
)
def test_a_serial_port_is_known_by_its_name(name: str, is_one: bool) -> None:
    device, regular = Path("/dev/null").stat(), Path(__file__).stat()
    assert is_port(Path(name), device) == is_one
    assert not is_port(Path(name), regular)


def test_a_missing_file_is_named(tmp_path: Path, capsys: Capsys) -> None:
    ran = within(capsys, "decode", tmp_path / "nix")
    assert ran.status == 2
    assert ran.complaint == f"{tmp_path / 'nix'}: there is no such file"


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("https://robots.example/run.log", "is no file of this machine: fetch it first"),
        (
            "socket://10.0.0.7:4000",
            "is a port: `sniffer record socket://10.0.0.7:4000` listens to it",
        ),
    ],
)
def test_an_address_is_told_to_be_none_of_a_file(address: str, told: str, capsys: Capsys) -> None:
    assert within(capsys, "decode", address).complaint == f"{address} {told}"


def test_a_name_of_control_characters_cannot_steer_the_terminal(
    tmp_path: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "decode", tmp_path / "a\x1b[31m\nb")
    assert ran.status == 2
    assert ran.complaint.isprintable()


def test_a_file_without_permission_is_a_mistake(good: Path) -> None:
    good.chmod(0)
    ran = forbidden(good, "decode", good)
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint == f"{good}: no permission to read it"


def test_a_log_that_breaks_off_is_decoded_up_to_there(tmp_path: Path, capsys: Capsys) -> None:
    lines = log(talk(300)).splitlines(keepends=True)
    path, out = tmp_path / "half.log", tmp_path / "half.jsonl"
    path.write_text("".join([*lines[:999], "\x00\x01garbage#zz\n", *lines[1000:]]))
    ran = within(capsys, "decode", path, "--format", "jsonl", "-o", out)
    assert ran.status == 3
    assert f"{path}, line 1000: " in ran.complaint
    before = b"".join(bytes.fromhex(line.split("#")[1]) for line in lines[:999])
    assert conserved(ran.out) == before
    assert out.read_text() == ran.out


def test_a_dump_that_breaks_off_is_decoded_up_to_there(tmp_path: Path, capsys: Capsys) -> None:
    data = talk(120)
    lines = [data[at : at + 8].hex(" ") + "\n" for at in range(0, len(data), 8)]
    path = tmp_path / "half.hex"
    path.write_text("".join([*lines[:999], "FF FF oops\n", *lines[1000:]]))
    ran = within(capsys, "decode", path, "--format", "jsonl")
    assert ran.status == 3
    assert f"{path}, line 1000, column 7: 'oops' is not hex" in ran.complaint
    assert conserved(ran.out) == data[: 8 * 999] + b"\xff\xff"


def test_two_buses_are_decoded_even_if_one_says_nothing_sensible(
    tmp_path: Path, capsys: Capsys
) -> None:
    path, out = tmp_path / "two.log", tmp_path / "two.jsonl"
    path.write_text("(1699999999.5) elbow #0102030405\n" + log(talk(20)))
    ran = within(capsys, "decode", path, "-o", out, "--quiet")
    assert ran.status == 2
    assert ran.complaint.startswith("cannot tell the protocol of these 5 bytes")
    assert conserved(out.read_text()) == talk(20)


# --- options -----------------------------------------------------------------------------------
