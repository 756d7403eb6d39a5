"""RS30x in columns; every layout number comes from the grammar."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.checksums import XOR8
from sniffer.ground.codes import IF_ALL, MUST, NEVER, REQUEST, RESPONSE
from sniffer.ground.distinct import numbers, within
from sniffer.ground.framing import Block, candidates, settle, undecided_from
from sniffer.ground.model import (
    ANY_ID,
    I64,
    MALFORMED,
    NO_ALT,
    RESETS,
    U8,
    UNKNOWN,
    UNUSUAL,
    Frames,
    Gap,
    Mask,
    Spans,
)
from sniffer.ground.patterns import later
from sniffer.ground.plan import plan_of
from sniffer.protocols.rs30x.grammar import (
    ACK_BYTE,
    ACK_OP,
    ACK_TOKEN,
    ASKS_ACK,
    ASKS_ADDRESS,
    COMMAND_ADDRESS,
    COMMAND_BITS,
    DEFAULT_ID,
    EVERYONE,
    FACTORY_RESET,
    FLASH_BIT,
    FLASH_WRITE,
    HIGHEST_ID,
    ID_REGISTER,
    LONG,
    LONG_WRITE,
    LOWEST_ID,
    MOST_DATA,
    NACK,
    NACK_BYTE,
    NO_TOKEN,
    OPS,
    PACKET,
    READ,
    REBOOT,
    REBOOT_BIT,
    REPLIES,
    REPLY_BITS,
    RESET_BIT,
    RESET_GUARDS,
    RESET_WITH_DATA,
    RETURN,
    RETURN_OP,
    WRITE,
    carries_registers,
    flag_names,
    op_of,
    status_names,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.protocols.base import State, Values
    from sniffer.protocols.shapes import Addressed

PLAN: Final = plan_of(PACKET)
RETURN_PLAN: Final = plan_of(RETURN)
OVERHEAD: Final = PLAN.tail_at + 1
"""Bytes of a packet beside its data."""

REACH: Final = OVERHEAD + 255
"""A request is closed after as many bytes as the longest return packet has."""

_RESET_LENGTH: Final = RESET_WITH_DATA.sizeof()
_ID, _FLAGS, _ADDRESS = PLAN.at["servo_id"], PLAN.at["flags"], PLAN.at["address"]
_LENGTH, _COUNT, _DATA = PLAN.at["length"], PLAN.at["count"], PLAN.tail_at

# What a FLAG byte alone decides, for each of its 256 values.
_BYTE: Final = np.arange(256)
_COMMAND: Final = np.select(
    [_BYTE & bit > 0 for bit in (FLASH_BIT, REBOOT_BIT, RESET_BIT)],
    [FLASH_WRITE, REBOOT, FACTORY_RESET],
    -1,
)
_NIBBLE: Final = _BYTE & REPLY_BITS
_ADDRESS_OF: Final = np.array(
    [REPLIES[k].address if k in REPLIES else -1 for k in _NIBBLE.tolist()]
)
_LENGTH_OF: Final = np.array([REPLIES[k].length if k in REPLIES else -1 for k in _NIBBLE.tolist()])
_REPLY: Final = np.select(
    [(_NIBBLE == 0) | (_COMMAND >= 0), np.isin(_NIBBLE, list(REPLIES))], [NEVER, MUST], IF_ALL
)
_ASKS_ACK: Final = (_NIBBLE == ASKS_ACK) & (_COMMAND < 0)
_SEVERAL: Final = np.array([(k & COMMAND_BITS).bit_count() > 1 for k in range(256)])
_ODD: Final = (_BYTE > 127) | _SEVERAL | ((_COMMAND >= 0) & (_NIBBLE > 0))
"""Flags that the manual excludes: bit 7, two commands in one, a reply to a command."""


def frame(block: Block) -> tuple[Spans, int]:
    """Frame by the two plans; a request with its ACK is one candidate, and ends behind the byte."""
    data, n = block.data, block.n
    start, end, waiting = candidates(PLAN, block)
    if n >= _RESET_LENGTH - 1:
        start, end, waiting = _with_resets(block, start, end, waiting)
    limit = block.limit(start)
    servo_id = data[start + _ID]
    asks = _ASKS_ACK[data[start + _FLAGS]] & (servo_id != LONG) & (servo_id <= HIGHEST_ID)
    answer = data[np.minimum(end, n - 1)]
    has = asks & (end < limit) & ((answer == ACK_BYTE) | (answer == NACK_BYTE))
    waits = start[asks & (end == limit) & block.open(limit)]
    back, back_end, back_waiting = candidates(RETURN_PLAN, block)
    kind = np.repeat(np.array([REQUEST, RESPONSE], np.uint8), [len(start), len(back)])
    start, end = np.concatenate([start, back]), np.concatenate([end, back_end])
    has = np.concatenate([has, np.zeros(len(back), bool)])
    order = np.argsort(start, kind="stable")
    start, end, has, kind = start[order], end[order], has[order], kind[order]
    waiting = np.sort(np.concatenate([waiting, waits, back_waiting]))
    rows, decided = settle(start, end + has, waiting, undecided_from(PLAN, block))
    start, end, has, kind = start[rows], end[rows], has[rows], kind[rows]
    if has.any():
        at = np.repeat(np.arange(len(rows)), 1 + has)
        ack = np.zeros(len(at), bool)
        ack[1:] = at[1:] == at[:-1]
        start, end = np.where(ack, end[at], start[at]), end[at] + ack
        kind = np.where(ack, RESPONSE, kind[at]).astype(np.uint8)
    return Spans(start, end, kind), decided


def _with_resets(block: Block, start: I64, end: I64, waiting: I64) -> tuple[I64, I64, I64]:
    """Add the factory resets with a data byte that their length does not count.

    Only where the packet without it does not hold: eight bytes are tried before nine.
    """
    data, m = block.data, block.n - (_RESET_LENGTH - 1) + 1
    head = (data[_ADDRESS:][:m] == COMMAND_ADDRESS) & (data[_DATA:][:m] == 0xFF)
    for k, byte in enumerate(PLAN.header):
        head &= data[k:][:m] == byte
    at = np.flatnonzero(head)
    if len(at):
        limit = np.broadcast_to(block.limit(at), at.shape)
        columns = PLAN.columns(data, at)
        ok = at + _RESET_LENGTH - 1 <= limit
        for guard in (*PLAN.checks, *RESET_GUARDS):
            ok = ok & guard(columns)
        ok &= ~within(at, start)
        at, limit = at[ok], limit[ok]
        stop = at + _RESET_LENGTH
        wait = (stop > limit) & block.open(limit)
        whole = stop <= limit
        more = at[whole]
        more = more[XOR8.good(data, more + PLAN.sum_from, stop[whole] - 1)]
        waiting = numbers(np.concatenate([waiting, at[wait]]))
        start, end = np.concatenate([start, more]), np.concatenate([end, more + _RESET_LENGTH])
    return start, end, waiting


def describe(block: Block, spans: Spans) -> Frames:
    """Say what each packet commands or returns, and which reply a request expects.

    For example, servo 1 is to switch its torque on and to acknowledge that (nibble 1), and is then
    asked for two bytes at 2A (nibble F), which it returns. Servo 2 is given a goal, no more::

        row      0      1      2      3      4
        ack      0      1      0      0      0
        head     0      0      10     18     28     where the fields stand: row 1 has row 0's
        op       0      7      1      6      0      WRITE, ACK_OP, READ, RETURN_OP, WRITE
        address  36     -1     42     42     30
        token    65536  65536  10754  10754  131072     ACK_TOKEN, 2A02, NO_TOKEN
        reply    4      0      4      0      0      MUST, NEVER

    Each column is made for all kinds of packets in turn, the commonest first, and what is otherwise
    is put over it: so the order of two lines about one column matters. Going kind by kind instead
    would gather and scatter every column once a kind.
    """
    data, start, end = block.data, spans.start, spans.end
    n = len(start)
    length = end - start
    back = spans.kind == RESPONSE
    ack = length == 1
    asked = ~back
    # An acknowledgement has no fields: those of its request, the row before, are read instead.
    head = start[np.arange(n) - ack]
    servo_id = data[head + _ID].astype(np.int64)
    bits = data[head + _FLAGS]
    wire_address = data[head + _ADDRESS].astype(np.int64)
    block_length = data[head + _LENGTH].astype(np.int64)
    data_length = np.where(ack, 0, length - OVERHEAD)
    nibble = bits & REPLY_BITS
    none = data_length == 0
    by = bits.astype(np.intp)  # as numpy looks up fastest
    command = _COMMAND[by]
    is_long = servo_id == LONG
    op = np.where(is_long, LONG_WRITE, WRITE)
    op = np.where(none & (nibble > 0), READ, op)
    op = np.where(command >= 0, command, op)
    op = np.where(back, np.where(ack, ACK_OP, RETURN_OP), op)
    by_packet = nibble == ASKS_ADDRESS
    from_address = np.where(by_packet, wire_address, _ADDRESS_OF[by])
    writes = (op == WRITE) | (op == LONG_WRITE)
    writes |= carries_registers(servo_id, op, wire_address, data_length)
    address = np.where(op == READ, from_address, np.where(writes, wire_address, -1))
    address = np.where(back & ~ack, wire_address, address)
    token = from_address << 8 | np.where(by_packet, block_length, _LENGTH_OF[by])
    token = np.where(token < 0, np.where(nibble == ASKS_ACK, ACK_TOKEN, NO_TOKEN), token)
    token = np.where(back, wire_address << 8 | block_length, token)
    token = np.where(ack, ACK_TOKEN, token)
    alone = ~is_long & (servo_id != EVERYONE)
    reply = np.where(asked & alone, _REPLY[by], NEVER)
    status = np.where(back, by, -1)
    status = np.where(ack, np.where(data[start] == ACK_BYTE, -1, NACK), status)
    alt = np.where(asked & (nibble == ASKS_ACK), ANY_ID, NO_ALT)
    renumbers = asked & (op == WRITE) & (alt == NO_ALT)
    alt = _new_id(data, head, renumbers, address, data_length, alt)
    flags = _flags(data, head, op, bits, servo_id, wire_address, data_length)
    alt = np.where(asked & alone & (flags & RESETS > 0), DEFAULT_ID, alt)
    flags = np.where(back, 0, flags)
    return Frames.stating(
        start=start,
        length=length,
        kind=spans.kind,
        servo_id=np.where(ack, -1, servo_id),
        op=op,
        address=address,
        data_start=np.where(ack, end, start + _DATA),
        data_length=data_length,
        status=status,
        reply=reply,
        token=token,
        alt_id=alt,
        flags=flags,
    )


def _new_id(data: U8, head: I64, writes: Mask, address: I64, length: I64, alt: I64) -> I64:
    """A write over the id register is answered under the old id or under the new one."""
    at = ID_REGISTER - address
    covers = writes & (at >= 0) & (at < length)
    return np.where(covers, data[np.where(covers, head + _DATA + at, 0)].astype(np.int64), alt)


def _flags(data: U8, head: I64, op: I64, bits: U8, servo_id: I64, address: I64, length: I64) -> I64:
    """Return the flags of requests: what the manual has no form for, and what it excludes."""
    nibble = bits & REPLY_BITS
    by = bits.astype(np.intp)
    command = _COMMAND[by] >= 0
    write = op == WRITE
    malformed = write & ((length == 0) | (data[head + _COUNT] != 1))
    malformed |= (op == LONG_WRITE) & ((length == 0) | (data[head + _LENGTH] < 2))
    malformed |= carries_registers(servo_id, op, address, length) & (data[head + _COUNT] != 1)
    undefined = ~command & (_REPLY[by] == IF_ALL)
    unknown = undefined & (op == READ)
    resets = bits & RESET_BIT > 0
    unusual = _ODD[by] | ((servo_id == LONG) & (bits > 0))
    unusual |= (servo_id == EVERYONE) & (nibble > 0)
    unusual |= (undefined & ~unknown) | (write & (nibble == ASKS_ADDRESS))
    data_of_reset = resets & (length == 1) & (data[head + _DATA] == 0xFF)
    unusual |= command & ((address != COMMAND_ADDRESS) | ((length > 0) & ~data_of_reset))
    out = np.zeros(len(op), np.int64)
    marks = ((malformed, MALFORMED), (unknown, UNKNOWN), (resets, RESETS), (unusual, UNUSUAL))
    for mask, flag in marks:
        out[mask] |= flag
    return out


def states_itself(frames: Frames) -> Mask:
    """Tell which are return packets: they name their servo and their address."""
    plain: Mask = frames.flags & UNUSUAL == 0
    plain &= frames.address >= 0
    plain &= frames.kind == RESPONSE
    return plain


def values(block: Block, frames: Frames, rows: I64, state: State, *, shapes: Addressed) -> Values:
    """Read register values; LENGTH of a long packet counts a servo's id and bytes."""
    address = frames.address[rows].astype(np.int64)
    asked = frames.kind[rows] == REQUEST
    address[asked & (frames.flags[rows] & MALFORMED > 0)] = -1
    step = np.zeros(len(rows), np.int64)
    several = asked & (frames.op[rows] == LONG_WRITE)
    if several.any():
        step[several] = block.data[frames.start[rows[several]] + _LENGTH]
    return shapes.values(block, frames, rows, address, step, state)


