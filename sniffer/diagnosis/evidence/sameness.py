"""Bytes that are no frame and come again and again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.evidence.chances import OFTEN
from sniffer.diagnosis.ledger.damage import HELD, IN_REPLY
from sniffer.diagnosis.physics.comparing import bits_wrong

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage

BITS: Final = 2
"""Bits that a weak signal alters in one request, always the same ones."""

WHOLE: Final = 4
"""Fewer bytes come again by chance."""


def not_held(case: Case) -> list[Damage]:
    """Return the damaged places at which nothing holds the line."""
    return [d for d in case.damages if d.turn != HELD]


def come_again(case: Case) -> Mapping[bytes, Sequence[Damage]]:
    """Return bytes that are no frame and most of what is torn, with their places."""
    known = case.ledger.exchanges.kinds.requests
    where: dict[bytes, list[Damage]] = {}
    damages = not_held(case)
    for d in damages:
        where.setdefault(d.got, []).append(d)
    return {
        got: places for got, places in where.items() if _is_sent_so(got, places, damages, known)
    }


def _is_sent_so(
    got: bytes, places: Sequence[Damage], damages: Sequence[Damage], known: Sequence[bytes]
) -> bool:
    """Tell whether somebody sends these bytes as they are."""
    if len(places) < OFTEN or len(got) < WHOLE or len(set(got)) < 3:
        return False
    # A request that is whole at times is torn at others.
    if 2 * len(places) < len(damages) or any(_is_torn(got, whole) for whole in known):
        return False
    # an answer that is due: a servo at rest says the same, and it is torn alike
    return 2 * sum(d.turn == IN_REPLY for d in places) <= len(places)


def _is_torn(got: bytes, whole: bytes) -> bool:
    """Tell whether bytes are those of a request but for a bit or two."""
    if len(got) != len(whole):
        return False
    return bits_wrong(got, whole) <= BITS
