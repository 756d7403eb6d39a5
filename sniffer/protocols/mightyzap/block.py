"""mightyZAP in columns; every layout number comes from the grammar."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.framing import Block, frame_by_plan
from sniffer.ground.model import (
    ANY_ID,
    I16,
    I64,
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
    U8,
    UNKNOWN,
    Frames,
    Gap,
    Mask,
    Spans,
)
from sniffer.ground.plan import plan_of
from sniffer.ground.registers import load_models
from sniffer.protocols.mightyzap.grammar import (
    BROADCAST,
    COMMANDS,
    EXECUTE,
    FACTORY_RESET,
    FEEDBACK_REGISTER,
    ID_REGISTER,
    LOAD,
    OPTION_ID,
    PACKET,
    SDK_FACTORY_RESET,
    SEND,
    STAND_ALONE,
    SYMMETRIC_STORE,
    WRITES,
)
from sniffer.protocols.shapes import Addressed

if TYPE_CHECKING:
    from sniffer.protocols.base import State, Values

MODELS: Final = load_models("mightyzap-l12", "mightyzap-12lf")
SHAPES: Final = Addressed(MODELS, first=1)
PLAN: Final = plan_of(PACKET)
OVERHEAD: Final = PLAN.tail_at + 1 - 2
"""Bytes of a frame beside what SIZE counts (which counts code and checksum, but not the header)."""

REACH: Final = OVERHEAD + 255
"""A request is closed after as many bytes as the longest frame has: its answer would be over."""

_ID, _SIZE, _CODE, _FACTORS = (PLAN.at["servo_id"], PLAN.at["size"], PLAN.at["code"], PLAN.tail_at)
_REPLY: Final = np.array(
    [COMMANDS[k].reply if k in COMMANDS else IF_ALL for k in range(256)], np.uint8
)
_KNOWN: Final = np.array([k in COMMANDS for k in range(256)])


def _sizes() -> tuple[I64, I64]:
    """Return the least and the greatest SIZE that each command's grammar accepts."""
    least, most = np.zeros(256, np.int64), np.full(256, 255)
    for code, command in COMMANDS.items():
        fits = []
        for n in range(12):
            try:
                # targets of a symmetric store: one servo, n - 3 data bytes
                command.factors.parse(bytes([0, max(n - 3, 0)] + [0] * 10)[:n])
            except Exception:
                continue
            fits.append(n + 2)
        least[code] = min(fits)
        if len(fits) == 1:
            most[code] = fits[0]
    return least, most


_LEAST, _MOST = _sizes()


def frame(block: Block) -> tuple[Spans, int]:
    """Frame by the plan; direction is told later, a frame looks alike both ways."""
    return frame_by_plan(PLAN, block)


def describe(block: Block, spans: Spans) -> Frames:
    """Tell commands from feedback, and what each expects."""
    data, start, end = block.data, spans.start, spans.end
    n = len(start)
    servo_id = data[start + _ID].astype(np.int16)
    size = data[start + _SIZE].astype(np.int64)
    code = data[start + _CODE]
    factors = start + _FACTORS
    # Frames are followed by their checksum, so factor 1 can be read even where there is none;
    # whether it is one, the size tells.
    first = data[factors].astype(np.int64)
    second = data[np.minimum(factors + 1, block.n - 1)].astype(np.int64)
    request = (servo_id == BROADCAST) | (code >= 0x80)
    if (code == SYMMETRIC_STORE).any():
        _either_way(block, request, servo_id, size, code, end, start, second)
    fits = (size >= _LEAST[code]) & (size <= _MOST[code])
    sync = request & (code == SYMMETRIC_STORE)
    if sync.any():
        fits &= ~sync | ((second >= 1) & ((size - 4) % (second + 1) == 0))
    known = _KNOWN[code]
    well = request & known & fits
    load = well & (code == LOAD)
    write = well & ((code == WRITES[0]) | (code == WRITES[1]))
    addressed = load | write | (well & sync)
    address = np.where(addressed, first, -1)
    data_length = np.where(load, 0, size - 2 - addressed)
    reply = np.where(request & (servo_id != BROADCAST), _REPLY[code], NEVER)
    at = FEEDBACK_REGISTER - address
    reply[write & (reply == IF_ALL) & (at >= 0) & (at < data_length)] = OPTIONAL
    token = np.where(request, np.where(load, second, 0), data_length)
    status = np.where(request, -1, code.astype(np.int64))
    # an error needs no data: a feedback of an error byte alone answers any read
    token[(status > 0) & (data_length == 0)] = -1
    alt = np.where(servo_id == STAND_ALONE, ANY_ID, NO_ALT)
    alt = np.where(
        write & (address <= ID_REGISTER), _new_id(data, factors, address, data_length, alt), alt
    )
    resets = well & ((code == FACTORY_RESET) | (code == SDK_FACTORY_RESET))
    alt = np.where(resets & (first & OPTION_ID > 0) & (alt == NO_ALT), 0, alt)
    flags = np.where(request & known & ~fits, MALFORMED, 0)
    flags |= np.where(request & ~known, UNKNOWN, 0)
    flags |= np.where(resets, RESETS, 0)
    flags |= np.where(well & (code == SEND), STAGED, 0)
    flags |= np.where(well & (code == EXECUTE), RELEASES, 0)
    zero = np.zeros(n, np.int64)
    return Frames(
        start=start,
        length=end - start,
        kind=np.where(request, REQUEST, RESPONSE).astype(np.uint8),
        servo_id=servo_id,
        op=np.where(request, code.astype(np.int64), -1),
        address=address.astype(np.int16),
        data_start=factors + addressed,
        data_length=data_length,
        status=status.astype(np.int16),
        reply=reply.astype(np.uint8),
        token=token,
        alt_id=alt.astype(np.int16),
        flags=flags.astype(np.uint8),
        t_start=zero,
        t_end=zero,
        uncertainty=zero,
        direction=np.zeros(n, np.uint8),
    )


