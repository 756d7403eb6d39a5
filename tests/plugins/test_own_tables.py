"""A register table of one's own: a new model without code."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests.commands import Ran, records, talk
from tests.plugin import NAME, PACKAGE
from tests.recorder import Recorder, assert_true_to_itself
from tests.terminals import LINUX_ONLY, Terminal

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tests.plugin import Command


READ = "A5 A5 A5 01 04 F2 8C 02 7A"
ANSWER = "A5 A5 A5 01 04 00 FF 07 F4"
MISSING = (
    f"bus0 needs the protocol '{NAME}' ({PACKAGE}): install the package that has it, or give its "
    "file with --protocol"
)


@pytest.fixture
def real(tmp_path: Path) -> Path:
    path = tmp_path / "real.bin"
    path.write_bytes(talk(30))
    return path


def angles(ran: Ran) -> dict[int, set[str]]:
    """Return the names of what each servo's bytes 8C and 8D were read as."""
    out: dict[int, set[str]] = {}
    for row in records(ran.out):
        if row["type"] == "sample" and row["quantity"] == "position":
            out.setdefault(row["servo_id"], set()).add(row["register"])
    return out


def test_a_table_makes_a_new_model_without_code(
    own: Path, real: Path, tmp_path: Path, plain: Command
) -> None:
    mine = ("--registers", own, "--model", "3=my-servo")
    ran = plain("decode", real, *mine, "--format", "jsonl")
    assert (ran.status, ran.content) == (0, True)
    assert angles(ran) == {1: {"present_position"}, 2: {"present_position"}, 3: {"angle"}}
    shown = plain("explain", "FFFFFF010400FF07F4", "--after", "FFFFFF0104F28C027A",
                    "--registers", own, "--model", "my-servo")  # fmt: skip
    assert "angle: raw 2047 = 511.75 deg" in shown.out
    assert "0x8C  angle" in plain("registers", own).out
    for command in (("view", real, "-o", tmp_path / "x.rrd"), ("replay", real, "--speed", "0")):
        assert plain(*command, *mine).status == 0


def test_a_recording_brings_the_tables_that_it_was_read_by(
    own: Path, real: Path, tmp_path: Path, plain: Command
) -> None:
    path, again = tmp_path / "run.mcap", tmp_path / "again.mcap"
    told = ("--registers", own, "--model", "3=my-servo", "--quiet")
    assert plain("decode", real, *told, "-o", path).status == 0
    own.unlink()
    ran = plain("decode", path, "--format", "jsonl", "-o", again)
    assert (ran.status, ran.err) == (0, "")
    assert angles(ran)[3] == {"angle"}
    assert angles(plain("decode", again, "--format", "jsonl"))[3] == {"angle"}
    assert plain("replay", again, "--redecode").out.endswith("the same as recorded\n")


@LINUX_ONLY
def test_a_port_is_recorded_with_a_table(own: Path, tmp_path: Path, plain: Command) -> None:
    said = talk(30)
    told = ("{}=mightyzap", "--registers", own, "--model", "3=my-servo", "--quiet")
    with Terminal() as line, Recorder(tmp_path, *told, lines=[line]) as run:
        line.say(said)
        run.wait_for(len(said))
        assert run.stop() == Ran(0, "", "")
    assert_true_to_itself(run.path)
    assert angles(plain("decode", run.path, "--format", "jsonl"))[3] == {"angle"}


@pytest.mark.parametrize(
    ("head", "arguments", "told"),
    [
        ('protocol = ""', (), "my-servo: it does not say whose it is"),
        ('protocol = "nix"', (), "my-servo: no protocol 'nix': one of mightyzap, lss"),
        ('protocol = "lss"', (), "my-servo: lss takes no further tables"),
        ('protocol = "wck"', (), "my-servo: wck takes no further tables"),
        ('protocol = "mightyzap"', ("--protocol", "lss"), "it is a table of mightyzap, and what"),
        ('protocol = "mightyzap"', ("--model", "my-other"), "no model 'my-other': one of"),
        ("protocl = 1", (), "there is no key 'protocl'"),
    ],
)
def test_a_table_of_no_use_is_told(
    head: str, arguments: Sequence[str], told: str, own: Path, real: Path, plain: Command
) -> None:
    text = own.read_text(encoding="utf-8").replace('protocol = "mightyzap"', head)
    own.write_text(text, encoding="utf-8")
    ran = plain("decode", real, "--registers", own, *arguments)
    assert (ran.status, ran.out) == (2, "")
    assert told in ran.complaint
