"""What servos say against it: alarms with what was commanded before, words unasked."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.diagnosis.acks import seldom_answered
from sniffer.diagnosis.case import episodes, sums
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.damage import IN_REPLY, IN_REQUEST
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.placed import finding_of
from sniffer.diagnosis.signs import SIGN, beginnings, loses_most, sign_of, signed
from sniffer.diagnosis.tracks import in_force, track
from sniffer.diagnosis.twins import torn_by_twins, twins
from sniffer.ground.codes import RESPONSE
from sniffer.ground.gaps import NOISE
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.damage import Damage
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "complaints-together",
        "device",
        "Several servos complain of the same within moments.",
        "Two servos and more, a half of those that answer, report one alarm within a second of each other.",
    ),
    FindingCode(
        "overload-passes",
        "device",
        "A servo takes its overload back at once, and moves on: it works hard where its goals go fast.",
        "Every overload alarm is over within half a second, and around each the joint moves by twice what counts as far from a goal.",
    ),
    FindingCode(
        "unasked-now-and-then",
        "device",
        "What a servo says unasked stands behind few of its exchanges.",
        "From the first such answer to the last one, behind fewer than a third of its sound exchanges, with what is torn behind them: a second servo of the same id would answer each.",
    ),
    FindingCode(
        "speaks-unasked",
        "device",
        "One device sends answers that nobody asked for.",
        "At least four answers without a request, or to commands of which it answers hardly any, whole or torn by the next one, and none right behind a torn request; nearly all of one servo, which answers what it is asked as well, or is never asked while others answer; where more frames are damaged, all of one servo, by a chance of 2 % at most.",
    ),
)

COMPLAINTS: Final = frozenset(
    code for code in CATALOGUE if code.startswith("device-") and code != "device-recovered"
)
"""Alarms by which a servo says itself what is wrong."""

_BRIEF: Final[Mapping[str, str]] = MappingProxyType(
    {
        "device-input-voltage": "servo {} complains of its supply",
        "device-overload": "servo {} reports an overload",
        "device-overheating": "servo {} reports overheating",
        "device-temperature-alarm": "servo {} warns of its temperature",
        "device-temperature-limit": "servo {} reaches its temperature limit",
        "device-stuck": "servo {} says that it is stuck",
        "device-blocked": "servo {} says that it is blocked",
        "device-safe-mode": "servo {} goes into safe mode",
        "device-stroke-limit": "servo {} reports a goal beyond its limits",
        "device-outside-limits": "servo {} is outside its limits",
    }
)

RECENT_NS: Final = 10 * NS
"""A goal stated longer before an alarm has nothing to do with it."""

SHARED: Final = ("device-safe-mode", "device-input-voltage", "device-overload")
"""Alarms that a supply which sags raises in all servos that hang on it."""

PASSES_NS: Final = NS // 2
"""A motor that starts hard, or hastens behind its goals, is over it in so long; who bears too much is not."""

TORN: Final = 40
BY_CHANCE: Final = 0.2
"""Torn places among which one may hold by chance (a sum of eight bits lets one in 256 pass, and each is
framed from several bytes on), and how much an alarm counts there that is said once and taken back."""

MOMENT_NS: Final = NS
"""Servos are asked one after the other."""

OWN: Final = 0.9
"""Part of the torn places with a servo's bytes that must be second answers of it for none to be more."""

SELDOM: Final = 1 / 3
"""Part of the exchanges behind which a second servo surely would be heard."""

SURE: Final = 1e-4

BARE_SHARE: Final = 0.7
"""Of bytes that are noise by their looks so many fit one servo if they are its: by chance a tenth."""

NEAR_RAW: Final = 3
"""Steps that a joint may have moved since its last answer."""

UNASKED: Final = 4
"""Answers without a request: fewer come from requests that the tap lost."""

USUALLY: Final = 0.5
"""Part of the requests that are answered where the tap hears both sides."""

CHANCE: Final = 0.02
"""Where frames are damaged, all answers without a request are of one servo for so rare a chance."""


