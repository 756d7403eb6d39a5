"""A packet family one frame at a time: the grammars parsed, the rules in the obvious words.

Nothing here knows the columns or the numbers walked for them; tests hold both equal.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import construct as c
from construct import ConstructError

from sniffer.ground.codes import IF_ALL, MANY, NEVER, ON_ITS_OWN, OPTIONAL, REQUEST, RESPONSE
from sniffer.ground.model import ANY_ID, MALFORMED, NO_ALT, UNKNOWN, UNUSUAL
from sniffer.ground.wire import Seal
from sniffer.protocols.base import SlowFrame
from sniffer.protocols.dissection import leaves
from sniffer.protocols.listing import ListedServo
from sniffer.protocols.packets.declare import ADDRESS_AT, ANY, CODE_AT, KEY, LISTED
from sniffer.protocols.packets.fields import bare, field_named, number_in, parsed
from sniffer.protocols.shapes import slow_spans

if TYPE_CHECKING:
    from sniffer.protocols.base import State
    from sniffer.protocols.packets.declare import Command, PacketFamily

HEAD: Final = 16
"""More bytes than any member's packet has beside what its length counts."""


class _Target(NamedTuple):
    """One of several servos that a command names, and the bytes that it is read or brought."""

    servo_id: int
    address: int
    length: int
    data: bytes


