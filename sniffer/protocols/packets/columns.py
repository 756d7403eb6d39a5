"""A packet family in columns: what the walk of its grammars gave, looked up by code and length.

``params`` of each command is walked once into ``what[code, count]``: eight bits that say what a
packet with that code and so many parameter bytes is, if it is a command. One gather asks them for
all rows; what is rare is then worked out for those rows only that have its bit.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from construct import Container

from sniffer.ground.codes import IF_ALL, MANY, NEVER, ON_ITS_OWN, OPTIONAL, REQUEST, RESPONSE
from sniffer.ground.distinct import numbers
from sniffer.ground.framing import frame_by_plan, frame_by_plans
from sniffer.ground.model import (
    ANY_ID,
    MALFORMED,
    NO_ALT,
    UNKNOWN,
    UNUSUAL,
    DeclarationError,
    Frames,
)
from sniffer.protocols.packets.declare import LISTED
from sniffer.protocols.packets.direction import alike, in_turn, near, said_again
from sniffer.protocols.packets.form import check_form, planned, shapes_of, told_of
from sniffer.protocols.packets.listed import Bytes, asked_by, column, listed, whole
from sniffer.protocols.packets.walk import ROOM

if TYPE_CHECKING:
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, U8, Mask, Spans
    from sniffer.protocols.packets.declare import PacketFamily

KNOWN, FITS, ADDRESSED, READS, WRITES, TARGETS, RENUMBERS, CHECKED = (1 << k for k in range(8))
_PLAIN: Final = "plain"  # what a block's notes hold


class FamilyColumns:
    """``frame`` and ``describe`` of a family, and what ``values`` asks of its shapes."""

    def __init__(self, family: PacketFamily) -> None:
        self.family = family
        check_form(family)
        self.plan = plan = planned(family)
        self.id_at, self.code_at = plan.at.get("servo_id", -1), plan.at["code"]
        self.back = planned(family, answers=True) if family.answer_header else None
        self.sizes = plan.sizes(family.most)
        self.sizes_back = self.sizes if self.back is None else self.back.sizes(family.most)
        self.longest = int(max(self.sizes.max(), self.sizes_back.max()))
        self.reach = max(self.longest, family.reach)
        self.told = told_of(family)
        self.shapes = shapes_of(family)
        self.width = self._one_place("address", 0)[1]
        self.length_at, self.length_width = self._one_place("length", self.width)
        self._id_register = family.effective("servo_id")
        self._reply_register = family.effective("feedback")
        codes = np.arange(256)
        self._what = np.zeros((256, ROOM), np.uint8)
        self._reply = np.full(256, IF_ALL, np.uint8)
        self._to_all, self._effect = np.zeros((2, 256), np.uint8)
        self._option, self._bits, self._new, self._answer = np.zeros((4, 256), np.int64)
        self._target, self._step_data = np.zeros((2, 256), np.int64)
        self._fixed, self._held = np.zeros((2, 256), np.int64)
        self._at = np.full(256, -1, np.int64)
        self._spaces, self._strides = np.zeros(256, np.int64), np.ones(256, np.int64)
        self._answer_at = np.full(256, -1, np.int64)
        self.lists, self.together, self._asks, self._repeats = np.zeros((4, 256), bool)
        self._own = np.zeros(256, bool)
        self.each = np.zeros(256, np.uint8)
        for code in self.shapes:
            self._enter(code)
        # whether anything stands between an address and the data
        self._wide = bool((self._held > self.width).any())
        self._tells_at = bool(self._at.max() >= 0)
        self._moves = bool(self._spaces.any() or (self._strides > 1).any())
        self._silent = np.isin(codes, family.silent)
        self._anyone = np.where(np.isin(codes, family.anyone), ANY_ID, NO_ALT)
        self._answers = np.isin(
            codes, [-1 if family.answers is None else family.answers, *family.asked_by]
        )
        self._certain = ~self._answers if self._answers.any() else codes >= family.certain
        # the error is a parameter, the first one
        self._error_width = int(family.answers is not None and self.told is None)

    def _one_place(self, name: str, at: int) -> tuple[int, int]:
        """Return where a field stands in all commands that have it; columns read it at once."""
        places = {s.at[name] for s in self.shapes.values() if name in s.at}
        if len(places) > 1:
            raise DeclarationError(
                f"{self.family.name}: columns want one place for {name}, not {sorted(places)}: let "
                "it stand alike in all commands, or name it otherwise where it does not"
            )
        return places.pop() if places else (at, 0 if name == "address" else 1)

    def _enter(self, code: int) -> None:
        """Lay what is known of a command into the tables."""
        command, shape = self.family.commands[code], self.shapes[code]
        what = KNOWN | FITS | ADDRESSED * ("address" in shape.at)
        asks_there = command.answer != 0 and command.answer_at < 0
        alone = shape.targets is None and not asks_there
        brings = shape.writes or (command.at >= 0 and shape.least > 0 and alone)
        self._asks[code] = command.at >= 0 and asks_there
        what |= READS * shape.reads | WRITES * brings | TARGETS * (shape.targets is not None)
        what |= RENUMBERS * (command.new_id is not None)
        what |= CHECKED * bool(shape.checks or shape.constants or shape.counted)
        self._held[code] = shape.fixed if shape.writes else self.width * ("address" in shape.at)
        self._what[code] = KNOWN
        self._what[code, shape.least : shape.most + 1] = what
        self._reply[code], self._to_all[code] = command.reply, command.to_all
        self._effect[code], self._answer[code] = command.effect, max(command.answer, 0)
        self._option[code] = shape.at.get("option", (0, 1))[0]
        self._bits[code], self._new[code] = command.new_id or (0, 0)
        self._fixed[code], self._at[code] = shape.fixed, command.at
        self._spaces[code], self._strides[code] = command.space, command.stride
        self._answer_at[code], self._repeats[code] = command.answer_at, command.repeats
        self.together[code], self.each[code] = command.together, command.each
        self._own[code] = self.family.echoes and command.on_its_own
        if shape.targets is not None:
            self.lists[code] = not shape.brings_several
            self._target[code], self._step_data[code] = shape.targets.size, shape.targets.data

    def frame(self, block: Block) -> tuple[Spans, int]:
        """Frame by the plan; direction is told later, unless the header tells it."""
        if self.back is not None:
            return frame_by_plans(((self.plan, REQUEST), (self.back, RESPONSE)), block)
        return frame_by_plan(self.plan, block)

    def plain(self, block: Block, start: I64, end: I64) -> Bytes:
        """Return where the parameters of each packet stand as they were meant.

        Those of the few stuffed packets are laid behind the block's own bytes; the columns of the
        packets themselves stay as on the wire.
        """
        stuffing, data = self.family.stuffing, block.data
        params = start + self.plan.tail_at
        count = self.plan.tail_in(end - start)
        if stuffing is None or not len(start):
            return Bytes(data, params, count)
        if _PLAIN not in block.notes:
            block.notes[_PLAIN] = stuffing.find(data)
        at = block.notes[_PLAIN]
        row = np.searchsorted(start, at, "right") - 1
        rows = numbers(row[(row >= 0) & (at >= params[row]) & (at < params[row] + count[row])])
        if self.together.any():  # what answers for several is read by place
            code, servo_id = data[start[rows] + self.code_at], self._ids(data, start[rows])
            rows = rows[~(self._answers[code] & self._silent[servo_id])]
        if not len(rows):
            return Bytes(data, params, count)
        told = [
            stuffing.plain(data[a : a + n].tobytes())
            for a, n in zip(params[rows].tolist(), count[rows].tolist(), strict=True)
        ]
        size = np.array([len(k) for k in told])
        params, count = params.copy(), count.copy()
        params[rows], count[rows] = len(data) + np.cumsum(size) - size, size
        behind = np.frombuffer(b"".join(told), np.uint8)
        return Bytes(np.concatenate([data, behind]), params, count)

    def _ids(self, data: U8, start: I64) -> U8:
        """Return whom each packet names."""
        if self.id_at < 0:
            return np.full(len(start), self.family.sole_id, np.uint8)
        return data[start + self.id_at]

    def describe(self, block: Block, spans: Spans) -> Frames:
        """Tell commands from responses, and what each expects.

        For example mightyZAP: servo 1 is asked for two bytes at 8C and gives them, servo 2 is given
        a goal and reports error 20, and servo 1 is asked with a byte too many::

            row          0    1    2    3    4
            code         242  0    243  32   242     F2 load, an error, F3 store, an error, F2
            count        2    2    3    0    3       parameter bytes
            what         15   0    23   0    1       of a command: 15 reads, 23 writes, 1 fits not
            request      1    0    1    0    1
            address      140  -1   134  -1   -1
            data_length  0    2    2    0    3
            token        2    2    0    -1   0       -1: an error without data answers anything

        Invariant: what a packet is as a command, ``what`` says by code and count alone. So commands
        are not gone through one by one, which would touch every array once a command; a row is
        looked at again only where its bits say that its own bytes matter (CHECKED, TARGETS).
        """
        start, end, family = spans.start, spans.end, self.family
        servo_id, code = self._ids(block.data, start), block.data[start + self.code_at]
        body = self.plain(block, start, end)
        data, params, count = body.data, body.params, body.number
        by, who = code.astype(np.intp), servo_id.astype(np.intp)  # as numpy looks up fastest
        what = self._what.ravel()[by << 8 | np.minimum(count, ROOM - 1)]
        seen = int(np.bitwise_or.reduce(what)) if len(what) else 0
        length = None
        if seen & (READS | TARGETS):
            length = column(data, params + self.length_at, self.length_width)
        if seen & CHECKED:
            self._check(body, what, code)
        if seen & TARGETS and length is not None:
            self._whole_targets(body, what, code, length)
        silent, answers = self._silent[who], self._answers[by]
        if self.back is not None:
            answers = spans.kind == RESPONSE
            request = ~answers
        elif family.echoes:
            answers = (self._answer[by] > 0) & (count == self._answer[by])
            if self._repeats.any():
                expects = np.where(silent, self._to_all[by], self._reply[by]) != NEVER
                may = self._repeats[by] & expects & (what & FITS > 0)
                answers |= said_again(block, spans, may, self.reach)
            request = ~answers
        else:
            request = self._certain[by] | (silent & ~answers)
        either = ~request & (what & KNOWN > 0) & ~answers
        might = np.zeros(0, np.int64)
        if either.any():
            request = self._either_way(
                block, spans, servo_id, code, body, what, length, silent, request, either
            )
            if family.doubt:
                might = np.flatnonzero(either & ~request & (what & FITS > 0) & (count > 0))
        asked = request.view(np.uint8)
        known = what & asked  # bit KNOWN is 1
        what = what * asked
        flags = self._effect[by] * (what & FITS > 0)
        flags += (asked - known) * np.uint8(UNKNOWN)
        flags += (known & ~(what >> 1)) * np.uint8(MALFORMED)
        flags[might] |= UNUSUAL
        held = (what & ADDRESSED > 0) * np.int64(self.width)
        address = np.where(held, column(data, params, self.width or 1), -1)
        if self._wide:
            held = np.where(held, self._held[by], 0)
        lists = (what & FITS > 0) & self.lists[by]
        brings_none = (what & READS > 0) | lists
        if self._tells_at:
            brings_none |= (what & FITS > 0) & self._asks[by]
        if family.echoes:  # what is said once more is nothing new
            brings_none |= ~request & self._repeats[by]
        if self._moves:
            there = address * self._strides[by] + self._spaces[by]
            address = np.where((what & FITS > 0) & (held > 0), there, address)
        if self._tells_at:
            address = np.where(what & FITS > 0, np.maximum(address, self._at[by]), address)
        status = np.where(request, np.int16(-1), code)  # a plain -1 would wrap to 255
        if self._error_width:
            told = ~request & (count > 0)
            status = np.where(told, column(data, params, 1), -1).astype(np.int16)
            held += told
            flags[~request & ~told] = MALFORMED
        data_length = np.where(brings_none, 0, count - held)
        token = np.where(request, 0, data_length)
        if length is not None and seen & READS:
            token = np.where(what & READS > 0, length, token)
        if self._answer.any():
            token += np.where(what & FITS, self._answer[by], 0)
        if family.echoes:
            status = np.full(len(start), -1, np.int16)
            # what it answers, the code says; of packets that come once more their number, too
            again = self._repeats[by] & (~request | (what & FITS > 0))
            token = np.where(again, count, token)
            token |= np.where((token > 0) | again | ~request, by << 8, 0)
            address = np.where(request, address, self._answer_at[by])
        own = ~request & self._own[by]
        token[own] = ON_ITS_OWN
        # an error needs no data: a response of an error byte alone answers any read
        token[(status > 0) & (data_length == 0)] = -1
        if self.told is not None:
            token = self.told.asks(by, token, address, what & ADDRESSED > 0)
            status = np.full(len(start), -1, np.int16)
            self.told.read(
                body, code, request, held=held, length=data_length, status=status,
                address=address, token=token, flags=flags,
            )  # fmt: skip
        reply = self._reply[by] * (request & ~silent)  # NEVER is 0
        alt = self._anyone[who]
        if self._to_all.any():
            reply = np.where(request & silent, self._to_all[by], reply)
            alt = np.where(reply == MANY, ANY_ID, alt)
        if seen & WRITES:
            self._over_registers(body, what, by, address, data_length, reply, alt)
        if seen & RENUMBERS:
            rows = np.flatnonzero(what & RENUMBERS)
            bits = self._bits[code[rows]]
            option = column(data, params[rows] + self._option[code[rows]], 1)
            rows = rows[((bits == 0) | (option & bits > 0)) & (alt[rows] == NO_ALT)]
            alt[rows] = self._new[code[rows]]
        if lists.any():
            token[lists] = LISTED
            asked_of = asked_by(block, spans, request, self.reach)
            listed(self, body, code, servo_id, lists, asked_of, data_length, address, token)
        as_sent, wire = data is block.data, self.plan.tail_in(end - start)
        return Frames.stating(
            start=start,
            length=end - start,
            kind=(~request).view(np.uint8),  # REQUEST is 0, RESPONSE 1
            servo_id=servo_id,
            op=np.where(request | own, by, -1 if self.told is None else self.told.asked[by]),
            address=address,
            data_start=start + self.plan.tail_at + held,
            data_length=data_length if as_sent else np.where(brings_none, 0, wire - held),
            status=status,
            reply=reply,
            token=token,
            alt_id=alt,
            flags=flags,
        )

    def _check(self, body: Bytes, what: U8, code: U8) -> None:
        """Let the grammars' own checks of fields judge whole columns."""
        rows = np.flatnonzero(what & CHECKED)
        for k in np.flatnonzero(np.bincount(code[rows], minlength=256)).tolist():
            mine, shape = rows[code[rows] == k], self.shapes[k]
            at = body.params[mine]
            bad = np.zeros(len(mine), bool)
            fields = Container(
                {name: column(body.data, at + p, w) for name, (p, w) in shape.at.items()}
            )
            for check in shape.checks:
                bad |= ~np.asarray(check(fields), bool)
            if shape.counted:
                bad |= fields["length"] != body.number[mine] - shape.fixed
            for place, constant in shape.constants:
                for i, byte in enumerate(constant):
                    bad |= body.data[at + place + i] != byte
            what[mine[bad]] = KNOWN

    def _whole_targets(self, body: Bytes, what: U8, code: U8, length: I64) -> None:
        """Take for malformed what ends inside a target."""
        rows = np.flatnonzero(what & TARGETS)
        step = self._target[code[rows]] + length[rows] * self._step_data[code[rows]]
        rest = body.number[rows] - self._fixed[code[rows]]
        bad = rest % np.maximum(step, 1) > 0
        for k in np.flatnonzero(np.bincount(code[rows], minlength=256)).tolist():
            targets = self.shapes[k].targets
            if targets is not None and targets.data and "length" in targets.at:
                mine = np.flatnonzero(code[rows] == k)
                bad[mine] = ~whole(body, rows[mine], self.shapes[k])
        what[rows[bad]] = KNOWN

    def _over_registers(
        self, body: Bytes, what: U8, code: I64, address: I64, length: I64, reply: U8, alt: I64
    ) -> None:
        """Say what a write over the id or over the return mode leaves open.

        It is answered under the old id or under the new one, in the old mode or in the new one.
        """
        rows = np.flatnonzero(what & WRITES)
        if self._reply_register >= 0:
            at = self._reply_register - address[rows]
            hit = rows[(at >= 0) & (at < length[rows])]
            reply[hit] = np.where(reply[hit] == IF_ALL, OPTIONAL, reply[hit])
        if self._id_register >= 0:
            at = self._id_register - address[rows]
            covers = (at >= 0) & (at < length[rows]) & (alt[rows] == NO_ALT)
            hit, at = rows[covers], at[covers]
            held = np.where(what[hit] & ADDRESSED, self._held[code[hit]], 0)
            alt[hit] = body.data[body.params[hit] + held + at]

    def _either_way(
        self, block: Block, spans: Spans, servo_id: U8, code: U8, body: Bytes, what: U8,
        length: I64 | None, silent: Mask, request: Mask, either: Mask,
    ) -> Mask:  # fmt: skip
        """Decide codes that are a command or an error byte: the request before them tells.

        Whether a row is a response depends on the row before it being a request, which may itself
        depend on the row before that: see ``in_turn``.
        """
        start, count = spans.start, body.number
        fits = what & FITS > 0
        if self.family.begins and length is not None:
            step = self._target[code] + length * self._step_data[code]
            fits |= (step > 0) & (length >= 1) & (count >= self._fixed[code] + step)
        base = request | (either & fits)
        expects = np.zeros(len(start), np.int64)
        if length is not None:
            np.copyto(expects, length, where=what & READS > 0)
        expects += np.where(fits, self._answer[code], 0)
        asks = base & ~silent & (self._reply[code] != NEVER)
        same = (servo_id[1:] == servo_id[:-1]) | (self._anyone[servo_id[:-1]] == ANY_ID)
        flips = np.zeros(len(start), bool)
        flips[1:] = (either & base)[1:] & asks[:-1] & same
        flips[1:] &= (count[1:] == expects[:-1]) | (count[1:] == 0)
        flips &= near(block, spans, self.reach)
        rows = np.flatnonzero(flips)
        rows = rows[(code[rows] == code[rows - 1]) & (count[rows] == count[rows - 1])]
        flips[rows] = ~alike(block, spans, rows)  # the same bytes: asked once more
        return in_turn(base, flips)
