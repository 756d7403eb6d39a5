"""The protocols under the conformance kit, and the kit under faults that it must find."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

import pytest

from sniffer.protocols import PROTOCOLS
from sniffer.testing import Requirement, checks

if TYPE_CHECKING:
    from sniffer.testing import Talk


def talk_of(name: str) -> Talk:
    """Return a protocol's labelled talk."""
    talk: Talk = importlib.import_module(f"tests.talks.{name}").TALK
    return talk


def held(name: str) -> list[Requirement]:
    """Return everything that is held of a protocol."""
    return checks(PROTOCOLS[name], talk_of(name))


@pytest.mark.parametrize(
    "one", [pytest.param(c, id=f"{n}: {c}") for n in PROTOCOLS for c in held(n)]
)
def test_what_the_kit_holds_of_each_protocol(one: Requirement) -> None:
    one()
