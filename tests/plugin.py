"""A protocol that a package brings: real servos speak no such thing, the tests of plug-ins do.

It is mightyZAP's with another header and a table of its own, so that the two cannot be mistaken for
each other. The package is laid on a path with what `pip` would have written beside it.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

import sniffer
from sniffer.protocols import PROTOCOLS
from tests.commands import talk

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


def _replaced(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, old
    return text.replace(old, new)


def write_module(folder: Path, *, said: str = "interface = 1\n    auto = True") -> None:
    """Write the package's code into a folder that is not there yet."""
    folder.mkdir(parents=True)
    for path in REAL.glob("*.py"):
        text = path.read_text(encoding="utf-8")
        text = text.replace("sniffer.protocols.mightyzap", folder.name)
        if path.name == "grammar.py":
            text = _replaced(text, 'b"\\xff\\xff\\xff"', 'b"\\xa5\\xa5\\xa5"')
        if path.name == "block.py":
            own = 'load_models(__import__("pathlib").Path(__file__).with_name("toy-a.toml"))'
            text = _replaced(text, 'load_models("mightyzap-l12", "mightyzap-12lf")', own)
        if path.name == "__init__.py":
            text = _replaced(text, 'name = "mightyzap"', f'name = "{NAME}"\n    {said}')
            text = text.replace('title = "IRROBOT mightyZAP (IR protocol)"', 'title = "Toy servos"')
            text += "\n\nPROTOCOL = MightyZap()\n"
        (folder / path.name).write_text(text, encoding="utf-8")
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
