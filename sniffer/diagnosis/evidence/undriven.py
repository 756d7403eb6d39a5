"""Whose frames lack their first bits, or their last ones: a driver is on or off at the wrong time.

What is torn so holds as a frame once these bits are put back, and what was heard is what a UART
makes of it without them. One of them proves nothing: noise turns a last bit into a one, too.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

from sniffer.decoding.holding import held
from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.signs import beginnings
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.physics.comparing import header_of
from sniffer.diagnosis.physics.misread import alike_of
from sniffer.diagnosis.physics.undriven import (
    REACH,
    before_let_go,
    lacks_begin,
    lacks_bytes,
    lacks_end,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage

CONTROLLER: Final = -1
"""Stands among servos for who asks."""

LOOKED: Final = 60
"""Torn frames of one sender that are looked at."""

SHORTEST, LONGEST = REACH, 48
"""Bytes of a frame that is looked at: a shorter one is all end (an ACK)."""


@dataclass(slots=True)
class Undriven:
    """What of one sender's torn frames lacks an end, and how likely each is to do so by chance."""

    torn: int = 0
    begins: list[Damage] = field(default_factory=list)
    ends: list[Damage] = field(default_factory=list)
    begins_by_chance: float = 0.0
    ends_by_chance: float = 0.0

    def chance_of_begins(self) -> float:
        """Return how likely so many lack their beginning by chance."""
        return at_least(len(self.begins), self.torn, self.begins_by_chance / max(self.torn, 1))

    def chance_of_ends(self) -> float:
        """Return how likely so many lack their end by chance."""
        return at_least(len(self.ends), self.torn, self.ends_by_chance / max(self.torn, 1))


def undriven(case: Case) -> Mapping[int, Undriven]:
    """Return it of each servo whose answers are torn, and of the controller."""
    return case.once(_undriven)


def _undriven(case: Case) -> Mapping[int, Undriven]:
    out: dict[int, Undriven] = {}
    requests = case.ledger.exchanges.kinds.requests
    header = requests[0][: header_of(requests)] if requests else b""
    for d in case.damages:
        sender = d.servo_id if d.turn == IN_REPLY else CONTROLLER
        one = out.setdefault(sender, Undriven())
        if d.turn not in (IN_REPLY, IN_REQUEST) or one.torn >= LOOKED:
            continue
        if d.turn == IN_REPLY and case.has_bare_answers:
            continue  # nothing tells what they were
        for got in (d.got,) if d.turn == IN_REPLY else _apart(d.got, header):
            _look(case, one, d, got)
    return {sender: one for sender, one in out.items() if one.torn}


def _apart(got: bytes, header: bytes) -> Iterator[bytes]:
    """Yield torn requests that stand one right behind the other."""
    begin, least = 0, len(header) + 1
    while header and (at := got.find(header, begin + least)) >= 0 and len(got) - at > least:
        yield got[begin:at]
        begin = at
    yield got[begin:]


def _look(case: Case, one: Undriven, d: Damage, got: bytes) -> None:
    if not SHORTEST <= len(got) <= LONGEST:
        return
    one.torn += 1
    one.begins_by_chance += min(REACH / len(got), 1.0)
    one.ends_by_chance += 1 / len(got)
    known = _known(case, d)
    if _lacks_end(case, d, got, known):
        one.ends.append(d)
    elif _lacks_begin(case, d, got, known):
        one.begins.append(d)


def _known(case: Case, d: Damage) -> tuple[bytes, ...]:
    """Return sound frames that are like a torn one."""
    if d.turn == IN_REPLY:
        return alike_of(d, case.ledger.damages.likes.known)
    return (*d.alike, *case.ledger.exchanges.kinds.requests)


def _lacks_end(case: Case, d: Damage, got: bytes, known: Sequence[bytes]) -> bool:
    if any(lacks_end(got, one) or lacks_bytes(got, one) for one in known):
        return True
    may_be = [got[:-1] + bytes((byte,)) for byte in before_let_go(got[-1])]
    may_be += [got + bytes((byte,)) for byte in range(256)]
    return _any_holds(case, d, may_be)


def _lacks_begin(case: Case, d: Damage, got: bytes, known: Sequence[bytes]) -> bool:
    heads = {one[:REACH] for one in known}
    if d.turn == IN_REPLY:
        heads.add(beginnings(case).get(d.servo_id, b"")[:REACH])
    may_be = {
        head[:k] + got[cut:]
        for head in heads
        for k in range(1, len(head) + 1)
        for cut in range(k + 1)
    }
    meant = [one for one in may_be if one != got and lacks_begin(got, one)]
    return _any_holds(case, d, meant)


def _any_holds(case: Case, d: Damage, may_be: Sequence[bytes]) -> bool:
    """Tell whether one of what was meant is a frame; an answer is one behind its request."""
    asked = d.asked if d.turn == IN_REPLY else b""
    tries = [asked + one for one in may_be]
    return any(held(case.protocol, tries, [len(one) for one in may_be]))
