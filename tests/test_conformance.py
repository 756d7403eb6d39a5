"""The protocols under the conformance kit: each is held to its labelled talk (tests/talks)."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.protocols import PROTOCOLS
from sniffer.testing import Requirement, Talk, checks
from tests.lists import each_in_turn
from tests.streams.members import ALL, example
from tests.talks import feetech

if TYPE_CHECKING:
    from sniffer.protocols.base import BusProtocol

TALKS: Final = Path(__file__).parent / "talks"


def talk_of(name: str) -> Talk:
    """Return a protocol's labelled talk."""
    talk: Talk = importlib.import_module(f"tests.talks.{name}").TALK
    return talk


def protocols() -> dict[str, BusProtocol]:
    """Return what is built in, and the examples that have a talk."""
    shown = {n: example(n).PROTOCOL for n in ALL if (TALKS / f"{n}.py").is_file()}
    return {**PROTOCOLS, **shown}


HELD: Final = [
    pytest.param(one, id=f"{name}: {one}")
    for name, protocol in protocols().items()
    for one in checks(protocol, talk_of(name))
]


@each_in_turn(10, "one", HELD)
def test_what_the_kit_holds_of_each_protocol(one: Requirement) -> None:
    one()


def test_servos_of_the_other_table_state_their_numbers_with_the_high_byte_first() -> None:
    other = Talk(feetech.speaks("scs009").table(), model="scs009")
    first = next(c for c in checks(example("feetech").PROTOCOL, other) if "answered" in c.name)
    first()
