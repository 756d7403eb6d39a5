"""Commands said one behind the other while their answers come: each answer lies over the next command.

A program that only writes may never read: it does not know that its servos answer. The answer to
one command and the next command begin together, and of the two headers bits of both are heard. Who
gets torn bytes does not answer, so that the command behind them is whole again::

    FF FF FF 01 05 F3 86 60 0D 13       a goal for servo 1, whole
    DF DF DF 02 20 FD 07 7B             that for servo 2, and over it the answer of servo 1
    FF FF FF 03 05 F3 86 23 08 53       that for servo 3, whole: servo 2 has not answered
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.physics.comparing import header_of
from sniffer.diagnosis.physics.mixing import mix_of
from sniffer.ground.codes import REQUEST

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "command-under-answer",
        "A command right behind another one is torn by the answer to that, time and again.",
        "Nine in ten torn frames stand behind a request that has no answer, and are longer than its "
        "answer would be; the beginnings of ten and of a fifth are those of two frames at once, two "
        "bits and more apart; and torn ones follow each other five times more seldom than so many do by chance.",
    ),
)

NEARLY: Final = 0.9
"""Part of what is torn that stands right behind requests: other damage looks for no such place."""

LEAST: Final = 10
PART: Final = 0.2
"""How many beginnings must be two at once, and which part: of many shifts the bits of one byte alone
tell, or none."""

APART: Final = 1.5
"""Bits by which the two must be apart: edges that come late take the first bit of each byte, too."""

SELDOM: Final = 5
"""How many times more seldom torn ones follow each other than they would by chance."""


def under_answers(case: Case) -> Iterator[Finding]:
    """Find a controller that goes on without its answers, in what they make of its commands."""
    torn = [d for d in case.damages if d.turn in (IN_REQUEST, IN_REPLY)]
    requests = case.ledger.exchanges.kinds.requests
    placed = [d for d in torn if d.behind == REQUEST and _is_no_answer(case, d)]
    if not requests or len(placed) < max(LEAST, NEARLY * len(torn)):
        return
    head = requests[0][: header_of(requests)]
    mixed = [d for d in placed if (m := mix_of(d.got, head, head)) and m.shift >= APART]
    if len(mixed) < max(LEAST, PART * len(placed)) or not _takes_turns(case, placed):
        return
    yield finding_of(
        placed,
        "command-under-answer",
        None,
        f"{len(placed)} of {len(torn)} torn frames are commands right behind another one, "
        f"{len(mixed)} of them begin as two frames at once, and what follows a torn one is whole: "
        "the answer to each command lies over the next",
        "a command under the answer to the one before",
        strength=min(0.5 + len(placed) / 20, 1.0),
        brief="commands are said into the answers to those before",
    )


def _is_no_answer(case: Case, d: Damage) -> bool:
    """Tell whether torn bytes are more than the answer to the request before them would be."""
    answers = case.ledger.damages.likes.known
    due = (len(a) for asked, some in answers.items() if len(asked) == len(d.asked) for a in some)
    return d.turn == IN_REQUEST or d.length > max(due, default=d.length)


def _takes_turns(case: Case, placed: Sequence[Damage]) -> bool:
    """Tell whether torn frames follow each other far more seldom than so many would by chance."""
    whole = int(case.ledger.exchanges.kinds.n.sum())
    longest = max(map(len, case.ledger.exchanges.kinds.requests))
    ends = {d.at + d.length for d in placed}
    in_row = sum(d.at in ends or d.length >= 2 * longest for d in placed)
    by_chance = len(placed) ** 2 / (len(placed) + whole)
    return by_chance >= LEAST and SELDOM * in_row <= by_chance


RULES: Final[tuple[Rule, ...]] = (under_answers,)
"""The rules of this file."""
