"""Since when a joint hangs: behind a moment, or since its servo first left a request unanswered."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.evidence.tracks import Away, JointTrack
    from sniffer.diagnosis.ledger.silences import Silence
    from sniffer.ground.model import I64, Mask

BEFORE_NS: Final = 5 * NS
"""An alarm or a restart may be so long before the joint is seen to hang."""

AFTER_NS: Final = 2 * NS
"""... and so long behind its beginning: it is weak before it lets go."""

LETS_GO_NS: Final = NS // 2
"""A joint that is let go of has sunk to where it stays by then."""


def hangs_behind(one: JointTrack, away: Away, moments: I64) -> bool:
    """Tell whether it hangs since one of some moments: shortly behind it, or it never moved."""
    near = moments[moments <= away.first_ns + AFTER_NS]
    if not len(near):
        return False
    last = int(near.max())
    p = one.position
    rows = (p.t_first >= last + LETS_GO_NS) & (p.t <= away.first_ns)
    return away.first_ns - last <= BEFORE_NS or (bool(rows.any()) and not _moves(one, rows))


def hangs_since_it_was_away(one: JointTrack, away: Away, silences: Sequence[Silence]) -> bool:
    """Tell whether it moved until its servo first left a request unanswered, and never since.

    A restart may be over before the next request. Of several silences only the first one tells:
    a joint that rests for a while stands still since the latest of many by chance.
    """
    first = silences[0] if silences else None
    if first is None or first.back_ns is None:
        return False
    p = one.position
    since = (p.t_first >= first.back_ns + LETS_GO_NS) & (p.t <= away.last_ns)
    return (
        _moves(one, p.t <= first.first_ns)
        and away.first_ns >= first.first_ns
        and bool(since.any())
        and not _moves(one, since)
    )


def _moves(one: JointTrack, rows: Mask) -> bool:
    """Tell whether a joint moves by what counts as far while it is looked at in some rows."""
    p = one.position
    return bool(rows.any()) and float(p.high[rows].max() - p.low[rows].min()) >= one.far / 2


def is_switched_on(case: Case, servo: int, away: Away) -> bool:
    """Tell whether a joint's torque was said to be on before it hung, and not off since.

    Nothing is known where the servo was away meanwhile: it may have begun anew.
    """
    on = case.settings("torque_enable", servo_id=servo)
    told = on.take(on.t_ns <= away.last_ns)
    if not len(told) or int(told.after[-1]) != 1 or int(told.t_ns[-1]) > away.first_ns:
        return False
    since = int(told.t_ns[-1])
    return not any(since < (run.back_ns or 0) for run in case.ledger.silences.runs(servo))
