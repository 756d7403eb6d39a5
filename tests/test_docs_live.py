"""The pages about live use are true: options, figures, keys, and what is shown of real adapters."""

from __future__ import annotations

import configparser
import io
import json
import re
import shutil
import subprocess
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.cli import cli
from sniffer.cli.doctor import lines as doctor_lines
from sniffer.cli.ports import lines as port_lines
from sniffer.doctor import judged
from sniffer.doctor.adapter import RULE
from sniffer.ground.model import Clock
from sniffer.ground.timing import LATENCY_NS
from sniffer.ports.listing import Holder, PortInfo
from sniffer.ports.tty import PTY_NS, latency_ns
from sniffer.simulation.faults import USUAL, spelled
from sniffer.tap.reader import BREATH_NS
from sniffer.tap.status import BusStatus, Status
from sniffer.viewers.board.board import Board
from sniffer.viewers.board.cells import COLUMNS
from sniffer.viewers.board.line import line
from tests.commands import sniffer
from tests.terminals import LINUX_ONLY
from tests.test_architecture import FLOORS
from tests.test_docs import DOCS, WRITTEN, in_code, section, text_of
from tests.test_doctor import FTDI, heard
from tests.transcripts import ROOT, fences

if TYPE_CHECKING:
    from pathlib import Path

UNIT: Final = DOCS / "sniffer-record@.service"
RULES: Final = DOCS / "60-servo-tap.rules"
SLOW: Final = replace(FTDI, latency_ms=16, all_seen=True)
MS: Final = 1_000_000


def calls(text: str) -> list[tuple[str, str]]:
    """Return the commands that a page shows, run or not, with what is given to them."""
    blocks = [f.text for f in fences(text) if f.language in ("console", "sh")]
    return re.findall(r"^(?:\$ )?sniffer (\w+)([^|;&#\n]*)", "\n".join(blocks), re.MULTILINE)


def options_of(command: str) -> set[str]:
    return {o for p in cli.commands[command].params for o in p.opts if o.startswith("-")}


def row(text: str, beginning: str) -> list[str]:
    """Return the cells of a table's row."""
    (found,) = (one for one in text.splitlines() if one.startswith(f"| {beginning}"))
    return [cell.strip() for cell in found.strip("|").split("|")]


# --- options -----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(cli.commands))
def test_the_examples_of_a_commands_help_have_options_that_there_are(name: str) -> None:
    for command, given in re.findall(r"sniffer (\w+)([^|&]*)", cli.commands[name].epilog or ""):
        unquoted = re.sub(r"'[^']*'|\"[^\"]*\"", "", given)
        assert set(re.findall(r"(?<!\S)--?[a-z][\w-]*", unquoted)) <= options_of(command), given


@pytest.mark.parametrize("page", WRITTEN, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_option_a_page_shows_is_an_option_of_its_command(page: Path) -> None:
    for command, given in calls(page.read_text(encoding="utf-8")):
        shown = set(re.findall(r"(?<!\S)--?[a-z][\w-]*", given))
        assert shown <= options_of(command), f"sniffer {command}{given}"


@pytest.mark.parametrize(
    ("command", "page"), [("record", "recording.md"), ("simulate", "simulating.md")]
)
def test_every_option_of_a_live_command_is_on_its_page(command: str, page: str) -> None:
    told = set(re.findall(r"--[a-z][\w-]*|(?<![\w-])-[a-z]\b", text_of(page)))
    as_in_decode = {"--protocol", "--baud", "--model", "--registers", "--output", "--help"}
    assert options_of(command) - told <= as_in_decode


# --- what is shown of real adapters --------------------------------------------------------------


def test_the_list_of_ports_is_printed_so() -> None:
    uart = PortInfo("/dev/ttyS0", "serial", "16550A", all_seen=True)
    taken = PortInfo(
        *("/dev/ttyUSB1", "ch341-uart", "CH340", 0x1A86, 0x7523, "", "USB Serial", ""),
        stable="/dev/serial/by-id/usb-1a86_USB_Serial-if00-port0",
        holders=(Holder(4711, "controller"),),
        all_seen=True,
    )
    assert "\n".join(port_lines([uart, SLOW, taken], 80)) in text_of("recording.md")


def test_the_verdicts_on_an_adapter_are_printed_so() -> None:
    case = replace(heard("mightyzap"), info=SLOW)
    printed = "\n".join(one.plain for one in doctor_lines(judged(case), 80))
    assert printed in text_of("recording.md")


# --- figures and keys ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("port", "held_ns"),
    [
        ("FTDI, latency timer 1 ms", latency_ns(FTDI, 1, 57600)),
        ("FTDI, latency timer 16 ms", latency_ns(FTDI, 16, 57600)),
        ("CH340", latency_ns(PortInfo("", "ch341-uart", "CH340", 0x1A86), None, 57600)),
        ("CP210x", latency_ns(PortInfo("", "cp210x", "CP2102", 0x10C4), None, 57600)),
        ("pseudo-terminal", PTY_NS),
    ],
)
def test_the_time_that_bytes_are_held_back_is_told(port: str, held_ns: int | None) -> None:
    told = row(section(text_of("recording.md"), "What a time stamp means"), port)[1]
    assumed = (LATENCY_NS[Clock.READ] if held_ns is None else held_ns) + BREATH_NS
    assert int(told.partition(",")[0]) * MS == assumed


