"""LSS one line at a time, by the grammar: what the reference decoder runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sniffer.ground.clues import told_by_word
from sniffer.ground.codes import IF_ALL, MANY, MUST, NEVER, REQUEST, RESPONSE, WHOLE
from sniffer.ground.model import ANY_ID, MALFORMED, NO_ALT, UNKNOWN, UNUSUAL
from sniffer.protocols.base import SlowFrame, State
from sniffer.protocols.lss.grammar import (
    BROADCAST,
    BUTTON_MODE,
    COMMAND_MARK,
    END,
    LONGEST,
    MODELS,
    MODIFIERS,
    REGISTERS,
    REPLY_MARK,
    SELECTOR_MOST,
    WORDS,
    Word,
    fitting,
    packed,
    query_form,
    unpacked,
)

if TYPE_CHECKING:
    from sniffer.ground.clues import Clue


def parse(data: bytes, at: int, limit: int) -> list[tuple[int, int, int]] | None:
    """Parse the line that begins here, up to its carriage return."""
    mark = data[at : at + 1]
    if mark not in (COMMAND_MARK, REPLY_MARK):
        return None
    end = data.find(END, at, min(limit, at + LONGEST)) + 1
    if not end or fitting(data[at:end]) is None:
        return None
    return [(at, end, REQUEST if mark == COMMAND_MARK else RESPONSE)]


def describe(raw: bytes, kind: int, before: SlowFrame | None) -> SlowFrame:
    """Describe one line; what stood before it does not matter."""
    del before
    found = fitting(raw)
    assert found is not None
    line = found[1]
    # an id reply states the id behind the word, all others between mark and word
    head = len(raw) - len(_rest(line)) - len(END)
    servo_id = int(line.value if "servo_id" not in line else line.servo_id)
    sent = line.word.upper()
    out = SlowFrame(
        0,
        len(raw),
        kind,
        servo_id,
        packed(sent),
        raw,
        data_start=head,
        data=_rest(line).encode("ascii"),
        reply=NEVER,
        token=packed(query_form(sent)),
        alt_id=NO_ALT,
    )
    if kind == RESPONSE:
        _reply(out, line, query_form(sent))
    else:
        _command(out, line, WORDS.get(sent))
    return out


def _rest(line: Any) -> str:
    """Return what stands behind the word."""
    if "text" in line:
        return str(line.text)
    modifiers = "".join(m.word + m.value for m in line.get("modifiers", []))
    return str(line.value) + modifiers


def _reply(out: SlowFrame, line: Any, asked: str) -> None:
    out.op = packed(asked)
    word = WORDS.get(asked)
    if word is None:
        out.flags |= UNKNOWN
    elif "text" in line:
        if "*" not in word.texts and line.text not in word.texts:
            out.flags |= MALFORMED
    elif not line.value and "" not in word.texts:
        out.flags |= MALFORMED
    if line.word != line.word.upper():
        out.flags |= UNUSUAL


def _command(out: SlowFrame, line: Any, word: Word | None) -> None:
    if word is None:
        out.flags |= UNKNOWN
        out.reply = IF_ALL if line.word.upper().startswith("Q") else NEVER
    elif word.kind == "query":
        out.op = packed(word.name)
        out.data = b""
        out.reply = MANY if out.servo_id == BROADCAST else MUST
        if line.modifiers or line.value.startswith("-") or int(line.value or 0) > SELECTOR_MOST:
            out.flags |= MALFORMED
        elif line.value:
            out.address = int(line.value)
            if out.address not in word.selectors:
                out.flags |= UNUSUAL
    else:
        out.op = packed(word.name)
        if not (word.takes_number if line.value else word.may_be_empty):
            out.flags |= UNUSUAL
        for m in line.modifiers:
            known = MODIFIERS.get(m.word.upper())
            if len(line.modifiers) > 1 or known is None or word.name not in known.modifies:
                out.flags |= UNUSUAL
    if out.reply != NEVER and out.servo_id in (BROADCAST, BUTTON_MODE):
        out.alt_id = ANY_ID


def states_itself(frame: SlowFrame) -> bool:
    """Tell whether a reply's word means the same whatever selector the query had."""
    word = WORDS.get(unpacked(frame.op))
    return frame.kind == RESPONSE and word is not None and len(set(word.selectors.values())) == 1


def parts(frame: SlowFrame) -> list[tuple[int, int, bytes]]:
    """Return nothing: registers have no addresses here."""
    del frame
    return []


def clues(frame: SlowFrame) -> list[Clue]:
    """Return what an answer tells by its word, and by the text behind it."""
    word = WORDS.get(unpacked(frame.op))
    if frame.kind == REQUEST or word is None:
        return []
    return list(told_by_word(MODELS, word.asks, frame.data))


def values(frame: SlowFrame, state: State) -> list[tuple[int, int, int, int]]:
    """Return the number of a line, then those of its modifiers."""
    model = int(state.model[frame.servo_id & 255])
    found = fitting(frame.raw)
    word = WORDS.get(unpacked(frame.op))
    if found is None or word is None or "text" in found[1]:
        return []
    line, out = found[1], []
    index = word.registers[model]
    if frame.kind == RESPONSE:
        index = word.answers[model].get(max(frame.address, 0), -1)
    if index >= 0 and line.value and REGISTERS[index].type == "decimal":
        out.append((frame.servo_id, index, int(line.value), WHOLE))
    for m in line.get("modifiers", []):
        known = MODIFIERS.get(m.word.upper())
        if known is not None and known.registers[model] >= 0:
            out.append((frame.servo_id, known.registers[model], int(m.value), WHOLE))
    return out
