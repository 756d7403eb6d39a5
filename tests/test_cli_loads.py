"""What commands load: no more than they need, so they answer at once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from sniffer.cli import COMMANDS, cli
from tests.lists import each_in_turn

Capsys = pytest.CaptureFixture[str]


def test_the_list_of_commands_says_what_each_command_says_of_itself() -> None:
    assert {name: cli.commands[name].get_short_help_str(200) for name in COMMANDS} == COMMANDS
    assert sorted(cli.commands) == sorted(COMMANDS)


def test_help_loads_no_command_and_nothing_that_reckons() -> None:
    code = (
        "import sys; from sniffer.cli import run; run(['--help']); "
        "print([m for m in ('numpy', 'construct', 'rich', 'sniffer.cli.decode') "
        "if m in sys.modules])"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines()[-1] == "[]"


ROOT = Path(__file__).parents[1]
HEAVY = ("numpy.ma", "tomllib", "tempfile", "shutil", "importlib.metadata", "serial", "mcap")
FAR = ("merging", "mcapfile", "ports", "simulation", "tap", "viewers", "decoding.reference")
SMALL = "sample_captures/mightyzap_manual.hex"


def run_apart(code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run code in an interpreter of its own, which has loaded nothing yet."""
    python = [sys.executable, "-c", code, *arguments]
    return subprocess.run(python, capture_output=True, text=True, check=True, cwd=ROOT)


@pytest.mark.parametrize(
    ("command", "apart"),
    [
        (["decode", SMALL], ("decoding.rows", "protocols.lss", "protocols.rs30x")),
        (["decode", SMALL, "--protocol", "mightyzap"], ("protocols.wck", "protocols.rs30x")),
        (["decode", "sample_captures/lss_manual.bin"], ("protocols.mightyzap", "protocols.wck")),
        (["decode", SMALL, "--format", "jsonl"], ("diagnosis", "sinks.text", "sinks.report")),
        (["explain", "FF FF FF 01 04 F2 8C 02 7A"], ("sinks", "sources", "protocols.lss")),
        (["protocols"], ("decoding", "sinks", "sources")),
        (["registers", "mightyzap-12lf"], ("decoding", "sinks", "sources")),
    ],
    ids=" ".join,
)
def test_a_small_thing_loads_only_what_it_needs(command: list[str], apart: tuple[str, ...]) -> None:
    """What is loaded is most of what it costs; how long that takes, the machine decides.

    What construct brings along is not ours: its debugger has ``tempfile`` from Python 3.14 on.
    """
    code = (
        "import sys, construct; its = {*sys.modules}; from sniffer.cli import run; "
        "status = run(sys.argv[1:]); print(status, *{*sys.modules} - its, file=sys.stderr)"
    )
    ran = run_apart(code, *command)
    status, *loaded = ran.stderr.splitlines()[-1].split()
    assert status == "0"
    is_table = command[0] == "decode" and "jsonl" not in command
    rich = () if is_table else ("rich",)
    assert ran.stdout.count("\n") > 3
    unwanted = {*HEAVY, *rich, *(f"sniffer.{room}" for room in (*FAR, *apart))}
    assert not unwanted & {*loaded}


@each_in_turn(2, "name", ["mightyzap_damaged.log", "lss_damaged.log"])
def test_a_log_whose_stamps_tell_how_long_a_byte_takes_loads_no_masked_arrays(name: str) -> None:
    code = (
        "import sys; from sniffer.cli import run; status = run(sys.argv[1:]); "
        "print(status, 'numpy.ma' in sys.modules, file=sys.stderr)"
    )
    ran = run_apart(code, "decode", f"sample_captures/{name}", "--format", "jsonl")
    assert ran.stderr.splitlines()[-1] == "0 False"


def modules_of_a_table(*arguments: str) -> set[str]:
    """Return what decoding something for people loads."""
    code = (
        "import sys; from sniffer.cli import run; status = run(['decode', *sys.argv[1:]]); "
        "print(status, *sys.modules, file=sys.stderr)"
    )
    ran = run_apart(code, *arguments)
    status, *loaded = ran.stderr.splitlines()[-1].split()
    assert status == "0"
    return {*loaded}


@pytest.mark.parametrize("name", ["mightyzap_clean.log", "wck_clean.log"])
def test_the_table_of_a_sound_log_looks_for_faults_and_loads_no_weights(name: str) -> None:
    loaded = modules_of_a_table(f"sample_captures/{name}")
    assert "sniffer.diagnosis.rules.line.motors" in loaded
    assert not {"numpy.ma", "sniffer.diagnosis.weights"} & loaded


def test_the_table_of_a_log_that_breaks_off_loads_no_protocol_that_is_not_spoken(
    tmp_path: Path,
) -> None:
    log = tmp_path / "cut.log"
    lines = (ROOT / "sample_captures" / "mightyzap_clean.log").read_text(encoding="utf-8")
    cut = [*lines.splitlines()[:40], "(1795215313.0) bus0 #FFFFFF030A00"]
    log.write_text("\n".join(cut) + "\n", encoding="utf-8")
    loaded = modules_of_a_table(str(log), "--protocol", "mightyzap")
    others = {f"sniffer.protocols.{name}" for name in ("lss", "wck", "rs30x")}
    assert not {"numpy.ma", *others} & loaded
