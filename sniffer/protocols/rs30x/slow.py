"""RS30x one frame at a time, by the grammar: what the reference decoder runs."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

from construct import ConstructError

from sniffer.ground.codes import IF_ALL, MUST, NEVER, REQUEST, RESPONSE
from sniffer.ground.model import ANY_ID, MALFORMED, NO_ALT, RESETS, UNKNOWN, UNUSUAL
from sniffer.protocols.base import SlowFrame, State
from sniffer.protocols.rs30x.grammar import (
    ACK,
    ACK_BYTE,
    ACK_OP,
    ACK_TOKEN,
    ASKS_ACK,
    ASKS_ADDRESS,
    COMMAND_ADDRESS,
    DEFAULT_ID,
    EVERYONE,
    FACTORY_RESET,
    FLAGS,
    FLASH_WRITE,
    ID_REGISTER,
    LONG,
    LONG_WRITE,
    NACK,
    NO_TOKEN,
    PACKET,
    READ,
    REBOOT,
    REPLIES,
    RESET_WITH_DATA,
    RETURN,
    RETURN_OP,
    WRITE,
    carries_registers,
    long_data,
    op_of,
)
from sniffer.protocols.shapes import slow_spans

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.registers import RegisterMap

COMMANDS = (FLASH_WRITE, REBOOT, FACTORY_RESET)


def parse(data: bytes, at: int, limit: int) -> list[tuple[int, int, int]] | None:
    """Parse one packet, and the bare byte that acknowledges it where it asked for one."""
    for grammar, kind in ((PACKET, REQUEST), (RESET_WITH_DATA, REQUEST), (RETURN, RESPONSE)):
        stream = io.BytesIO(data[at:limit])
        try:
            body = grammar.parse_stream(stream).body.value
        except ConstructError:
            continue
        end = at + stream.tell()
        out = [(at, end, kind)]
        if kind == REQUEST and _asks_ack(body):
            try:
                ACK.parse(data[end:limit])
            except ConstructError:
                return out
            out.append((end, end + 1, RESPONSE))
        return out
    return None


def _asks_ack(body: Any) -> bool:
    return _replies(body) and FLAGS.parse(bytes([body.flags])).reply == ASKS_ACK


def _replies(body: Any) -> bool:
    """A servo of its own is addressed, and by something else than a command that none answers."""
    command = op_of(body.servo_id, body.flags, body.data) in COMMANDS
    return body.servo_id not in (LONG, EVERYONE) and not command


def describe(raw: bytes, kind: int, before: SlowFrame | None) -> SlowFrame:
    """Describe one packet; nothing depends on the one before it."""
    del before
    if kind == REQUEST:
        try:
            body = PACKET.parse(raw).body.value
        except ConstructError:
            body = RESET_WITH_DATA.parse(raw).body.value
        return _request(raw, body)
    if len(raw) == 1:
        status = -1 if ACK.parse(raw).answer == ACK_BYTE else NACK
        return SlowFrame(
            0, 1, RESPONSE, -1, ACK_OP, raw, status=status, reply=NEVER, token=ACK_TOKEN
        )
    body = RETURN.parse(raw).body.value
    out = SlowFrame(0, len(raw), RESPONSE, body.servo_id, RETURN_OP, raw)
    out.address, out.data, out.data_start = body.address, body.data, len(raw) - 1 - len(body.data)
    out.status, out.token = body.flags, body.address << 8 | body.length
    return out


def _request(raw: bytes, body: Any) -> SlowFrame:
    op = op_of(body.servo_id, body.flags, body.data)
    bits = FLAGS.parse(bytes([body.flags]))
    out = SlowFrame(0, len(raw), REQUEST, body.servo_id, op, raw)
    out.data, out.data_start = bytes(body.data), len(raw) - 1 - len(body.data)
    out.token = NO_TOKEN
    asked = REPLIES.get(bits.reply)
    address, length = (asked.address, asked.length) if asked else (-1, -1)
    if bits.reply == ASKS_ADDRESS:
        address, length = body.address, body.length
    if bits.reply == ASKS_ACK:
        out.token = ACK_TOKEN
    elif asked:
        out.token = address << 8 | length
    carries = carries_registers(body.servo_id, op, body.address, len(body.data))
    if op in (WRITE, LONG_WRITE) or carries:
        out.address = body.address
    elif op == READ:
        out.address = address
    if bits.reply and _replies(body):
        out.reply = MUST if asked else IF_ALL
    out.alt_id = _alt(out, bits)
    if bits.factory_reset:
        out.flags |= RESETS
        if body.servo_id not in (LONG, EVERYONE):
            out.alt_id = DEFAULT_ID
    if op == READ and not asked:
        out.flags |= UNKNOWN
    if op == WRITE and (not body.data or body.count != 1):
        out.flags |= MALFORMED
    if carries and body.count != 1:
        out.flags |= MALFORMED
    if op == LONG_WRITE and (not body.data or body.length < 2):
        out.flags |= MALFORMED
    if _unusual(op, body, bits):
        out.flags |= UNUSUAL
    return out


def _alt(out: SlowFrame, bits: Any) -> int:
    """An acknowledgement names nobody; a servo that was renumbered may answer under either id."""
    if bits.reply == ASKS_ACK:
        return ANY_ID
    at = ID_REGISTER - out.address
    if out.op == WRITE and 0 <= at < len(out.data):
        return out.data[at]
    return NO_ALT


def _unusual(op: int, body: Any, bits: Any) -> bool:
    """What the manual excludes or never shows, though a servo may well obey it."""
    if bits.unused:
        return True
    if body.servo_id == LONG and body.flags:
        return True  # the flags of a long packet are always 00
    if body.servo_id == EVERYONE and bits.reply:
        return True  # nobody can answer
    if op in (WRITE, LONG_WRITE) and bits.reply and bits.reply not in REPLIES:
        return True
    if op not in COMMANDS:
        return bool(op == WRITE and bits.reply == ASKS_ADDRESS)  # asked for with COUNT 0 only
    together = bits.flash_write + bits.reboot + bits.factory_reset > 1 or bits.reply
    data_of_reset = bits.factory_reset and body.data == b"\xff"
    return bool(together or body.address != COMMAND_ADDRESS or (body.data and not data_of_reset))


def states_itself(frame: SlowFrame) -> bool:
    """Tell whether this is a return packet of a servo: it names that and its address."""
    return frame.kind == RESPONSE and len(frame.raw) > 1 and not frame.flags & UNUSUAL


def _sets(frame: SlowFrame) -> bool:
    return frame.op in (WRITE, LONG_WRITE) or (frame.op in COMMANDS and frame.address >= 0)


def values(
    frame: SlowFrame, state: State, *, models: Sequence[RegisterMap]
) -> list[tuple[int, int, int, int]]:
    """Split what is written or returned by each servo's table, byte by byte."""
    return slow_spans(models, state, parts(frame))


def parts(frame: SlowFrame) -> list[tuple[int, int, bytes]]:
    """Return (servo_id, address, bytes) of each servo's registers."""
    if frame.flags & MALFORMED or (frame.kind == REQUEST and not _sets(frame)):
        return []
    if frame.kind == REQUEST and frame.op == LONG_WRITE:
        length = PACKET.parse(frame.raw).body.value.length
        servos = long_data(length).parse(frame.data).servos
        return [(s.servo_id, frame.address, s.data) for s in servos]
    return [(frame.servo_id, frame.address, frame.data)]
