"""The arrangements: what a bus makes of labelled exchanges. The kit arranges, not the author.

Each function takes an exchange and what others there are, and yields cases with their truth. What
no protocol could tell in principle is left out here (bits flipped where no checksum covers them);
what a protocol leaves undecided, its author declares and counts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.codes import MANY, MISMATCHED, OK, RESPONSE, UNSOLICITED
from sniffer.testing.broken import cut, damaged, request_damaged, silence_inside
from sniffer.testing.case import DUE, NOTHING, TalkCase
from sniffer.testing.facts import plain

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.testing.facts import Known
    from sniffer.testing.others import Others
    from sniffer.testing.talk import Exchange


def answered(k: Known, others: Others) -> Iterator[TalkCase]:
    """Said and answered."""
    del others
    yield plain(k.exchange)


def lost(k: Known, others: Others) -> Iterator[TalkCase]:
    """Said once, twice, three times, and answered at last or never."""
    del others
    e = k.exchange
    for name, times, is_answered in _LOST:
        if not k.answers and (is_answered or times == 1):
            continue
        case = TalkCase(name, (e,) * times)
        for _ in range(times - is_answered):
            case.unanswered(e, case.ask(e))
        if is_answered:
            case.exchange(e)
        yield case


_LOST: Final = (
    ("lost", 1, False),
    ("repeated", 2, True),
    ("repeated twice", 3, True),
    ("repeated, lost", 2, False),
)


def lost_then_another(k: Known, others: Others) -> Iterator[TalkCase]:
    """Lost, then another request to the same servo."""
    if not k.answers:
        return
    e = k.exchange
    for o in others.some(lambda o: o.servo_id == k.servo_id and o.exchange.request != e.request):
        case = TalkCase("lost, then another", (e, o.exchange))
        case.unanswered(e, case.ask(e))
        case.exchange(o.exchange)
        yield case


def asked_twice(k: Known, others: Others) -> Iterator[TalkCase]:
    """Said and answered, and all of it once more."""
    del others
    case = TalkCase("asked twice", (k.exchange, k.exchange), valued=True)
    case.exchange(k.exchange)
    case.exchange(k.exchange)
    yield case


def answered_twice(k: Known, others: Others) -> Iterator[TalkCase]:
    """One request, and its answer twice."""
    del others
    if not k.answers:
        return
    e = k.exchange
    case = TalkCase("answered twice", (e,))
    at = case.exchange(e)
    for raw in e.replies:
        if not k.stands_alone:
            case.noise(raw)
        elif k.request.reply == MANY:
            case.pair(at, case.frame(raw, RESPONSE, e.name), OK)
        else:
            case.pair(-1, case.frame(raw, RESPONSE), UNSOLICITED)
    yield case


def one_silent(k: Known, others: Others) -> Iterator[TalkCase]:
    """Several are listed, and one of them leaves its answer out: it is missed by its id."""
    e = k.exchange
    if len(e.replies) < 2 or len(e.listed or ()) != len(e.replies):
        return
    for silent in others.places(len(e.replies), 4):
        case = TalkCase(ONE_SILENT, (e,))
        at = case.ask(e)
        for n, raw in enumerate(e.replies):
            if n != silent:
                case.pair(at, case.frame(raw, RESPONSE, e.name), OK)
        case.missing(at, e.owing[silent : silent + 1], DUE if e.due else NOTHING)
        yield case


def another_servos(k: Known, others: Others) -> Iterator[TalkCase]:
    """The answer of another servo, then the right one."""
    if not k.asks_one:
        return

    def alike(o: Known) -> bool:
        same = o.exchange.name == k.exchange.name and len(o.exchange.data) == len(k.exchange.data)
        return o.asks_one and same and o.answers[0].servo_id != k.answers[0].servo_id

    yield from _misfits("answer from another id", k, others.some(alike))


def another_commands(k: Known, others: Others) -> Iterator[TalkCase]:
    """The answer to another command, by the servo that was asked; then the right one."""
    if not k.asks_one:
        return
    tokens = {-1, k.request.token}

    def unlike(o: Known) -> bool:
        same = o.servo_id == k.servo_id and o.answers and o.stands_alone
        return bool(same) and o.answers[0].token not in tokens and len(o.answers) == 1

    yield from _misfits("answer to another command", k, others.some(unlike))


def _misfits(name: str, k: Known, some: Sequence[Known]) -> Iterator[TalkCase]:
    for o in some:
        case = TalkCase(name, (k.exchange, o.exchange))
        case.pair(case.ask(k.exchange), case.frame(o.exchange.replies[0], RESPONSE), MISMATCHED)
        yield case
        case = TalkCase(name, (k.exchange, o.exchange))
        at = case.ask(k.exchange)
        case.pair(-1, case.frame(o.exchange.replies[0], RESPONSE), UNSOLICITED)
        case.answer(k.exchange, at)
        yield case


def in_flight(k: Known, others: Others) -> Iterator[TalkCase]:
    """Two servos asked at once, answering in both orders."""
    if not k.asks_one:
        return
    reach = others.protocol.reach - len(k.exchange.data)

    def beside(o: Known) -> bool:
        return o.asks_one and o.servo_id != k.servo_id and len(o.exchange.data) <= reach

    for o in others.some(beside):
        for first, second in ((k, o), (o, k)):
            case = TalkCase("two in flight", (k.exchange, o.exchange))
            asked = {id(x): case.ask(x.exchange) for x in (k, o)}
            for x in (first, second):
                case.answer(x.exchange, asked[id(x)])
            yield case


def late(k: Known, others: Others) -> Iterator[TalkCase]:
    """Answered behind a silence in which nothing can still be waited for."""
    del others
    if not k.answers:
        return
    e = k.exchange
    case = TalkCase("answer late", (e,))
    case.missing(case.ask(e), e.owing, NOTHING)
    for raw in e.replies:
        case.silence()
        case.stray(raw, stands_alone=k.stands_alone)
    yield case


def stray_byte(k: Known, others: Others) -> Iterator[TalkCase]:
    """A byte of nothing at the turn of the bus."""
    del others
    if k.stands_alone:
        case = TalkCase("a stray byte", (k.exchange,))
        at = case.ask(k.exchange)
        case.noise(b"\0")
        case.answer(k.exchange, at)
        yield case


def done_later(k: Known, others: Others) -> Iterator[TalkCase]:
    """Answered, and once more when it is done: at once, after a silence, in another's turn."""
    if not (e := k.exchange).later:
        return
    for silent in (False, True):
        case = TalkCase(DONE_LATER, (e.done,), valued=e.later_values is not None)
        case.exchange(e)
        _done(case, e, silent=silent)
        yield case
    mine = others.some(lambda o: o.asks_one and o.servo_id == k.servo_id and o is not k)
    for o in (k, *mine) if k.asks_one else mine:
        case = TalkCase(DONE_LATER, (e, o.exchange))
        case.exchange(e)
        at = case.ask(o.exchange)
        _done(case, e)
        case.answer(o.exchange, at)
        yield case


