"""wCK one frame at a time, by the grammar: what the reference decoder runs."""

from __future__ import annotations

import io
from typing import Any

from construct import ConstructError

from sniffer.ground.codes import MUST, NEVER, OPTIONAL, REQUEST, RESPONSE, WHOLE
from sniffer.ground.model import ANY_ID, DEPTH, ECHO_DIFFERS, NO_ALT, UNKNOWN, UNUSUAL
from sniffer.protocols.base import SlowFrame, State
from sniffer.protocols.wck import controller
from sniffer.protocols.wck.grammar import (
    COMMANDS,
    FIRSTS,
    HEADER,
    INDEX,
    MASKS,
    OPS,
    READ_10BIT_TEXT,
    REGISTERS,
    REPLIES,
    REPLY,
    SECONDS,
    UNKNOWN_BASE,
    Op,
)


def command(data: bytes, at: int, limit: int) -> tuple[Op, int] | None:
    """Parse one command; return it with its end, or None where none holds."""
    if limit - at < 3 or data[at] != HEADER:
        return None
    for op, grammar, firsts, seconds in zip(OPS, COMMANDS, FIRSTS, SECONDS, strict=True):
        if data[at + 1] not in firsts or data[at + 2] not in seconds:
            continue
        for form in (grammar, READ_10BIT_TEXT) if op.name == "position_read_10bit" else (grammar,):
            stream = io.BytesIO(data[at:limit])
            try:
                form.parse_stream(stream)
            except ConstructError:
                continue
            return op, at + stream.tell()
    return None


def parse(data: bytes, at: int, limit: int) -> list[tuple[int, int, int]] | None:
    """Parse one command, and the bare reply behind it if there is one.

    Commands that have replies may stand in a row; then their replies come in order behind the last.
    """
    found = command(data, at, limit)
    if found is None:
        past = _packet(data, at, limit)
        return None if past is None else [(at, past, REQUEST)]
    row = [(at, *found)]
    while True:
        begin, op, end = row[-1]
        replied = bool(op.reply) and _replied(op, data, begin, end, limit)
        following = command(data, end, limit) if op.reply and not replied else None
        if following is None or not following[0].reply:
            break
        row.append((end, *following))
    out = [(begin, end, REQUEST) for begin, _, end in row]
    if not replied:
        return out
    for k in range(min(len(row), DEPTH)):
        reply = data[end : min(end + REPLY, limit)]
        if k and (len(reply) < REPLY or HEADER in reply):
            break
        out.append((end, end + REPLY, RESPONSE))
        end += REPLY
    return out


def _replied(op: Op, data: bytes, at: int, end: int, limit: int) -> bool:
    """Tell whether the next bytes are a reply rather than a command or the end."""
    reply = data[end : min(end + len(op.reply), limit)]
    if len(reply) < len(op.reply):
        return False
    for k, byte in enumerate(reply):
        if byte != HEADER:
            continue
        if not op.reply_ff[k]:
            return False
        if k == 0 and op.name == "io_write" and reply[0] == data[at + 3] and reply[1] == reply[0]:
            continue
        if command(data, end + k, limit) is not None:
            return False
        if _packet(data, end + k, limit) is not None:
            return False
    return True


def _parsed(raw: bytes) -> tuple[Op, Any, bool]:
    """Return a command's op, its fields, and whether its checksum is the text's own form."""
    found = command(raw, 0, len(raw))
    assert found is not None, "only frames that hold are described"
    op = found[0]
    try:
        return op, COMMANDS[INDEX[op.name]].parse(raw).body.value, False
    except ConstructError:
        return op, READ_10BIT_TEXT.parse(raw).body.value, True


def describe(raw: bytes, kind: int, before: SlowFrame | None) -> SlowFrame:
    """Describe a command, or the reply to the command ``before``."""
    if controller.is_packet(raw):
        return _controllers(raw, before)
    if kind == RESPONSE:
        assert before is not None, "a reply stands right behind its command"
        return _describe_reply(raw, before)
    op, fields, text_sum = _parsed(raw)
    servo_id = fields.id if "id" in fields else fields.data1.id
    if op.name in ("sync_position_move", "break", "rbc_direct_control_end"):
        servo_id = -1
    out = SlowFrame(0, len(raw), REQUEST, servo_id, INDEX[op.name], raw)
    if op.name == "unknown":
        out.op = UNKNOWN_BASE + fields.data2.command
        out.flags |= UNKNOWN
    if text_sum or ("again" in op.params and raw[3] != raw[4]):
        out.flags |= UNUSUAL
    out.data_start, out.data = _parameters(op, raw)
    out.reply = MUST if op.reply else NEVER
    out.token = len(op.reply)
    out.alt_id = ANY_ID if op.name == "break" else NO_ALT
    return out


