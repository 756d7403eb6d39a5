"""Captures that are not what was on the wire: programs between took bytes for text."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.texts import READABLE, is_printed
from sniffer.decoding.translations import LONGEST, Translated, translated, translated_torn
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.comparing import REPEATS, SEQUENCE, repeated
from sniffer.ground.codes import NEVER, REQUEST

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "bytes-translated",
        "The capture is not what was on the wire: a terminal, telnet or a program that takes bytes for "
        "text has exchanged, doubled or left out some of them.",
        "Frames hold once the exchange is undone; or torn frames hold, one by one, once a value is put "
        "back that is never seen; or all bytes are text, and no frame holds.",
    ),
    FindingCode(
        "sent-translated",
        "Commands are exchanged, doubled or left out in part before they are sent: nobody understands them.",
        "The same, and none of eight requests and more is answered.",
    ),
)


ASKED: Final = 8
"""Requests of which one at least would be answered, if servos heard them as they are meant."""

PLENTY: Final = 500
"""So many bytes without an eighth bit are no chance."""

SAID: Final = 8
"""Different values that a conversation has at least: a line that is held, or far slower, has one."""

WITHOUT_ANY: Final = 2000
"""So many are none even where values are so different that no sequence comes again."""

CHANCE: Final = 0.1
"""Part of the bytes that holds by chance, at most."""


def bytes_translated(case: Case) -> Iterator[Finding]:
    """Look whether a translation explains what no frame claims."""
    if case.lost_ns is None:
        return
    found = translated(case.ledger.head, case.protocol) or _of_torn(case)
    found = found or _without_eighth_bit(case)
    if found is None:
        return
    first_ns, last_ns = case.lost_ns
    code, brief, told = "bytes-translated", "bytes are not as they were on the wire", ""
    asked, answered = _exchanges(case, found)
    if asked >= ASKED and not answered:
        code, brief = "sent-translated", "commands are altered before they are sent"
        told = f"; none of {asked} requests is answered"
    where = "not as it was meant" if told else "not as it was on the wire"
    yield Finding(
        code,
        None,
        first_ns,
        last_ns,
        int(case.line["gaps"].sum()),
        f"{found.what}: {found.shown}{told}",
        tuple(Place(at, length, first_ns, where) for at, length in found.at),
        brief=brief,
    )


def _of_torn(case: Case) -> Translated | None:
    """Look at the torn frames of the whole capture: a value may be rare, and few stand at its head."""
    torn = [d for d in case.damages if d.turn in (IN_REPLY, IN_REQUEST) and d.length <= LONGEST]
    seen = frozenset(case.ledger.head).union(*(d.got for d in torn))
    return translated_torn(case.protocol, [(d.at, d.got) for d in torn], seen)


def _exchanges(case: Case, found: Translated) -> tuple[int, int]:
    """Return how many requests want an answer, and how many answers there are."""
    if not found.undone:
        asked = case.total("asked")
        return asked, asked - case.total("missing")
    decoder = Decoder(found.protocol)
    batches = decoder.feed(found.undone), decoder.close()
    kinds = np.concatenate([b.frames.kind for b in batches])
    replies = np.concatenate([b.frames.reply for b in batches])
    asks = kinds == REQUEST
    return int((asks & (replies != NEVER)).sum()), int((~asks).sum())


def _without_eighth_bit(case: Case) -> Translated | None:
    """Tell whether this is a conversation in seven bits that no protocol knows."""
    head, total = case.ledger.head, case.ledger.bytes
    lost = int(case.line["gap_bytes"].sum())
    if len(head) < PLENTY or max(head) >= READABLE or len(set(head)) < SAID or is_printed(head):
        return None
    if total - lost > CHANCE * (total - case.held_bytes):
        return None
    again = repeated(head)
    if again < REPEATS and len(head) < WITHOUT_ANY:
        return None
    return Translated(
        "the eighth bit of each byte is lost, or bytes from 80 on are left out or replaced",
        f"none of {len(head)} bytes is over 7F, hardly one is in a frame, and {100 * again:.0f} % of "
        f"their sequences of {SEQUENCE} come again",
        ((0, 1),),
    )


RULES: Final[tuple[Rule, ...]] = (bytes_translated,)
"""The rules of this file."""
