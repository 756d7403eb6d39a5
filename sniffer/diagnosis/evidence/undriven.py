"""Whose frames lack their first bits, or their last ones: a driver is on or off at the wrong time.

What is torn so holds as a frame once these bits are put back, and what was heard is what a UART
makes of it without them. One of them proves nothing: noise turns a last bit into a one, too.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.decoding.holding import held
from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.signs import SIGN, beginnings
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.physics.comparing import alike, header_of
from sniffer.diagnosis.physics.misread import alike_of
from sniffer.diagnosis.physics.undriven import (
    HEAD,
    REACH,
    before_let_go,
    lacks_bytes,
    lacks_end,
    with_begin,
)
from sniffer.protocols.base import answer_begins

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

FEW: Final = 0.2
"""How many answers are torn at most for each torn request."""

EITHER: Final = 0.5
"""How often what takes an end of a frame takes its beginning."""


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
        return self._chance(len(self.begins), len(self.ends), self.begins_by_chance)

    def chance_of_ends(self) -> float:
        """Return how likely so many lack their end by chance."""
        return self._chance(len(self.ends), len(self.begins), self.ends_by_chance)

    def _chance(self, here: int, there: int, by_chance: float) -> float:
        """Return the likelier: that it hits any byte, or either end, as lost bytes do of a line.

        Lines of text hold without most of their bytes, so that what is torn lacks an end.
        """
        anywhere = at_least(here, self.torn, by_chance / max(self.torn, 1))
        return max(anywhere, at_least(here, here + there, EITHER))


def undriven(case: Case) -> Mapping[int, Undriven]:
    """Return it of each servo whose answers are torn, and of the controller."""
    return case.once(_undriven)


def _undriven(case: Case) -> Mapping[int, Undriven]:
    out: dict[int, Undriven] = {}
    requests = case.ledger.exchanges.kinds.requests
    header = requests[0][: header_of(requests)] if requests else b""
    looked = Counter[int]()
    for d in case.damages:
        awaited = d.turn == IN_REPLY
        sender = d.servo_id if awaited else CONTROLLER
        # nothing tells what a bare answer was
        is_known = d.turn == IN_REQUEST or (awaited and not case.has_bare_answers)
        if not is_known or looked[sender] >= LOOKED:
            continue
        for got in (d.got,) if awaited else _apart(d.got, header):
            if SHORTEST <= len(got) <= LONGEST:
                looked[sender] += 1
                _add(out, sender, _looked_at(case, d, got), d, len(got))
    return out


def _apart(got: bytes, header: bytes) -> Iterator[bytes]:
    """Yield torn requests that stand one right behind the other, which may lack a first byte."""
    begin, least = 0, len(header) + 1
    sign = header[1:] if len(header) > SIGN else header
    while sign and (at := got.find(sign, begin + least)) >= 0 and len(got) - at > least:
        yield got[begin:at]
        begin = at
    yield got[begin:]


def _add(out: dict[int, Undriven], sender: int, meant: _Meant, d: Damage, size: int) -> None:
    one = out.setdefault(CONTROLLER if meant.is_request else sender, Undriven())
    one.torn += 1
    one.begins_by_chance += EITHER * min(REACH / size, 1.0)
    one.ends_by_chance += 1 / size
    if meant.lacks_begin:
        one.begins.append(d)
    if meant.lacks_end:
        one.ends.append(d)


class _Meant(NamedTuple):
    """Which end of a torn frame is missing, and whether it is a request where an answer was due."""

    lacks_begin: bool = False
    lacks_end: bool = False
    is_request: bool = False


def _looked_at(case: Case, d: Damage, got: bytes) -> _Meant:
    """Look first whether it is what was due there."""
    requests = (*d.alike, *case.ledger.exchanges.kinds.requests)
    answers = alike_of(d, case.ledger.damages.likes.known) if d.turn == IN_REPLY else ()
    begins = (*answers, *_begins(case, d))
    for known, heads in ((answers, begins), (requests, requests)):
        if heads and (whole := _without_end(case, d, got, known)):
            return _Meant(lacks_end=True, is_request=_is_nearer(whole, requests, begins))
        if whole := _without_begin(case, d, got, heads):
            return _Meant(lacks_begin=True, is_request=_is_nearer(whole, requests, begins))
    return _Meant()


def _begins(case: Case, d: Damage) -> tuple[bytes, ...]:
    """Return with what an answer begins that is due; nothing where none is."""
    if d.turn != IN_REPLY:
        return ()
    begins = (beginnings(case).get(d.servo_id, b""), answer_begins(case.protocol, d.asked))
    return tuple(one for one in begins if one)


def _is_nearer(meant: bytes, some: Sequence[bytes], others: Sequence[bytes]) -> bool:
    """Tell whether a frame begins as one of some, for longer than as any of the others."""
    longest = (max((alike(meant, one) for one in side), default=0) for side in (some, others))
    return next(longest) > next(longest)


def _without_end(case: Case, d: Damage, got: bytes, known: Sequence[bytes]) -> bytes:
    """Return the frame of which bytes lack the end; none if they are none of any."""
    for one in known:
        if lacks_end(got, one) or lacks_bytes(got, one):
            return one
    may_be = [got[:-1] + bytes((byte,)) for byte in before_let_go(got[-1])]
    may_be += [got + bytes((byte,)) for byte in range(256)]
    return _one_that_holds(case, d, may_be)


def _without_begin(case: Case, d: Damage, got: bytes, begins: Sequence[bytes]) -> bytes:
    """Return the frame of which bytes lack the beginning; none if they are none of any."""
    heads = {one[:HEAD] for one in begins}
    may_be = {one for head in heads for one in with_begin(got, head)} - {got}
    if d.turn == IN_REPLY:  # who is asked says whose answer it is
        may_be = {one for one in may_be if one.startswith(tuple(begins))}
    else:
        may_be = {one for one in may_be if _is_rest(case, d, one, got)}
    return _one_that_holds(case, d, sorted(may_be))


def _is_rest(case: Case, d: Damage, whole: bytes, got: bytes) -> bool:
    """Tell whether the line may have been at rest while the first bytes were due.

    Else another's lie over them, as where a controller does not wait for answers.
    """
    lost = len(whole) - len(got)
    if lost <= 0 or not d.got.startswith(got):
        return True
    if case.has_prompt_stamps:
        return d.since_ns >= lost * case.ledger.byte_ns
    return case.once(_answers_are_whole)


def _answers_are_whole(case: Case) -> bool:
    """Tell whether hardly an answer is torn: who does not wait tears them before its heads."""
    torn = sum(d.turn == IN_REQUEST for d in case.damages)
    return case.total("damaged") <= FEW * torn


def _one_that_holds(case: Case, d: Damage, may_be: Sequence[bytes]) -> bytes:
    """Return the first of them that is a frame; an answer is one behind its request."""
    asked = d.asked if d.turn == IN_REPLY else b""
    tries = [asked + one for one in may_be]
    holds = held(case.protocol, tries, [len(one) for one in may_be])
    return next((one for one, is_frame in zip(may_be, holds, strict=True) if is_frame), b"")
