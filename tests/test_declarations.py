"""Declarations of the packet family that are refused, and members that echo the code."""

from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path
from typing import Any, Final

import pytest
from construct import Byte, Bytes, Checksum, Const, GreedyBytes, RawCopy, Struct, this

from sniffer.decoding.detect import detect
from sniffer.ground.checksums import COMPLEMENT_SUM
from sniffer.ground.model import Chunk
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.packets import MUST, Command, Member
from sniffer.sources import open_source
from tests.streams.members import example

ID, LENGTH, CODE, REST = (
    "servo_id" / Byte,
    "length" / Byte,
    "code" / Byte,
    "params" / Bytes(this.length - 2),
)
SUM: Final = "checksum" / Checksum(Byte, COMPLEMENT_SUM, this.body.data)


def packet(*fields: Any, checksum: Any = SUM) -> Any:
    return Struct("header" / Const(b"\xff\xff"), "body" / RawCopy(Struct(*fields)), checksum)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"packet": packet("id" / Byte, LENGTH, CODE, REST)}, "one byte that is named servo_id"),
        ({"packet": packet(ID, LENGTH, "cmd" / Byte, REST)}, "one byte that is named code"),
        ({"packet": Struct(ID, LENGTH, CODE, REST, SUM)}, 'packet needs "body" / RawCopy'),
        ({"packet": packet(ID, LENGTH, CODE, REST, checksum=Byte)}, 'needs "checksum" / Checksum'),
        (
            {
                "packet": packet(
                    ID,
                    LENGTH,
                    CODE,
                    REST,
                    checksum="checksum" / Checksum(Byte, sum, this.body.data),
                )
            },
            "take one of sniffer.ground.checksums",
        ),
        (
            {"packet": packet(ID, LENGTH, CODE, "sums" / Bytes(2), REST)},
            "no plan for params <Bytes>",
        ),
        ({"feedback": Struct("data" / GreedyBytes)}, "feedback needs a field named error"),
        ({"feedback": Struct("error" / Byte)}, 'feedback needs "data" / GreedyBytes'),
        (
            {"echoes": True, "commands": {1: Command("get", Struct("x" / Byte), MUST, answer=1)}},
            "get may have 1 parameters, as its answer has",
        ),
    ],
)
def test_a_declaration_of_another_form_is_refused_with_what_to_write(
    changes: dict[str, Any], told: str
) -> None:
    with pytest.raises(TypeError, match=told):
        Member(dataclasses.replace(example("dynamixel1").FAMILY, **changes))


@pytest.fixture
def everyone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have all examples looked for beside what is built in."""
    names = ("dynamixel1", "dynamixel2", "feetech", "lx16a", "herkulex")
    them = [*PROTOCOLS.values(), *(example(name).PROTOCOL for name in names)]
    monkeypatch.setattr(PROTOCOLS, "candidates", lambda heard=None: them)


@pytest.mark.usefixtures("everyone")
@pytest.mark.parametrize("name", ["lx16a", "herkulex"])
def test_a_member_is_told_from_the_bytes_among_all_others(name: str) -> None:
    exchanges = importlib.import_module(f"tests.talks.{name}").TALK.exchanges
    said = b"".join(
        raw for e in exchanges if e.answers is not None for raw in (e.request, *e.answers)
    )
    found = detect([Chunk(said)])
    assert (found.protocol, found.certainty) == (name, "sure")


@pytest.mark.usefixtures("everyone")
@pytest.mark.parametrize("name", list(PROTOCOLS.built_in))
def test_no_member_takes_a_capture_from_those_that_are_built_in(name: str) -> None:
    for path in sorted((Path(__file__).parents[1] / "sample_captures").glob(f"{name}_*")):
        heard = [c for group in open_source(path) for c in group]
        assert detect(heard).protocol == name
