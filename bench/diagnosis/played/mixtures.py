"""Two faults at once that have nothing to do with each other; and one that looks like more."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Final

from bench.diagnosis.played.cases import EVERY, Cases
from bench.diagnosis.played.draft import ALL
from bench.diagnosis.played.joints import goes_limp, grows_hot, is_held
from bench.diagnosis.played.loops import hangs
from bench.diagnosis.played.orders import goal_jumps, wears
from bench.diagnosis.played.presence import dies, is_missing, is_renamed, lags, sags, suffers
from bench.diagnosis.played.words import chats
from sniffer.simulation import faults as f

if TYPE_CHECKING:
    from bench.diagnosis.played.draft import Draft

CASES: Final = Cases()
OF_CONTROLLERS: Final = Cases()


@CASES("mightyzap", "rs30x", servos=(3, 5), seconds=(14, 28), polls=(ALL,))
def mixed_limp_and_brownout(draft: Draft) -> None:
    """One hangs limp, and the supply of another sags."""
    goes_limp(draft)
    sags(draft, [draft.pick()])


@CASES(*EVERY, servos=(3, 5), seconds=(12, 25), polls=(ALL,))
def mixed_dead_and_slow(draft: Draft) -> None:
    """One dies, another is slow from the start."""
    lags(draft, 0)
    dies(draft)


@CASES("mightyzap", "lss", "rs30x", servos=(3, 5), seconds=(20, 40), polls=(ALL,))
def mixed_hot_and_chatty(draft: Draft) -> None:
    """One grows hot, another speaks unasked."""
    grows_hot(draft)
    chats(draft)


@CASES("mightyzap", "wck", servos=(3, 5), seconds=(14, 28), polls=(ALL,))
def mixed_held_and_missing(draft: Draft) -> None:
    """One is held fast, another was never there."""
    is_missing(draft)
    is_held(draft)


@CASES(*EVERY, servos=(3, 6), polls=(ALL,))
def chain_broken(draft: Draft) -> None:
    """The cable breaks between two servos of a chain: all behind it fall silent at once."""
    behind = draft.ids[-draft.rng.randint(2, len(draft.ids) - 1) :]
    first_s = draft.onset()
    for who in behind:
        draft.at(first_s, functools.partial(suffers, kind=f.DEAD, who=who))
    draft.truth("servo-dead", behind, first_s, draft.seconds)


@OF_CONTROLLERS("rs30x", "lss", servos=(3, 5), seconds=(14, 28), polls=(ALL,))
def mixed_hangs_and_held(draft: Draft) -> None:
    """The loop stops now and then, and a joint is held fast."""
    hangs(draft)
    is_held(draft)


@OF_CONTROLLERS("mightyzap", "wck", servos=(3, 5), seconds=(12, 24), polls=(ALL,))
def mixed_wears_and_missing(draft: Draft) -> None:
    """Memories are worn out, and somebody is asked who is not there."""
    is_missing(draft)
    wears(draft)


@OF_CONTROLLERS("mightyzap", "rs30x", "lss", servos=(3, 5), polls=(ALL,))
def mixed_jumps_and_renamed(draft: Draft) -> None:
    """Goals of one jump, and another is given a new id."""
    goal_jumps(draft)
    is_renamed(draft)
