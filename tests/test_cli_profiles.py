"""Profiles: what a file says of a bus stands where the command line says nothing."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Final

import pytest

from sniffer.cli.profiles import KEYS, files
from tests.commands import talk, within
from tests.recorder import facts
from tests.streams.mightyzap import packet

Capsys = pytest.CaptureFixture[str]
Patch = pytest.MonkeyPatch

PAGE: Final = (Path(__file__).parents[1] / "docs/profiles.md").read_text(encoding="utf-8")


@pytest.fixture(autouse=True)
def bench(tmp_path: Path, monkeypatch: Patch) -> Path:
    """A folder to work in, and a user without settings."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "xdg"))
    monkeypatch.delenv("SNIFFER_PROFILE", raising=False)
    monkeypatch.chdir(tmp_path)
    Path("capture.bin").write_bytes(talk(3))
    return tmp_path


def write(text: str, file: str = "sniffer.toml") -> None:
    Path(file).parent.mkdir(parents=True, exist_ok=True)
    Path(file).write_text(text, encoding="utf-8")


def test_a_profile_says_the_protocol_and_a_stated_option_wins(capsys: Capsys) -> None:
    write('[profile.arm]\nprotocol = "lss"\n')
    assert (
        "bus0: lss" in within(capsys, "decode", "capture.bin", "--profile", "arm", "--summary").out
    )
    ran = within(
        capsys, "decode", "capture.bin", "--profile", "arm", "--protocol", "mightyzap", "--summary"
    )
    assert "bus0: mightyzap" in ran.out
    assert "bus0: mightyzap" in within(capsys, "decode", "capture.bin", "--summary").out


def test_the_environment_names_a_profile_and_the_folders_file_comes_first(
    capsys: Capsys, monkeypatch: Patch
) -> None:
    write('[profile.arm]\nprotocol = "lss"\n', "xdg/sniffer/config.toml")
    monkeypatch.setenv("SNIFFER_PROFILE", "arm")
    assert "bus0: lss" in within(capsys, "decode", "capture.bin", "--summary").out
    write('[profile.arm]\nprotocol = "rs30x"\n')
    assert "bus0: rs30x" in within(capsys, "decode", "capture.bin", "--summary").out
    write('[profile.leg]\nprotocol = "rs30x"\n')
    assert "bus0: lss" in within(capsys, "decode", "capture.bin", "--summary").out


def test_names_of_a_profile_are_kept_by_what_is_made_with_it(capsys: Capsys) -> None:
    write('[profile.arm]\nnames = { 1 = "left knee" }\n')
    out = ("-o", "out.mcap", "--quiet")
    assert within(capsys, "decode", "capture.bin", "--profile", "arm", *out).status == 0
    assert facts(Path("out.mcap"))["name.1"] == "left knee"


def test_rules_and_rates_of_a_profile_are_those_of_the_options(capsys: Capsys) -> None:
    write(
        '[profile.arm]\nbaud = 9600\nmodels = { all = "mightyzap-l12" }\n'
        'alarms = ["position > 1 for 1ms"]\n'
    )
    answer = packet(1, 0, (2047).to_bytes(2, "little"))
    Path("moves.bin").write_bytes((packet(1, 0xF2, b"\x8c\x02") + answer) * 4)
    said = within(
        capsys, "decode", "moves.bin", "--protocol", "mightyzap", "--baud", "9600",
        "--model", "mightyzap-l12", "--alarm", "position > 1 for 1ms", "--format", "jsonl",
    )  # fmt: skip
    ran = within(
        capsys, "decode", "moves.bin", "--protocol", "mightyzap", "--profile", "arm",
        "--format", "jsonl",
    )  # fmt: skip
    assert '"code":"alarm"' in said.out.replace(" ", "")
    assert ran.out == said.out


def test_ports_of_a_profile_are_opened_and_one_must_be_named_where_one_is_asked(
    capsys: Capsys,
) -> None:
    write(
        '[profile.arm]\nports = "arm=/dev/nonesuch=wck@9600"\nprotocol = "lss"\n'
        '[profile.legs]\nports = ["/dev/none1", "/dev/none2"]\n'
    )
    for command in ("record", "doctor"):
        complaint = within(capsys, command, "--profile", "arm").complaint
        assert complaint.startswith("/dev/nonesuch: there is no such port")
        assert "profile arm of sniffer.toml is in use" in complaint
        # a port that is stated wins, and the protocol that it states
        complaint = within(capsys, command, "/dev/other=wck", "--profile", "arm").complaint
        assert complaint.startswith("/dev/other: there is no such port")
    complaint = within(capsys, "doctor", "--profile", "legs").complaint
    assert "sniffer.toml:5: ports: 2 ports: name the one" in complaint
    assert "Missing argument" in within(capsys, "record").complaint


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("[profile.arm]\n\nbauds = 1\n", "toml:3: bauds: there is no such key: did you mean baud"),
        ("[profile.arm]\nxyz = 1\n", "sniffer.toml:2: xyz: there is no such key: one of ports"),
        ("[profile.leg]\nbaud = 1\n[profile.arm]\nbaud=7\n", "toml:4: baud: 7 is not in the"),
        ('[profile.arm]\nprotocol = "wkc"\n', "sniffer.toml:2: protocol: 'wkc' is not one of"),
        ("[profile.arm]\nbaud = true\n", "sniffer.toml:2: baud: write a number"),
        ("[profile.arm]\nmodels = 3\n", "sniffer.toml:2: models: write ids and models"),
        ('[profile.arm]\nnames = "x"\n', "sniffer.toml:2: names: write ids and names"),
        ("[profile.arm.models]\n300 = 'wck'\n", "toml:1: models: '300=wck': write ID=MODEL"),
        ("[profile.arm]\nalarms = ['voltage >']\n", "sniffer.toml:2: alarms: "),
        ("[profile.arm]\nregisters = 'no.toml'\n", "no.toml"),
        ("[profile.amr]\n", "no profile 'arm' in sniffer.toml and"),
        ("[profile.amr]\n", "did you mean amr?"),
        ("", "have none; write [profile.arm] into one of them"),
        ("baud = 3\n", "sniffer.toml: there is no key 'baud': write settings below [profile.NAME]"),
        ("profile = 3\n", "sniffer.toml: profile: write [profile.NAME]"),
        ("[profile.arm\n", "sniffer.toml: this is no TOML: "),
    ],
    ids=lambda text: re.sub(r"\W+", "-", text)[:40],
)  # fmt: skip
def test_what_is_wrong_in_a_file_is_told_with_its_place(
    text: str, told: str, capsys: Capsys
) -> None:
    write(text)
    ran = within(capsys, "decode", "capture.bin", "--profile", "arm")
    assert ran.status == 2
    assert told in ran.complaint


def test_a_broken_file_harms_nobody_who_asks_for_no_profile(capsys: Capsys) -> None:
    write("[profile.arm\n")
    assert within(capsys, "decode", "capture.bin", "--summary").status == 0


def test_the_page_has_every_key_and_its_example_is_one(
    capsys: Capsys, monkeypatch: Patch, tmp_path: Path
) -> None:
    assert set(re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)) == set(KEYS)
    found = re.search(r"^```toml\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)
    assert found is not None
    write(found[1])
    for name in tomllib.loads(found[1])["profile"]:
        complaint = within(capsys, "record", "--profile", name).complaint
        assert "there is no such port" in complaint
    assert files()[1] == tmp_path / "xdg/sniffer/config.toml"
