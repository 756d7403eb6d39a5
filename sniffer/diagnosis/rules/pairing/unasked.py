"""What devices say unasked: a second servo of the same id, or one that speaks when it likes."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.case import sums
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.acks import seldom_answered
from sniffer.diagnosis.evidence.chances import at_least
from sniffer.diagnosis.evidence.hit import torn_answers
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.evidence.signs import SIGN, beginnings, loses_most, sign_of, signed
from sniffer.diagnosis.evidence.twins import torn_by_twins, twins
from sniffer.diagnosis.ledger.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.comparing import alike
from sniffer.ground.codes import RESPONSE
from sniffer.ground.distinct import within
from sniffer.ground.medians import quantile
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence, Set

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

FINDINGS: Final = (
    FindingCode(
        "behind-its-own-alone",
        "What a servo says unasked comes right behind its own answers, to the same questions, and nowhere else.",
        "Second answers in a row, and so few elsewhere that one who speaks at any time would stand there once in a hundred times: behind its own exchanges as often as it is asked. Then a second servo of the same id answers some of what it is asked.",
    ),
    FindingCode(
        "torn-elsewhere",
        "Beside a device that speaks unasked frames are torn where it says nothing.",
        "Torn frames of two servos and of requests, more than 64 bytes from all that the device says unasked, twice as many as it says words.",
    ),
    FindingCode(
        "unasked-now-and-then",
        "What a servo says unasked stands behind few of its exchanges.",
        "From the first such answer to the last one, behind fewer than a third of its sound exchanges, with what is torn behind them, and of its own answers where hardly others' are: a second servo of the same id would answer each.",
    ),
    FindingCode(
        "speaks-unasked",
        "One device sends answers that nobody asked for.",
        "At least four answers without a request, or to commands of which it answers hardly any, whole or torn by the next one, and none right behind a torn request; nearly all of one servo, which answers what it is asked as well, or is never asked while others answer (then those count, too, that stand now and then where another one's answer is due); where more frames are damaged, all of one servo, by a chance of 2 % at most.",
        is_its_own=True,
    ),
)

OWN: Final = 0.9
"""Part of the torn places with a servo's bytes that must be second answers of it for none to be more."""

ALONE: Final = 1e-2
"""Chance at most that one who speaks at any time says all of it behind its own answers."""

PROMPT_NS: Final = NS // 1000
"""By how much more two servos differ in the time that they take for an answer is seldom."""

EITHER: Final = 0.5
"""How much counts what one servo may have said as well as another one, or unasked."""

_HEARD_AS: Final = (
    "unsolicited-response",
    "duplicate-response",
    "late-response",
    "mismatched-response",
)
"""What a word that nobody asked for is told as."""

WORD: Final = 64
"""Bytes from the beginning of a word that it may tear: itself, and a request with its answer."""

OFTENER: Final = 2
"""Torn frames a word from which on it is not words that tear them: of a word that is torn beyond
knowing there may be one for each that is whole."""

SELDOM: Final = 1 / 3
"""Part of the exchanges behind which a second servo surely would be heard."""

SURE: Final = 1e-4
"""So rare a chance is out of the question."""

UNASKED: Final = 4
"""Answers without a request: fewer come from requests that the tap lost."""

HEARD: Final = 3
"""Whole ones of one servo, and none of another, from where on it may have begun others, too."""

USUALLY: Final = 0.5
"""Part of the requests that are answered where the tap hears both sides."""

CHANCE: Final = 0.02
"""Where frames are damaged, all answers without a request are of one servo for so rare a chance."""


