"""``sniffer wireshark``: files are put where Wireshark finds them, nobody else's are touched."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import sniffer
from sniffer.wireshark.install import MARK, install, pieces
from sniffer.wireshark.places import Places, places
from tests.commands import environment, within
from tests.commands import sniffer as sniffed
from tests.sharks import counted

if TYPE_CHECKING:
    from collections.abc import Callable

Capsys = pytest.CaptureFixture[str]

FILES = Path("sniffer/wireshark/files")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home without anything in it, on a machine without Wireshark."""
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    monkeypatch.delenv("XDG_CONFIG_HOME", raising=False)
    return tmp_path


def files_in(folder: Path) -> set[str]:
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


def test_without_wireshark_the_usual_folders_are_written_for_every_version(
    home: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "wireshark", "install")
    assert ran.status == 0
    assert "there is no tshark" in ran.err
    assert files_in(home) == {
        ".local/lib/wireshark/plugins/servo-sniffer.lua",
        *(f".config/wireshark/profiles/servo/{p.name}" for p in (FILES / "profile").iterdir()),
        ".config/wireshark/extcap/servo-sniffer",
        ".local/lib/wireshark/extcap/servo-sniffer",
    }
    assert {f"wrote {home / name}" for name in files_in(home)} == {*ran.out.splitlines()}
    assert (home / ".config/wireshark/extcap/servo-sniffer").stat().st_mode & 0o111


def test_settings_are_where_the_environment_says(home: Path) -> None:
    found = places({"HOME": str(home), "XDG_CONFIG_HOME": str(home / "etc"), "PATH": ""})
    assert found.profile == home / "etc/wireshark/profiles/servo"
    assert found.plugins == home / ".local/lib/wireshark/plugins"


@pytest.mark.parametrize(
    ("told", "extcap"),
    [
        ("Personal Extcap path:\t/home/me/.local/lib/wireshark/extcap\n", "/home/me/.local/lib"),
        ("Extcap path:         \t/usr/lib/wireshark/extcap\n", "/home/me/.config"),
    ],
)
def test_wireshark_is_asked_for_its_folders(told: str, extcap: str, home: Path) -> None:
    program = home / "bin" / "tshark"
    program.parent.mkdir()
    folders = f"Temp:\t/tmp\nPersonal configuration:\t/home/me/.config/wireshark\n{told}"
    folders += "Personal Lua Plugins:\t/home/me/plugins\n"
    program.write_text(f"#!/bin/sh\n/bin/cat <<'X'\n{folders}X\n")
    program.chmod(0o755)
    found = places()
    assert found.program == str(program)
    assert found.plugins == Path("/home/me/plugins")
    assert found.profile == Path("/home/me/.config/wireshark/profiles/servo")
    assert found.extcap == (Path(extcap) / "wireshark/extcap",)


def test_what_a_broken_tshark_says_is_not_believed(home: Path) -> None:
    program = home / "bin" / "tshark"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\nexit 1\n")
    program.chmod(0o755)
    assert places().program == ""


def test_path_tells_where_each_file_is_and_what_is_there(home: Path, capsys: Capsys) -> None:
    before = within(capsys, "wireshark", "path").out
    assert before.count("not there") == len(before.splitlines()) == 6
    within(capsys, "wireshark", "install")
    dissector = home / ".local/lib/wireshark/plugins/servo-sniffer.lua"
    dissector.write_text(f"-- {MARK}\n-- of another version\n")
    (home / ".config/wireshark/profiles/servo/colorfilters").write_text("# mine\n")
    states = [line.split("  ") for line in within(capsys, "wireshark", "path").out.splitlines()]
    told = {Path(line[-1].strip()).name: " ".join(line).split("/")[0] for line in states}
    assert "of another version" in told["servo-sniffer.lua"]
    assert "not ours" in told["colorfilters"]
    assert "installed" in told["preferences"]


def test_what_one_process_installs_another_one_knows_again(home: Path) -> None:
    told = {"HOME": str(home), "PATH": ""}
    assert sniffed("wireshark", "install", env={**told, "PYTHONHASHSEED": "1"}).status == 0
    seen = sniffed("wireshark", "path", env={**told, "PYTHONHASHSEED": "2"}).out.splitlines()
    assert sum(" installed " in line for line in seen) == len(seen) == 6


def test_a_file_that_is_not_ours_is_kept_and_nothing_is_written(home: Path, capsys: Capsys) -> None:
    theirs = home / ".config/wireshark/profiles/servo/preferences"
    theirs.parent.mkdir(parents=True)
    theirs.write_text("gui.toolbar_main_style: 0\n")
    ran = within(capsys, "wireshark", "install")
    assert ran.status == 2
    assert f"{theirs} is not ours, or was changed since: move it away, or --force" in ran.err
    assert files_in(home) == {str(theirs.relative_to(home))}
    assert within(capsys, "wireshark", "install", "--force").status == 0
    assert MARK in theirs.read_text()


def test_a_file_of_another_version_is_replaced_and_one_of_this_is_not_written_again(
    home: Path, capsys: Capsys
) -> None:
    within(capsys, "wireshark", "install")
    dissector = home / ".local/lib/wireshark/plugins/servo-sniffer.lua"
    whole = dissector.read_text()
    dissector.write_text(f"-- {MARK}\n-- of another version\n")
    assert within(capsys, "wireshark", "install").out == f"wrote {dissector}\n"
    assert dissector.read_text() == whole


