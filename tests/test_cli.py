"""What a user gets wrong, and what breaks off: one line that helps, and nothing is lost."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from sniffer.sinks import SINKS
from tests.commands import (
    COMMAND,
    Ran,
    conserved,
    damaged,
    forbidden,
    sniffer,
    talk,
    within,
)
from tests.streams.mightyzap import packet

Capsys = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--protocol", "dynamixel"], "'dynamixel' is not one of 'auto', 'mightyzap'"),
        (
            ["--protocol", "dynamixel"],
            "others are declared in a FILE.py of yours (docs/plugins.md)",
        ),
        (["--model", "9=nix"], "no model 'nix': one of lss, lss-pro, mightyzap-12lf"),
        (["--model", "x=wck"], "'x=wck': write ID=MODEL with an id of 0..255, or MODEL"),
        (["--model", "256=wck"], "'256=wck': write ID=MODEL with an id of 0..255, or MODEL"),
        (["--model", "=wck"], "'=wck': write ID=MODEL"),
        (["--model", "rs305cr"], "mightyzap has no model 'rs305cr': one of mightyzap-l12"),
        (["--baud", "fast"], "'fast' is not a valid integer"),
        (["--baud", "1"], "1 is not in the range"),
        (["--latency", "nan"], "'nan' is no number to reckon with"),
        (["--format", "xml"], "'xml' is not one of 'text', 'jsonl', 'pcapng'"),
        (["--fail-on", "all"], "'all' is not one of 'note', 'warn', 'error'"),
        (["--input-format", "nix"], "'nix' is not one of 'auto', 'bin'"),
        (["--nix"], "No such option '--nix': see `sniffer decode --help`"),
        (["-x"], "No such option '-x': see `sniffer decode --help`"),
        (["--last", "5s"], "No such option '--last': --from -5s begins 5 s before the end"),
        (["--first", "5s"], "No such option '--first': --to 5s ends 5 s behind the beginning"),
        (["--id", "3"], "No such option '--id': --servo 3,5 selects servos"),
        (["--wide"], "No such option '--wide': `sniffer convert` takes it; see `sniffer decode"),
        (["--why", "1"], "No such option '--why': `sniffer diagnose` takes it; see"),
        (["--ring", "3s"], "'--ring': `sniffer record` takes it; see"),
        (["--together"], "No such option '--together': see `sniffer decode --help`"),
        (["and-another"], "and-another: there is no such file"),
    ],
)
def test_a_wrong_option_says_what_is_right(
    arguments: list[str], told: str, good: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "decode", good, *arguments)
    assert (ran.status, ran.out) == (2, "")
    assert told in ran.complaint


@pytest.mark.parametrize(
    "command",
    [
        ("stats", "GOOD", "--servo", "3", "--format", "csv"),
        ("diagnose", "GOOD"),
        ("report", "GOOD"),
        ("report", "GOOD", "-o", "OUT.md"),
        ("replay", "GOOD", "--speed", "0"),
        ("cut", "GOOD", "--from", "0", "-o", "OUT.bin"),
        ("diff", "GOOD", "GOOD"),
        ("discover", "GOOD", "--servo", "3"),
        ("query", "SELECT count(*) FROM frames", "GOOD"),
        ("convert", "GOOD", "OUT.hex", "--servo", "3"),
        ("decode", "GOOD", "-o", "OUT.csv"),
    ],
    ids=" ".join,
)
def test_quiet_leaves_what_is_printed_and_says_nothing_beside_it(
    command: tuple[str, ...], good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    stands = {word: tmp_path / word for word in command if word.startswith("OUT.")}
    asked = [stands.get(word, good if word == "GOOD" else word) for word in command]
    asked += ["--force"] if stands else []
    aloud = within(capsys, *asked)
    quiet = within(capsys, *asked, "--quiet")
    assert (quiet.status, quiet.err) == (aloud.status, "")
    assert aloud.err
    assert command[0] == "decode" or quiet.out == aloud.out


def test_no_command_and_no_file_are_mistakes(capsys: Capsys) -> None:
    assert within(capsys).status == 2
    told = within(capsys, "nix").complaint
    assert told == "No such command 'nix': `sniffer --help` lists those there are"
    assert "'decode'" in within(capsys, "filter").complaint
    told = within(capsys, "registers", "lss", "--where", "1").complaint
    assert told == "No such option '--where': see `sniffer registers --help`"
    assert within(capsys, "compare", "a.log", "b.log").complaint == (
        "No such command 'compare': did you mean 'diff' (Compare two runs, servo by servo)?"
    )
    assert within(capsys, "measure").complaint == (
        "No such command 'measure': did you mean 'stats' "
        "(Count and measure: load, rates, times, errors)?"
    )
    for word, meant in (("export", "convert"), ("info", "stats"), ("tail", "record")):
        assert f"did you mean '{meant}' (" in within(capsys, word).complaint
    for option, form in (("--json", "jsonl"), ("--text", "text")):
        assert within(capsys, "decode", "a.log", option).complaint == (
            f"No such option '{option}': --format {form} prints that"
        )
    assert "--where \"severity = 'error'\"" in within(capsys, "stats", "a", "--errors").complaint
    assert within(capsys, "check", "a.log").complaint == (
        "Missing option '--rules': see `sniffer check --help`, and `sniffer check --example` for "
        "rules to begin with"
    )
    assert "Did you mean 'cut'?" in within(capsys, "cut2").complaint
    assert (
        within(capsys, "decode").complaint
        == "Missing argument 'FILE...': see `sniffer decode --help`"
    )


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["view", "x", "-o", "x.rrd", "--web"], "choose one"),
        (["view", "x", "--port", "80"], "--web-port goes with --web"),
        (["replay", "x", "--redecode", "--rerun"], "choose one"),
        (
            ["diagnose", "x", "--servo", "3"],
            "'--servo': all that was said is judged; `sniffer decode`",
        ),
        (["report", "x", "--where=value > 3"], "'--where': all that was said is judged"),
        (
            ["cut", "x", "--servo", "3"],
            "'--servo': a part has every byte of its buses; `sniffer conv",
        ),
        (["convert", "x", "--every"], "requires an argument: see `sniffer convert --help`"),
        (["replay", "x", "--speed", "fast"], "'fast' is not a valid number"),
        (["recover", "x.mcap", "-o", "x.jsonl"], "a recording's name ends in .mcap"),
        (["recover", "missing.mcap"], "there is no such file"),
        (["recover", "/"], "is a directory: give the recording in it"),
        (["recover", "-"], "this needs a file: save standard input first"),
        (["layout", "-"], "this needs a file: save standard input first"),
        (["replay", "--redecode", "-"], "this needs a file: save standard input first"),
        (["simulate", "dxl"], "Invalid value for 'PROTOCOL': 'dxl' is not one of 'mightyzap'"),
        (["decode", "x", "--name", "/"], "that can be read (Is a directory)"),
        (["recover", __file__], "`sniffer decode` reads other captures"),
        (
            ["explain", "12175"],
            "write bytes as FF FF FF 01 02 F1 0B, a place in a capture as FILE@12175",
        ),
        (["explain", ""], "no bytes to explain: write them as"),
        (["explain", "FF", "--model", "nix"], "no model 'nix': one of lss, lss-pro"),
    ],
)
def test_what_cannot_be_meant_is_told_with_what_to_do(
    arguments: list[str], told: str, capsys: Capsys
) -> None:
    ran = within(capsys, *arguments)
    assert (ran.status, ran.out) == (2, "")
    assert told in ran.complaint


@pytest.mark.parametrize(
    ("head", "what"),
    [
        (b"\x89PNG\r\n\x1a\n", "a PNG image"),
        (b"%PDF-1.7\n", "a PDF document"),
        (b"\x7fELF\x02\x01", "a program"),
    ],
)
def test_a_file_that_is_no_capture_is_named(
    head: bytes, what: str, tmp_path: Path, capsys: Capsys
) -> None:
    (tmp_path / "file").write_bytes(head + bytes(100))
    ran = within(capsys, "decode", tmp_path / "file")
    assert ran.status == 2
    assert f"{what} is not read: give the file that your logger wrote" in ran.complaint


@pytest.mark.parametrize(
    "command", ["", "decode", "view", "replay", "recover", "explain", "protocols", "registers"]
)
def test_help_is_there_and_fits_a_terminal(command: str, capsys: Capsys) -> None:
    ran = within(capsys, *([command] if command else []), "--help")
    assert (ran.status, ran.err) == (0, "")
    assert max(map(len, ran.out.splitlines())) <= 84
    if command != "protocols":
        assert f"sniffer {command}".strip() in ran.out.partition("Options:")[2]


def test_the_version_is_told(capsys: Capsys) -> None:
    from sniffer import __version__

    assert within(capsys, "--version").out == f"sniffer, version {__version__}\n"


@pytest.mark.parametrize(("level", "status"), [("error", 1), ("warn", 1), ("note", 1), (None, 0)])
def test_anomalies_fail_the_command_only_where_asked(
    level: str | None, status: int, tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / "damaged.bin"
    path.write_bytes(damaged(talk(20)))
    asked = ["--fail-on", level] if level else []
    ran = within(capsys, "decode", path, "--quiet", *asked)
    assert (ran.status, ran.out, ran.err) == (status, "", "")


def test_a_level_that_is_not_reached_does_not_fail(tmp_path: Path, capsys: Capsys) -> None:
    path = tmp_path / "tail.bin"
    path.write_bytes(packet(1, 0xF1) + packet(1, 0) + b"\xfe" + packet(1, 0xF1) + packet(1, 0))
    assert within(capsys, "decode", path, "--quiet", "--fail-on", "warn").status == 1
    assert within(capsys, "decode", path, "--quiet", "--fail-on", "error").status == 0


# --- outputs -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("output", "told"),
    [
        ("no/x.jsonl", "there is no folder"),
        ("no/x.csv", "there is no folder"),
        ("folder.jsonl", "is a directory: give a file name"),
        ("x.xml", "the suffix must be one of .jsonl, .csv, .parquet, .mcap, .rrd"),
        ("x", "the suffix must be one of"),
        ("x.mpac", ".hex: did you mean .mcap?"),
        ("good.jsonl", "is the input: choose another output"),
        ("link.jsonl", "is the input: choose another output"),
    ],
)
def test_a_wrong_output_says_what_is_right_and_leaves_no_file(
    output: str, told: str, tmp_path: Path, capsys: Capsys
) -> None:
    good = tmp_path / "good.jsonl"
    good.write_bytes(talk(20))
    (tmp_path / "folder.jsonl").mkdir()
    (tmp_path / "link.jsonl").symlink_to(good)
    before = sorted(tmp_path.iterdir())
    ran = within(capsys, "decode", good, "-o", tmp_path / output)
    assert (ran.status, ran.out) == (2, "")
    assert str(tmp_path / output) in ran.complaint
    assert told in ran.complaint
    assert sorted(tmp_path.iterdir()) == before
    assert good.read_bytes() == talk(20)


@pytest.mark.parametrize(
    ("one", "other"),
    [("x.jsonl", "x.jsonl"), ("x.jsonl", "./x.jsonl"), ("x.csv", "x.frames.csv")],
)
def test_the_same_file_is_not_written_twice(
    one: str, other: str, good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    ran = within(capsys, "decode", good, "-o", tmp_path / one, "-o", f"{tmp_path}/{other}")
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint.endswith("would be written twice: choose another output")
    assert list(tmp_path.iterdir()) == [good]


def test_one_mistaken_output_leaves_the_others_unopened(
    good: Path, tmp_path: Path, capsys: Capsys
) -> None:
    precious = tmp_path / "precious.jsonl"
    precious.write_text("kept")
    ran = within(capsys, "decode", good, "-o", precious, "-o", tmp_path / "x.xml")
    assert ran.status == 2
    assert precious.read_text() == "kept"


def test_standard_input_is_not_overwritten_either(tmp_path: Path) -> None:
    path = tmp_path / "in.jsonl"
    path.write_bytes(talk(20))
    with path.open("rb") as file:
        done = subprocess.run(
            [*COMMAND, "decode", "-", "-o", str(path)],
            stdin=file, capture_output=True, text=True, check=False,
        )  # fmt: skip
    assert Ran(done.returncode, done.stdout, done.stderr).complaint.startswith(f"{path} is the")
    assert path.read_bytes() == talk(20)


def test_a_folder_without_permission_is_a_mistake(good: Path, tmp_path: Path) -> None:
    folder = tmp_path / "closed"
    folder.mkdir(mode=0o555)
    ran = forbidden(folder, "decode", good, "-o", folder / "x.jsonl")
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint == f"{folder / 'x.jsonl'}: no permission to write it"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("suffix", SINKS)
def test_a_full_disk_spoils_one_output_and_not_the_others(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / "in.bin"
    path.write_bytes(talk(100))
    full, kept = tmp_path / f"full{suffix}", tmp_path / "kept.jsonl"
    full.symlink_to("/dev/full")
    ran = sniffer("decode", path, "-o", full, "-o", kept, "--summary")
    assert ran.status == 2
    assert ran.complaint.startswith(f"{full}: ")
    assert "No space left" in ran.complaint
    if kept.exists():  # some outputs write at once: then the mistake is known before the decoding
        assert conserved(kept.read_text()) == talk(100)
    else:
        assert (suffix in (".mcap", ".rrd"), ran.out) == (True, "")


@pytest.mark.skipif(sys.platform == "win32", reason="needs ulimit")
def test_a_file_that_may_not_grow_is_a_mistake(tmp_path: Path) -> None:
    path, out = tmp_path / "in.bin", tmp_path / "x.jsonl"
    path.write_bytes(talk(100))
    ran = sniffer(
        "decode", path, "-o", out, "--quiet", before=("sh", "-c", 'ulimit -f 32; exec "$@"', "sh")
    )
    assert (ran.status, ran.out) == (2, "")
    assert ran.complaint == f"{out}: cannot be written (File too large)"
    assert 0 < out.stat().st_size <= 32 * 1024


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    "arguments", [["decode", "FILE"], ["decode", "FILE", "--summary"], ["protocols"]]
)
def test_a_full_standard_output_is_a_mistake(arguments: list[str], good: Path) -> None:
    named = [str(good) if a == "FILE" else a for a in arguments]
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run([*COMMAND, *named], stdout=full, stderr=subprocess.PIPE, check=False)
    ran = Ran(done.returncode, "", done.stderr.decode())
    assert ran.status == 2
    assert ran.complaint == "standard output: cannot be written (No space left on device)"


@pytest.mark.skipif(sys.platform == "win32", reason="needs a shell that closes outputs")
def test_a_closed_standard_output_is_borne_and_the_file_is_whole(
    good: Path, tmp_path: Path
) -> None:
    out = tmp_path / "x.jsonl"
    ran = sniffer("decode", good, "-o", out, before=("sh", "-c", 'exec "$@" >&-', "sh"))
    assert (ran.status, ran.out) == (0, "")
    assert ran.content
    assert conserved(out.read_text()) == good.read_bytes()


def test_characters_the_terminal_lacks_are_no_reason_to_stop(tmp_path: Path) -> None:
    path = tmp_path / "in.bin"
    path.write_bytes(damaged(talk(20)))
    ascii_only = {"PYTHONIOENCODING": "ascii", "COLUMNS": "80"}
    ran = sniffer("decode", path, env=ascii_only)
    assert ran.status == 0
    assert ran.content
    ran.out.encode("ascii")
    ran = sniffer("decode", path, "--format", "jsonl", env=ascii_only)
    assert ran.status == 0
    assert conserved(ran.out) == path.read_bytes()
