"""What a servo forgot or was told: registers at their defaults, torque gone, goals without torque."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnosis.case import episodes, runs
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.told import told_to
from sniffer.diagnosis.evidence.tracks import track
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.rules.device.joints import ALARMS
from sniffer.ground.codes import MEASURED
from sniffer.ground.distinct import within
from sniffer.ground.model import NEVER_NS, NS
from sniffer.protocols.base import LETS_GO, RESTARTS, TURNS_ELSEWHERE

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.evidence.tracks import JointTrack
    from sniffer.diagnosis.ledger.events import Happenings
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "back-at-defaults",
        "Registers of a servo that are lost without power are at their defaults, and nobody wrote that.",
        "Two such registers, or one after a silence of the servo, read at the manual's default after another value; no restart was commanded.",
    ),
    FindingCode(
        "torque-gone",
        "A servo's torque was on and is off, and nobody switched it off.",
        "The torque register is read as off (or the status as limp) after it was on; no write, no release and no restart between.",
    ),
    FindingCode(
        "torque-never-on",
        "Nobody switches the torque of a servo on that has it off after power-on, and its joint stands still.",
        "Goals, none of which its joint follows, from the first look to the last; by the manual its torque is off after power-on, and no request here switches it on; no joint moves, or another one's torque was switched on here.",
        is_omission=True,
    ),
    FindingCode(
        "follows-again",
        "A joint that did not follow its goals follows them again, and nobody switched its torque on.",
        "Its torque was switched on before, and never since; it is near its goals for a second behind a stretch in which it was not, and the servo did not complain.",
    ),
    FindingCode(
        "goals-without-torque",
        "A servo gets goals while its torque is off.",
        "Its torque register was written or read as off, and goals follow for a second or longer, three or more, before it is on again; its joint is not seen to follow. Where a goal may switch it on (`on_with` in the table of its model, or of any while nothing tells the model), its joint is seen to hang.",
        is_lasting=True,
    ),
    FindingCode(
        "limp-by-status",
        "A servo says that it is limp while it has a goal.",
        "Its status is read as limp 0.3 seconds or more behind a goal, without a release or a restart in between.",
        is_lasting=True,
    ),
)

ORDERED_NS: Final = 10 * NS
"""A restart that was commanded explains what is read so long after it."""

SILENT_NS: Final = 10 * NS
"""A silence so long before explains one register at its default."""

TOGETHER_NS: Final = 2 * NS
"""Registers read within this time are of one restart; a poll of all settings takes a while."""

LEAST: Final = 3
"""Goals without torque that are no accident."""

LASTS_NS: Final = NS

SETTLED_NS: Final = 3 * NS // 10
"""What a servo needs to answer a goal with another status."""

LIMP: Final = "limp"


def defaults(case: Case) -> Iterator[Finding]:
    """Servos whose registers went back to their defaults by themselves."""
    registers = case.protocol.registers
    for servo in case.servos:
        h = case.settings(servo_id=servo)
        mine = [
            i
            for i, (what, before, after, written) in enumerate(
                zip(h.what, h.before, h.after, h.written, strict=True)
            )
            if not written
            and before not in (-1, after)
            and registers[what].volatile
            and registers[what].role != MEASURED
            and registers[what].default == after
        ]
        if not mine:
            continue
        changed = h.take(np.array(mine))
        ordered = case.order_times(servo, RESTARTS)
        silent = [s.back_ns for s in case.ledger.silences.runs(servo) if s.back_ns is not None]
        kept: list[int] = []
        for i, t in enumerate(changed.t_ns.tolist()):
            near = int((np.abs(changed.t_ns - t) <= TOGETHER_NS).sum())
            after_silence = any(0 <= t - back <= SILENT_NS for back in silent)
            was_told = ((ordered <= t) & (ordered >= t - ORDERED_NS)).any()
            if not was_told and (near > 1 or after_silence):
                kept.append(i)
        if kept:
            yield _defaults(case, servo, changed.take(np.array(kept)))


def _defaults(case: Case, servo: int, changed: Happenings) -> Finding:
    names = list(dict.fromkeys(case.protocol.registers[i].name for i in changed.what.tolist()))
    spans = episodes(changed.t_ns, changed.t_ns)
    shown = ", ".join(names[:4]) + (" ..." if len(names) > 4 else "")
    return Finding(
        "back-at-defaults",
        servo,
        spans[0][0],
        spans[-1][1],
        len(spans),
        f"servo {servo} has {shown} at the default, and nobody wrote that",
        case.places(changed, "registers at their defaults"),
        strength=1.0 if len(names) > 1 or len(spans) > 1 else 0.7,
        brief=f"servo {servo} back with registers at their defaults",
        episodes=spans,
    )


class _Off(NamedTuple):
    """A time without torque: how it began (written by a request or not), and until when."""

    since_ns: int
    until_ns: int
    written: bool
    known_on: bool
    at: int
    length: int


def _offs(case: Case, servo: int) -> list[_Off]:
    """Return the times in which the torque register is known to be off."""
    h = told_to(case, servo, "torque_enable")
    out: list[_Off] = []
    for k in range(len(h)):
        if h.after[k] == 1 or (k and h.after[k - 1] != 1 and h.before[k] != 1):
            continue
        on = np.flatnonzero(h.after[k + 1 :] == 1)
        until = int(h.t_ns[k + 1 + int(on[0])]) if len(on) else NEVER_NS
        out.append(
            _Off(
                int(h.t_ns[k]),
                until,
                bool(h.written[k]),
                int(h.before[k]) == 1,
                int(h.at[k]),
                int(h.length[k]),
            )
        )
    return out


def torque(case: Case) -> Iterator[Finding]:
    """Torque that is gone by itself, and goals that go to a servo without it."""
    for servo in case.servos:
        offs = _offs(case, servo)
        told = case.order_times(servo, LETS_GO, RESTARTS)
        gone = [
            o
            for o in offs
            if not o.written
            and o.known_on
            and not ((told <= o.since_ns) & (told >= o.since_ns - ORDERED_NS)).any()
        ]
        if gone:
            yield Finding(
                "torque-gone",
                servo,
                gone[0].since_ns,
                gone[-1].since_ns,
                len(gone),
                f"the torque of servo {servo} was on and is read as off at "
                f"{case.since(gone[0].since_ns)}; nobody switched it off",
                tuple(Place(o.at, o.length, o.since_ns, "torque read as off") for o in gone[:3]),
                brief=f"torque of servo {servo} off",
            )
        yield from _goals_without(case, servo, offs)


def _goals_without(case: Case, servo: int, offs: list[_Off]) -> Iterator[Finding]:
    goal = case.series(servo, "goal_position")
    if goal is None or case.ledger.unproven.is_doubted(servo):
        return  # its torque may have been switched on in what was taken for an answer
    joint = track(case, servo)
    goes_on = any(r.on_with for r in case.registers_of(servo, "torque_enable"))
    for o in offs:
        rows = np.flatnonzero((goal.t_first > o.since_ns) & (goal.t < o.until_ns))
        if not len(rows):
            continue
        first, last = int(goal.t_first[rows[0]]), int(goal.t[rows[-1]])
        count = int(goal.n[rows].sum())
        if count < LEAST or last - first < LASTS_NS:
            continue
        strength, hangs = 0.6, False
        if joint is not None:
            hangs = any(a.last_ns > first and a.first_ns < last for a in joint.away)
            strength = 1.0 if hangs else 0.2
        if goes_on and not hangs:
            continue
        how = "switched off" if o.written else "read as off"
        yield Finding(
            "goals-without-torque",
            servo,
            o.since_ns,
            last,
            count,
            f"the torque of servo {servo} is {how} at {case.since(o.since_ns)}, and {count} goals "
            f"follow in {(last - first) / NS:.1f} s",
            (
                Place(o.at, o.length, o.since_ns, f"torque {how}"),
                Place(int(goal.at[rows[0]]), 1, first, "a goal without torque"),
            ),
            strength=strength,
            brief=f"torque of servo {servo} {how}",
        )
        return


def never_on(case: Case) -> Iterator[Finding]:
    """Find joints that stand still and whose torque nobody switches on, in a servo that has it off.

    Where other joints move it tells only if theirs was switched on here: a capture may begin later.
    """
    torque = [i for i, r in enumerate(case.protocol.registers) if r.quantity == "torque_enable"]
    w, tracks = case.writes, [t for t in map(functools.partial(track, case), case.servos) if t]
    is_on = within(w["register"], torque) & (w["high"] > 0)
    others = any(_went(t) for t in tracks)
    for one in tracks:
        servo = one.servo_id
        registers = case.registers_of(servo, "torque_enable")
        if not registers or registers[0].default != 0 or any(r.on_with for r in registers):
            continue
        mine = is_on & within(w["servo_id"], [servo, *case.everyone])
        if _went(one) or not one.away or mine.any() or (others and not is_on.any()):
            continue
        first, last = one.away[0], one.away[-1]
        yield Finding(
            "torque-never-on",
            servo,
            first.first_ns,
            last.last_ns,
            len(one.away),
            f"nobody switches the torque of servo {servo} on, which is off after power-on by its "
            "manual, and its joint never moves",
            (Place(int(one.position.at[first.first]), 1, first.first_ns, "it stands still"),),
            brief=f"torque of servo {servo} never switched on",
        )


def went_on(case: Case) -> Iterator[Finding]:
    """Find joints that follow again by themselves: who is without torque stays so until it is told."""
    torque = [i for i, r in enumerate(case.protocol.registers) if r.quantity == "torque_enable"]
    w, alarmed = case.writes, {int(i) for i in case.anomalies(*ALARMS).servo_id}
    is_on = within(w["register"], torque) & (w["high"] > 0)
    for servo in case.servos:
        registers = case.registers_of(servo, "torque_enable")
        one = track(case, servo) if registers and servo not in alarmed else None
        if one is None:
            continue
        # where a goal switches it on, a motor that is off is none that goals come to
        mine = is_on & within(w["servo_id"], [servo, *case.everyone])
        if not mine.any():
            continue
        told_ns = int(w["t_last"][mine].max())
        again = [a for a in one.away if told_ns < a.first_ns and one.follows(a.last_ns)]
        if not again:
            continue
        often = "once" if len(again) == 1 else f"{len(again)} times"
        yield Finding(
            "follows-again",
            servo,
            again[0].last_ns,
            again[-1].last_ns,
            len(again),
            f"servo {servo} follows its goals again {often} after it did not, and its torque was not "
            "switched on meanwhile",
            tuple(
                Place(int(one.position.at[a.last]), 1, a.last_ns, "it follows again behind this")
                for a in again[:3]
            ),
            brief=f"servo {servo} follows again by itself",
            episodes=tuple((a.last_ns, a.last_ns) for a in again),
        )


def _went(one: JointTrack) -> bool:
    """Tell whether a joint ever moved by more than it gives."""
    return float(one.position.high.max() - one.position.low.min()) > one.far / 2


LASTING_NS: Final = NS // 2
LASTING: Final = 6
"""So long, and so many times in a row, a joint says that it is limp before that is believed."""


def limp_status(case: Case) -> Iterator[Finding]:
    """Servos that say that they are limp, with a goal."""
    for servo in case.measured_by("status"):
        status, goal = case.series(servo, "status"), case.series(servo, "goal_position")
        if status is None or goal is None:
            continue
        code = next((k for k, name in status.register.values.items() if name == LIMP), None)
        if code is None:
            continue
        # One that holds again a moment later is no limp joint: it says so time and again.
        lasting = runs((status.low == code) & (status.high == code), status.t, LASTING_NS)
        limp = [row for a, b in lasting if b - a >= LASTING for row in range(a, b)]
        ends = case.order_times(servo, LETS_GO, RESTARTS, TURNS_ELSEWHERE)
        kept = []
        for row in limp:
            t = int(status.t_first[row] if status.first[row] == code else status.t[row])
            stated = np.flatnonzero(goal.t <= t - SETTLED_NS)
            if not len(stated):
                continue
            since = int(goal.t[stated[-1]])
            if not ((ends >= since) & (ends <= t)).any():
                kept.append((row, t))
        if len(kept) < 2:
            continue
        yield Finding(
            "limp-by-status",
            servo,
            kept[0][1],
            kept[-1][1],
            len(kept),
            f"servo {servo} says {len(kept)} times that it is limp, while it has goals",
            tuple(Place(int(status.at[row]), 1, t, "status limp") for row, t in kept[:3]),
            brief=f"servo {servo} says that it is limp",
        )


RULES: Final[tuple[Rule, ...]] = (defaults, torque, never_on, went_on, limp_status)
"""The rules of this file."""