_ANY_HEADER: Final = b"|".join(re.escape(p.header) for p in (PLAN, RETURN_PLAN))
_HEADER: Final = later(_ANY_HEADER)
_TORN: Final = later(
    b"(?:(?:%b).{0,%d}?(?=%b))+" % (_ANY_HEADER, PLAN.prefix - 1 - len(PLAN.header), _ANY_HEADER),
    re.DOTALL,
)
"""Packets that break off before their length is known, for the next header: they are one gap."""


def explain(run: bytes, start: int) -> list[Gap]:
    """Say why no frame claims these bytes: plain Python, for the rare stretch of damage."""
    out: list[Gap] = []
    p, n = 0, len(run)

    def add(until: int, reason: str, detail: Mapping[str, object]) -> None:
        nonlocal p
        if until > p:
            out.append(Gap(start + p, until - p, reason, detail))
            p = until

    while p < n:
        found = _HEADER.search(run, p)
        if found is None:
            # Half a header tells a packet no better than a stray byte: noise.
            add(n, "noise", {})
            break
        at = found.start()
        add(at, "noise", {})
        following = _HEADER.search(run, found.end())
        stop = following.start() if following else n
        broken = _TORN.match(run, at)
        if broken and broken.end() > stop:
            add(broken.end(), "truncated", {"have": broken.end() - at})
            continue
        need, wrong = _needs(run[at:stop])
        fields = _as_read(run[at : min(stop, at + (need or REACH) - 1)])
        if need is not None and at + need <= n and stop >= at + need - 1:
            expected, got = XOR8(run[at + PLAN.sum_from : at + need - 1]), run[at + need - 1]
            sums = {"checksum_expected": expected, "checksum_got": got}
            add(at + need, "damaged", {**(sums if expected != got else {}), **wrong, **fields})
        elif wrong and need is None:
            add(min(stop, at + REACH), "damaged", {**wrong, **fields})
        else:
            detail = {"have": stop - at} | ({} if need is None else {"need": need})
            add(stop, "truncated", {**detail, **fields})
    return out


