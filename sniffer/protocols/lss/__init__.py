"""Lynxmotion Smart Servos (LSS): the protocol as the core sees it."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.codes import REQUEST
from sniffer.protocols.base import (
    LETS_GO,
    RESTARTS,
    TURNS_ELSEWHERE,
    FieldSpan,
    FrameView,
)
from sniffer.protocols.dissection import leaves
from sniffer.protocols.lss import block, lines, slow
from sniffer.protocols.lss.grammar import (
    BROADCAST,
    LONGEST,
    MODELS,
    MODIFIERS,
    REGISTERS,
    REPLY_MARK,
    WORDS,
    Word,
    fitting,
    packed,
    query_form,
    unpacked,
)

if TYPE_CHECKING:
    from sniffer.ground.checksums import Checksum
    from sniffer.ground.model import I16, I64, Frames, Gap, Mask
    from sniffer.ground.registers import Register

WINDOW_NS: Final = 100_000_000
"""The page promises a reply "almost instantaneously" (Query Commands) and gives no figure; client
libraries give up after 10 to 100 ms, so an answer later than that finds nobody."""

REACH: Final = 512
"""A query is closed after as many bytes: a broadcast one may be answered by every servo on the bus,
with ten bytes or so each, so there is room for some fifty."""

_ENDS_GOAL: Final = {
    "L": LETS_GO,
    "RESET": RESTARTS,
    "CONFIRM": RESTARTS,
    **dict.fromkeys(("H", "MD", "WD", "WR"), TURNS_ELSEWHERE),
}
"""Source: protocol page 106.1, Command List."""

_FACTORS: Final = {("deg/s", "rpm"): 1 / 6, ("s", "ms"): 1000.0, ("mA", "a"): 0.001}
"""From a register's unit to the one that ends its label."""


class Lss:
    """See ``sniffer.protocols.base.BusProtocol``."""

    name = "lss"
    title = "Lynxmotion Smart Servo (LSS)"
    # Details 17. Baud Rate; the last one is not on the page, a vendor's test rig uses it
    bauds: tuple[int, ...] = (
        9600,
        19200,
        38400,
        57600,
        115200,
        230400,
        250000,
        460800,
        500000,
        921600,
    )
    baud = 115200  # the default of every client library; the page ships servos at 9600
    longest = LONGEST
    reach = REACH
    tail_ns = 250_000_000  # far beyond what clients wait for a reply
    everyone: tuple[int, ...] = (BROADCAST,)
    blank = lines.BLANK
    ordered = False
    models = MODELS
    registers = REGISTERS
    ends_goal = MappingProxyType({packed(word): how for word, how in _ENDS_GOAL.items()})

    frame = staticmethod(block.frame)
    describe = staticmethod(block.describe)
    states_itself = staticmethod(block.states_itself)
    values = staticmethod(block.values)
    slow_parse = staticmethod(slow.parse)
    slow_describe = staticmethod(slow.describe)
    slow_states_itself = staticmethod(slow.states_itself)
    slow_parts = staticmethod(slow.parts)
    slow_clues = staticmethod(slow.clues)
    slow_values = staticmethod(slow.values)

    def op_name(self, op: int) -> str:
        """Return the word, aliases resolved."""
        return unpacked(op)

    def refused(self, status: I16) -> Mask:
        """Tell that no servo ever says so: there is no status byte."""
        return np.zeros(len(status), bool)

    def window_ns(self, frames: Frames) -> I64:
        """Return the reply window, alike for every query."""
        return np.full(len(frames), WINDOW_NS)

    def answer_begins(self, request: bytes) -> bytes:
        """Return the mark, the id and the word of the reply to a query."""
        line = lines.read(request)
        if not isinstance(line, lines.Line) or line.is_reply or not line.word.startswith("Q"):
            return b""
        return REPLY_MARK + str(line.servo_id).encode() + line.word.encode()

    def status_names(self, status: int) -> tuple[str, ...]:
        """Return no names: what a servo is doing is the value of a register, not a status byte."""
        del status
        return ()

    def fields(self, raw: bytes, row: FrameView) -> dict[str, Any]:
        """Return the word as sent, value, selector, modifiers or text, and what they mean."""
        line = lines.read(raw)
        if not isinstance(line, lines.Line):
            return {}
        sent = line.word.upper()
        word = WORDS.get(query_form(sent) if line.is_reply else sent)
        if word is not None and word.name != unpacked(row.op):
            word = None  # it answers another query: what the number means is not known
        out: dict[str, Any] = {"word": line.word}
        if row.address >= 0:
            out["selector"] = row.address
        if word is not None and word.is_query and row.kind == REQUEST:
            return out
        candidates = _candidates(word, row)
        if line.value is not None:
            out |= {"value": line.value, **_labelled(_told(candidates, row), line.value)}
        else:
            if line.text is not None:
                out["value"] = line.text
            if line.text is not None and (word is None or word.texts.get(line.text) is None):
                out["text"] = line.text
            elif candidates and (meant := candidates[0].texts.get(line.text or "")):
                out |= {candidates[0].label: meant} if candidates[0].values else {meant: True}
        if line.modifiers:
            out["modifiers"] = {name.upper(): value for name, value in line.modifiers}
            for name, value in line.modifiers:
                out |= _labelled(_told(_modifier(name), row), value)
        return out

    def checksum_of(self, raw: bytes) -> tuple[Checksum, bytes, int] | None:
        """Return none: lines have no checksum."""
        del raw
        return None

    def explain(self, run: bytes, start: int, *, awaited: bool = False) -> list[Gap]:
        """Tell blanks from noise, cut lines from damaged ones; say where a line is wrong."""
        del awaited  # a line tells by its first character
        return lines.explain(run, start)

    def dissect(self, raw: bytes, row: FrameView) -> list[FieldSpan]:
        """Return the line's fields by its grammar, with what word and value mean."""
        found = fitting(raw)
        if found is None:
            return []
        stated = {k: v for k, v in self.fields(raw, row).items() if k not in _PLAIN}
        modifier = ""
        out: list[FieldSpan] = []
        for leaf in leaves(found[0], raw):
            name = leaf.path.replace("[", " ").replace("].", " ")
            shown, note = leaf.value, leaf.docs
            if leaf.path in ("mark", "end"):
                shown = {b"#": "# command", b"*": "* reply", b"\r": "CR"}[leaf.value]
            elif leaf.path == "word":
                note = _remark(WORDS.get(unpacked(row.op)), str(leaf.value), row)
            elif leaf.path in ("value", "text"):
                name = "selector" if row.kind == REQUEST and row.address >= 0 else leaf.path
                note = ", ".join(f"{k} {v}" for k, v in stated.items() if k not in _OF_MODIFIERS)
            elif leaf.path.endswith("word"):
                modifier = str(leaf.value).upper()
                note = _name(MODIFIERS[modifier].register) if modifier in MODIFIERS else ""
            elif modifier in MODIFIERS:
                told = _labelled(_told(_modifier(modifier), row), int(leaf.value))
                note = ", ".join(f"{k} {v}" for k, v in told.items())
            out.append(FieldSpan(leaf.offset, leaf.length, name, str(shown), note))
        return out


