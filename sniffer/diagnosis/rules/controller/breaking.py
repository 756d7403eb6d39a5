"""Requests that their sender breaks off: beginnings alone, and nothing else is torn."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.ledger.damage import HELD, IN_REPLY, REST
from sniffer.diagnosis.physics.comparing import alike

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

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

VALUES: Final = 5
"""Bytes of the head that tell which request it is; behind it may stand other values."""

LEAST: Final = 5
PLACES: Final = 2
"""Beginnings, and lengths of them: a driver that cuts always at one place is another fault."""

NEARLY: Final = 0.9
ANSWERS: Final = 0.2
"""Part of what is torn that must be beginnings, and how many torn answers there may be for each."""


def requests_broken_off(case: Case) -> Iterator[Finding]:
    """Beginnings of requests with nothing behind them."""
    if case.has_bare_answers:  # an answer without a header is no end of what is before it
        return
    known = case.ledger.exchanges.kinds.requests
    torn = [d for d in case.damages if d.turn not in (IN_REPLY, HELD, REST)]
    begun = [d for d in torn if are_beginnings(d.got, known)]
    some = [d for d in begun if d.length >= PIECE]
    if len(some) < LEAST or len({d.length for d in some}) < PLACES:
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


def _begun(got: bytes, whole: bytes) -> int:
    """Return how many bytes are the beginning of a request like a known one.

    Behind its head stand values, which are any; what ends as the request does lacks its middle.
    """
    same = alike(got, whole)
    most = min(len(got), len(whole) - 1)
    if same < VALUES or (same < most and got[most - 1] == whole[-1]):
        return same
    return max(same, most)


def are_beginnings(got: bytes, known: Sequence[bytes]) -> bool:
    """Tell whether bytes are the beginnings of one or more requests, one behind the other."""
    reached = {0}
    for at in range(len(got)):
        if at in reached:
            size = max((_begun(got[at:], whole) for whole in known), default=0)
            reached.update(range(at + 1, at + size + 1))
    return len(got) in reached


RULES: Final[tuple[Rule, ...]] = (requests_broken_off,)
"""The rules of this area."""
