"""Register values of a packet family: each servo's span of bytes is a part, read by its shape."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.codes import MANY, REQUEST
from sniffer.ground.distinct import numbers
from sniffer.ground.framing import Block
from sniffer.ground.model import MALFORMED, UNKNOWN, UNUSUAL, Spans
from sniffer.protocols.packets.declare import LISTED
from sniffer.protocols.packets.listed import Nth, asked_by, steps, targets
from sniffer.protocols.shapes import Addressed, Parts

if TYPE_CHECKING:
    from sniffer.ground.model import I64, Frames, Mask
    from sniffer.protocols.base import State, Values
    from sniffer.protocols.listing import Listing
    from sniffer.protocols.packets.columns import FamilyColumns
    from sniffer.protocols.packets.listed import Bytes


class Readings:
    """``values`` of a family."""

    def __init__(self, columns: FamilyColumns) -> None:
        self._columns = columns
        self._shapes = Addressed(columns.family.models, first=0)
        self._joint = bool(columns.together.any())
        self._several = np.array(
            [k in columns.shapes and columns.shapes[k].brings_several for k in range(256)]
        )

    def values(self, block: Block, frames: Frames, rows: I64, state: State) -> Values:
        """Read register values; a packet to several gives each servo its own."""
        columns = self._columns
        body = columns.plain(block, frames.start, frames.end)
        at, length = frames.data_start[rows], frames.data_length[rows]
        if body.data is not block.data:
            held = at - frames.start[rows] - columns.plan.tail_at
            at = body.params[rows] + held
            length = np.where(length > 0, body.number[rows] - held, 0)
        op, asked = frames.op[rows], frames.kind[rows] == REQUEST
        address = frames.address[rows]
        if columns.family.doubt:
            address = np.where(~asked & (frames.flags[rows] & UNUSUAL > 0), -1, address)
        parts = Parts(rows, frames.servo_id[rows], address, length, at, asked)
        several = asked & self._several[op & 255]
        if several.any():
            several &= frames.flags[rows] & (MALFORMED | UNKNOWN) == 0
        joint = np.zeros(1, bool)
        if self._joint:
            joint = ~asked & (op >= 0) & columns.together[op & 255]
            joint &= frames.token[rows] == LISTED
        if several.any() or joint.any():
            found = self._several_of(body, op, rows, several)
            found += self._joint_of(block, frames, body, at, rows, joint)
            parts = _laid_out(parts, several | joint, found)
        if body.data is not block.data:
            block = Block(body.data, block.barriers, block.final)
        return self._shapes.read(block, parts, state)

    def targets(self, block: Block, frames: Frames) -> Listing:
        """Return whom the requests that read several servos list."""
        columns = self._columns
        lists = (frames.kind == REQUEST) & (frames.token == LISTED) & (frames.reply == MANY)
        body = columns.plain(block, frames.start, frames.end)
        return targets(columns, body, block.data[frames.start + columns.code_at], lists)

    def _several_of(self, body: Bytes, op: I64, rows: I64, several: Mask) -> list[Nth]:
        """Return the parts of commands that bring data for several servos.

        ``rows`` of what is returned are places in the rows asked for.
        """
        out: list[Nth] = []
        place = np.flatnonzero(several)
        for code in numbers(op[place]).tolist():
            mine = place[op[place] == code]
            found = steps(body, rows[mine], self._columns.shapes[code])
            out += [n._replace(rows=mine[np.searchsorted(rows[mine], n.rows)]) for n in found]
        return out

    def _joint_of(
        self, block: Block, frames: Frames, body: Bytes, at: I64, rows: I64, joint: Mask
    ) -> list[Nth]:
        """Return the same of answers that hold what all have answered, one behind the other."""
        out: list[Nth] = []
        place = np.flatnonzero(joint)
        if not len(place):
            return out
        columns = self._columns
        spans = Spans(frames.start, frames.end, frames.kind)
        asked = asked_by(block, spans, frames.kind == REQUEST, columns.reach)[rows[place]]
        between = columns.plan.sum_width + 1  # a checksum and the next one's error
        pos = at[place].copy()
        code = np.where(asked >= 0, frames.op[asked], -1)
        for k in numbers(code[code >= 0]).tolist():
            if not columns.together[k]:
                continue
            mine = np.flatnonzero(code == k)
            for step in steps(body, numbers(asked[mine]), columns.shapes[k]):
                row = np.minimum(np.searchsorted(step.rows, asked[mine]), len(step.rows) - 1)
                hit = step.rows[row] == asked[mine]
                here, row = mine[hit], row[hit]
                servo = body.data[pos[here]]
                length = step.length[row]
                out.append(Nth(place[here], servo, step.address[row], length, pos[here] + 1))
                pos[here] += 1 + length + between
        return out


def _laid_out(parts: Parts, several: Mask, found: list[Nth]) -> Parts:
    """Put the parts of several servos in place of the one that their packet had, in order.

    The n-th part of a packet was found by the n-th step: it goes n places behind the first.
    """
    count = np.where(several, 0, 1)
    nth: list[I64] = []
    for part in found:
        nth.append(count[part.rows])
        count[part.rows] += 1
    first = np.cumsum(count) - count
    alone = np.flatnonzero(~several)
    of = np.zeros(int(count.sum()), np.int64)
    of[first[alone]] = alone
    places = [first[part.rows] + n for part, n in zip(found, nth, strict=True)]
    for part, place in zip(found, places, strict=True):
        of[place] = part.rows
    servo, address = parts.servo_id[of], parts.address[of]
    length, at = parts.length[of], parts.at[of]
    for part, place in zip(found, places, strict=True):
        servo[place], address[place] = part.servo_id, part.address
        length[place], at[place] = part.length, part.at
    return Parts(parts.row[of], servo, address, length, at, parts.written[of])