def test_a_uart_on_board_holds_back_two_milliseconds_and_twenty_bytes() -> None:
    told = row(section(text_of("recording.md"), "What a time stamp means"), "UART on board")[1]
    assert told == "2, and 20 bytes' time"
    held_ns = latency_ns(PortInfo("", "serial", "16550A"), None, 100_000)
    assert held_ns is not None
    assert held_ns + BREATH_NS == 2 * MS + 20 * 100_000


def test_every_column_of_the_board_is_explained() -> None:
    told = in_code(section(text_of("recording.md"), "The board"))
    assert {title for c in COLUMNS for title in c.titles[1:]} | {"alarms"} <= told


def test_every_key_of_the_line_a_second_is_explained() -> None:
    bus = BusStatus("bus0", "/dev/ttyUSB0", 57600, None, "silent", 0, 0, None)
    printed = line(Status(0.0, 0, "x.mcap", 0, 0, (bus,)), Board())
    keys = [part.partition("=")[0].replace("load.bus0", "load.BUS") for part in printed.split()]
    text = section(text_of("recording.md"), "Log lines")
    table = text[text.index("|---|") :]
    assert re.findall(r"`([^`]+)`", table.replace("`unknown`", "")) == keys


def test_every_fault_is_explained_with_its_usual_rate() -> None:
    text = section(text_of("simulating.md"), "Faults")
    for kind, rate in USUAL.items():
        assert row(text, f"`{spelled(kind)}`")[-1] == f"{100 * rate:g}%"


def test_every_key_of_a_simulations_truth_is_explained(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    faults = ("--fault", "noise:50%", "--fault", "drop-reply:1")
    assert sniffer("simulate", "wck", "--duration", "1s", "--truth", truth, *faults).status == 0
    rows = [json.loads(one) for one in truth.read_text(encoding="utf-8").splitlines()]
    text = section(text_of("formats.md"), "Truth of a simulation")
    for kind in ("simulation", "frame", "end"):
        table = text[text.index(f"| `{kind}` |") :].partition("\n\n")[0]
        keys = {key for one in rows if one["type"] == kind for key in one}
        assert keys <= in_code(table)
    told = in_code(row(text, "`kind`")[1])
    assert {one["kind"] for one in rows if one["type"] == "frame"} == told


def test_the_design_names_every_module_on_its_floor() -> None:
    table = in_code(section(text_of("design.md"), "2. Floors"))
    rooms = {room for floor in FLOORS for room in floor if not room.startswith("__")}
    assert rooms - {name.rstrip("/") for name in table} == set()


# --- the unit and the rule -----------------------------------------------------------------------


def unit() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(UNIT.read_text(encoding="utf-8"))
    return parser


def test_the_service_records_with_options_that_there_are() -> None:
    _, command, given = unit()["Service"]["ExecStart"].split(maxsplit=2)
    (usual,) = re.findall(r"OPTIONS=(.*)", UNIT.read_text(encoding="utf-8"))
    assert command == "record"
    assert set(re.findall(r"--[a-z-]+", f"{given} {usual}")) <= options_of("record")


def test_the_service_may_read_ports_and_do_no_more() -> None:
    text = UNIT.read_text(encoding="utf-8")
    assert re.findall(r"^DeviceAllow=char-tty\w+ (\w+)$", text, re.MULTILINE) == ["r", "r", "r"]
    assert unit()["Service"]["DevicePolicy"] == "closed"


@LINUX_ONLY
def test_systemd_understands_the_service(tmp_path: Path) -> None:
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("systemd is not installed")
    here = tmp_path / UNIT.name
    command = unit()["Service"]["ExecStart"].split()[0]
    text = UNIT.read_text(encoding="utf-8").replace(command, "/bin/true")
    here.write_text(text, encoding="utf-8")
    instance = here.with_name(UNIT.name.replace("@", "@arm"))
    done = subprocess.run(
        [analyze, "verify", str(instance)], capture_output=True, text=True, check=False, timeout=600
    )
    complaints = [one for one in io.StringIO(done.stderr) if UNIT.name.split("@")[0] in one]
    assert complaints == []


def test_the_udev_rule_is_the_one_that_the_doctor_prescribes() -> None:
    assert RULE in RULES.read_text(encoding="utf-8").splitlines()
