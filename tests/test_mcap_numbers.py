"""Numbers that two bytes of a varint do not hold are in the recording all the same."""

from __future__ import annotations

import numpy as np
import pytest

from sniffer.mcapfile.encoder import Encoder
from sniffer.mcapfile.rows import Blob, Heads, Loose
from sniffer.messages.recording_pb2 import Frame
from sniffer.messages.servo_state_pb2 import ServoState

IDS = (0, 1, 127, 128, 16383, 16384, 20000, 32767, -1)


def heads(count: int) -> Heads:
    numbers = np.arange(count)
    return Heads(np.ones(count, np.uint16), numbers.astype(np.uint32), numbers, numbers, numbers)


def bodies(parts: list[object]) -> dict[int, bytes]:
    """Return the messages of records by their sequence number."""
    out: dict[int, bytes] = {}
    for part in parts:
        data = part.data if isinstance(part, Loose) else [r.tobytes() for r in part.data]  # type: ignore[attr-defined]
        out.update((int.from_bytes(record[11:15], "little"), record[31:]) for record in data)
    return out


@pytest.mark.parametrize("times", [1, 20])
def test_a_number_of_any_size_is_read_as_it_was_written(times: int) -> None:
    servo_id = np.array(IDS * times)
    n = len(servo_id)
    zeros, at = np.zeros(n, np.int64), np.arange(n)
    names = ("t_start_ns", "t_end_ns", "offset", "length", "kind", "op_code", "direction")
    numbers = {**dict.fromkeys(names, zeros), "flags": np.array([0, 1, 70_000] * (n // 3))}
    told = Encoder(Frame).encode(
        heads(n),
        numbers,
        {"servo_id": (servo_id, servo_id >= 0)},
        ("op", zeros),
        Blob("data", bytes(i % 256 for i in range(n)), at, np.ones(n, np.int64)),
    )
    read = bodies([*told])
    assert sorted(read) == at.tolist()
    for row, body in read.items():
        frame = Frame.FromString(body)
        assert (frame.servo_id if frame.HasField("servo_id") else -1) == servo_id[row]
        assert frame.flags == numbers["flags"][row]
        assert (frame.data, frame.op) == (bytes([row % 256]), "0")


def test_an_enumerated_register_of_two_bytes_keeps_its_value() -> None:
    torque, there = np.array([1.0, 65535.0, 99999.0]), np.array([True, True, False])
    zeros = np.zeros(3, np.int64)
    told = Encoder(ServoState).encode(
        heads(3), {"offset": zeros, "kind": zeros}, {"torque_enable": (torque, there)}
    )
    read = {row: ServoState.FromString(body) for row, body in bodies([*told]).items()}
    assert [read[row].torque_enable for row in range(3)] == [1, 65535, 0]
    assert not read[2].HasField("torque_enable")