class Slow:
    """The oracle of a family."""

    def __init__(self, family: PacketFamily) -> None:
        self.family = family
        self._sum_width = self._behind = self._spared = 0
        fields = family.packet.subcons
        sum_field = next((s.subcon for s in fields if s.name == "checksum"), None)
        if isinstance(sum_field, c.Checksum):
            self._sum_width = self._behind = len(sum_field.checksumfield.build(0))
        else:
            tail = next(i for i, s in enumerate(fields) if s.name == family.tail)
            self._behind = sum(s.sizeof() for s in fields[tail + 1 :])
            last = bare(fields[-1])
            self._spared = last.sizeof() if isinstance(last, Seal) and last.some else 0

    def parse(self, data: bytes, at: int, limit: int) -> list[tuple[int, int, int]] | None:
        """Parse one packet; its direction is told later."""
        raw = data[at : min(limit, at + HEAD + self.family.most)]
        stream = io.BytesIO(raw)
        try:
            self.family.packet_of(raw).parse_stream(stream)
        except ConstructError:
            return None
        kind = RESPONSE if self.family.is_answer(raw) else REQUEST
        return [(at, at + stream.tell(), kind)]

    def describe(self, raw: bytes, kind: int, before: SlowFrame | None) -> SlowFrame:
        """Describe one packet by the rules of direction and expectation."""
        del kind  # a packet looks alike both ways
        family = self.family
        packet = family.body_of(raw)
        servo_id = packet.get("servo_id", family.sole_id)
        wire = bytes(packet[family.tail])
        params = family.plain(wire, servo_id, packet.code)
        command = family.commands.get(packet.code)
        fields = parsed(command.params, params) if command else None
        out = SlowFrame(0, len(raw), REQUEST, servo_id, packet.code, raw)
        behind = self._behind if wire else self._behind - self._spared
        out.data_start, out.data = len(raw) - behind - len(wire), wire
        out.alt_id = ANY_ID if servo_id in family.anyone else NO_ALT
        out.token = 0
        if not self._is_request(packet, params, fields, raw, before):
            self._response(out, packet.code, params, before)
            if family.doubt and params and fields is not None:
                out.flags |= UNUSUAL
            return out
        if servo_id not in family.silent:
            out.reply = command.reply if command else IF_ALL
        elif command:
            out.reply = command.to_all
        if out.reply == MANY:
            out.alt_id = ANY_ID
        if command is None or fields is None:
            out.flags |= UNKNOWN if command is None else MALFORMED
        else:
            self._command(out, command, fields, params)
        if packet.code in family.asked_by.values() and out.token != LISTED:
            out.token |= KEY | packet.code << CODE_AT
            repeated = field_named(family.feedback_of(packet.code), "address") is not None
            if repeated and fields is not None and "address" in fields:
                out.token |= out.address << ADDRESS_AT
        return out

    def _response(self, out: SlowFrame, code: int, params: bytes, before: SlowFrame | None) -> None:
        """Read what a servo says, and whether the request before lists it."""
        out.kind, out.op, out.reply = RESPONSE, -1, NEVER
        if before is not None:
            out.asked = before if before.kind == REQUEST else before.asked
        if self.family.echoes:
            command = self.family.commands[code]
            out.token, out.address = code << 8 | len(params), command.answer_at
            if command.on_its_own:
                out.token, out.op = ON_ITS_OWN, code
            if command.repeats:
                out.data = b""  # it says nothing new
            return
        if self.family.tells_more:
            self._told(out, code, params)
            length = len(out.data)
        elif (feedback := parsed(self.family.feedback, bytes([code]) + params)) is None:
            out.flags |= MALFORMED
            out.token, length = len(params), 0
        else:
            length = len(feedback.data)
            taken = len(params) - len(feedback.data)
            out.status = params[0] if taken else code
            out.data_start, out.data = out.data_start + taken, out.data[taken:]
            out.token = len(feedback.data)
            if out.status > 0 and not feedback.data:
                out.token = -1  # an error needs no data
        asked = out.asked
        if asked is None or asked.token != LISTED:
            return
        targets = self._targets(asked)
        if self.family.commands[asked.op].together:
            due = sum(2 + t.length + self._sum_width for t in targets) - self._sum_width - 1
            right = out.servo_id in self.family.silent and length == due
            own = targets[0]
        else:
            mine = [t for t in targets if t.servo_id == out.servo_id]
            right = bool(mine) and mine[0].length == length
            own = mine[0] if mine else targets[0]
        if right:
            out.address, out.token = own.address, LISTED

    def _told(self, out: SlowFrame, code: int, params: bytes) -> None:
        """Read an answer that says more than an error and data."""
        family = self.family
        out.op = family.asked_by.get(code, -1)
        grammar, key = family.feedback_of(out.op), 0
        command = family.commands.get(out.op)
        if out.op < 0 and family.answers is None:  # it has the header of answers, and answers none
            out.flags |= MALFORMED
            out.token = len(params)
            return
        if command is not None:
            key = KEY | out.op << CODE_AT
        fields = parsed(grammar, params)
        if fields is None:
            out.flags |= MALFORMED
            out.token = key | len(params)
            if command is not None and command.answer == ANY:
                out.token = key
            return
        place = {leaf.path: leaf.offset for leaf in leaves(grammar, params)}
        out.data = fields.get("data", b"")
        out.data_start += place.get("data", 0)
        out.token = key | len(out.data)
        if command is not None:
            out.token = key if command.answer == ANY else out.token
            out.address = command.answer_at
        if "address" in fields:
            out.address = fields.address
            if command is not None:
                out.address = fields.address * command.stride + command.space
            out.token |= out.address << ADDRESS_AT
        if "error" in fields:
            out.status = params[place["error"]]
            wild = "data" in fields and "length" not in fields and not out.data
            out.token = -1 if wild and out.status else out.token
        for name, values in command.later.items() if command is not None else ():
            if number_in(grammar, name, params) in values:
                out.token = ON_ITS_OWN
        if command is not None and command.on_its_own:
            out.token = ON_ITS_OWN

    def _command(self, out: SlowFrame, command: Command, fields: Any, params: bytes) -> None:
        """Read what a command wants, and what it changes."""
        family = self.family
        alone = out.alt_id == NO_ALT
        out.flags |= command.effect
        out.token = max(command.answer, 0)
        if command.repeats:
            out.token = len(params)
        if family.echoes and (command.answer or command.repeats):
            out.token |= out.op << 8
        if "address" in fields:
            width = field_named(command.params, "address").sizeof()
            if "data" in fields:
                width = len(params) - len(fields.data)
            out.address = fields.address * command.stride + command.space
            out.data_start, out.data = out.data_start + width, out.data[width:]
        if "targets" in fields:
            if not _brings(command):
                out.token, out.data = LISTED, b""
                out.targets = self._listed(out, command) if out.reply == MANY else ()
        elif "length" in fields and "data" not in fields:
            out.token, out.data = fields.length, b""
        brought = params if command.at >= 0 else fields.get("data", b"")
        if command.at >= 0:
            out.address = command.at
            if command.answer and command.answer_at < 0:  # it asks for what is there
                out.data = brought = b""
        own = "length" not in fields or "data" in fields
        if out.address >= 0 and brought and own and "targets" not in fields:
            at = family.effective("feedback") - out.address
            if family.effective("feedback") >= 0 and out.reply == IF_ALL:
                out.reply = OPTIONAL if 0 <= at < len(brought) else out.reply
            at = family.effective("servo_id") - out.address
            if family.effective("servo_id") >= 0 and alone and 0 <= at < len(brought):
                out.alt_id = brought[at]
        if command.new_id is not None and alone:
            bits, servo_id = command.new_id
            if not bits or number_in(command.params, "option", params) & bits:
                out.alt_id = servo_id

    def _is_request(
        self, packet: Any, params: bytes, fields: Any, raw: bytes, before: SlowFrame | None
    ) -> bool:
        family = self.family
        if family.echoes:
            asks = family.commands.get(packet.code)
            if asks is not None and asks.repeats and fields is not None:
                again = before is not None and before.kind == REQUEST and before.raw == raw
                return not again or before is None or before.reply == NEVER
            return asks is None or not asks.answer or len(params) != asks.answer
        if family.answers is not None:
            return bool(packet.code != family.answers)
        if family.answer_header:
            return not family.is_answer(raw)
        if family.answer_code is not None:
            return packet.code not in family.asked_by
        if packet.servo_id in family.silent or packet.code >= family.certain:
            return True
        command = family.commands.get(packet.code)
        if command is None:
            return False
        if fields is None and not (family.begins and _begins(command, params)):
            return False
        if before is None or before.kind != REQUEST or before.reply == NEVER:
            return True
        if before.servo_id not in family.anyone and before.servo_id != packet.servo_id:
            return True
        return len(params) not in (0, before.token) or raw == before.raw

    def _listed(self, frame: SlowFrame, command: Command) -> tuple[ListedServo, ...]:
        """Return whom a request lists, each once, and under which id each answers."""
        silent, out = self.family.silent, dict[int, ListedServo]()
        head = len(frame.raw) - self._behind - len(self._read(frame)[0])
        begins = 0
        for t in self._targets(frame):
            by = next(iter(silent), -1) if command.together else t.servo_id
            at = head + begins if command.together and begins else 0
            if t.servo_id not in silent:
                out.setdefault(t.servo_id, ListedServo(t.servo_id, by, command.each, at))
            begins += t.length + 2 + self._sum_width
        return tuple(out.values())

    def _targets(self, frame: SlowFrame) -> list[_Target]:
        """Return the servos that a command to several names."""
        command = self.family.commands[frame.op]
        fields = command.params.parse(self._read(frame)[1])
        out = []
        if command.at >= 0:  # a target as it stands, whatever is in it
            params, size = self._read(frame)[1], _target_of(command).sizeof()
            first = len(params) - size * len(fields.targets)
            for i, t in enumerate(fields.targets):
                data = params[first + i * size :][:size]
                out.append(_Target(t.servo_id, command.at, size, data))
            return out
        for t in fields.targets:
            data = bytes(t.get("data", b""))
            length = t.length if "length" in t else fields.length
            address = t.address if "address" in t else fields.address
            address = address * command.stride + command.space
            out.append(_Target(t.servo_id, address, length, data))
        return out

    def _read(self, frame: SlowFrame) -> tuple[bytes, bytes]:
        """Return the parameters as they are on the wire, and as they were meant."""
        packet = self.family.body_of(frame.raw)
        wire = bytes(packet[self.family.tail])
        return wire, self.family.plain(wire, frame.servo_id, packet.code)

    def parts(self, frame: SlowFrame) -> list[tuple[int, int, bytes]]:
        """Return (servo_id, address, bytes) of each servo's registers."""
        if not frame.data:
            return []
        known = frame.op in self.family.commands and not frame.flags & (MALFORMED | UNKNOWN)
        if frame.kind == REQUEST and known and _brings(self.family.commands[frame.op]):
            return [(t.servo_id, t.address, t.data) for t in self._targets(frame)]
        if frame.address < 0:
            return []
        wire, params = self._read(frame)
        held = len(wire) - len(frame.data)
        if frame.kind == REQUEST:
            return [(frame.servo_id, frame.address, params[held:])]
        if self.family.doubt and frame.flags & UNUSUAL:
            return []
        if self.family.tells_more:
            return [(frame.servo_id, frame.address, frame.data)]
        asked = frame.asked
        joint = frame.token == LISTED and self.family.commands[frame.op].together
        if not joint or asked is None:
            return [(frame.servo_id, frame.address, params[held:])]
        out, at = [], held
        for t in self._targets(asked):
            out.append((params[at], t.address, params[at + 1 : at + 1 + t.length]))
            at += 1 + t.length + self._sum_width + 1
        return out

    def values(self, frame: SlowFrame, state: State) -> list[tuple[int, int, int, int]]:
        """Split what each servo is brought or says by its table."""
        return slow_spans(self.family.models, state, self.parts(frame))


def _brings(command: Command) -> bool:
    """Tell whether a command brings data for several servos."""
    target = _target_of(command)
    if target is None:
        return False
    return command.at >= 0 or field_named(target, "data") is not None


def _target_of(command: Command) -> Any:
    """Return the grammar of one of several servos, None where a command has none."""
    targets = field_named(command.params, "targets")
    return None if targets is None else targets.subcon


def _begins(command: Command, params: bytes) -> bool:
    """Tell whether the parameters begin as those of the command."""
    return any(parsed(command.params, params[:n]) for n in range(len(params), 0, -1))
