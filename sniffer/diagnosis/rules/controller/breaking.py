"""Requests that their sender breaks off: beginnings alone, and nothing else is torn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.ledger.damage import HELD, IN_REPLY, REST
from sniffer.diagnosis.physics.comparing import are_beginnings

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "requests-broken-off",
        "Requests stop before their end: their sender throws away what it has not sent yet.",
        "Nine tenths of what is torn, but for answers, are beginnings of requests that this controller makes, cut at different places and with no byte altered; five of four bytes and more, and hardly an answer is torn. Noise alters bytes, and what a tap loses ends anywhere.",
        settle="Look at both sides of the controller's driver with a logic analyser: what never leaves the UART was thrown away, what leaves it and not the driver was switched off.",
        remedy="Let the controller wait until all is sent (tcdrain, flush) before it switches direction, closes the port or empties its buffers (tcflush with TCIOFLUSH or TCOFLUSH throws away what is not sent).",
    ),
)

PIECE: Final = 4
"""Bytes of a beginning that is no mere header."""


LEAST: Final = 5
PLACES: Final = 2
"""Beginnings, and lengths of them: a driver that cuts always at one place is another fault."""

NEARLY: Final = 0.9
ANSWERS: Final = 0.2
"""Part of what is torn that must be beginnings, and how many torn answers there may be for each."""


def requests_broken_off(case: Case) -> Iterator[Finding]:
    """Beginnings of requests with nothing behind them."""
    known = case.ledger.exchanges.kinds.requests
    # a bare answer behind would be no end of it; of the shortest ones one byte alone can be missing
    shortest = min(map(len, known), default=0) - 1
    least, places = min(PIECE, shortest), 1 if shortest < PIECE else PLACES
    torn = [d for d in case.damages if d.turn not in (IN_REPLY, HELD, REST)]
    begun = [d for d in torn if are_beginnings(d.got, known)]
    some = [d for d in begun if d.length >= least]
    if len(some) < LEAST or len({d.length for d in some}) < places:
        return
    answers = sum(d.turn == IN_REPLY for d in case.damages)
    if len(begun) < NEARLY * len(torn) or answers > ANSWERS * len(some):
        return
    yield finding_of(
        some,
        "requests-broken-off",
        None,
        f"{len(begun)} of {len(torn)} torn places but answers are beginnings of requests, cut after "
        f"{min(d.length for d in some)} to {max(d.length for d in some)} bytes, with no byte altered",
        "a request that stops here",
        strength=min(0.6 + len(some) / 25, 1.0),
        brief="requests stop before their end",
    )


RULES: Final[tuple[Rule, ...]] = (requests_broken_off,)
"""The rules of this area."""