def chatty(case: Case) -> Iterator[Finding]:
    """A device that speaks without being asked."""
    unasked = sums(case.answers, "servo_id", "unsolicited")
    torn = int(case.damage["n"].sum())
    # what stands right behind a torn request was asked for by it
    ends = {d.at + d.length for d in case.damages if d.turn == IN_REQUEST}
    pieces = {**_spoken_into(case)}
    speaker = _who_alone(unasked)
    begun_by = _begun_by(case, speaker, pieces) if speaker is not None else {}
    if speaker is not None:
        pieces[speaker] = [*pieces.get(speaker, ()), *begun_by]
    for servo in unasked:
        events = case.anomalies("unsolicited-response", "duplicate-response", servo_id=servo)
        unasked[servo] += len(pieces.get(servo, ())) - len(ends & set(events.at.tolist()))
    for servo, said in case.once(seldom_answered).items():
        unasked[servo] = unasked.get(servo, 0) + said.n
    for servo, n in _instead_of_others(case).items():
        unasked[servo] += n
    shares = {s: case.total("asked", s) / max(case.total("asked"), 1) for s in unasked}
    seconds = {s: min(_seconds(case, s, ends), n) for s, n in unasked.items()}
    # who speaks when the line is at rest stands behind whoever was asked last in the cycle
    chances = {
        s: at_least(seconds[s], n, shares[s]) if _are_prompt(case, s) else 1.0
        for s, n in unasked.items()
    }
    for servo, n in unasked.items():
        if n < UNASKED:
            continue
        # the second answers of another one of two are what that one says
        others = sum(
            unasked[s] - seconds[s] * (p < ALONE) for s, p in chances.items() if s != servo
        )
        missing = case.total("missing", servo) + case.total("damaged", servo)
        # a request that was damaged leaves an answer behind, too: of anybody's, as often as asked
        share = shares[servo]
        cut = begun_by.values() if servo == speaker else ()
        as_likely = share ** (n - len(cut) - 1)
        as_likely *= math.prod(sum(shares.get(s, 0.0) for s in some) for some in cut)
        is_sure = not others and as_likely < SURE and case.total("missing", servo) < n / 2
        if others > n / 5 or (missing > n / 2 and not is_sure):
            continue
        # what it says itself tears no requests that it would answer
        if torn - len(pieces.get(servo, ())) > n and (others or as_likely > CHANCE):
            continue
        if servo < 0 or not (case.total("ok", servo) or _is_stranger(case, servo)):
            continue
        told = case.anomalies("unsolicited-response", "duplicate-response", servo_id=servo)
        begun = pieces.get(servo, ())
        acks = case.once(seldom_answered).get(servo)
        times = [*told.t_ns.tolist(), *(d.t_ns for d in begun)]
        times += [] if acks is None else [acks.first_ns, acks.last_ns]
        since, until = min(times), max(times)
        over = sum(d.turn == IN_REQUEST for d in begun)
        into = f"; {over} of them began before a request was over" if over else ""
        into += f"; {len(begun) - over} lie over others' answers" if len(begun) > over else ""
        into += f"; {acks.n} look like answers to commands that it does not answer" if acks else ""
        yield Finding(
            "speaks-unasked",
            servo,
            since,
            until,
            n,
            f"servo {servo} sent {n} answers that nobody asked for, all others {others}{into}",
            case.places(told, "an answer without a request")
            or tuple(Place(d.at, d.length, d.t_ns, "begins within") for d in begun[:3])
            or tuple(acks.places if acks is not None else ()),
            strength=min(0.7 + n / 25, 1.0),
            brief=f"servo {servo} speaks unasked",
        )
        if chances[servo] < ALONE:
            yield Finding(
                "behind-its-own-alone",
                servo,
                since,
                until,
                seconds[servo],
                f"{seconds[servo]} of {n} that servo {servo} said unasked came right behind its own answer to "
                f"the same request, which {share:.0%} of the requests are",
                case.places(
                    case.anomalies("duplicate-response", servo_id=servo),
                    "the second of two answers",
                ),
                strength=unlikely(chances[servo]) * (1.0 if case.has_prompt_stamps else EITHER),
                brief=f"a second servo {servo} answers now and then",
            )
        if chances[servo] < ALONE and case.has_prompt_stamps:
            continue
        # a word behind a torn request looks like a late answer to it
        heard = case.anomalies(*_HEARD_AS, servo_id=servo)
        words = np.sort([*heard.at.tolist(), *(d.at for d in begun)])
        if len(words) >= n:
            yield from _apart(case, servo, words, since, until)
        answers = case.answers
        within = (answers["t_last"] >= since) & (answers["t_first"] <= until)
        mine = within & (answers["servo_id"] == servo)
        # what is torn of its answers, and hardly of others', a second one may lie over
        lain_over = int(answers["damaged"][mine].sum()) if servo in torn_answers(case) else 0
        exchanges = int(answers["ok"][mine].sum()) + lain_over
        twin = twins(case).get(servo)
        # of two answers one may tear the other, or come when another one is being asked
        late = set()
        if twin is not None:
            places = (twin.torn, twin.stray, twin.foreign, twin.crossed)
            late = {d.at for some in places for d in some} | {t.at for t in twin.behind}
        more = n + lain_over
        more += sum(
            since <= d.t_ns <= until and (d.at in late or _is_behind(d, servo))
            for d in case.damages
        )
        if more < SELDOM * exchanges:
            yield Finding(
                "unasked-now-and-then",
                servo,
                since,
                until,
                n,
                f"servo {servo} said something more behind {more} of {exchanges} exchanges at most",
                strength=min(1.0, (SELDOM * exchanges - more) / more),
            )


