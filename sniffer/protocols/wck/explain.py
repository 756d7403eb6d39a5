"""Why no frame claims some bytes: plain Python, for the rare stretch of damage."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.checksums import XOR7
from sniffer.ground.model import Gap
from sniffer.ground.patterns import later
from sniffer.protocols.wck import controller
from sniffer.protocols.wck.block import (
    DATA1,
    DATA2,
    ID_BITS,
    KIND,
    MOTION,
    MOVE_10BIT,
    NONE,
    PARAMS,
    READ_10BIT,
    SYNC,
)
from sniffer.protocols.wck.grammar import HEADER, MOTION_MOST, OPS, REPLY, UNKNOWN_OP

if TYPE_CHECKING:
    from collections.abc import Iterator

_HEADER_BYTE: Final = bytes([HEADER])
_HEADER: Final = later(rb"\xff(?=[^\xff])", re.DOTALL)
"""The last FF of a row of them."""

_STARTS: Final = KIND.reshape(256, 256)
"""Row of OPS by Data2, Data1."""


def explain(run: bytes, start: int, *, awaited: bool) -> list[Gap]:
    """Say why no frame claims these bytes; the pieces join to the whole of them.

    ``awaited``: a command that has a reply stands right before them.
    """
    if awaited and len(run) == 1 and run[0] != HEADER:
        return [
            Gap(start, 1, "truncated", {"have": 1, "need": REPLY, "fields": {"reply": run.hex()}})
        ]
    packet = run.find(controller.HEADER)
    if packet >= 0:
        found = controller.explain(run[packet:], start + packet)
        rest = found.start + found.length - start
        before = explain(run[:packet], start, awaited=awaited) if packet else []
        behind = explain(run[rest:], start + rest, awaited=False) if rest < len(run) else []
        return [*before, found, *behind]
    out: list[Gap] = []
    done = 0
    for at, length, reason, detail in _torn_frames(run):
        if at > done:
            out.append(Gap(start + done, at - done, "noise"))
        out.append(Gap(start + at, length, reason, detail))
        done = at + length
    if done < len(run):
        out.append(Gap(start + done, len(run) - done, "noise"))
    return out


def _torn_frames(run: bytes) -> Iterator[tuple[int, int, str, dict[str, Any]]]:
    """Yield (offset, length, reason, detail) of what may have been meant as a command.

    Four bytes and a sum of seven bits are weak evidence, so position has to help. Commands are
    looked for from the run's first header on, as long as no more than a reply lies between two of
    them, and once more at its last header. In a muddle between nothing is claimed.
    """
    n, done = len(run), -1
    for match in _HEADER.finditer(run):
        at = match.start()
        if done >= 0 and at - done > REPLY:
            break
        found = _one(run, at)
        if found is None:
            break
        yield at, *found
        done = at + found[0]
    last = run.rfind(_HEADER_BYTE)
    # An FF with nothing behind it is a stray one as well as a header: noise.
    if max(done, 0) <= last < n - 1 and (found := _one(run, last)) is not None:
        yield last, *found


def _one(run: bytes, at: int) -> tuple[int, str, dict[str, Any]] | None:
    """Judge the bytes from a header to before the next; None for noise.

    "damaged" asks for a command of the table, and behind it for the next header, or the end, after
    no more than a reply.
    """
    following = run.find(_HEADER_BYTE, at + 1)
    stop = following if following >= 0 else len(run)
    have = stop - at
    if have == PARAMS - 1:
        starts = stop == len(run) and bool((_STARTS[:, run[at + DATA1]] != NONE).any())
        return (have, "truncated", {"have": have}) if starts else None
    kind = int(_STARTS[run[at + DATA2], run[at + DATA1]])
    if kind == NONE:
        return None
    need = OPS[kind].length
    if kind == SYNC:
        need += run[at + DATA2] & ID_BITS
    if kind == MOTION:
        if have <= PARAMS:
            return have, "truncated", {"have": have}
        need += 2 * run[at + PARAMS]
        if run[at + PARAMS] > MOTION_MOST:
            return _overlong(run, at, need)
    if need > have:
        if kind == UNKNOWN_OP:
            return None
        fields = _as_read(run[at:stop], kind)
        return have, "truncated", {"have": have, "need": need, "fields": fields}
    summed = run[at + (PARAMS if kind == SYNC else DATA1) : at + need - 1]
    expected, got = XOR7(summed), run[at + need - 1]
    if have - need > REPLY or expected == got:
        return None
    detail = {"checksum_expected": expected, "checksum_got": got}
    return need, "damaged", {**detail, "fields": _as_read(run[at : at + need - 1], kind)}


def _overlong(run: bytes, at: int, need: int) -> tuple[int, str, dict[str, Any]] | None:
    """Judge a motion with more words than there are: only its own checksum makes it one."""
    end = at + need
    if end > len(run) or XOR7(run[at + DATA1 : end - 1]) != run[end - 1]:
        return None
    most = {"motion_count": run[at + PARAMS], "motion_count_most": MOTION_MOST}
    return need, "damaged", {**most, "fields": _as_read(run[at : end - 1], MOTION)}


def _as_read(raw: bytes, kind: int) -> dict[str, Any]:
    """Return the fields of a frame that does not hold, without its checksum, as they stand."""
    out: dict[str, Any] = {}
    if kind in (MOVE_10BIT, READ_10BIT):
        if len(raw) > PARAMS:
            out["servo_id"] = raw[PARAMS]
    elif raw[DATA1] & ID_BITS < ID_BITS:
        out["servo_id"] = raw[DATA1] & ID_BITS
    if kind == UNKNOWN_OP:
        out["op"] = f"unknown_{raw[DATA2]:02x}"
    else:
        out["op"] = OPS[kind].name
    out["data"] = raw[DATA2:].hex()
    return out
