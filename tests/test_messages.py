"""The messages of recordings: what is generated, declared and held in tables agrees."""

from __future__ import annotations

import subprocess
import sys
from typing import TYPE_CHECKING, Any

from sniffer.ground import codes, model
from sniffer.ground.model import Clock, Direction, MarkKind
from sniffer.ground.registers import read_table, schema_path
from sniffer.mcapfile.fields import state_field
from sniffer.messages.recording_pb2 import Anomaly, Kind, Transaction
from sniffer.messages.recording_pb2 import Clock as ClockMessage
from sniffer.messages.recording_pb2 import Direction as DirectionMessage
from sniffer.messages.recording_pb2 import Mark as MarkMessage
from sniffer.messages.servo_state_pb2 import ServoState

if TYPE_CHECKING:
    from pathlib import Path


def test_every_quantity_of_the_register_tables_has_a_field() -> None:
    known = {f.name for f in ServoState.DESCRIPTOR.fields}
    for path in sorted(schema_path("registers").glob("*.toml")):
        for register in read_table(path.stem)[1]:
            field = state_field(register)
            assert field is None or field in known, f"{path.name}: {register.name} needs {field}"


def test_numbers_in_the_schemas_are_those_of_the_model() -> None:
    def names(enum: Any, prefix: str = "") -> dict[str, int]:
        return {k.removeprefix(prefix).lower(): v for k, v in enum.items()}

    assert names(Transaction.Outcome) == {n: i for i, n in enumerate(codes.OUTCOMES)}
    assert names(Kind) == {n: i for i, n in enumerate(codes.KINDS)}
    assert names(Anomaly.Severity) == {s.name.lower(): s.value for s in model.Severity}
    assert names(ClockMessage, "CLOCK_") == {c.name.lower(): c.value for c in Clock}
    assert names(MarkMessage.Kind) == {"unknown": 0, **{k.name.lower(): k.value for k in MarkKind}}
    assert names(DirectionMessage, "DIRECTION_") == {d.name.lower(): d.value for d in Direction}


def test_the_generated_messages_are_those_of_the_schemas(tmp_path: Path) -> None:
    folder = schema_path("messages")
    command = [sys.executable, "-m", "grpc_tools.protoc", f"-Isniffer/messages={folder}"]
    command += [f"--python_out={tmp_path}", *map(str, sorted(folder.glob("*.proto")))]
    subprocess.run(command, check=True)
    for made in sorted(tmp_path.glob("sniffer/messages/*_pb2.py")):
        there = folder.parents[1] / "sniffer" / "messages" / made.name
        assert embedded(there) == embedded(made), "run `make schemas`"


def embedded(generated: Path) -> list[str]:
    """Return the file's descriptor; the lines around it depend on protoc's version."""
    lines = generated.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if "AddSerializedFile" in line]
