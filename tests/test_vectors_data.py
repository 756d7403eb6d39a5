"""The test vectors under ``tests/vectors`` are what they say, judged without the sniffer package.

The checksums and lengths are worked out here a second time, from the manuals' formulae alone, so
that a wrong vector and a wrong decoder cannot agree.
"""

from __future__ import annotations

import functools
import operator
import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

from tests.vectors import WCK_SET_OPS

if TYPE_CHECKING:
    from collections.abc import Callable

VECTORS: Final = Path(__file__).parent / "vectors"
AT_LEAST: Final = {"mightyzap": 47, "lss": 150, "wck": 55, "rs30x": 43}
"""Vectors per protocol: none may get lost."""

KEYS: Final = frozenset(
    {"name", "source", "hex", "ascii", "kind", "after", "verdict", "note", "op", "servo_id"}
    | {"fields"}
)
GOOD: Final = "good"
BAD_SUM: Final = "bad_checksum"
BAD: Final = "bad"

MIGHTYZAP_OPS: Final = {
    0xF1: "echo",
    0xF2: "load_data",
    0xF3: "store_data",
    0xF4: "send_data",
    0xF5: "execution",
    0xF6: "factory_reset",
    0xF8: "restart",
    0x73: "symmetric_store",
}
WCK_WHEEL_OPS: Final = {1: "passive", 2: "break", 3: "wheel", 4: "wheel"}
LSS_ALIASES: Final = {"PD": "D", "CP": "CFP", "CD": "CFD", "RS": "RESET"}
LSS_COMMAND: Final = re.compile(rb"#(\d{1,3})([A-Z]+)(-?\d+)?((?:[A-Z]+\d+)*)\r")
LSS_REPLY: Final = re.compile(rb"\*(\d{1,3})?(?:(QMS)[!-~]+|(QF[PD])DIS|([A-Z]+)(?:-?\d+)?)\r")

EVERY_OP: Final = {
    "mightyzap": set(MIGHTYZAP_OPS.values()),
    "wck": {*WCK_SET_OPS.values(), *WCK_WHEEL_OPS.values(), "position_move", "status_read"}
    | {"sync_position_move"},
    "rs30x": {"write", "read", "flash_write", "reboot", "factory_reset", "long_write"},
}
"""What a good request must exist for; LSS has the words its page gives examples of."""


@dataclass(frozen=True, slots=True)
class Vector:
    """One example frame."""

    protocol: str
    name: str
    source: str
    frame: bytes
    kind: str
    verdict: str
    op: str
    after: bytes | None
    servo_id: int | None
    note: str
    keys: frozenset[str]
    fields: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.name


def load(protocol: str) -> list[Vector]:
    """Read one protocol's file."""
    text = (VECTORS / f"{protocol}.toml").read_text(encoding="utf-8")
    ascii_frames = protocol == "lss"

    def wire(value: str) -> bytes:
        return value.encode("ascii") if ascii_frames else bytes.fromhex(value)

    return [
        Vector(
            protocol=protocol,
            name=row["name"],
            source=row["source"],
            frame=wire(row["ascii" if ascii_frames else "hex"]),
            kind=row["kind"],
            verdict=row["verdict"],
            op=row["op"],
            after=wire(row["after"]) if "after" in row else None,
            servo_id=row.get("servo_id"),
            note=row.get("note", ""),
            keys=frozenset(row),
            fields=row.get("fields", {}),
        )
        for row in tomllib.loads(text)["vector"]
    ]


ALL: Final = [vector for protocol in AT_LEAST for vector in load(protocol)]
every_vector = pytest.mark.parametrize("vector", ALL, ids=str)


def xor(data: bytes) -> int:
    """Return the exclusive or of the bytes."""
    return functools.reduce(operator.xor, data, 0)


def by_sum(expected: int, got: int) -> str:
    """Return the verdict on a frame whose shape holds."""
    return GOOD if expected == got else BAD_SUM


def judge_mightyzap(frame: bytes, kind: str) -> str:
    """FFFFFF, ID, SIZE, then SIZE bytes; the checksum inverts the sum of all from ID."""
    del kind  # command and feedback look the same
    if frame[:3] != b"\xff\xff\xff" or len(frame) < 7 or frame[3] == 0xFF:
        return BAD
    if frame[4] < 2 or len(frame) != 5 + frame[4]:
        return BAD
    return by_sum(~sum(frame[3:-1]) & 0xFF, frame[-1])


def wck_length(frame: bytes) -> int:
    """Return the length of the command that begins so, 0 for none."""
    mode, module, data2 = frame[1] >> 5, frame[1] & 31, frame[2]
    if mode == 7:
        return {0x96: 5 + 2 * frame[3], 0xC8: 8}.get(data2, 6) if data2 in WCK_SET_OPS else 0
    if mode <= 4 and module == 31:
        return 4 + (data2 & 31)
    return 4


def judge_wck(frame: bytes, kind: str) -> str:
    """XOR from Data1, 7 bits of it; of a synchronized move the targets only. Replies are bare."""
    if kind == "response":
        return GOOD if len(frame) == 2 else BAD
    if len(frame) < 4 or frame[0] != 0xFF or len(frame) != wck_length(frame):
        return BAD
    synchronized = frame[1] >> 5 <= 4 and frame[1] & 31 == 31
    return by_sum(xor(frame[3 if synchronized else 1 : -1]) & 0x7F, frame[-1])


