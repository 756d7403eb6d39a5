"""Sentences that name arguments: the library says its own names, the command line its options."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

import sniffer
from sniffer.cli import cli
from sniffer.ground.naming import worded
from sniffer.ground.wording import Sentence, spelled
from tests.commands import within

if TYPE_CHECKING:
    from collections.abc import Callable

Capsys = pytest.CaptureFixture[str]
ROOT: Final = Path(sniffer.__file__).parent

OPTION: Final = re.compile(r"(?<![\w-])--[a-z]")
COMMAND: Final = re.compile(r"`[^`]*`|sniffer \w+ [^;]*")
"""What is to be typed as it stands may have options in it."""

FIELD: Final = re.compile(r"\{([a-z_|]+)(?::([^{}]*))?\}")

OTHERS: Final = (
    "anomalies/",  # the catalogue is a page about the commands; details are a contract
    "viewers/viewer.py",  # options of the Rerun viewer, a program of its own
    "viewers/companion/child.py",
    "ground/naming.py",  # what the command line calls arguments
    "sources/refusals.py",  # options of candump
)

ONE: Final = sniffer.PortSpec("arm", "/dev/ttyNothing", "lss")
BYTES: Final = b"hello world, this is no dump\n"


def raised(call: Callable[[], object]) -> sniffer.SnifferError:
    with pytest.raises(sniffer.SnifferError) as caught:
        call()
    return caught.value


def recorded(*ports: sniffer.PortSpec, pair: bool = False, **files: object) -> Callable[[], object]:
    made = sniffer.Files(**{"recording": Path("x.mcap"), **files})  # type: ignore[arg-type]
    return lambda: sniffer.record(ports, made, listening=sniffer.Listening(pair=pair))


def scenario(**said: object) -> Callable[[], object]:
    return lambda: sniffer.Scenario("mightyzap", **said)  # type: ignore[arg-type]


NO_DUMP: Final = (
    "there.mcap: this is text, but no dump that is read ('hello world, this is no dump'): give raw "
    "bytes, or a dump made by `xxd` or `hexdump -C`; if the text itself is the traffic, say"
)
UNTOLD: Final = (
    "cannot tell the protocol of these 40 bytes (none explains any of them): name it with"
)
PORT: Final = "/dev/ttyNothing=lss"
BOTH: Final = {
    "keep": (
        recorded(ONE, keep=3),
        ["record", PORT, "-o", "x.mcap", "--keep", "3"],
        "`keep` goes with `rotate_bytes` or `rotate_ns`",
        "--keep goes with --rotate",
    ),
    "rotate": (
        recorded(ONE, recording=None, rotate_ns=10**9),
        ["record", PORT, "-o", "x.jsonl", "--rotate", "1s"],
        "`rotate_bytes` or `rotate_ns` and `keep` are about a recording: `recording='x.mcap'`",
        "--rotate and --keep are about a recording: -o x.mcap",
    ),
    "pair": (
        recorded(ONE, pair=True),
        ["record", PORT, "-o", "x.mcap", "--pair"],
        "`pair=True` takes two ports: the controller's wire, then the servos'",
        "--pair takes two ports: the controller's wire, then the servos'",
    ),
    "there already": (
        recorded(ONE, recording=Path("there.mcap")),
        ["record", PORT, "-o", "there.mcap"],
        "there.mcap is there already: choose another name, or `overwrite=True`",
        "there.mcap is there already: choose another name, or --force",
    ),
    "convert": (
        lambda: sniffer.convert("there.mcap", [Path("x.jsonl")]),
        ["decode", "there.mcap", "-o", "x.jsonl", "--quiet"],
        f"{NO_DUMP} `input_format='bin'`",
        f"{NO_DUMP} --input-format bin",
    ),
    "decimal": (
        lambda: sniffer.decode("numbers"),
        ["decode", "numbers"],
        "numbers: this looks like decimal numbers: say `input_format='decimal'` (or hex)",
        "numbers: this looks like decimal numbers: say --input-format decimal (or hex)",
    ),
    "undecided": (
        lambda: sniffer.decode("noise"),
        ["decode", "noise"],
        f"{UNTOLD} `protocol`, or check that this is a bus capture",
        f"{UNTOLD} --protocol, or check that this is a bus capture",
    ),
    "respond": (
        scenario(respond=True, rate_hz=5),
        ["simulate", "mightyzap", "--respond", "--rate", "5"],
        "`respond` plays no controller: `rate_hz` and `full` say nothing",
        "--respond plays no controller: --rate and --full say nothing",
    ),
    "absent": (
        scenario(models={9: "mightyzap-12lf"}),
        ["simulate", "mightyzap", "--model", "9=mightyzap-12lf"],
        "`models`: 9=mightyzap-12lf: that servo is not on the bus, only 1, 2, 3",
        "--model: 9=mightyzap-12lf: that servo is not on the bus, only 1, 2, 3",
    ),
    "no tap": (
        lambda: sniffer.play(
            sniffer.Scenario("lss", respond=True), tap=False, tap_link=Path("tap")
        ),
        ["simulate", "lss", "--respond", "--no-tap", "--tap-link", "tap"],
        "`tap_link` needs the tap: leave `tap=False` out",
        "--tap-link needs the tap: leave --no-tap out",
    ),
}
"""By what is wrong: a library call, a command line, and what each of them is told."""


@pytest.mark.parametrize("case", BOTH)
def test_a_mistake_is_told_in_the_words_of_who_made_it(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capsys
) -> None:
    call, command, in_python, on_the_line = BOTH[case]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.mcap").write_bytes(BYTES)
    (tmp_path / "numbers").write_text("[10, 25, 12, 34, 90, 28, 99, 20]\n" * 3)
    (tmp_path / "noise").write_bytes(b"\x00" * 40)
    error = raised(call)
    assert str(error) == in_python
    assert worded(error) == on_the_line
    ran = within(capsys, *command)
    assert (ran.status, ran.complaint) == (2, on_the_line)


def test_a_sentence_within_a_sentence_is_said_in_the_same_words() -> None:
    inner = sniffer.InputError(Sentence("say {input_format:bin}"))
    outer = Sentence("{name}: {error}", name="a{b}", error=inner)
    assert str(outer) == "a{b}: say `input_format='bin'`"
    assert worded(outer) == "a{b}: say --input-format bin"
    assert worded("plain {text}") == "plain {text}"
    assert spelled(ValueError("x"), lambda names, value: "") == "x"


def test_what_the_command_line_calls_an_argument_is_an_option_that_it_has() -> None:
    options = {
        o for c in cli.commands.values() for p in c.params for o in p.opts + p.secondary_opts
    }
    named = {argument for file in ROOT.rglob("*.py") for argument in arguments(file)}
    assert {"{keep}", "{rotate_bytes|rotate_ns}", "{overwrite:True}", "{tap:False}"} <= named
    for argument in named:
        assert worded(Sentence(argument)).split()[0] in options, argument


def arguments(file: Path) -> set[str]:
    """Return the fields of a file's sentences that no value is given for."""
    text = file.read_text(encoding="utf-8")
    if "Sentence(" not in text:
        return set()
    nodes = list(ast.walk(ast.parse(text)))
    named = [n for n in nodes if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)]
    calls = [n for n in named if ast.unparse(n.func) == "Sentence"]
    given = {keyword.arg for call in calls for keyword in call.keywords}
    names = {call.args[0].id for call in calls if isinstance(call.args[0], ast.Name)}
    said = [
        n.value for n in nodes if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) in names
    ]
    texts = [n.value for n in (*said, *(c.args[0] for c in calls)) if isinstance(n, ast.Constant)]
    fields = [field for text in texts for field in FIELD.findall(str(text))]
    return {f"{{{n}:{s}}}" if s else f"{{{n}}}" for n, s in fields if n not in given}


@pytest.mark.parametrize(
    "room", sorted(path.name for path in ROOT.iterdir() if path.name[0] != "_")
)
def test_no_option_is_named_but_by_the_command_line(room: str) -> None:
    files = sorted((ROOT / room).rglob("*.py")) or [ROOT / room]
    for file in files:
        place = file.relative_to(ROOT).as_posix()
        if not place.startswith(("cli/", *OTHERS)):
            names_no_option(file, place)


def names_no_option(file: Path, place: str) -> None:
    source = file.read_text(encoding="utf-8")
    if not OPTION.search(source):  # most files: they need no parsing
        return
    code = ast.parse(source)
    documentation = {
        id(node.value)
        for node in ast.walk(code)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(code):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = COMMAND.sub("", node.value)
            said = id(node) not in documentation and OPTION.search(text)
            assert not said, f"{place}:{node.lineno} says {node.value!r}"