def _done(case: TalkCase, e: Exchange, *, silent: bool = False) -> None:
    for raw in e.later:
        if silent:
            case.silence()
        case.pair(-1, case.frame(raw, RESPONSE), UNSOLICITED)


def scene_of(exchanges: Sequence[Exchange]) -> TalkCase:
    """Return exchanges in their order, all answered."""
    case = TalkCase(SCENE, tuple(exchanges), valued=True)
    for e in exchanges:
        case.exchange(e)
    return case


ARRANGEMENTS: Final = (
    answered,
    lost,
    lost_then_another,
    asked_twice,
    answered_twice,
    one_silent,
    another_servos,
    another_commands,
    in_flight,
    late,
    stray_byte,
    cut,
    damaged,
    request_damaged,
    silence_inside,
    done_later,
)

SCENE: Final = "scene"

DONE_LATER: Final = "done later"  # only of talks that have such answers

ONE_SILENT: Final = "one of several silent"  # only where requests list whom they ask

NAMES: Final = (
    "answered",
    *(name for name, _, _ in _LOST),
    "lost, then another",
    "asked twice",
    "answered twice",
    "answer from another id",
    "answer to another command",
    "two in flight",
    "answer late",
    "a stray byte",
    "answer cut",
    "answer damaged",
    "request damaged",
    "silence inside",
)