def _parameters(op: Op, raw: bytes) -> tuple[int, bytes]:
    match op.name:
        case "position_move" | "wheel":
            return 2, raw[2:3]
        case "position_move_10bit":
            return 4, raw[4:-1]
        case "sync_position_move" | "motion_data_write" | "io_write" | "unknown":
            return 3, raw[3:-1]
        case "rbc_direct_control_end":
            return 3, raw[3:-1]
        case name if name.endswith("_set"):
            return 3, raw[3:-1]
        case _:
            return 3, b""


def _describe_reply(raw: bytes, before: SlowFrame) -> SlowFrame:
    op, fields, _ = _parsed(before.raw)
    reply = REPLIES[INDEX[op.name]].parse(raw)
    out = SlowFrame(0, len(raw), RESPONSE, before.servo_id, before.op, raw, data=raw)
    out.reply, out.token, out.alt_id = NEVER, len(raw), before.alt_id
    if op.name == "break":
        out.servo_id = reply.id
    asked = {"data2": before.raw[2], **{name: fields[name] for name in op.params}}
    for name in op.reply:
        if name == "again":
            differs = raw[1] != raw[0]
        else:
            differs = name in asked and (asked[name] ^ reply[name]) & MASKS.get(name, 0xFF) != 0
        if differs or raw[0] > op.reply_most:
            out.flags |= ECHO_DIFFERS
    return out


def states_itself(frame: SlowFrame) -> bool:
    """Tell nothing. A reply is two bytes: what they are, only the command says."""
    del frame
    return False


def parts(frame: SlowFrame) -> list[tuple[int, int, bytes]]:
    """Return nothing: registers have no addresses here."""
    del frame
    return []


def values(frame: SlowFrame, state: State) -> list[tuple[int, int, int, int]]:
    """Return what the fields say, by the registers that bear their names."""
    if frame.op >= controller.BASE:
        return []
    name = "unknown" if frame.op >= UNKNOWN_BASE else OPS[frame.op].name
    if frame.kind == RESPONSE:
        fields = {**REPLIES[INDEX[name]].parse(frame.raw)}
    else:
        body = _parsed(frame.raw)[1]
        fields = {**body.data1, **body.data2, **body}
    if name == "sync_position_move":
        torque, goal = REGISTERS["torque_level"], REGISTERS["goal_position"]
        return [
            row
            for servo, target in enumerate(fields["targets"])
            for row in (
                (servo, torque, fields["torque_level"], WHOLE),
                (servo, goal, target, WHOLE),
            )
        ]
    out = [
        (frame.servo_id, REGISTERS[field], value & MASKS.get(field, 0xFF), WHOLE)
        for field, value in fields.items()
        if field in REGISTERS
    ]
    for prefix, register in (("target_", "goal_position_10bit"), ("", "position_10bit")):
        if f"{prefix}h3" in fields:
            raw = aligned(fields[f"{prefix}h3"], fields[f"{prefix}l7"], state)
            out.append((frame.servo_id, REGISTERS[register], raw, WHOLE))
    return out


def aligned(h3: int, l7: int, state: State) -> int:
    """Return a 10-bit position.

    L7 stands in bits 7..1 of its byte as the manual draws it (manual 1.07, A-1-4 (26)), unless the
    bus shows that it stands in bits 6..0: no such byte has had bit 7 set, and one has had bit 0.
    """
    if l7 & 0x80:
        state.notes["l7_bit7"] = 1
    if l7 & 0x01:
        state.notes["l7_bit0"] = 1
    right = state.notes.get("l7_bit0", 0) and not state.notes.get("l7_bit7", 0)
    return (h3 & 7) << 7 | (l7 & 0x7F if right else l7 >> 1)


def _packet(data: bytes, at: int, limit: int) -> int | None:
    """Return the end of the controller's packet that begins here, or None where none holds."""
    stream = io.BytesIO(data[at : min(limit, at + controller.LONGEST)])
    try:
        controller.PACKET.parse_stream(stream)
    except ConstructError:
        return None
    return at + stream.tell()


def _controllers(raw: bytes, before: SlowFrame | None) -> SlowFrame:
    """Describe a packet of the controller by what it is and what stands right before it."""
    packet = controller.PACKET.parse(raw)
    op = controller.BASE + int(packet.type)
    asked = before is not None and before.kind == REQUEST and before.op == op
    out = SlowFrame(0, len(raw), RESPONSE if asked else REQUEST, -1, op, raw)
    out.data = bytes(packet.contents.data)
    out.data_start = len(raw) - 1 - len(out.data)
    out.reply = 0 if asked else OPTIONAL
    out.token, out.alt_id = op, NO_ALT
    return out