def _needs(raw: bytes) -> tuple[int | None, dict[str, object]]:
    """Return the packet's length, if it states a possible one, and what cannot be right in it."""
    wrong: dict[str, object] = {}
    back = raw.startswith(RETURN_PLAN.header)
    if len(raw) > _ID and HIGHEST_ID < raw[_ID] < EVERYONE + back:
        wrong["servo_id_most"] = HIGHEST_ID
    if back and len(raw) > _ID and raw[_ID] < LOWEST_ID:
        wrong["servo_id_least"] = LOWEST_ID
    if len(raw) < PLAN.prefix:
        return None, {}
    length, count = raw[_LENGTH], raw[_COUNT]
    if back:
        if count != 1:
            return None, {**wrong, "count_expected": 1}
        return OVERHEAD + length, wrong
    if length * count > MOST_DATA:
        return None, {**wrong, "data_bytes": length * count, "data_bytes_most": MOST_DATA}
    extra = raw[_FLAGS] & RESET_BIT and raw[_ADDRESS] == COMMAND_ADDRESS and not length * count
    if extra and raw[_DATA : _DATA + 1] == b"\xff" and len(raw) >= _RESET_LENGTH:
        return _RESET_LENGTH, wrong
    return OVERHEAD + length * count, wrong


def _as_read(raw: bytes) -> dict[str, object]:
    """Return the fields of a packet that does not hold, without its checksum, as they stand."""
    names = ((_ID, "servo_id"), (_ADDRESS, "address"), (_LENGTH, "length"), (_COUNT, "count"))
    out: dict[str, object] = {name: raw[at] for at, name in names if at < len(raw)}
    if len(raw) > _FLAGS:
        flags, back = raw[_FLAGS], raw.startswith(RETURN_PLAN.header)
        named = status_names(flags) if back else flag_names(flags)
        out["flags"] = {"number": flags, "names": list(named)}
        if len(raw) > _COUNT:
            op = RETURN_OP if back else op_of(raw[_ID], flags, raw[_DATA:])
            out["op"] = OPS[op]
            out["data"] = raw[_DATA:].hex()
    return {"fields": out} if out else {}
