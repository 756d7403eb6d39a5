"""Talk of the example protocols: built with their own grammars, answers in order, lost or odd."""

from __future__ import annotations

import functools
import importlib.util
import itertools
import sys
from pathlib import Path
from typing import Any, Final

from hypothesis import strategies as st

from tests.streams import KEPT, damaged

EXAMPLES: Final = Path(__file__).parents[2] / "examples" / "protocols"
NAMES: Final = ("dynamixel1", "dynamixel2", "feetech")
"""Those that read and write by address."""

ALL: Final = (*NAMES, "lx16a", "herkulex", "ics", "lktech", "cubemars", "mks")

BYTES: Final = [0xFF, 0xFF, 0xFD, 0xFD, 0, 1, 2, 3, 4, 5, 7, 0x1E, 0x24, 0x2A, 0x55, 0x83, 0xFE]


@functools.cache
def example(name: str) -> Any:
    """Return the module of an example, loaded from its file."""
    return loaded(EXAMPLES / name / f"sniffer_{name}.py")


def loaded(path: Path) -> Any:
    """Return the module that a file is."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


@functools.lru_cache(KEPT)
def packet(
    name: str, servo_id: int, code: int, params: bytes = b"", *, stuffed: bool = True
) -> bytes:
    """Build a packet with the grammar; ``stuffed`` False leaves the parameters as they are."""
    two = name == "dynamixel2"
    if two and stuffed:
        params = params.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    body = {
        "servo_id": servo_id,
        "length": len(params) + (3 if two else 2),
        "code": code,
        "params": params,
    }
    return bytes(example(name).PACKET.build({"body": {"value": body}}))


def status(name: str, servo_id: int, error: int, data: bytes = b"") -> bytes:
    """Build what a servo answers."""
    if name == "dynamixel2":
        return packet(name, servo_id, 0x55, bytes([error]) + data)
    return packet(name, servo_id, error, data)


def joint(answers: list[tuple[int, int, bytes]]) -> bytes:
    """Build what answers a fast read: (id, error, data) of each servo, a checksum between two."""
    parts = [bytes([error, servo_id]) + data for servo_id, error, data in answers]
    # what stands between is the CRC of all bytes so far; nobody but the servos looks at it
    params = b"\x12\x34".join(parts)
    return packet("dynamixel2", 254, 0x55, params, stuffed=False)


def number(name: str, value: int) -> bytes:
    """Return an address or a length as it stands in a packet."""
    return value.to_bytes(2 if name == "dynamixel2" else 1, "little")


_byte = st.one_of(st.sampled_from(BYTES), st.integers(0, 255))
_STUFFED: Final = (
    b"\xff\xff\xfd",
    b"\xff\xff\xfd\xfd",
    b"\x00\xff\xff\xfd\x01",
    b"\xff\xff\xff\xfd",
)


def _data(size: int) -> st.SearchStrategy[bytes]:
    odd = st.sampled_from(_STUFFED).map(lambda x: (x * size)[:size])
    return st.one_of(st.lists(_byte, min_size=size, max_size=size).map(bytes), odd)


_PLACES: Final = {
    "dynamixel1": [(36, 2), (36, 8), (3, 1), (16, 1), (43, 1), (0, 3), (30, 4), (250, 2)],
    "dynamixel2": [(132, 4), (126, 10), (7, 1), (68, 1), (144, 3), (0, 7), (0xFFFF, 2), (116, 4)],
    "feetech": [(56, 2), (56, 8), (5, 1), (8, 1), (62, 2), (42, 6), (57, 1), (3, 4)],
}
_ERRORS: Final = [0, 0, 0, 0, 1, 2, 3, 4, 5, 6, 8, 0x20, 0x24, 0x80]


@st.composite
def asked(draw: st.DrawFn, name: str) -> tuple[bytes, list[bytes]]:
    """Draw an instruction and its answers."""
    who = draw(st.sampled_from([1, 1, 1, 2, 3, 0, 254]))
    by = who if who != 254 else 1
    error = draw(st.sampled_from(_ERRORS))
    address, size = draw(st.sampled_from(_PLACES[name]))
    span = number(name, address) + number(name, size)
    told = [status(name, by, error)]
    commands = sorted(example(name).FAMILY.commands)
    match draw(st.sampled_from(["read", "read", "read", "write", "sync", "several", "other"])):
        case "read":
            data = draw(_data(size)) if draw(st.integers(0, 9)) else b""
            return packet(name, who, 2, span), [status(name, by, error, data)]
        case "write":
            code = draw(st.sampled_from([3, 3, 3, 4]))
            return packet(name, who, code, number(name, address) + draw(_data(size))), told
        case "sync":
            ids = draw(st.lists(st.sampled_from([1, 2, 3]), min_size=1, max_size=3))
            body = b"".join(bytes([i]) + draw(_data(size)) for i in ids)
            return packet(
                name, 254, 0x83, span + body + draw(st.sampled_from([b"", b"", b"\x01"]))
            ), []
        case "several":
            return draw(_several(name, span, size))
        case _:
            code = draw(st.one_of(st.sampled_from(commands), _byte))
            params = draw(st.lists(_byte, max_size=14).map(bytes))
            return packet(name, who, code, params), told


@st.composite
def _several(draw: st.DrawFn, name: str, span: bytes, size: int) -> tuple[bytes, list[bytes]]:
    """Draw a read of several servos, or a write with an address for each."""
    ids = draw(st.lists(st.sampled_from([1, 2, 3]), min_size=1, max_size=3))
    errors = [draw(st.sampled_from(_ERRORS)) for _ in ids]
    places = [draw(st.sampled_from(_PLACES[name])) for _ in ids]
    alike = [status(name, i, e, draw(_data(size))) for i, e in zip(ids, errors, strict=True)]
    each = [
        status(name, i, e, draw(_data(n))) for i, e, (_, n) in zip(ids, errors, places, strict=True)
    ]
    if name == "feetech":
        return packet(name, 254, 0x82, span + bytes(ids)), alike
    if name == "dynamixel1":
        body = b"".join(bytes([n, i, a]) for i, (a, n) in zip(ids, places, strict=True))
        return packet(name, 254, 0x92, b"\x00" + body), each
    spans = [number(name, a) + number(name, n) for a, n in places]
    match draw(st.sampled_from(["sync", "bulk", "fast", "fast bulk", "write", "ping"])):
        case "sync":
            return packet(name, 254, 0x82, span + bytes(ids)), alike
        case "fast":
            told = [(i, e, draw(_data(size))) for i, e in zip(ids, errors, strict=True)]
            return packet(name, 254, 0x8A, span + bytes(ids)), [joint(told)]
        case "fast bulk":
            told = [
                (i, e, draw(_data(n))) for i, e, (_, n) in zip(ids, errors, places, strict=True)
            ]
            body = b"".join(bytes([i]) + s for i, s in zip(ids, spans, strict=True))
            return packet(name, 254, 0x9A, body), [joint(told)]
        case "bulk":
            body = b"".join(bytes([i]) + s for i, s in zip(ids, spans, strict=True))
            return packet(name, 254, 0x92, body), each
        case "write":
            body = b"".join(
                bytes([i]) + s + draw(_data(n))
                for i, s, (_, n) in zip(ids, spans, places, strict=True)
            )
            return packet(name, 254, 0x93, body + draw(st.sampled_from([b"", b"", b"\x01"]))), []
        case _:
            return packet(name, 254, 1), [status(name, i, 0, b"\x06\x04\x26") for i in ids]


@st.composite
def conversation(draw: st.DrawFn, name: str) -> bytes:
    """Draw exchanges in a row: answered, lost, asked twice, answered twice, late."""
    out: list[bytes] = []
    late: list[bytes] = []
    for request, answers in draw(st.lists(asked(name), max_size=10)):
        out += [request] * draw(st.sampled_from([1, 1, 1, 1, 1, 2, 3]))
        kept = [a for a in answers if draw(st.integers(0, 6))]
        if draw(st.integers(0, 9)) == 0:
            late, kept = late + kept, []
        out += itertools.chain.from_iterable(
            [a] * draw(st.sampled_from([1, 1, 1, 2])) for a in kept
        )
        comes = draw(st.booleans())
        if late and comes:
            out.append(late.pop(0))
    return b"".join(out)


@st.composite
def stream(draw: st.DrawFn, name: str) -> bytes:
    """Draw conversations, noise made of meaningful bytes, and damage to it all."""
    noise = st.lists(_byte, max_size=12).map(bytes)
    talk = conversation(name)
    data = b"".join(draw(st.lists(st.one_of(talk, talk, talk, noise), max_size=4)))
    if draw(st.integers(0, 4)) == 0:
        data = data[draw(st.integers(0, 8)) :]
    return draw(damaged(data))
