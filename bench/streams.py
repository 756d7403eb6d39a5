"""Streams to measure on: polling at full load, with one byte in a thousand corrupted.

Frames are built by the grammars once, then their values vary in columns: building a million frames
one by one would take longer than all measurements.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from sniffer.ground.checksums import COMPLEMENT_SUM, XOR7, XOR8, Checksum

U8 = npt.NDArray[np.uint8]
SERVOS = 8


def _sums(rows: U8, checksum: Checksum, first: int, at: int) -> None:
    folded = checksum.fold.reduce(rows[:, first:at], axis=1, dtype=np.uint8)
    rows[:, at] = checksum.seal(folded)


def _wave(n: int, low: float, high: float, every: float) -> npt.NDArray[np.int64]:
    middle, swing = (low + high) / 2, (high - low) / 2
    wave: npt.NDArray[np.int64] = (middle + swing * np.sin(np.arange(n) / every)).astype(np.int64)
    return wave


def corrupted(rows: U8, share: float, seed: int) -> bytes:
    """Return the rows as one stream with ``share`` of its bytes altered."""
    rng = np.random.default_rng(seed)
    flat = rows.ravel()
    hit = rng.integers(0, len(flat), int(len(flat) * share))
    flat[hit] ^= rng.integers(1, 256, len(hit)).astype(np.uint8)
    return flat.tobytes()


def mightyzap(size: int, share: float = 0.001) -> bytes:
    """Load Data of 8C..93 from eight servos, answered."""
    one = bytes.fromhex("FFFFFF0004F28C0800") + bytes.fromhex("FFFFFF000A00") + bytes(9)
    n = size // len(one)
    rows = np.tile(np.frombuffer(one, np.uint8), (n, 1)).copy()
    ids = np.arange(n) % SERVOS + 1
    rows[:, 3] = rows[:, 12] = ids
    position, speed = _wave(n, 47, 4047, 500), _wave(n, 0, 2047, 90)
    for at, value in ((15, position), (17, speed), (19, _wave(n, 0, 2047, 40))):
        rows[:, at], rows[:, at + 1] = value & 255, value >> 8
    rows[:, 21], rows[:, 22] = 120, 40
    _sums(rows, COMPLEMENT_SUM, 3, 8)
    _sums(rows, COMPLEMENT_SUM, 12, 23)
    return corrupted(rows, share, 1)


def wck(size: int, share: float = 0.001) -> bytes:
    """Position moves and status reads of sixteen modules, answered."""
    n = size // 6
    rows = np.zeros((n, 6), np.uint8)
    turn = np.arange(n)
    rows[:, 0] = 0xFF
    rows[:, 1] = np.where(turn % 2, 5 << 5, 2 << 5) | (turn % 16)
    rows[:, 2] = _wave(n, 27, 227, 300)
    rows[:, 4] = turn * 7 % 40
    rows[:, 5] = rows[:, 2]
    _sums(rows, XOR7, 1, 3)
    return corrupted(rows, share, 2)


def rs30x(size: int, share: float = 0.001) -> bytes:
    """Reads of 42..59 (reply nibble 9) from eight servos, answered."""
    one = (
        bytes.fromhex("FAAF01090000010 0".replace(" ", ""))
        + bytes.fromhex("FDDF01002A1201")
        + bytes(19)
    )
    n = size // len(one)
    rows = np.tile(np.frombuffer(one, np.uint8), (n, 1)).copy()
    rows[:, 2] = rows[:, 10] = np.arange(n) % SERVOS + 1
    values = (
        (15, _wave(n, 0, 1500, 500)),
        (21, _wave(n, 10, 900, 60)),
        (25, _wave(n, 700, 740, 90)),
    )
    for at, value in values:
        rows[:, at], rows[:, at + 1] = value & 255, value >> 8
    rows[:, 23] = 40
    _sums(rows, XOR8, 2, 7)
    _sums(rows, XOR8, 10, 33)
    return corrupted(rows, share, 3)


def lss(size: int, share: float = 0.001) -> bytes:
    """Position, voltage, temperature and current queries of eight servos, answered, and moves."""
    lines: list[str] = []
    length = 0
    turn = 0
    while length < min(size, 200_000):
        who = turn % SERVOS + 1
        degrees = int(900 * np.sin(turn / 50))
        part = (
            f"#{who}D{degrees}\r#{who}QD\r*{who}QD{degrees - 7}\r"
            f"#{who}QV\r*{who}QV{11200 - turn % 90}\r"
            f"#{who}QT\r*{who}QT{400 + turn % 60}\r#{who}QC\r*{who}QC{turn * 7 % 900}\r"
        )
        lines.append(part)
        length += len(part)
        turn += 1
    once = "".join(lines).encode("ascii")
    whole = (once * (size // len(once) + 1))[:size]
    return corrupted(np.frombuffer(whole, np.uint8).copy(), share, 4)


STREAMS = {"mightyzap": mightyzap, "wck": wck, "rs30x": rs30x, "lss": lss}


def hostile(name: str, size: int) -> dict[str, bytes]:
    """Return streams made to hurt: noise, headers only, one byte only, frames inside frames."""
    rng = np.random.default_rng(7)
    header = {"mightyzap": b"\xff\xff\xff", "wck": b"\xff", "rs30x": b"\xfa\xaf", "lss": b"#"}[name]
    heavy = rng.integers(0, 256, size).astype(np.uint8)
    marks = np.frombuffer(header, np.uint8)
    for k, mark in enumerate(marks):
        where = rng.integers(0, size - len(marks), size // 5)
        heavy[where + k] = mark
    good = STREAMS[name](4096, 0.0)
    cut = len(good) // 3
    nested = (good[:cut] + header + good[cut:]) * (size // len(good) + 1)
    return {
        "noise": rng.integers(0, 256, size).astype(np.uint8).tobytes(),
        "one byte": header[:1] * size,
        "headers": header * (size // len(header)),
        "header-heavy": heavy.tobytes(),
        "nested": nested[:size],
    }
