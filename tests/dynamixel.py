"""Dynamixel 1.0 as far as framing and pairing go: a fifth protocol, whose frames others contain.

    FF FF | ID | LENGTH | INSTRUCTION or ERROR | PARAMETER ... | CHECKSUM

A mightyZAP frame less its first FF is one of these, checksum and all.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from construct import Byte, Bytes, Check, Checksum, Const, RawCopy, Struct, this
from hypothesis import strategies as st

from sniffer.ground.checksums import COMPLEMENT_SUM
from sniffer.ground.framing import frame_by_plan
from sniffer.ground.model import (
    MUST,
    NEVER,
    NO_ALT,
    REQUEST,
    RESPONSE,
    Frames,
    Gap,
)
from sniffer.ground.plan import plan_of
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.base import Values

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.framing import Block
    from sniffer.ground.model import I16, I64, Mask, Spans
    from sniffer.protocols.base import FrameView, State

PACKET: Final = Struct(
    "header" / Const(b"\xff\xff"),
    "body"
    / RawCopy(
        Struct(
            "servo_id" / Byte,
            Check(this.servo_id != 255),
            "length" / Byte,
            Check(this.length >= 2),
            "code" / Byte,
            "params" / Bytes(this.length - 2),
        )
    ),
    "checksum" / Checksum(Byte, COMPLEMENT_SUM, this.body.data),
)
PLAN: Final = plan_of(PACKET)
BROADCAST: Final = 254
PING, READ, WRITE = 1, 2, 3
NAMES: Final = {PING: "ping", READ: "read", WRITE: "write"}


def packet(servo_id: int, code: int, params: bytes = b"") -> bytes:
    """Return a packet of either direction."""
    body = bytes([servo_id, len(params) + 2, code]) + params
    return b"\xff\xff" + body + bytes([~sum(body) & 255])


class Dynamixel1:
    """See ``sniffer.protocols.base.BusProtocol``; no registers are read."""

    name = "dynamixel1"
    title = "ROBOTIS Dynamixel (Protocol 1.0)"
    bauds: tuple[int, ...] = (9600, 57600, 115200, 1000000)
    baud = 57600
    longest = reach = 259
    tail_ns = 100_000_000
    everyone: tuple[int, ...] = (BROADCAST,)
    blank = b""
    ordered = False
    models = PROTOCOLS["mightyzap"].models[:1]
    registers = models[0].registers

    def frame(self, block: Block) -> tuple[Spans, int]:
        return frame_by_plan(PLAN, block)

    def describe(self, block: Block, spans: Spans) -> Frames:
        n = len(spans)
        start, length = spans.start, spans.end - spans.start
        servo_id, code = block.data[start + 2].astype(np.int16), block.data[start + 4]
        kind = np.full(n, REQUEST, np.uint8)
        for i in range(1, n):  # what stands behind a request to the same servo answers it
            asks = kind[i - 1] == REQUEST and servo_id[i - 1] != BROADCAST
            if asks and servo_id[i] == servo_id[i - 1] and code[i] == 0:
                kind[i] = RESPONSE
        answer = kind == RESPONSE
        zero, none = np.zeros(n, np.int64), np.full(n, -1, np.int16)
        return Frames(
            start=start,
            length=length,
            kind=kind,
            servo_id=servo_id,
            op=np.where(answer, -1, code.astype(np.int64)),
            address=none,
            data_start=start + 5,
            data_length=length - 6,
            status=np.where(answer, code, -1).astype(np.int16),
            reply=np.where(answer | (servo_id == BROADCAST), NEVER, MUST).astype(np.uint8),
            token=np.full(n, -1, np.int64),
            alt_id=np.full(n, NO_ALT, np.int16),
            flags=np.zeros(n, np.uint8),
            t_start=zero,
            t_end=zero,
            uncertainty=zero,
            direction=np.zeros(n, np.uint8),
        )

    def values(self, block: Block, frames: Frames, rows: I64, state: State) -> Values:
        none = np.empty(0, np.int64)
        small = none.astype(np.int16)
        return Values(none, small, small, none, none.astype(np.uint8))

    def explain(self, run: bytes, start: int, *, awaited: bool = False) -> list[Gap]:
        del awaited
        at = run.find(b"\xff\xff")
        if at < 0 or len(run) < at + 6:
            return [Gap(start, len(run), "noise")]
        head = [Gap(start, at, "noise")] * bool(at)
        size = run[at + 3] + 4
        if at + size > len(run):
            return [*head, Gap(start + at, len(run) - at, "truncated", {"need": size})]
        got, due = run[at + size - 1], ~sum(run[at + 2 : at + size - 1]) & 255
        detail = {"checksum_expected": due, "checksum_got": got}
        rest = run[at + size :]
        tail = self.explain(rest, start + at + size) if rest else []
        return [*head, Gap(start + at, size, "damaged", detail), *tail]

    def op_name(self, op: int) -> str:
        return NAMES.get(op, "status" if op < 0 else f"unknown_{op:02x}")

    def refused(self, status: I16) -> Mask:
        return np.asarray(status > 0)

    def states_itself(self, frames: Frames) -> Mask:
        return np.zeros(len(frames), bool)

    def window_ns(self, frames: Frames) -> I64:
        return np.full(len(frames), 10_000_000)

    def status_names(self, status: int) -> tuple[str, ...]:
        return (f"error {status:02x}",) if status else ()

    def fields(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        return {"params": raw[5:-1].hex()}

    def checksum_of(self, raw: bytes) -> tuple[Any, bytes, int]:
        return PLAN.checksum, raw[2:-1], raw[-1]


def said(exchanges: int, servos: Sequence[int] = (1, 2, 3)) -> bytes:
    """Return reads of some servos with their answers."""
    return b"".join(
        packet(who, READ, b"\x24\x02") + packet(who, 0, (n * 7 % 1024).to_bytes(2, "little"))
        for n, who in zip(range(exchanges), itertools.cycle(servos))
    )


TALK: Final = st.tuples(st.integers(0, 253), st.binary(max_size=6)).map(
    lambda e: packet(e[0], READ, b"\x24\x02") + packet(e[0], 0, e[1])
)
"""One exchange."""