def judge_rs30x(frame: bytes, kind: str) -> str:
    """XOR from ID; Length * Count bytes of data, in a return packet Length, in a reset one more."""
    if frame == b"\x07":
        return GOOD if kind == "response" else BAD
    header = b"\xfd\xdf" if kind == "response" else b"\xfa\xaf"
    if len(frame) < 8 or frame[:2] != header:
        return BAD
    flags, address, length, count = frame[3:7]
    reset_with_data = flags & 0x10 and address == 0xFF and frame[7:-1] == b"\xff"
    if kind == "response" and count != 1:
        return BAD
    if len(frame) != 8 + length * count and not reset_with_data:
        return BAD
    return by_sum(xor(frame[2:-1]), frame[-1])


def judge_lss(frame: bytes, kind: str) -> str:
    """No checksum: the shape of the line is all there is."""
    shape = LSS_REPLY if kind == "response" else LSS_COMMAND
    return GOOD if shape.fullmatch(frame) else BAD


JUDGES: Final[dict[str, Callable[[bytes, str], str]]] = {
    "mightyzap": judge_mightyzap,
    "wck": judge_wck,
    "rs30x": judge_rs30x,
    "lss": judge_lss,
}


def op_mightyzap(frame: bytes) -> tuple[str, int | None]:
    """Name a command and its servo by the bytes."""
    return MIGHTYZAP_OPS[frame[5]], frame[3]


def op_wck(frame: bytes) -> tuple[str, int | None]:
    """Name a command and its module by the bytes."""
    mode, module, data2 = frame[1] >> 5, frame[1] & 31, frame[2]
    if mode <= 4:
        return ("sync_position_move", None) if module == 31 else ("position_move", module)
    if mode == 5:
        return "status_read", module
    if mode == 6:
        return WCK_WHEEL_OPS[data2 >> 4], None if module == 31 else module
    return WCK_SET_OPS[data2], frame[3] if data2 in {0xC8, 0xC9} else module


def op_rs30x(frame: bytes) -> tuple[str, int | None]:
    """Name a request and its servo by the bytes."""
    servo_id, flags, data = frame[2], frame[3], frame[7:-1]
    for bit, op in ((0x40, "flash_write"), (0x20, "reboot"), (0x10, "factory_reset")):
        if flags & bit:
            return op, servo_id
    if servo_id == 0:
        return "long_write", servo_id
    return "write" if data else "read", servo_id


def op_lss(frame: bytes) -> tuple[str, int | None]:
    """Name a command and its servo by the line."""
    match = LSS_COMMAND.fullmatch(frame)
    assert match
    word = match[2].decode()
    return LSS_ALIASES.get(word, word), int(match[1])


OPS: Final[dict[str, Callable[[bytes], tuple[str, int | None]]]] = {
    "mightyzap": op_mightyzap,
    "wck": op_wck,
    "rs30x": op_rs30x,
    "lss": op_lss,
}


@pytest.mark.parametrize("protocol", AT_LEAST)
def test_no_vector_got_lost(protocol: str) -> None:
    assert len([v for v in ALL if v.protocol == protocol]) >= AT_LEAST[protocol]


def test_names_are_unique() -> None:
    names = [vector.name for vector in ALL]
    assert sorted(set(names)) == sorted(names)


@pytest.mark.parametrize("protocol", EVERY_OP)
def test_every_command_of_the_manual_has_a_good_request(protocol: str) -> None:
    requests = (v for v in ALL if v.protocol == protocol and v.kind == "request")
    assert {v.op for v in requests if v.verdict == GOOD} == EVERY_OP[protocol]


@every_vector
def test_vector_is_well_formed(vector: Vector) -> None:
    assert vector.keys <= KEYS
    assert ("ascii" if vector.protocol == "lss" else "hex") in vector.keys
    assert re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)+", vector.name)
    assert vector.kind in {"request", "response"}
    assert vector.verdict in {GOOD, BAD_SUM, BAD}
    assert (vector.kind == "response") == (vector.after is not None)
    assert vector.note or vector.verdict == GOOD, "a wrong frame says what is wrong"


@every_vector
def test_source_names_a_manual_and_no_file(vector: Vector) -> None:
    assert re.search(r"Manual|Protocol|取扱説明書", vector.source)
    assert not re.search(r"seed|\.(txt|md|pdf)\b|^/", vector.source)


@every_vector
def test_verdict_agrees_with_the_manuals_formula(vector: Vector) -> None:
    found = JUDGES[vector.protocol](vector.frame, vector.kind)
    if vector.verdict == BAD and found == GOOD:
        # a frame that holds, printed in the wrong place: it must be no answer at all
        assert vector.frame == vector.after
    else:
        assert found == vector.verdict


@every_vector
def test_op_and_servo_agree_with_the_bytes(vector: Vector) -> None:
    if vector.kind == "request" and (vector.verdict != BAD or vector.protocol != "lss"):
        assert (vector.op, vector.servo_id) == OPS[vector.protocol](vector.frame)


@every_vector
def test_response_answers_a_good_request_of_its_file(vector: Vector) -> None:
    if vector.after is None:
        return
    asked = [
        v
        for v in ALL
        if (v.protocol, v.kind, v.frame) == (vector.protocol, "request", vector.after)
    ]
    assert asked
    assert {(v.op, v.verdict) for v in asked} == {(vector.op, GOOD)}


@every_vector
def test_reply_word_is_that_of_the_query(vector: Vector) -> None:
    if vector.protocol != "lss" or vector.kind != "response":
        return
    match = LSS_REPLY.fullmatch(vector.frame)
    assert match
    word = next(group for group in match.groups()[1:] if group).decode()
    assert word in {vector.op, vector.op.removeprefix("Q")}
    assert vector.servo_id == (int(match[1]) if match[1] else None)