def _new_id(data: U8, factors: I64, address: I64, length: I64, alt: I64) -> I64:
    """A write over the id register is answered under the old id or under the new one."""
    at = ID_REGISTER - address
    covers = (address >= 0) & (at >= 0) & (at < length)
    where = np.where(covers, factors + 1 + at, 0)
    return np.where(covers & (alt == NO_ALT), data[where], alt)


def _either_way(
    block: Block,
    request: Mask,
    servo_id: I16,
    size: I64,
    code: U8,
    end: I64,
    start: I64,
    second: I64,
) -> None:
    """Code 73 to one servo is a command or an error byte: the request before it decides."""
    segment = block.segment(start)
    for i in np.flatnonzero((code == SYMMETRIC_STORE) & (servo_id != BROADCAST)).tolist():
        j = i - 1
        pending = (
            j >= 0
            and bool(request[j])
            and servo_id[j] != BROADCAST
            and servo_id[j] in (STAND_ALONE, servo_id[i])
            and segment[j] == segment[i]
            and start[i] - end[j] <= REACH
        )
        expects = 2 + (int(second[j]) if pending and code[j] == LOAD and size[j] == 4 else 0)
        command = size[i] >= 4 + int(second[i]) + 1
        request[i] = command and not (pending and size[i] == expects)


def states_itself(frames: Frames) -> Mask:
    """Tell nothing. A feedback names no address: what its bytes are, only the request says."""
    return np.zeros(len(frames), bool)


def values(
    block: Block, frames: Frames, rows: I64, state: State, *, shapes: Addressed = SHAPES
) -> Values:
    """Read register values; a symmetric store names the bytes a servo first, then the servos."""
    address = frames.address[rows].astype(np.int64)
    sync = (frames.op[rows] == SYMMETRIC_STORE) & (address >= 0)
    step = np.zeros(len(rows), np.int64)
    if sync.any():
        step[sync] = block.data[frames.data_start[rows[sync]]].astype(np.int64) + 1
    return shapes.values(block, frames, rows, address, step, state)


def explain(run: bytes, start: int) -> list[Gap]:
    """Say why no frame claims these bytes: plain Python, for the rare stretch of damage."""
    out: list[Gap] = []
    p, n, head = 0, len(run), PLAN.header

    def noise(until: int) -> None:
        if until > p:
            out.append(Gap(start + p, until - p, "noise"))

    while p < n:
        at = run.find(head, p)
        while at >= 0 and run[at + _ID : at + _ID + 1] == b"\xff":
            at += 1  # an id is never FF: the header is the last three of a run
        if at < 0 or at + _ID >= n:
            # Less than a header tells a packet no better than a stray byte: noise.
            noise(n if at < 0 else at)
            if at >= 0:
                out.append(Gap(start + at, n - at, "truncated", {"have": n - at}))
            break
        noise(at)
        size = run[at + _SIZE] if at + _SIZE < n else None
        following = run.find(head, at + 3)
        stop = at + OVERHEAD + (size or 0)
        if size is not None and size < 2:
            end = at + _CODE
            out.append(Gap(start + at, end - at, "damaged", {"size": size, "size_least": 2}))
        elif size is None or stop > n or 0 <= following < stop - 1:
            end = following if following >= 0 else n
            detail = (
                {"have": end - at, "need": OVERHEAD + size}
                if size is not None
                else {"have": end - at}
            )
            out.append(Gap(start + at, end - at, "truncated", {**detail, **_as_read(run[at:end])}))
        else:
            end = stop
            body = run[at + PLAN.sum_from : stop - 1]
            out.append(
                Gap(
                    start + at,
                    stop - at,
                    "damaged",
                    {
                        "checksum_expected": PLAN.checksum(body),
                        "checksum_got": run[stop - 1],
                        **_as_read(run[at : stop - 1]),
                    },
                )
            )
        p = end
    return out


def _as_read(raw: bytes) -> dict[str, object]:
    """Return the fields of a frame that does not hold, without its checksum, as they stand."""
    out: dict[str, object] = {}
    if len(raw) > _ID:
        out["servo_id"] = raw[_ID]
    if len(raw) > _CODE:
        code = raw[_CODE]
        if code in COMMANDS:
            out["op"] = COMMANDS[code].name
        else:
            out["code"] = code
        out["data"] = raw[_FACTORS:].hex()
    return {"fields": out} if out else {}
