"""Packets to several servos in columns: who is meant, and which answers are theirs.

A walk along targets takes one step a target for all rows at once:

    row 7   84 00 04 00 | 01 | 02 | 03        sync read: address, length, then the ids
    row 9   84 00 04 00 | 01 | 02
    step 0: rows 7, 9 (id 1)   step 1: rows 7, 9 (id 2)   step 2: row 7 (id 3)
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from sniffer.ground.distinct import numbers
from sniffer.protocols.listing import Listing
from sniffer.protocols.packets.declare import LISTED

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, U8, Mask, Spans
    from sniffer.ground.plan import Plan
    from sniffer.protocols.packets.declare import PacketFamily
    from sniffer.protocols.packets.walk import Place, Shape


class Bytes(NamedTuple):
    """Where the parameters of packets stand, and their number, as they were meant."""

    data: U8
    params: I64
    number: I64


class Nth(NamedTuple):
    """The n-th target of ``rows``."""

    rows: I64
    servo_id: U8
    address: I64
    length: I64
    at: I64


class Tables(Protocol):
    """What is known of a family's commands before a byte is read.

    ``shapes`` by code; ``together``, for each of the 256 codes, whether one packet answers for all;
    ``each``, how far every servo owes an answer.
    """

    family: PacketFamily
    plan: Plan
    shapes: dict[int, Shape]
    together: Mask
    each: U8


def column(data: U8, at: I64, width: int) -> I64:
    """Read a field a row; what lies behind the block is never a field of a packet that fits."""
    last = len(data) - 1
    out = data[np.minimum(at, last)].astype(np.int64)
    return out if width == 1 else out | data[np.minimum(at + 1, last)].astype(np.int64) << 8


def steps(body: Bytes, rows: I64, shape: Shape) -> Iterator[Nth]:
    """Walk along the targets of commands of one shape, whose targets are whole."""
    targets, data = shape.targets, body.data
    if targets is None:
        return
    pos, stop = body.params[rows] + shape.fixed, body.params[rows] + body.number[rows]
    base = body.params[rows]

    def field(name: str) -> I64:
        if shape.begin >= 0:
            return np.full(len(pos), shape.begin if name == "address" else targets.size)
        place: Place | None = targets.at.get(name)
        first = pos
        if place is None:
            place, first = shape.at[name], base
        return column(data, first + place[0], place[1])

    while True:
        alive = pos < stop
        if not alive.all():
            rows, pos, stop, base = rows[alive], pos[alive], stop[alive], base[alive]
        if not len(rows):
            return
        length, at = field("length"), pos + targets.size
        servo_id = data[pos + targets.at["servo_id"][0]]
        if shape.begin >= 0:
            yield Nth(rows, servo_id, field("address"), length, pos)
        else:
            address = field("address") * shape.stride + shape.space
            yield Nth(rows, servo_id, address, length, at)
        pos = at + length if targets.data else at


def whole(body: Bytes, rows: I64, shape: Shape) -> Mask:
    """Tell which commands, each target of which has a length of its own, end with a target."""
    out = np.zeros(len(rows), bool)
    targets = shape.targets
    if targets is None:
        return out
    place, width = targets.at["length"]
    which = np.arange(len(rows))
    pos, stop = body.params[rows] + shape.fixed, body.params[rows] + body.number[rows]
    while len(which):
        out[which[pos == stop]] = True
        more = pos + targets.size <= stop
        which, pos, stop = which[more], pos[more], stop[more]
        pos = pos + targets.size + column(body.data, pos + place, width)
    return out


def asked_by(block: Block, spans: Spans, request: Mask, reach: int) -> I64:
    """Return for each response the last request before it, -1 if that is closed or there is none.

    Requests have -1.
    """
    row = np.arange(len(request))
    last: I64 = np.maximum.accumulate(np.where(request, row, -1))
    near = ~request & (last >= 0)
    near &= spans.start - spans.end[last] <= reach
    if len(block.barriers):
        segment = block.segment(spans.start)
        near &= segment == segment[last]
    return np.where(near, last, -1)


def listed(
    of: Tables, body: Bytes, code: U8, servo_id: U8, lists: Mask, asked: I64,
    length: I64, address: I64, token: I64,
) -> None:  # fmt: skip
    """Give those that a request lists, and that answer it as it says, their address and its token.

    Args:
        of: the family's tables.
        body: parameters of all rows.
        code: of all rows, as the next.
        servo_id: who is named.
        lists: requests that list whom they read.
        asked: the last request before each response, or -1.
        length: data bytes, as meant.
        address: filled in.
        token: filled in.

    For example a read of four bytes from servos 1, 2 and 3 (row 0). 2 answers first, then 1, then
    5, which was not asked, and 3 with two bytes::

        servo_id   254  2    1    5   3
        asked      -1   0    0    0   0
        length     0    4    4    4   2
        first      0    4    4    4   4     in ``single``, where its answers begin
        last       4    4    4    4   4     and end
        at         2                        step 1, servo 1: the answer in row 2
        at         1                        step 2, servo 2
        at         4                        step 3, servo 3 ...
        right      0                        ... which has not the four bytes that it should
        left       1    0    0    1   0     nobody lists row 3
        address    132  132  132  -1  -1    what is right states the bytes from 132 on

    A step is a servo of each list, not an answer: lists are short, and all lists of a pass take
    theirs together. Whatever the order of the answers, each meets its own servo; so none has to
    be sorted, and one that is missing moves no other.
    """
    answers = np.flatnonzero((asked >= 0) & lists[asked])
    if not len(answers):
        return
    together = of.together[code[asked[answers]]]
    single, all_in_one = answers[~together], answers[together]
    first = np.searchsorted(asked[single], np.arange(len(asked)))
    last = np.searchsorted(asked[single], np.arange(len(asked)), "right")
    due = np.zeros(len(asked), np.int64)  # bytes of a packet that answers for all
    place = np.full(len(asked), -1, np.int64)
    left = np.ones(len(asked), bool)
    rows = numbers(asked[answers])
    for k in numbers(code[rows]).tolist():
        mine = rows[code[rows] == k]
        for step in steps(body, mine, of.shapes[k]):
            due[step.rows] += step.length + 2 + of.plan.sum_width
            place[step.rows] = np.where(place[step.rows] < 0, step.address, place[step.rows])
            many = last[step.rows] - first[step.rows]
            of_step = np.repeat(np.arange(len(many)), many)
            nth = np.arange(len(of_step)) - np.repeat(np.cumsum(many) - many, many)
            at = single[first[step.rows][of_step] + nth]
            own = left[at] & (servo_id[at] == step.servo_id[of_step])
            at, of_step = at[own], of_step[own]
            left[at] = False  # of an id that is listed twice the first counts
            right = length[at] == step.length[of_step]
            address[at[right]] = step.address[of_step[right]]
            token[at[right]] = LISTED
    # error, id and data of each with a checksum between two; the first error is no data
    due -= 1 + of.plan.sum_width
    good = all_in_one[length[all_in_one] == due[asked[all_in_one]]]
    good = good[np.isin(servo_id[good], of.family.silent)]
    address[good], token[good] = place[asked[good]], LISTED


def targets(of: Tables, body: Bytes, code: U8, lists: Mask) -> Listing:
    """Return whom requests list; an id that is listed twice answers once.

    Args:
        of: the family's tables.
        body: parameters of all rows.
        code: of all rows.
        lists: which of them are such requests.
    """
    rows = np.flatnonzero(lists)
    found = [
        step
        for k in numbers(code[rows]).tolist()
        for step in steps(body, rows[code[rows] == k], of.shapes[k])
    ]
    row, servo_id, address, length = (
        np.concatenate([np.empty(0, np.int64), *(np.asarray(s[i], np.int64) for s in found)])
        for i in range(4)
    )
    order = np.argsort(row, kind="stable")  # steps come one after the other, row by row
    row, servo_id, address, length = row[order], servo_id[order], address[order], length[order]
    together = of.together[code[row]]
    size = np.cumsum(length + 2 + of.plan.sum_width) - (length + 2 + of.plan.sum_width)
    first = np.searchsorted(row, row)
    begins = np.where(together & (size > size[first]), of.plan.tail_at + size - size[first], 0)
    by = np.where(together, next(iter(of.family.silent), -1), servo_id)
    _, once = np.unique(row << 8 | servo_id, return_index=True)
    once = np.sort(once[~np.isin(servo_id[once], of.family.silent)])
    reply = of.each[code[row]].astype(np.int64)
    told = Listing(row, servo_id, by, address, length, reply, begins)
    return Listing(*(column[once] for column in told))
