"""RoboBuilder's controller (RBC) on the same line: its packets, in both directions.

    FF FF AA 55 AA 55 37 BA | TYPE | PLATFORM | SIZE, 4 bytes, high first | CONTENTS | XOR

A PC speaks to the modules through the controller: it puts it into direct control mode by a packet
of this kind, speaks wCK, and ends the mode with the command ``rbc_direct_control_end``. Nothing in
a packet tells whether it asks or answers: one right behind a request of its type is its answer.

The maker's document (RBC protocol 1.13) is not at hand: all of this is as third-party clients
(PCremote of philleveridge, the "homebrew OS" for the controller) write and read it.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from construct import Byte, Bytes, Check, Checksum, Const, RawCopy, Struct, this

from sniffer.ground.checksums import XOR8
from sniffer.ground.framing import Block, candidates
from sniffer.ground.model import I64, Gap, Mask
from sniffer.ground.plan import plan_of

if TYPE_CHECKING:
    from collections.abc import Mapping

HEADER: Final = bytes.fromhex("FFFFAA55AA5537BA")

CONTENTS_MOST: Final = 64
"""Longest contents believed, in bytes. The longest that clients know, zero positions, has 19; files
are downloaded in longer ones, which stay gaps."""

PACKET: Final = Struct(
    "header" / Const(HEADER),
    "type" / Byte * "what it is about",
    "platform" / Byte,
    "size_3" / Byte,
    "size_2" / Byte,
    "size_1" / Byte,
    "size" / Byte * "bytes of the contents",
    Check(this.size_3 == 0),
    Check(this.size_2 == 0),
    Check(this.size_1 == 0),
    Check(this.size <= CONTENTS_MOST),
    "contents" / RawCopy(Bytes(this.size)),
    "checksum" / Checksum(Byte, XOR8, this.contents.data),
)

PLAN: Final = plan_of(PACKET)
OVERHEAD: Final = PLAN.tail_at + 1
LONGEST: Final = OVERHEAD + CONTENTS_MOST
TYPE_AT: Final = PLAN.at["type"]

BASE: Final = 512
"""``Frames.op`` of a packet is this plus its type."""

TYPES: Final[Mapping[int, str]] = MappingProxyType(
    {
        0x0B: "read_zero_positions",
        0x0C: "read_serial_number",
        0x0E: "set_zero_positions",
        0x0F: "read_free_memory",
        0x10: "direct_control_begin",
        0x12: "read_firmware_version",
        0x14: "play_motion",
        0x15: "play_sound",
        0x16: "read_distance",
        0x17: "wait_for_sound",
        0x18: "wait_for_button",
        0x19: "wait_for_remote_control",
        0x1A: "read_acceleration",
        0x1E: "read_execution_status",
        0x1F: "erase_memory",
    }
)
"""By TYPE. Source: third-party code, see above."""


def op_name(op: int) -> str:
    """Return what a packet is about."""
    return f"rbc_{TYPES.get(op - BASE, f'{op - BASE:02x}')}"


def is_packet(raw: bytes) -> bool:
    """Tell a packet from the wCK commands and replies."""
    return raw.startswith(HEADER)


def find(block: Block) -> tuple[I64, I64, I64]:
    """Return starts and ends of packets that hold, and starts that wait for bytes."""
    # FF FF AA 55 at the end of an open block may be a packet's first half, but no plan can say so:
    # it needs 14 bytes to read a length. So each of the last 13 places is asked whether what stands
    # there is the header's beginning, or the header with too little behind it. A single FF, or two,
    # is left to wCK: there they begin a command, and framing waits for it anyway.
    start = end = waiting = np.empty(0, np.int64)
    if HEADER in block.data.tobytes():  # rare: most buses never see one
        start, end, waiting = candidates(PLAN, block)
    n = block.n
    tail = block.data[max(n - PLAN.prefix + 1, 0) :].tobytes()
    for k in range(len(tail), 2, -1):  # of one or two bytes, wCK's own header waits
        begun = tail[-k:]
        torn = HEADER.startswith(begun) or begun.startswith(HEADER)
        if torn and np.all(block.open(block.limit(np.array([n - k])))):
            waiting = np.append(waiting, n - k)
    return start, end, waiting


def answers(block: Block, start: I64, end: I64, is_one: Mask, op: I64) -> Mask:
    """Tell which packets answer the one right before them: of its type, and itself no answer."""
    # Packets of type 10 (begin) and 12 (version), with a wCK read and its reply between:
    #
    #     row       0   1   2   3   4   5   6
    #     type      10  10  -   -   12  12  12
    #     follows   0   1   0   0   0   1   1      like the packet right before it
    #     first     0   0   2   3   4   4   4      where the row of likes begins
    #     answers   0   1   0   0   0   1   0      every second of a row
    #
    # An answer answers a request, so in a row of likes they take turns. To compare neighbours only
    # would make 6 answer 5, which is itself an answer.
    follows = np.zeros(len(start), bool)
    segment = block.segment(start)
    follows[1:] = is_one[1:] & (op[1:] == op[:-1]) & (start[1:] == end[:-1])
    follows[1:] &= segment[1:] == segment[:-1]
    row = np.arange(len(start))
    first = np.maximum.accumulate(np.where(follows, 0, row))
    return np.asarray((row - first) % 2 == 1)


def fields(raw: bytes) -> dict[str, Any]:
    """Return the packet's head and contents."""
    packet = PACKET.parse(raw)
    return {
        "type": packet.type,
        "platform": packet.platform,
        "length": packet.size,
        "contents": packet.contents.data.hex(),
    }


def explain(run: bytes, start: int) -> Gap:
    """Say why the packet whose header ``run`` begins with does not hold, and how far it reaches."""
    told: dict[str, object] = {"fields": _as_read(run)}
    if len(run) < PLAN.prefix:
        return Gap(start, len(run), "truncated", {"have": len(run), **told})
    size = int.from_bytes(run[PLAN.tail_at - 4 : PLAN.tail_at], "big")
    need = OVERHEAD + size
    if size > CONTENTS_MOST:
        told = {"contents_bytes": size, "contents_bytes_most": CONTENTS_MOST, **told}
        return Gap(start, PLAN.prefix, "damaged", told)
    if need > len(run):
        return Gap(start, len(run), "truncated", {"have": len(run), "need": need, **told})
    sums = {"checksum_expected": XOR8(run[PLAN.tail_at : need - 1]), "checksum_got": run[need - 1]}
    return Gap(start, need, "damaged", {**sums, **told})


def _as_read(raw: bytes) -> dict[str, object]:
    out: dict[str, object] = {}
    if len(raw) > TYPE_AT:
        out["op"] = op_name(BASE + raw[TYPE_AT])
    if len(raw) > TYPE_AT + 1:
        out["platform"] = raw[TYPE_AT + 1]
    return out