def test_uninstall_removes_what_is_ours_and_nothing_else(home: Path, capsys: Capsys) -> None:
    within(capsys, "wireshark", "install")
    changed = home / ".config/wireshark/profiles/servo/preferences"
    changed.write_text("# written by Wireshark\n")
    beside = home / ".local/lib/wireshark/plugins/mine.lua"
    beside.write_text("-- mine\n")
    ran = within(capsys, "wireshark", "uninstall")
    assert ran.status == 0
    assert f"{changed} is not ours, or was changed since: it stays" in ran.err
    assert files_in(home) == {str(p.relative_to(home)) for p in (changed, beside)}
    changed.unlink()
    again = within(capsys, "wireshark", "uninstall")
    assert (again.status, again.out) == (0, "")
    assert "nothing of ours was there" in again.err
    assert not changed.parent.exists()


def test_a_folder_that_may_not_be_written_is_a_mistake(home: Path, capsys: Capsys) -> None:
    (home / ".local").write_text("a file where a folder belongs")
    ran = within(capsys, "wireshark", "install")
    assert ran.status == 2
    assert "Traceback" not in ran.err
    assert str(home / ".local") in ran.err


def test_every_file_of_ours_bears_the_mark_and_the_program_this_python(tmp_path: Path) -> None:
    for piece in pieces(Places(tmp_path, tmp_path, (tmp_path / "extcap",))):
        assert MARK in piece.text, piece.path
        assert not re.search(r"@[A-Z]+@", piece.text), piece.path


def test_the_program_that_wireshark_calls_at_its_start_imports_nothing_of_ours() -> None:
    code = ast.parse((FILES / "extcap").read_text())
    drawn = {
        name.name for node in ast.walk(code) if isinstance(node, ast.Import) for name in node.names
    }
    assert drawn == {"os", "sys"}
    assert not [node for node in ast.walk(code) if isinstance(node, ast.ImportFrom)]


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("capture") / "x.pcapng"
    sniffer.convert("sample_captures/mightyzap_damaged.log", [path])
    return path


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., str]:
    """Tshark of a user who has installed it; skips without."""
    if shutil.which("tshark") is None:
        pytest.skip("needs tshark")
    mine = tmp_path_factory.mktemp("home")
    own = environment(HOME=str(mine))
    own.pop("XDG_CONFIG_HOME", None)
    install(places(own))

    def call(*arguments: str) -> str:
        ran = subprocess.run(
            ["tshark", *arguments],
            env=own,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert ran.returncode == 0, ran.stderr
        return ran.stdout

    return call


def test_tshark_finds_the_dissector_and_the_profile(
    installed: Callable[..., str], capture: Path
) -> None:
    text = installed("-C", "servo", "-r", str(capture), "-Y", "servo.reg.present_voltage", "-c60")
    assert "servo 1 → controller" in text
    assert "response load_data present_position" in text


def test_tshark_lists_the_capture_interface_and_its_link_type(
    installed: Callable[..., str],
) -> None:
    assert "servo-bus (Robot servo bus (servo-sniffer))" in installed("-D")
    assert "RTAC_SERIAL" in installed("-L", "-i", "servo-bus")


def test_every_filter_of_the_profile_is_one(dissector: Path, capture: Path) -> None:
    colors = [
        line.split("@")[2]
        for line in (FILES / "profile/colorfilters").read_text().splitlines()
        if line.startswith("@")
    ]
    buttons = re.findall(
        r'^"TRUE","[^"]*","([^"]*)"', (FILES / "profile/dfilter_buttons").read_text(), re.M
    )
    assert (len(colors), len(buttons)) == (6, 6)
    every = [f.replace("\\x22", '"') for f in (*colors, *buttons)]
    assert sum(counted(dissector, capture, every)) > 700


PAGE = Path("docs/with/wireshark.md").read_text(encoding="utf-8")


def test_the_filters_of_the_page_show_what_it_says(dissector: Path, capture: Path) -> None:
    told = re.findall(r"^\| `([^`]+)` \| (\d+) \|$", PAGE, re.M)
    assert len(told) == 9
    # statistics count for all filters in one pass
    shown = counted(dissector, capture, [filter_ for filter_, _ in told])
    assert dict(zip((f for f, _ in told), shown, strict=True)) == {f: int(n) for f, n in told}


def test_the_page_has_every_field_of_the_dissector_and_no_other(dissector: Path) -> None:
    lua = dissector.read_text("utf-8")
    there = set(re.findall(r'Proto(?:Field\.\w+|Expert\.new)\("(servo\.[\w.]+)"', lua))
    named = set(re.findall(r"`(servo\.[a-z_.]+)(?:NAME)?`", PAGE))
    assert there == {name for name in named if not re.fullmatch(r"servo\.reg\..+", name)}


def test_the_program_answers_from_a_folder_with_blanks_in_its_name(tmp_path: Path) -> None:
    python = tmp_path / "a folder" / "python"
    python.parent.mkdir()
    python.symlink_to(sys.executable)
    program = tmp_path / "servo-sniffer"
    text = (FILES / "extcap").read_text("utf-8").replace("@PYTHON@", str(python))
    program.write_text(text.replace("@VERSION@", sniffer.__version__))
    program.chmod(0o755)
    told = subprocess.run(
        [program, "--extcap-interfaces"], capture_output=True, text=True, check=True, timeout=60
    )
    assert told.stderr == ""
    assert told.stdout.splitlines() == [
        f"extcap {{version={sniffer.__version__}}}{{display=servo-sniffer}}",
        "interface {value=servo-bus}{display=Robot servo bus (servo-sniffer)}",
    ]
