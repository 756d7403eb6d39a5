"""A protocol that a package brings: real servos speak no such thing, the tests of plug-ins do.

It is mightyZAP's with another header and a table of its own, so that the two cannot be mistaken for
each other. The package is laid on a path with what `pip` would have written beside it.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import sniffer
from sniffer.protocols import PROTOCOLS
from tests.commands import Ran, talk, within

if TYPE_CHECKING:
    import pytest

NAME: Final = "toyservo"
PACKAGE: Final = "sniffer-toyservo 1.2"
HEADER: Final = b"\xa5\xa5\xa5"
_REAL_HEADER: Final = re.compile(rb"\xff\xff\xff(?!\xff)")
REAL: Final = Path(sniffer.__file__).parent / "protocols" / "mightyzap"

TABLE: Final = """\
model = "{model}"
protocol = "{protocol}"
title = "Toy servo"
source = "Toy manual 1"

[[register]]
name = "goal_position"
address = 0x86
type = "u16le"
unit = "deg"
scale = {scale}
quantity = "goal_position"
role = "commanded"
source = "Toy manual 1, 0x86"

[[register]]
name = "angle"
address = 0x8C
type = "u16le"
unit = "deg"
scale = {scale}
quantity = "position"
role = "measured"
access = "r"
source = "Toy manual 1, 0x8C"

[[register]]
name = "supply"
address = 0x92
unit = "V"
scale = 0.1
quantity = "voltage"
role = "measured"
access = "r"
source = "Toy manual 1, 0x92"
"""


def table(model: str = "toy-a", protocol: str = NAME, scale: float = 0.5) -> str:
    """Return a register table as TOML."""
    return TABLE.format(model=model, protocol=protocol, scale=scale)


def speech(cycles: int, seed: int = 1) -> bytes:
    """Return what a controller and three toy servos say."""
    # a checksum may be FF, an id never is: the header is the last three of a run
    return _REAL_HEADER.sub(HEADER, talk(cycles, seed))


_OWN_TABLE: Final = 'load_models(__import__("pathlib").Path(__file__).with_name("toy-a.toml"))'
_CHANGES: Final = (
    (r'b"\\xff\\xff\\xff"', r'b"\\xa5\\xa5\\xa5"'),
    (r'load_models\("mightyzap-l12", "mightyzap-12lf"\)', _OWN_TABLE),
    (r'\bname( ?= ?)"mightyzap"', rf'name\1"{NAME}"'),
    (r'title( ?= ?)"IRROBOT mightyZAP \(IR protocol\)"', r'title\1"Toy servos"'),
)
"""What makes another protocol of mightyZAP's code: each stands in it once."""

AUTO: Final = "PROTOCOL.interface = 1\nPROTOCOL.auto = True\n"
"""Behind the code: what makes a plug-in of a protocol."""


def write_module(folder: Path, *, behind: str = AUTO) -> None:
    """Write the package's code into a folder that is not there yet."""
    folder.mkdir(parents=True)
    found: Counter[str] = Counter()
    for path in REAL.glob("*.py"):
        text = path.read_text(encoding="utf-8").replace("sniffer.protocols.mightyzap", folder.name)
        for old, new in _CHANGES:
            text, times = re.subn(old, new, text)
            found[old] += times
        if path.name == "__init__.py":
            made = "" if "PROTOCOL: Final = " in text else "\n\nPROTOCOL = MightyZap()\n"
            text += made + behind
        (folder / path.name).write_text(text, encoding="utf-8")
    assert found == Counter(old for old, _ in _CHANGES)
    (folder / "toy-a.toml").write_text(table(), encoding="utf-8")


def write_facts(path: Path, entries: str, *, package: str = PACKAGE) -> None:
    """Write what an installation leaves beside the code: name, version and entry points."""
    name, version = package.split()
    facts = path / f"{name.replace('-', '_')}-{version}.dist-info"
    facts.mkdir(parents=True)
    head = f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n"
    (facts / "METADATA").write_text(head, encoding="utf-8")
    text = f"[sniffer.protocols]\n{entries}\n"
    (facts / "entry_points.txt").write_text(text, encoding="utf-8")


def install(path: Path) -> dict[str, str]:
    """Install the plug-in into a folder; return the environment in which it is found."""
    write_module(path / NAME)
    write_facts(path, f"{NAME} = {NAME}:PROTOCOL")
    return {"PYTHONPATH": str(path)}


def visible(patch: pytest.MonkeyPatch, path: Path | None = None) -> None:
    """Let this process see the plug-ins of a folder, and forget all of them afterwards."""
    if path is not None:
        patch.syspath_prepend(path)
    patch.setattr(PROTOCOLS, "_plugins", None)
    for kept in ("_loaded", "_files", "_origins", "_broken"):
        patch.setattr(PROTOCOLS, kept, dict(getattr(PROTOCOLS, kept)))


def as_file(path: Path) -> Path:
    """Write the plug-in as a file, with its package beside it; return the file."""
    write_module(path / "toycode")
    file = path / "toy_protocol.py"
    file.write_text("from toycode import PROTOCOL as PROTOCOL\n", encoding="utf-8")
    return file


Command = Callable[..., Ran]
"""Runs a command within this process."""


def runs(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, path: Path | None
) -> Command:
    """Return what runs a command that sees the plug-ins of a folder."""

    def run(*arguments: str | Path) -> Ran:
        with monkeypatch.context() as patch:
            visible(patch, path)
            return within(capsys, *arguments)

    return run
