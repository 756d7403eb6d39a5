"""Servos that were given another id or rate, or told to say nothing, and are asked as if not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.told import told_to
from sniffer.diagnosis.model import LINE, Finding, Place
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

CUT_IT_OFF: Final = (
    "Decode what comes behind it by the rate that was given, as a capture of its own: cut it off "
    "there, or record it anew."
)

LEAD_IT_BACK: Final = (
    "Lead it back to this protocol as its manual says (a button, a start with a jumper), and look at "
    "what wrote that register."
)

LEAVE_IT_OUT: Final = "Leave the old id out of the controller's list: the servo answers by its new one, which is asked, too."

FINDINGS: Final = (
    FindingCode(
        "old-id-asked",
        "A servo was given another id, and the old one is asked still and answers nothing.",
        "A frame that gives the id, then at least three requests to the old one, none with an answer, or none from some moment on to the end: some servos take it with their next start.",
    ),
    FindingCode(
        "both-ids-asked",
        "A servo was given another id; it is asked by that one and answers, and by the old one in vain.",
        "The same as `old-id-asked`, and three answers and more of the new id behind the frame that gives it.",
        remedy=LEAVE_IT_OUT,
        settle=LEAVE_IT_OUT,
        concerns="",
    ),
    FindingCode(
        "id-given-twice",
        "A servo was given an id that another one has: two answer to it since.",
        "A frame that gives the id; two answers and more behind it that come second, that nobody asked for, or that are torn where it answered whole before and hardly does since; all of that id, and none before.",
        is_its_own=True,
        settle="Ask the id it had before: the one that was given another answers no more.",
        remedy="Disconnect all but one of the two and give it its own id back; look at the command that gave it this one.",
    ),
    FindingCode(
        "silent-at-old-rate",
        "A servo was told another baud rate and answers nothing at this one since.",
        "A frame that gives the rate, at least three requests behind it, and none of them answered from some moment on.",
    ),
    FindingCode(
        "torn-at-old-rate",
        "A servo was told another baud rate, and nothing of what is said since holds at this one.",
        "A frame that gives the rate, at most ten seconds before the last frame that holds, and 50 bytes and more behind that one.",
        remedy=CUT_IT_OFF,
        settle=CUT_IT_OFF,
    ),
    FindingCode(
        "silent-in-other-mode",
        "A servo was told to leave this protocol and answers nothing since.",
        "A write of a register whose effect is another protocol, at least three requests behind it, and none of them answered from some moment on.",
        remedy=LEAD_IT_BACK,
        settle=LEAD_IT_BACK,
        concerns="",
    ),
    FindingCode(
        "reads-unanswered-as-told",
        "A servo was told to answer no reads, and is read from all the same.",
        "At least three reads, without an answer, of a servo whose return mode is that it answers none.",
    ),
)

LEAST: Final = 3

NO_READS: Final = 0
"""The return mode in which reads are not answered: see ``Register.effect``."""

SOON_NS: Final = 10 * NS
"""So long behind the frame that gives a rate the line may go on at the old one, at most: a servo takes
it with its next start, which who gave it commands, and others are told, too."""

PLENTY: Final = 50
"""Bytes in no frame that are no noise of a restart."""

TOO_MANY: Final = ("duplicate-response", "unsolicited-response")
"""What comes of a second answer that lies over no other one."""

SECOND: Final = 2
"""Answers too many behind the frame that gave the id: one may be an answer that came late."""


def old_ids(case: Case) -> Iterator[Finding]:
    """Ids that were given away and are asked still."""
    told = case.anomalies("id-changed")
    found: dict[int, Finding] = {}  # of several orders the last one: it may have had its id back
    for k, named in enumerate(told.servo_id.tolist()):
        t, at, length = (int(x[k]) for x in (told.t_ns, told.at, told.length))
        new = _value(case, "servo_id", named, t)
        to = "another id" if new is None else f"the id {new}"
        name = "another" if new is None else str(new)
        for servo in case.answering if named in case.everyone else (named,):
            if servo == new:
                continue
            asked, first, last = _asked_in_vain(case, servo, t)
            if asked < LEAST:
                continue
            answers = 0 if new is None else _since(case, new, t)[1]
            # who answered by it before is another one
            is_both = LEAST <= answers == case.total("ok", new)
            beside = f"; {name} is asked as well, and answers" if is_both else ""
            found[servo] = Finding(
                "both-ids-asked" if is_both else "old-id-asked",
                servo,
                t,
                last,
                asked,
                f"servo {servo} was given {to} at {case.since(t)}; {asked} requests to {servo} "
                f"follow, the first {(first - t) / NS:.3f} s later, and none is answered{beside}",
                (Place(at, length, t, f"servo {named} is given {to}"),),
                strength=min(0.7 + asked / 20, 1.0),
                brief=f"servo {servo} becomes {name}, {servo} is asked still",
            )
    yield from found.values()


def _asked_in_vain(case: Case, servo: int, since_ns: int) -> tuple[int, int, int]:
    """Return how often a servo is asked for nothing from some time on, and when first and last.

    What is kept without power may become true with the next start only, as LSS has it.
    """
    asked, ok, first, last = _since(case, servo, since_ns)
    if not ok:
        return asked, first, last
    spells = case.ledger.silences.of(servo)
    late = [s for s in spells if s.back_ns is None and s.first_ns >= since_ns]
    return (late[0].missed, late[0].first_ns, case.last_ns) if late else (0, first, last)


def ids_given_twice(case: Case) -> Iterator[Finding]:
    """Ids that were given to a servo though another one has them."""
    told = case.anomalies("id-changed")
    for k, servo in enumerate(told.servo_id.tolist()):
        t, at, length = (int(x[k]) for x in (told.t_ns, told.at, told.length))
        new = _value(case, "servo_id", servo, t)
        if new is None or new == servo or new not in case.answering:
            continue
        more = case.anomalies(*TOO_MANY, servo_id=new)
        if _mostly_torn_since(case, new, t):
            more = case.anomalies(*TOO_MANY, "damaged-response", servo_id=new)
        since = more.take(more.at > at)
        if len(since) < SECOND or len(since) < len(more):
            continue
        to_all = servo in case.everyone
        given = f"{'all servos are' if to_all else f'servo {servo} is'} given the id {new}"
        were = f"{'all servos were' if to_all else f'servo {servo} was'} given the id {new}"
        other = "" if to_all else ", which another one has"
        yield Finding(
            "id-given-twice",
            new,
            t,
            int(since.t_ns[-1]),
            len(since),
            f"{were} at {case.since(t)}{other}: {len(since)} answers of {new} came second, unasked "
            "or torn since, none before",
            (
                Place(at, length, t, given),
                *case.places(since, "a second answer", 2),
            ),
            strength=min(0.7 + len(since) / 20, 1.0),
            brief=f"{given}, and two answer to it",
            befell=() if to_all else (servo,),
        )


def _mostly_torn_since(case: Case, servo: int, t_ns: int) -> bool:
    """Tell whether a servo answered whole before a moment, and mostly torn behind it."""
    a = case.answers
    mine = a["servo_id"] == servo
    before, behind = mine & (a["t_last"] < t_ns), mine & (a["t_first"] > t_ns)
    torn, whole = (int(a[what][behind].sum()) for what in ("damaged", "ok"))
    return torn > whole and bool(a["ok"][before].any()) and not a["damaged"][before].any()


def old_rates(case: Case) -> Iterator[Finding]:
    """Servos that are silent since they were told another rate."""
    told = case.anomalies("baud-changed")
    for k, servo in enumerate(told.servo_id.tolist()):
        t, at, length = (int(x[k]) for x in (told.t_ns, told.at, told.length))
        to_all = servo in case.everyone
        for one in case.answering if to_all else (servo,):
            rate = _rate(case, _value(case, "baud", servo, t))
            place = Place(at, length, t, f"servo {one} is told {rate}")
            yield from _silent_since(case, "silent-at-old-rate", one, rate, place)


def torn_since(case: Case) -> Iterator[Finding]:
    """Lines on which nothing holds any more since a servo was told another rate."""
    told = case.anomalies("baud-changed")
    told = told.take((told.t_ns >= case.last_ns - SOON_NS) & (told.t_ns <= case.last_ns))
    behind = case.line["t_first"] > case.last_ns
    lost = int(case.line["gap_bytes"][behind].sum())
    if not len(told) or lost < PLENTY:
        return
    for servo in dict.fromkeys(told.servo_id.tolist()):
        mine = told.take(told.servo_id == servo)
        t, at, length = int(mine.t_ns[-1]), int(mine.at[-1]), int(mine.length[-1])
        rate = _rate(case, _value(case, "baud", servo, t))
        yield Finding(
            "torn-at-old-rate",
            servo,
            t,
            int(case.line["t_last"][behind].max()),
            len(mine),
            f"servo {servo} was told {rate} at {case.since(t)}, and none of the {lost} bytes behind "
            f"{case.since(case.last_ns)} is in a frame",
            (Place(at, length, t, f"servo {servo} is told {rate}"),),
            brief=f"servo {servo} is told {rate}, and nothing holds since",
            befell=(servo, LINE),
        )


def other_modes(case: Case) -> Iterator[Finding]:
    """Servos that are silent since they were told to speak another protocol."""
    told = case.settings("protocol")
    for k in np.flatnonzero(told.written == 1).tolist():
        servo, t, at, length, what, value = (
            int(x[k])
            for x in (told.servo_id, told.t_ns, told.at, told.length, told.what, told.after)
        )
        register = case.protocol.registers[what]
        mode = f"{register.name} {register.values.get(value, value)}"
        for one in case.answering if servo in case.everyone else (servo,):
            place = Place(at, length, t, f"servo {one} is told {mode}")
            yield from _silent_since(case, "silent-in-other-mode", one, mode, place)


def reads_unanswered(case: Case) -> Iterator[Finding]:
    """Servos that are read from though they were told to answer no reads."""
    counted = case.ledger.unanswered_reads.counted()
    columns = ("servo_id", "n", "t_first", "t_last", "at", "length")
    for servo, n, first, last, at, length in zip(
        *(counted[name].tolist() for name in columns), strict=True
    ):
        told = told_to(case, servo, "feedback")
        k = int((told.t_ns <= first).sum()) - 1
        if n < LEAST or k < 0 or int(told.after[k]) != NO_READS:
            continue  # its answers are not expected for another reason: an echo stands there
        since, how = int(told.t_ns[k]), "is told" if told.written[k] else "says"
        register = case.protocol.registers[int(told.what[k])]
        mode = f"{register.name} {register.values.get(NO_READS, NO_READS)}"
        yield Finding(
            "reads-unanswered-as-told",
            servo,
            since,
            last,
            n,
            f"servo {servo} {how} that it answers no reads ({mode}); {n} reads follow until "
            f"{case.since(last)}, and none is answered",
            (
                Place(
                    int(told.at[k]),
                    int(told.length[k]),
                    since,
                    f"servo {servo} {how} that it answers no reads",
                ),
                Place(at, length, first, "it is read from"),
            ),
            strength=min(0.7 + n / 20, 1.0),
            brief=f"servo {servo} {how} that it answers no reads, and is read from",
        )


def _silent_since(case: Case, code: str, servo: int, told: str, place: Place) -> Iterator[Finding]:
    """Find the silence of a servo to the end that began when it was told something, if any.

    What is kept without power becomes true with the next start, on some servos.
    """
    t = place.t_ns
    spells = [s for s in case.ledger.silences.of(servo) if s.back_ns is None]
    silent = next((s for s in spells if s.first_ns >= t - NS and s.missed >= LEAST), None)
    if silent is None:
        return
    yield Finding(
        code,
        servo,
        t,
        case.last_ns,
        silent.missed,
        f"servo {servo} was told {told} at {case.since(t)}, and answers none of {silent.missed} "
        f"requests since {case.since(silent.first_ns)}",
        (place, Place(silent.at, silent.length, silent.first_ns, "no answer")),
        brief=f"servo {servo} is told {told} and falls silent",
    )


def _since(case: Case, servo: int, t_ns: int) -> tuple[int, int, int, int]:
    """Return how often a servo was asked and answered behind a moment, and when that was.

    Buckets that the moment lies in count by what was asked in them behind it at the least: nothing.
    """
    a = case.answers
    rows = np.flatnonzero((a["servo_id"] == servo) & (a["t_first"] > t_ns))
    if not len(rows):
        return 0, 0, t_ns, t_ns
    asked, ok = int(a["missing"][rows].sum()), int(a["ok"][rows].sum())
    return asked, ok, int(a["t_first"][rows[0]]), int(a["t_last"][rows[-1]])


def _value(case: Case, effect: str, servo: int, t_ns: int) -> int | None:
    """Return what a servo was told at a moment."""
    h = case.settings(effect, servo_id=servo)
    rows = np.flatnonzero((h.written == 1) & (h.t_ns == t_ns))
    return int(h.after[rows[0]]) if len(rows) else None


def _rate(case: Case, code: int | None) -> str:
    if code is None:
        return "another rate"
    named = (r.values.get(code) for r in case.protocol.registers if r.effect == "baud")
    return f"{next((n for n in named if n), code)} baud"


RULES: Final[tuple[Rule, ...]] = (
    *(old_ids, ids_given_twice, old_rates, torn_since),
    *(other_modes, reads_unanswered),
)
"""The rules of this file."""
