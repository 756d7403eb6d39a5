"""The protocols under the conformance kit: each is held to its labelled talk (tests/talks)."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.protocols import PROTOCOLS
from sniffer.testing import Requirement, checks

if TYPE_CHECKING:
    from sniffer.testing import Talk

ROOT: Final = Path(__file__).parents[1]


def talk_of(name: str) -> Talk:
    """Return a protocol's labelled talk."""
    talk: Talk = importlib.import_module(f"tests.talks.{name}").TALK
    return talk


def protocols() -> dict[str, str]:
    """Return what is built in, and the plug-ins that are shown and have a talk, by file."""
    out = {name: name for name in PROTOCOLS.built_in}
    for path in sorted(ROOT.glob("examples/protocols/*/sniffer_*.py")):
        name = path.stem.removeprefix("sniffer_")
        if (ROOT / "tests" / "talks" / f"{name}.py").is_file():
            out[name] = str(path)
    return out


HELD: Final = [
    pytest.param(one, id=f"{name}: {one}")
    for name, protocol in protocols().items()
    for one in checks(protocol, talk_of(name))
]


@pytest.mark.parametrize("one", HELD)
def test_what_the_kit_holds_of_each_protocol(one: Requirement) -> None:
    one()