def _seconds(case: Case, servo: int, ends: Set[int]) -> int:
    """Return how often a servo answered twice in a row.

    What stands right behind a torn request, of which ``ends`` are the ends, is the answer to it.
    """
    events = case.anomalies("duplicate-response", servo_id=servo)
    rows = case.alarm_rows("duplicate-response", servo_id=servo)
    return int(case.alarms["n"][rows].sum()) - int(within(events.at, list(ends)).sum())


def _are_prompt(case: Case, servo: int) -> bool:
    """Tell whether second answers come about as soon behind the first ones as servos answer.

    One who speaks in step with the controller comes as steadily, but in the rest of the cycle.
    """
    some = [s.times for s in case.ledger.second_answers.kept if s.servo_id == servo]
    if not case.has_prompt_stamps or not some:
        return True
    since = np.array([second[0] - first[1] for first, second in some])
    return bool(quantile(since, 0.9) <= PROMPT_NS + 2 * case.latency_ns)


def _apart(case: Case, servo: int, words: I64, since: int, until: int) -> Iterator[Finding]:
    """Yield that frames are torn where a device says nothing, if that is most of them by far."""
    torn = [d for d in case.damages if since <= d.t_ns <= until]
    at = np.array([d.at for d in torn], np.int64)
    row = np.searchsorted(words, at)
    behind = at - words[np.maximum(row - 1, 0)]
    before = words[np.minimum(row, len(words) - 1)] - at
    is_apart = np.minimum(np.abs(behind), np.abs(before)) > WORD
    apart = [d for d, far in zip(torn, is_apart.tolist(), strict=True) if far]
    senders = {d.servo_id for d in apart if d.turn == IN_REPLY}
    asked = sum(d.turn == IN_REQUEST for d in apart)
    if len(apart) < OFTENER * len(words) or len(senders) < 2 or not asked:
        return
    yield finding_of(
        apart,
        "torn-elsewhere",
        None,
        f"{len(apart)} of {len(torn)} torn frames, {asked} of them requests, are more than {WORD} "
        f"bytes from all that servo {servo} says unasked",
        "torn, and nobody speaks unasked here",
        brief="frames are torn elsewhere, too",
    )


def _is_stranger(case: Case, servo: int) -> bool:
    """Tell whether nobody ever asks a device, and those who are asked answer.

    Where hardly anybody answers what is heard, requests may be on a wire that is not.
    """
    answered, asked = case.total("ok"), case.total("asked")
    return not case.total("asked", servo) and answered >= max(UNASKED, USUALLY * asked)


