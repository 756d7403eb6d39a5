"""A packet family in words: names, fields, dissection, and why bytes are no packet."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import construct as c
import numpy as np

from sniffer.ground.codes import REQUEST
from sniffer.ground.model import MALFORMED, Gap
from sniffer.ground.registers import bit_names
from sniffer.protocols.base import FieldSpan
from sniffer.protocols.dissection import leaves
from sniffer.protocols.packets.fields import (
    field_named,
    flag_bits,
    named,
    numbers,
    unnamed,
)
from sniffer.protocols.packets.form import errors_of
from sniffer.protocols.packets.listed import column
from sniffer.protocols.packets.survey import size_place, survey

if TYPE_CHECKING:
    from sniffer.ground.checksums import Sum
    from sniffer.ground.model import I64, U8, Frames
    from sniffer.protocols.base import FrameView
    from sniffer.protocols.dissection import Leaf
    from sniffer.protocols.explaining import Runs, Torn
    from sniffer.protocols.packets.columns import FamilyColumns


class Words:
    """The presentation of a family."""

    def __init__(self, columns: FamilyColumns) -> None:
        self.family = family = columns.family
        self.plan = columns.plan
        self._size, self._size_place = self.plan.size, size_place(self.plan)
        header, answer = self.plan.header, family.answer_header
        self._heads = (header,) if answer in (b"", header) else (header, answer)
        error = next(iter(errors_of(family)), None)
        self._bits, self._numbers = flag_bits(error), numbers(error)
        self.error_number = 0xFF & ~sum(family.alerts) if self._numbers and not self._bits else 0
        self.reports = family.reports
        plain = [code for code, command in family.commands.items() if not command.effect]
        self.doubtful = tuple(plain if family.doubt else ())
        self._tells_more = family.tells_more
        # a packet's bytes by its length, or its code; that of an answer may be another one
        self._total, self._total_back = columns.sizes, columns.sizes_back
        self._least = int(np.flatnonzero(self._total >= 0)[0])
        self._by_length = bool((self._total[self._least :] >= 0).all())
        self._length_at, self._length_width = columns.length_at, columns.length_width
        # a stuffed byte stands behind another one, so twice the bytes hold the fields in any case
        wire = 1 if family.stuffing is None else 2
        self._telling = np.full(256, np.iinfo(np.int64).max)
        self._several = np.zeros(256, bool)
        for code, shape in columns.shapes.items():
            self._several[code] = shape.targets is not None and shape.targets.data
            alike = self._several[code] and "length" in shape.at
            if shape.writes or alike:
                self._telling[code] = self.plan.tail_at + wire * shape.fixed

    def op_name(self, op: int) -> str:
        """Return the command's name; a code no manual has is ``unknown_<hex>``."""
        if op < 0:
            return self.family.terms[2]
        commands = self.family.commands
        return commands[op].name if op in commands else f"unknown_{op:02x}"

    def status_names(self, status: int) -> tuple[str, ...]:
        """Name the bits of an error byte, or its number and what else it tells."""
        if self._bits or not self._numbers:
            return tuple(bit_names(self._bits, status))
        alerts = self.family.alerts
        number = status & ~sum(alerts)
        out = [self._numbers.get(number, f"error_{number}")] if number else []
        return tuple(out + [name for bit, name in alerts.items() if status & bit])

    def checksum_of(self, raw: bytes) -> tuple[Sum, bytes, int]:
        """Return the checksum, the bytes it covers, and what was sent."""
        return self.plan.checksum_of(raw)

    def fields(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        """Return address, length, option, or the error."""
        data = raw[row.data_start : row.data_start + row.data_length]
        if row.kind != REQUEST:
            out: dict[str, Any] = {}
            if self._tells_more:
                out |= self._told(raw, row)
            elif not self.family.echoes:
                names = list(self.status_names(max(row.status, 0)))
                out["error"] = {"number": row.status, "names": names}
            if data and row.address < 0:
                out["data"] = self._plain(raw, data).hex()
            return out
        params = self._plain(raw, self.plan.tail_of(raw))
        rest = {self.family.tail: params.hex()} if params else {}
        command = self.family.commands.get(row.op)
        if command is None:
            return rest
        if row.flags & MALFORMED:
            front = self._leading(row.op, params)
            return {name: _worded(con, params[i]) for i, (name, con) in enumerate(front)} | rest
        out, servos = {}, []
        found = leaves(command.params, params)
        brings = "data" in {leaf.path.rpartition(".")[2] for leaf in found}
        for leaf in found:
            inside, _, name = leaf.path.rpartition(".")
            if not inside and isinstance(leaf.value, int | float | dict | str):
                out[name] = _said(field_named(command.params, name), leaf, params)
            elif name == "servo_id" and not brings:
                servos.append(leaf.value)
        return {**out, "servo_ids": servos} if servos else out

    def _told(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        """Return what an answer says beside address, length and data."""
        if row.flags & MALFORMED:
            return {}
        out: dict[str, Any] = {}
        params = self.plan.tail_of(raw)
        grammar = self.family.feedback_of(row.op)
        for leaf in leaves(grammar, params):
            if leaf.path == "error":
                names = list(self.status_names(row.status))
                out["error"] = {"number": row.status, "names": names}
            elif leaf.path not in ("address", "length", "data", ""):
                out[leaf.path] = _said(field_named(grammar, leaf.path), leaf, params)
        return out

    def telling_bytes(self, frames: Frames, data: U8) -> I64:
        """Return the bytes before those of registers: what these are, ``fields`` does not look at.

        Of a response all is told by its columns, unless nobody knows what its data is.
        """
        f = frames
        asked = (f.kind == REQUEST) & (f.flags & MALFORMED == 0) & (f.op >= 0) & (f.op < 256)
        out = np.where(asked, self._telling[f.op & 255], f.length)
        several = np.flatnonzero(asked & self._several[f.op & 255])
        if len(several):  # none brings any data where the length says so: then it lists servos
            at = np.minimum(f.start[several] + self.plan.tail_at + self._length_at, len(data) - 1)
            size = column(data, at, self._length_width)
            out[several[size == 0]] = f.length[several[size == 0]]
        registers = (f.kind != REQUEST) & ((f.address >= 0) | (f.data_length <= 0))
        registers &= not self._tells_more
        return np.asarray(np.where(registers, 0, out))

    def _leading(self, op: int, params: bytes) -> list[tuple[str, Any]]:
        """Return the one-byte fields that a command's parameters begin with, as far as they go.

        They can be read although the body as a whole is not as the grammar has it.
        """
        out: list[tuple[str, Any]] = []
        for name, con in named(self.family.commands[op].params):
            if unnamed(con) is not c.Byte or len(out) == len(params):
                break
            out.append((name, con))
        return out

    def dissect(self, raw: bytes, row: FrameView) -> list[FieldSpan]:
        """Return the packet's fields, the parameters split by their command's grammar."""
        out: list[FieldSpan] = []
        for leaf in leaves(self.family.packet_of(raw), raw):
            name = leaf.path.rpartition(".")[2]
            if name == "code":
                asked = row.kind == REQUEST
                words = self.op_name(row.op if asked else -1)
                if self.family.echoes:
                    words = self.op_name(leaf.value)
                elif self.family.asked_by and not asked:
                    words = self.op_name(self.family.asked_by.get(leaf.value, leaf.value))
                elif not asked and self.family.answers is None:
                    words = ", ".join(self.status_names(leaf.value)) or "none"
                label = self.family.terms[not asked]
                out.append(FieldSpan(leaf.offset, 1, label, f"{leaf.value:02X} {words}"))
            elif name == self.family.tail:
                out += self._params(leaf, self._plain(raw, leaf.value), row)
            else:
                out.append(_span(leaf, name))
        return out

    def _plain(self, raw: bytes, params: bytes) -> bytes:
        """Return parameters of a packet as they were meant."""
        if self.family.stuffing is None:
            return params
        at = self.plan.at
        return self.family.plain(params, raw[at["servo_id"]], raw[at["code"]])

    def _params(self, leaf: Leaf, plain: bytes, row: FrameView) -> list[FieldSpan]:
        """Split the parameters of one packet; stuffed bytes shift what stands behind them."""
        wire, at = leaf.value, leaf.offset
        if not wire:
            return []
        if plain != wire:
            whole = FieldSpan(at, len(wire), self.family.tail, _hex(wire), "stuffed")
            return [whole]
        if row.kind != REQUEST and self._tells_more and not row.flags & MALFORMED:
            return self._told_fields(wire, at, row)
        if row.kind != REQUEST:
            out = []
            if self.family.answers is not None:
                words = ", ".join(self.status_names(wire[0])) or "none"
                out.append(FieldSpan(at, 1, "error", f"{wire[0]:02X} {words}"))
            rest = wire[len(out) :]
            return out + [FieldSpan(at + len(out), len(rest), "data", _hex(rest))] * bool(rest)
        command = self.family.commands.get(row.op)
        if command is None or row.flags & MALFORMED:
            found = self._leading(row.op, wire) if command else []
            out = [FieldSpan(at + i, 1, name, str(wire[i])) for i, (name, _) in enumerate(found)]
            rest = wire[len(out) :]
            return out + [FieldSpan(at + len(out), len(rest), "data", _hex(rest))] * bool(rest)
        out = []
        for part in leaves(command.params, wire):
            if isinstance(part.value, dict | str):  # flags, or one of an enumeration
                con = field_named(command.params, part.path)
                text = str(_number(con, wire[part.offset : part.offset + part.length]))
                out.append(FieldSpan(at + part.offset, part.length, part.path, text, part.docs))
            else:
                out.append(_span(part, part.path, at))
        return out

    def _told_fields(self, wire: bytes, at: int, row: FrameView) -> list[FieldSpan]:
        """Split the parameters of an answer by its grammar."""
        out, grammar = [], self.family.feedback_of(row.op)
        for part in leaves(grammar, wire):
            con = field_named(grammar, part.path)
            bits = flag_bits(con)
            if bits or part.path == "error":
                number = _number(con, wire[part.offset : part.offset + part.length])
                names = bit_names(bits, number) if bits else self.status_names(number)
                text = f"{number:0{2 * part.length}X} {', '.join(names) or 'none'}"
                out.append(FieldSpan(at + part.offset, part.length, part.path, text, part.docs))
            else:
                out.append(_span(part, part.path, at))
        return out

    def explain(self, run: bytes, start: int, *, awaited: bool = False) -> list[Gap]:
        """Look for headers: what follows one is a damaged or a truncated packet, the rest noise."""
        del awaited  # headers tell
        out: list[Gap] = []
        plan, head, heads = self.plan, self.plan.header, self._heads
        size_at, width = self._size_place
        p, n = 0, len(run)

        def add(until: int, reason: str, detail: dict[str, Any]) -> None:
            nonlocal p
            if until > p:
                out.append(Gap(start + p, until - p, reason, detail))
                p = until

        while p < n:
            at = _first(run, heads, p)
            while at >= 0 and run.startswith(heads, at + 1):
                at += 1  # an id is never a header's byte: the header is the last of a run
            if at < 0 or at + len(head) >= n:
                # Less than a header tells a packet no better than a stray byte: noise.
                add(n if at < 0 else at, "noise", {})
                add(n, "truncated", {"have": n - at})
                break
            add(at, "noise", {})
            stop = at + size_at + width
            size = int.from_bytes(run[at + size_at : stop], "little") if stop <= n else None
            total = self._total if run.startswith(head, at) else self._total_back
            need = None
            if size is not None:
                need = total.item(size) if size < len(total) else -1
                if need < 0:
                    add(stop, "damaged", self._impossible(size))
                    continue
            following = _first(run, heads, at + len(head))
            stop = at + (need or 0)
            if need is None or stop > n or 0 <= following < stop - plan.behind:
                end = following if following >= 0 else n
                detail = {"have": end - at} | ({} if need is None else {"need": need})
                add(end, "truncated", {**detail, **self._as_read(run[at:end])})
                continue
            detail = self._broken(run[at:stop])
            read = self._as_read(run[at : stop - plan.behind])
            add(stop, "damaged", {**detail, **read})
        return out

    def _impossible(self, size: int) -> dict[str, Any]:
        """Return what is wrong with a length that no packet has, or with a code."""
        if not self._by_length:
            return {self._size: size}
        bound = "least" if size < self._least else "most"
        limit = self._least if size < self._least else self.family.most
        return {self._size: size, f"{self._size}_{bound}": limit}

    def _broken(self, raw: bytes) -> dict[str, Any]:
        """Return which checksum of a packet does not hold, empty if all do."""
        for seal in self.plan.seals:
            if not seal.stands_in(raw):
                continue
            expected, got = seal.checksum(seal.covered(raw)), seal.sent(raw)
            if expected != got:
                return {"checksum_expected": expected, "checksum_got": got}
        return {}

    def survey(self, runs: Runs) -> Torn:
        """Tell the same of all runs of a pass at once."""
        heads = (self.plan.header, self.family.answer_header)
        totals = (self._total, self._total_back)
        return survey(runs, self.plan, heads, totals, self.family.sole_id)

    def _as_read(self, raw: bytes) -> dict[str, Any]:
        """Return the fields of a packet that does not hold, without its checksum."""
        at = self.plan.at
        out: dict[str, Any] = {}
        if self.family.sole_id is not None:
            if len(raw) > len(self.plan.header):
                out["servo_id"] = self.family.sole_id
        elif len(raw) > at["servo_id"]:
            out["servo_id"] = raw[at["servo_id"]]
        if len(raw) > at["code"]:
            code = raw[at["code"]]
            code = self.family.asked_by.get(code, code)
            if code in self.family.commands:
                out["op"] = self.op_name(code)
            else:
                out["code"] = code
            out["data"] = raw[self.plan.tail_at :].hex()
        return {"fields": out} if out else {}


def _first(run: bytes, heads: tuple[bytes, ...], at: int) -> int:
    """Return where the first header stands from an offset on, -1 if there is none."""
    if len(heads) == 1:
        return run.find(heads[0], at)
    found = [place for head in heads if (place := run.find(head, at)) >= 0]
    return min(found, default=-1)


def _said(con: Any, leaf: Leaf, params: bytes) -> Any:
    """Return what a field of some parameters says: a number as its grammar reads it, or names."""
    number = _number(con, params[leaf.offset : leaf.offset + leaf.length])
    if isinstance(number, float):
        return number if math.isfinite(number) else str(number)
    return _worded(con, number)


def _number(con: Any, part: bytes) -> Any:
    """Return the number in the bytes of a field: its high byte may be the first."""
    inner = unnamed(con)
    if isinstance(inner, c.FormatField | c.BytesInteger):
        return inner.parse(part)
    return int.from_bytes(part, "little")


def _worded(con: Any, number: int) -> Any:
    """Return a field's number; of flags or an enumeration with the names."""
    bits, known = flag_bits(con), numbers(con)
    if bits:
        return {"number": number, "names": bit_names(bits, number)}
    return {"number": number, "names": [known.get(number, "unknown")]} if known else number


def _span(leaf: Leaf, name: str, offset: int = 0) -> FieldSpan:
    value = leaf.value
    text = _hex(value) if isinstance(value, bytes) else str(value)
    return FieldSpan(leaf.offset + offset, leaf.length, name, text, leaf.docs)


def _hex(data: bytes) -> str:
    return data.hex(" ").upper()