_PLAIN: Final = ("word", "value", "selector", "modifiers", "text")
_OF_MODIFIERS: Final = frozenset(REGISTERS[m.register].label for m in MODIFIERS.values())


def _name(register: int) -> str:
    return REGISTERS[register].name.replace("_", " ")


def _candidates(word: Word | None, row: FrameView) -> list[Register]:
    """Return what a line may state, by model: of a reply by the selector of its query, too."""
    if word is None:
        return []
    if row.kind == REQUEST:
        indices = list(word.registers)
    else:
        indices = [by.get(max(row.address, 0), -1) for by in word.answers]
    return [REGISTERS[i] for i in indices if i >= 0]


def _modifier(name: str) -> list[Register]:
    known = MODIFIERS.get(name.upper())
    return [REGISTERS[i] for i in known.registers if i >= 0] if known else []


def _told(candidates: list[Register], row: FrameView) -> Register | None:
    """Return the one of them that the value was read as; unread, only if all read it alike."""
    read = [REGISTERS[i] for i in row.registers]
    for register in candidates:
        if register in read:
            return register
    alike = {(r.label, r.unit, r.scale, *r.values.items()) for r in candidates}
    return candidates[0] if len(alike) == 1 else None


def _labelled(register: Register | None, raw: int) -> dict[str, Any]:
    """Return a value in the unit, or by the name, that the register's label promises."""
    if register is None or not register.label or raw in register.special:
        return {}
    if register.values and register.effect != "baud":
        return {register.label: register.names(raw)}
    if not register.unit:
        return {register.label: raw}
    factor = _FACTORS.get((register.unit, register.label.rpartition("_")[2]), 1.0)
    return {register.label: round(raw * register.scale * factor, 6)}


def _remark(word: Word | None, sent: str, row: FrameView) -> str:
    """Say in words what the word of a line is."""
    if word is None:
        return "not in the manual"
    candidates = _candidates(word, row)
    said = "the meaning depends on the selector"
    if candidates:
        said = candidates[0].name.replace("_", " ")
    if word.is_query and row.kind == REQUEST:
        index = word.selectors.get(max(row.address, 0), -1)
        said = "asks " + (_name(index) if index >= 0 else "by selector")
    return said if sent.upper() == word.name else f"{word.name}: {said}"
