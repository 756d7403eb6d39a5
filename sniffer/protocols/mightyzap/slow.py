"""mightyZAP one frame at a time, by the grammar: what the reference decoder runs."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from construct import ConstructError

from sniffer.ground.model import (
    ANY_ID,
    IF_ALL,
    MALFORMED,
    NEVER,
    NO_ALT,
    OPTIONAL,
    RELEASES,
    REQUEST,
    RESETS,
    RESPONSE,
    STAGED,
    UNKNOWN,
)
from sniffer.protocols.base import SlowFrame, State
from sniffer.protocols.mightyzap.block import MODELS, REACH
from sniffer.protocols.mightyzap.grammar import (
    BROADCAST,
    COMMANDS,
    EXECUTE,
    FACTORY_RESET,
    FEEDBACK,
    FEEDBACK_REGISTER,
    ID_REGISTER,
    LOAD,
    OPTION_ID,
    PACKET,
    SDK_FACTORY_RESET,
    SEND,
    STAND_ALONE,
    SYMMETRIC,
    SYMMETRIC_STORE,
    WRITES,
)
from sniffer.protocols.shapes import slow_spans

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.registers import RegisterMap


def parse(data: bytes, at: int, limit: int) -> list[tuple[int, int, int]] | None:
    """Parse one packet; its direction is told later."""
    stream = io.BytesIO(data[at : min(limit, at + REACH)])
    try:
        PACKET.parse_stream(stream)
    except ConstructError:
        return None
    return [(at, at + stream.tell(), REQUEST)]


def describe(raw: bytes, kind: int, before: SlowFrame | None) -> SlowFrame:
    """Describe one packet by the rules of direction and expectation."""
    del kind  # a packet looks alike both ways
    body = PACKET.parse(raw).body.value
    start, end = 0, len(raw)
    factors_at = len(raw) - 1 - len(body.factors)
    if not _is_command(body, raw, before):
        feedback = FEEDBACK.parse(bytes([body.code]) + body.factors)
        token = -1 if body.code > 0 and not feedback.data else len(feedback.data)
        return SlowFrame(
            start,
            end,
            RESPONSE,
            body.servo_id,
            -1,
            raw,
            data_start=factors_at,
            data=bytes(feedback.data),
            status=body.code,
            reply=NEVER,
            token=token,
            alt_id=ANY_ID if body.servo_id == STAND_ALONE else NO_ALT,
        )
    out = SlowFrame(
        start,
        end,
        REQUEST,
        body.servo_id,
        body.code,
        raw,
        data_start=factors_at,
        data=bytes(body.factors),
        token=0,
        alt_id=ANY_ID if body.servo_id == STAND_ALONE else NO_ALT,
    )
    command = COMMANDS.get(body.code)
    if body.servo_id != BROADCAST:
        out.reply = command.reply if command else IF_ALL
    if command is None:
        out.flags |= UNKNOWN
        return out
    try:
        fields = command.factors.parse(body.factors)
    except ConstructError:
        out.flags |= MALFORMED
        return out
    if "address" in fields:
        out.address = fields.address
        out.data_start += 1
        out.data = out.data[1:]
    if body.code == LOAD:
        out.token, out.data = fields.length, b""
    if body.code in WRITES:
        at = ID_REGISTER - out.address
        if 0 <= at < len(out.data) and out.alt_id == NO_ALT:
            out.alt_id = out.data[at]
        if out.reply == IF_ALL and 0 <= FEEDBACK_REGISTER - out.address < len(out.data):
            out.reply = OPTIONAL
    if body.code in (FACTORY_RESET, SDK_FACTORY_RESET):
        out.flags |= RESETS
        if fields.option & OPTION_ID and out.alt_id == NO_ALT:
            out.alt_id = 0
    out.flags |= {SEND: STAGED, EXECUTE: RELEASES}.get(body.code, 0)
    return out


def _is_command(body: object, raw: bytes, before: SlowFrame | None) -> bool:
    servo_id, code, factors = body.servo_id, body.code, body.factors  # type: ignore[attr-defined]
    if servo_id == BROADCAST:
        return True
    if code != SYMMETRIC_STORE:
        return bool(code >= 0x80)
    # Bytes behind the code, checksum included: the size alone tells whether factor 2 exists.
    behind = raw[len(raw) - 1 - len(factors) :]
    length = behind[1] if len(behind) > 1 else behind[0]
    expects = None
    if before is not None and before.kind == REQUEST and before.servo_id in (STAND_ALONE, servo_id):
        expects = 2 + (before.token if before.op == LOAD else 0)
    return len(factors) + 2 >= 4 + length + 1 and expects != len(factors) + 2


def states_itself(frame: SlowFrame) -> bool:
    """Tell nothing. A feedback names no address: what its bytes are, only the request says."""
    del frame
    return False


def values(
    frame: SlowFrame, state: State, *, models: Sequence[RegisterMap] = MODELS
) -> list[tuple[int, int, int, int]]:
    """Split the data by each servo's table, byte by byte."""
    return slow_spans(models, state, parts(frame))


def parts(frame: SlowFrame) -> list[tuple[int, int, bytes]]:
    """Return (servo_id, address, bytes) of each servo's registers."""
    if frame.address < 0 or not frame.data:
        return []
    if frame.kind == REQUEST and frame.op == SYMMETRIC_STORE:
        packet = SYMMETRIC.parse(bytes([frame.address]) + frame.data)
        return [(t.servo_id, frame.address, t.data) for t in packet.targets]
    return [(frame.servo_id, frame.address, frame.data)]