def complaints(case: Case) -> Iterator[Finding]:
    """Alarms, by code and servo, with their times and what was commanded before the first."""
    alarms = case.alarms
    numbers = [n for n in np.unique(alarms["code"]).tolist() if case.code(n) in COMPLAINTS]
    for number in numbers:
        code = case.code(number)
        mine = alarms["code"] == number
        for servo in np.unique(alarms["servo_id"][mine]).tolist():
            rows = np.flatnonzero(mine & (alarms["servo_id"] == servo))
            count = int(alarms["n"][rows].sum())
            spans = episodes(alarms["t_first"][rows], alarms["t_last"][rows])
            first, last = spans[0][0], spans[-1][1]
            words = code.removeprefix("device-").replace("-", " ")
            when = f"at {case.since(first)}"
            if count > 1:
                when = f"{count} times, first {when}, last at {case.since(last)}"
            who = None if servo < 0 else servo
            before = "" if who is None else _commanded(case, who, first)
            yield Finding(
                code,
                who,
                first,
                last,
                count,
                f"servo {servo} reports {words} {when}{before}",
                case.places(case.anomalies(code, servo_id=servo), f"servo {servo}: {words}", 2),
                strength=_sure(case, servo, count, first),
                brief=_BRIEF.get(code, f"servo {{}} reports {words}").format(servo),
                episodes=spans,
            )


def _sure(case: Case, servo: int, count: int, t_ns: int) -> float:
    """Return how sure it is that a servo said so.

    Of frames that are torn some hold by chance, and say anything: once, and not in the next answer.
    """
    if count > 1:
        return 1.0
    back = case.anomalies("device-recovered", servo_id=servo).t_ns
    is_moment = bool(((back >= t_ns) & (back <= t_ns + MOMENT_NS)).any())
    is_torn = int(case.damage["n"].sum()) >= TORN
    return BY_CHANCE if is_moment and is_torn else 0.8


def _commanded(case: Case, servo: int, t_ns: int) -> str:
    """Say what the goal was before a moment."""
    goal = case.series(servo, "goal_position")
    if goal is None:
        return ""
    row = int(np.searchsorted(goal.t_first, t_ns, "right")) - 1
    if row < 0 or t_ns - int(goal.t[row]) > RECENT_NS:
        return ""
    stated = max(t_ns - int(goal.t[row]), 0) / 1e6
    near = f", stated {stated:.0f} ms before" if int(goal.t[row]) < t_ns else ""
    return f"; its goal was {goal.told(float(goal.last[row]))}{near}"


def overload_passes(case: Case) -> Iterator[Finding]:
    """Overloads that servos take back at once while they move on."""
    for servo in case.servos if case.has_clock else ():
        told = case.anomalies("device-overload", servo_id=servo)
        back = case.anomalies("device-recovered", servo_id=servo).t_ns
        joint = track(case, servo)
        if not len(told) or joint is None:
            continue
        row = np.searchsorted(back, told.t_ns, "right")
        if (row >= len(back)).any() or (back[row] - told.t_ns > PASSES_NS).any():
            continue
        low, high = in_force(joint.position, told.t_ns - NS, back[row] + NS)
        if (high - low < 2 * joint.far).any():
            continue
        longest = int((back[row] - told.t_ns).max())
        yield Finding(
            "overload-passes",
            servo,
            int(told.t_ns[0]),
            int(back[row[-1]]),
            len(told),
            f"servo {servo} takes its overload back within {max(longest / 1e6, 1):.0f} ms, and moves "
            f"by {joint.position.told(float((high - low).min()))} meanwhile",
            case.places(told, f"servo {servo}: overload", 2),
            brief=f"servo {servo} moves on",
        )


