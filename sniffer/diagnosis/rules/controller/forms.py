"""What a controller sends that is not as the manual has it: other forms, other commands, no frames."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.chances import OFTEN, TORN, may_be_torn
from sniffer.diagnosis.evidence.misaddressed import misaddressed
from sniffer.diagnosis.evidence.placed import finding_of, single
from sniffer.diagnosis.evidence.sameness import come_again, not_held
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.distinct import numbers, within
from sniffer.ground.model import MALFORMED, UNKNOWN, UNUSUAL

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

ITEM_LENGTH: Final = "Compare the length that the command states for an item with what the program writes behind each id."

FINDINGS: Final = (
    FindingCode(
        "gain-read-sets-id",
        "wCK servos are given the id 0 by a command that client libraries take for a gain read.",
        "`id_set` (0C) to the id 0, sent to a servo of another id: the appendix of the manual has "
        "the codes of gain read (0A) and id set exchanged.",
    ),
    FindingCode(
        "modifier-misused",
        "A modifier stands behind a command that has none, or behind another than its own.",
        "LSS lines that hold, with modifiers the page does not allow with that command.",
    ),
    FindingCode(
        "same-bytes-torn",
        "The same bytes that are no frame stand there time and again, and never whole: they are sent so.",
        "Half of all damaged places and more hold the same bytes, no sound request is like them, and most stand where no answer is due.",
    ),
    FindingCode(
        "items-misread",
        "Items of commands to several servos are of another length than the command says: values are read as ids.",
        "Three servos and more that nobody asks or hears get goals out of range, each in one of ten commands to all at most.",
        remedy=ITEM_LENGTH,
        settle=ITEM_LENGTH,
    ),
    FindingCode(
        "odd-commands",
        "Requests that hold and are not as the manual has them.",
        "Kinds of requests with a body they cannot have, or that stand in no manual, and how often "
        "each was sent.",
    ),
)

SHOWN: Final = 5

ID_SET: Final = "id_set"
"""The command whose code the appendix of the wCK manual (1.07, A-4) gives for reading gains."""


def gain_read(case: Case) -> Iterator[Finding]:
    """Ids that a client sets to 0 because it thinks that it reads gains."""
    if ID_SET not in map(case.protocol.op_name, case.ledger.exchanges.kinds.op):
        return
    rows = case.settings("servo_id")
    given = rows.take((rows.written == 1) & (rows.after == 0) & (rows.servo_id > 0))
    for servo in numbers(given.servo_id).tolist():
        mine = given.take(given.servo_id == servo)
        yield Finding(
            "gain-read-sets-id",
            servo,
            int(mine.t_ns[0]),
            int(mine.t_ns[-1]),
            len(mine),
            f"servo {servo} is told the id 0 by id_set (0C): clients send this where they mean a gain "
            "read (0A)",
            case.places(mine, "id_set to 0"),
            brief=f"servo {servo} is given the id 0",
        )


_WORDS: Final = re.compile(r"([A-Z]+)(-?\d*)")


def _misused(case: Case, line: bytes) -> str:
    """Return the first modifier of a line that its command does not have; empty: there is none."""
    known: dict[str, set[str]] = {}
    for r in case.protocol.registers:
        if r.kind == "modifier":
            known.setdefault(r.word, set()).update(r.modifies)
    action, *modifiers = (word for word, _ in _WORDS.findall(line.decode("latin-1").upper()))
    # of some the page says nothing: they may stand anywhere
    wrong = (m for m in modifiers if m not in known or (known[m] and action not in known[m]))
    return next(wrong, "")


_LINE: Final = re.compile(r"#\d+([A-Z]+)(-?\d*)(?:[A-Z]+-?\d+)*\r?\n?")
"""A line as the page has it: an id, a word, its number, modifiers with theirs."""


def _incomplete(case: Case, line: bytes) -> str:
    """Return what a line lacks, or has too much of; empty: nothing."""
    form = _LINE.fullmatch(line.decode("latin-1").upper())
    if form is None:
        return "with what no line has"
    word, number = form.groups()
    needs = any(
        r.kind == "action" and r.word == word and r.quantity for r in case.protocol.registers
    )
    return "without its number" if needs and not number else ""


def odd_commands(case: Case) -> Iterator[Finding]:
    """Requests that are not as the manual has them, and modifiers where they mean nothing."""
    kinds = case.ledger.exchanges.kinds
    torn = case.count(*TORN)
    has_modifiers = any(r.kind == "modifier" for r in case.protocol.registers)
    for k, odd in enumerate(kinds.odd):
        n, servo = int(kinds.n[k]), kinds.servo_id[k]
        name = case.protocol.op_name(kinds.op[k])
        shown = kinds.example[k][:24].hex(" ").upper()
        span = kinds.t_first[k], int(kinds.t_last[k])
        wrong = _misused(case, kinds.example[k]) if has_modifiers and odd & UNUSUAL else ""
        lacks = _incomplete(case, kinds.example[k]) if has_modifiers and odd & UNUSUAL else ""
        if wrong and not may_be_torn(case, n):
            text = kinds.example[k].decode("latin-1").strip()
            code, what = "modifier-misused", f"{n} x {text}: {name} has no modifier {wrong}"
        elif odd & (MALFORMED | UNKNOWN) and (
            not torn or (n >= OFTEN and not may_be_torn(case, n))
        ):
            how = "with a body it cannot have" if odd & MALFORMED else "which stands in no manual"
            code, what = "odd-commands", f"{n} x {name} {how}: {shown}"
        elif lacks and n >= OFTEN and not may_be_torn(case, n):
            text = kinds.example[k].decode("latin-1").strip()
            code, what = "odd-commands", f"{n} x {name} {lacks}: {text}"
        else:
            continue
        yield Finding(
            code,
            single(case, servo),
            *span,
            n,
            what,
            (Place(kinds.at[k], len(kinds.example[k]), span[0], name),),
            strength=min(0.5 + n / 10, 1.0),
            brief=f"{name} is not as the manual has it",
        )


def items_misread(case: Case) -> Iterator[Finding]:
    """Commands to several servos that name now these, now those that are not there."""
    some = misaddressed(case)
    if not some:
        return
    w = case.writes
    rows = np.flatnonzero(within(w["servo_id"], list(some)))
    first = int(rows[np.argmin(w["t_first"][rows])])
    ids = sorted(some)
    shown = ", ".join(map(str, ids[:SHOWN])) + (" ..." if len(ids) > SHOWN else "")
    yield Finding(
        "items-misread",
        None,
        int(w["t_first"][first]),
        int(w["t_last"][rows].max()),
        sum(some.values()),
        f"commands to several name {len(ids)} servos that nobody asks or hears ({shown}), each now and "
        "then, with goals out of range: their items are of another length than they say",
        (Place(int(w["at"][first]), 1, int(w["t_first"][first]), "a value read as an id"),),
        brief=f"commands to several name {len(ids)} servos that are not there",
    )


def same_bytes(case: Case) -> Iterator[Finding]:
    """Bytes that are no frame and come again and again: somebody sends them so."""
    damages = not_held(case)
    for got, places in come_again(case).items():
        servos = {d.servo_id for d in places}
        yield finding_of(
            places,
            "same-bytes-torn",
            single(case, servos.pop()) if len(servos) == 1 else None,
            f"{len(places)} of {len(damages)} pieces that are no frame are the same "
            f"{len(got)} bytes: {got[:24].hex(' ').upper()}",
            "no frame, the same again",
            strength=min(0.7 + len(places) / 30, 1.0),
            brief=f"the same {len(got)} bytes that are no frame, {len(places)} times",
        )


RULES: Final[tuple[Rule, ...]] = (gain_read, odd_commands, items_misread, same_bytes)
"""The rules of this area."""
