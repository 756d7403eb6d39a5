"""Arrangements in which something is broken: answers cut, bits flipped, silences inside frames.

They are made as those of ``arrange`` are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.ground.codes import MANY, NEVER, OK, RESPONSE
from sniffer.ground.model import NO_ALT
from sniffer.testing.case import NOTHING, TORN, TalkCase

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.testing.facts import Known
    from sniffer.testing.others import Others


def cut(k: Known, others: Others) -> Iterator[TalkCase]:
    """The answer cut anywhere; a silence or the next request behind it."""
    if not k.answers:
        return
    e, raw = k.exchange, k.exchange.replies[0]
    for n in others.places(len(raw), 4)[1:]:
        for o in others.some(_is_healthy)[:1]:
            for silent in (True, False):
                case = TalkCase("answer cut", (e, o.exchange))
                case.torn(e, case.ask(e))
                case.noise(raw[:n])
                if silent:
                    case.silence()
                case.exchange(o.exchange)
                yield case


def damaged(k: Known, others: Others) -> Iterator[TalkCase]:
    """One bit of the answer flipped anywhere; then the next exchange."""
    if not k.answers:
        return
    e, raw = k.exchange, k.exchange.replies[0]
    for broken in _flipped(others, raw):
        for o in others.some(_is_healthy)[:1]:
            case = TalkCase("answer damaged", (e, o.exchange))
            at = case.ask(e)
            case.noise(broken)
            if k.request.reply == MANY and len(e.replies) > 1:
                case.missing(at, e.owing[:1] if e.listed else (), TORN)
                case.answer(e, at, first=1)
            else:
                case.torn(e, at)
                for other in e.replies[1:]:
                    case.stray(other, stands_alone=k.stands_alone)
            case.exchange(o.exchange)
            yield case


def request_damaged(k: Known, others: Others) -> Iterator[TalkCase]:
    """One bit of the request flipped anywhere: whoever answers all the same is not asked."""
    e = k.exchange
    for broken in _flipped(others, e.request):
        for o in others.some(_is_healthy)[:1]:
            case = TalkCase("request damaged", (e, o.exchange))
            case.noise(broken)
            for raw in e.replies:
                case.stray(raw, stands_alone=k.stands_alone)
            case.exchange(o.exchange)
            yield case


def silence_inside(k: Known, others: Others) -> Iterator[TalkCase]:
    """A silence at every boundary of request and answers: nothing leads across it."""
    e = k.exchange
    frames = (e.request, *e.replies)
    for at in others.places(len(e.data), 24)[1:]:
        case = TalkCase("silence inside", (e,))
        begin, asked, torn, answers = 0, -1, False, 0
        for n, raw in enumerate(frames):
            inside = begin < at < begin + len(raw)
            behind = at <= begin
            if n == 0 and not inside:
                asked = case.ask(e)
            elif inside:
                torn = torn or (asked >= 0 and n == 1 + answers and (n == 1 or bool(e.listed)))
                case.noise(raw)
                case.silences.append(at)
            elif asked >= 0 and not behind:
                answers += 1
                case.pair(asked, case.frame(raw, RESPONSE, e.name), OK)
            else:
                case.stray(raw, stands_alone=k.stands_alone)
            begin += len(raw)
            if begin == at:
                case.silence()
        if torn:
            case.torn(e, asked, answers)
        elif asked >= 0 and not answers:
            case.unanswered(e, asked)
        elif asked >= 0 and e.listed:
            case.missing(asked, e.owing[answers:], NOTHING)
        yield case


def _is_healthy(k: Known) -> bool:
    """Whether an exchange is one that shows that what was before it is over."""
    return bool(k.answers) and k.request.reply != NEVER and k.request.alt_id == NO_ALT


def _flipped(others: Others, raw: bytes) -> Iterator[bytes]:
    """Yield a frame with one bit wrong where its first byte or its checksum tells that."""
    told = others.protocol.checksum_of(raw)
    if told is None:
        return
    checksum, covered, sent = told
    first = raw.find(covered)
    if first < 0:  # it covers bytes that stand apart
        yield _flip(raw, 0, 1)
        for at in others.places(len(raw), 4)[1:]:
            broken = _flip(raw, at, 1 << (at % 7))
            told = others.protocol.checksum_of(broken)
            if told is not None and told[0](told[1]) != told[2]:
                yield broken
        return
    for at in others.places(len(raw), 4):
        bit = 1 << (at % 7)
        inside = first <= at < first + len(covered)
        if not inside or checksum(_flip(covered, at - first, bit)) != sent:
            yield _flip(raw, at, bit)


def _flip(raw: bytes, at: int, bit: int) -> bytes:
    return raw[:at] + bytes([raw[at] ^ bit]) + raw[at + 1 :]
