"""One packet that answers for all servos of a read: Dynamixel 2's fast sync read."""

from __future__ import annotations

import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.model import Chunk
from tests.members import heard, outcomes, protocol, values
from tests.records import batches, records
from tests.streams.members import joint, packet


def test_one_packet_that_answers_for_all_gives_each_servo_its_values() -> None:
    ask = packet("dynamixel2", 254, 0x8A, b"\x84\x00\x04\x00\x03\x07\x04")
    data = [(3, b"\xa6\x00\x00\x00"), (7, b"\x1f\x08\x00\x00"), (4, b"\xff\x03\x00\x00")]
    answer = joint([(who, 0, x) for who, x in data])
    assert answer[5:7] == b"\x19\x00"  # as the manual's example of three servos has it: 25
    batch = heard("dynamixel2", ask, answer)
    assert outcomes(batch) == ["ok", "ok", "ok"]  # of each servo that was asked
    assert values("dynamixel2", batch) == [
        (3, "present_position", 14.59),
        (7, "present_position", 182.725),
        (4, "present_position", 89.912),
    ]


@pytest.mark.parametrize("cut", [0, 1, 4])
@pytest.mark.parametrize("who", [254, 3])
def test_the_oracle_reads_one_packet_that_answers_for_all_as_the_columns_do(
    who: int, cut: int
) -> None:
    ask = packet("dynamixel2", 254, 0x8A, b"\x84\x00\x04\x00\x03\x07\x04")
    data = [(3, b"\xa6\x00\x00\x00"), (7, b"\x1f\x08\x00\x00"), (4, b"\xff\x03\x00\x00"[cut:])]
    whole = joint([(servo, 0, x) for servo, x in data])
    # who answers for all has the id of all; a servo's own, or a byte too few, answers nobody
    answer = packet("dynamixel2", who, 0x55, whole[8:-2], stuffed=False)
    chunks, p = [Chunk(ask + answer)], protocol("dynamixel2")
    got, want = records(batches(Decoder(p), [chunks])), Reference(p).decode(chunks)
    assert (got.frames, got.transactions) == (want.frames, want.transactions)
    assert got.samples == want.samples
    assert len(got.samples) == (3 if who == 254 and not cut else 0)


def test_stuffing_is_not_taken_out_of_what_answers_for_all() -> None:
    ask = packet("dynamixel2", 254, 0x8A, b"\x84\x00\x04\x00\x01\x02")
    answer = joint([(1, 0, b"\xff\xff\xfd\xfd"), (2, 0, b"\x01\x00\x00\x00")])
    batch = heard("dynamixel2", ask, answer)
    assert batch.values.raw.tolist() == [
        int.from_bytes(b"\xff\xff\xfd\xfd", "little", signed=True),
        1,
    ]