def chatty(case: Case) -> Iterator[Finding]:
    """A device that speaks without being asked."""
    unasked = sums(case.answers, "servo_id", "unsolicited")
    torn = int(case.damage["n"].sum())
    # what stands right behind a torn request was asked for by it
    ends = {d.at + d.length for d in case.damages if d.turn == IN_REQUEST}
    pieces = _spoken_into(case)
    for servo in unasked:
        events = case.anomalies("unsolicited-response", "duplicate-response", servo_id=servo)
        unasked[servo] += len(pieces.get(servo, ())) - len(ends & set(events.at.tolist()))
    for servo, said in case.once(seldom_answered).items():
        unasked[servo] = unasked.get(servo, 0) + said.n
    for servo, n in unasked.items():
        if n < UNASKED:
            continue
        others = sum(unasked.values()) - n
        missing = case.total("missing", servo) + case.total("damaged", servo)
        # a request that was damaged leaves an answer behind, too: of anybody's, as often as asked
        share = case.total("asked", servo) / max(case.total("asked"), 1)
        is_sure = not others and share ** (n - 1) < SURE and case.total("missing", servo) < n / 2
        if others > n / 5 or (missing > n / 2 and not is_sure):
            continue
        # what it says itself tears no requests that it would answer
        if torn - len(pieces.get(servo, ())) > n and (others or share ** (n - 1) > CHANCE):
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
        answers = case.answers
        within = (answers["t_last"] >= since) & (answers["t_first"] <= until)
        ok = int(answers["ok"][within & (answers["servo_id"] == servo)].sum())
        twin = twins(case).get(servo)
        # of two answers one may tear the other, or come when another one is being asked
        late = set()
        if twin is not None:
            places = (twin.torn, twin.stray, twin.foreign, twin.crossed)
            late = {d.at for some in places for d in some} | {t.at for t in twin.behind}
        more = n + sum(
            since <= d.t_ns <= until and (d.at in late or _is_behind(d, servo))
            for d in case.damages
        )
        if more < SELDOM * ok:
            yield Finding(
                "unasked-now-and-then",
                servo,
                since,
                until,
                n,
                f"servo {servo} said something more behind {more} of {ok} exchanges at most",
                strength=min(1.0, (SELDOM * ok - more) / more),
            )


def _is_stranger(case: Case, servo: int) -> bool:
    """Tell whether nobody ever asks a device, and those who are asked answer.

    Where hardly anybody answers what is heard, requests may be on a wire that is not.
    """
    answered, asked = case.total("ok"), case.total("asked")
    return not case.total("asked", servo) and answered >= max(UNASKED, USUALLY * asked)


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


def together(case: Case) -> Iterator[Finding]:
    """Servos that complain of the same at the same time."""
    many = max(len(case.answering), 1)
    for code in SHARED:
        firsts = {s: case.anomalies(code, servo_id=s).t_ns for s in case.servos}
        first = {s: int(t.min()) for s, t in firsts.items() if len(t)}
        for servo, t in first.items():
            near = sum(abs(other - t) <= MOMENT_NS for other in first.values())
            if near < 2 or 2 * near < many:
                continue
            yield Finding(
                "complaints-together",
                servo,
                t,
                t,
                near,
                f"{near} of {many} servos report {code.removeprefix('device-')} within a second",
                strength=min(near / many, 1.0),
                brief=f"{near} servos complain at once",
            )


def chatty_bare(case: Case) -> Iterator[Finding]:
    """A device that speaks unasked where answers are bare bytes: they are noise by their looks."""
    size = case.ledger.answer_length
    if not case.protocol.ordered or case.has_checksum or not size:
        return
    # what stands in the place of an answer was asked for
    stray = [d for d in case.damages if d.kind == NOISE and d.turn != IN_REPLY]
    alike = [d for d in stray if len(d.got) == d.length == size]
    if len(alike) < max(UNASKED, BARE_SHARE * len(stray)):
        return
    for servo in case.answering:
        p = case.series(servo, "position")
        if p is None or p.register.width != 1:
            continue
        t = np.array([d.t_ns for d in alike])
        low, high = (x / p.register.scale for x in in_force(p, t - NS // 4, t))
        fits = [
            d
            for d, a, b in zip(alike, low.tolist(), high.tolist(), strict=True)
            if any(a - NEAR_RAW <= byte <= b + NEAR_RAW for byte in d.got)
        ]
        chance = float(np.mean(high - low + 2 * NEAR_RAW)) * size / 256
        if len(fits) < max(UNASKED, BARE_SHARE * len(alike), 2 * chance * len(alike)):
            continue
        yield finding_of(
            fits,
            "speaks-unasked",
            servo,
            f"{len(fits)} times {size} bytes stand between the frames that would be an answer of "
            f"servo {servo}, where it is at the moment",
            "would be an answer",
            strength=min(0.5 + len(fits) / 25, 0.9),
            brief=f"servo {servo} speaks unasked",
        )


RULES: Final[tuple[Rule, ...]] = (complaints, together, overload_passes, chatty, chatty_bare)
"""The rules of this file."""