def _instead_of_others(case: Case) -> Mapping[int, int]:
    """Return by stranger how often it is heard where another servo's answer is due.

    A controller that waits long for a servo that is away hears most of what is said unasked
    meanwhile. Of several strangers, and where a servo mostly answers by that name, nobody knows.
    """
    frames = sums(case.traffic, "servo_id", "frames")
    strangers = [s for s in case.servos if frames.get(s, 0) and _is_stranger(case, s)]
    asked = sum(case.total("asked", s) for s in case.servos if case.total("mismatched", s))
    instead = case.total("mismatched")
    if len(strangers) != 1 or instead > SELDOM * asked:
        return {}
    (one,) = strangers
    alone = int(sums(case.answers, "servo_id", "unsolicited").get(one, 0))
    return {one: min(instead, frames[one] - alone)} if alone else {}


def _spoken_into(case: Case) -> Mapping[int, Sequence[Damage]]:
    """Return by servo what begins as its answers where nobody is asked, and is torn by a request."""
    begins, requests = beginnings(case), case.ledger.exchanges.kinds.requests
    signs = {}
    for servo, own in begins.items():
        others = [other for s, other in begins.items() if s != servo]
        signs[servo] = sign_of(own, [*others, *requests])
    within = signed(case)
    found = {
        servo: [
            d
            for d in case.damages
            if within.get(d.at) == servo
            or (
                len(sign) >= SIGN
                and _is_into_request(d)
                and d.got[:-1].startswith(sign)
                and not loses_most(case, servo)
            )
        ]
        for servo, sign in signs.items()
    }
    return {s: () if _answers_so(case, s, pieces) else pieces for s, pieces in found.items()}


def _who_alone(unasked: Mapping[int, float]) -> int | None:
    """Return the one servo that says whole answers unasked, if it is no accident."""
    said = [servo for servo, n in unasked.items() if n > 0]
    return said[0] if len(said) == 1 and unasked[said[0]] >= HEARD else None


def _begun_by(
    case: Case, speaker: int, pieces: Mapping[int, Sequence[Damage]]
) -> Mapping[Damage, Set[int]]:
    """Return what a speaker may have begun where nobody is asked, with all who may have instead.

    The next request tears an answer before it says whose it is. That it is one its header tells,
    where requests have another one::

        answer of 21     2A 32 31 51 44 ..
        request to 22          23 32 32 51 50 0D
        heard            2A 32 90 88 51 50 0D         it may be of 22 as well, and not of 37
    """
    if loses_most(case, speaker):
        return {}
    begins, requests = beginnings(case), case.ledger.exchanges.kinds.requests
    headers = {servo: sign_of(own, requests) for servo, own in begins.items()}
    known = {d.at for some in pieces.values() for d in some}
    found = {}
    for d in case.damages:
        if d.at in known or not _is_into_request(d):
            continue
        same = {
            s: alike(d.got[:-1], begins[s])
            for s, one in headers.items()
            if one and d.got.startswith(one)
        }
        nearest = {s for s, n in same.items() if n == max(same.values())}
        if speaker in nearest:
            found[d] = nearest
    return found


def _answers_so(case: Case, servo: int, pieces: Sequence[Damage]) -> bool:
    """Tell whether pieces are second answers, each to an earlier request to a servo of two.

    It gives them time and again, not now and then as a device that has something to say.
    """
    twin = twins(case).get(servo)
    if twin is None or twin.twice < SELDOM * case.total("ok", servo):
        return False
    theirs = torn_by_twins(case)
    return sum(d.at in theirs for d in pieces) >= OWN * len(pieces)


def _is_into_request(d: Damage) -> bool:
    """Tell whether a torn request stands behind an answer: what begins there is no answer to it."""
    return d.turn == IN_REQUEST and d.behind == RESPONSE


def _is_behind(d: Damage, servo: int) -> bool:
    """Tell whether damage stands behind an exchange of a servo, or in the next one."""
    return (d.asked_id if d.behind == RESPONSE else d.earlier_id) == servo


def unlikely(chance: float) -> float:
    """Return how much a chance is out of the question, 0..1."""
    return min(1.0, math.log(max(chance, SURE)) / math.log(SURE))


RULES: Final[tuple[Rule, ...]] = (chatty,)
"""The rules of this file."""
