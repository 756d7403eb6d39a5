"""What is said on the line in another way: by another protocol, or at another rate."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.beginnings import most_begun
from sniffer.decoding.holding import spans_in
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.comparing import REPEATS, SEQUENCE, repeated
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.unclaimed import first_low
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.protocols.base import BusProtocol

FINDINGS: Final = (
    FindingCode(
        "two-protocols",
        "line",
        "Frames of two protocols hold on one line.",
        "The decoder explains the bytes by two protocols, each byte by one of them.",
    ),
    FindingCode(
        "foreign-frames",
        "line",
        "What no frame of the protocol claims holds as frames of another one.",
        "Five frames or more of another protocol, which explain three fifths of the unclaimed runs (nine tenths where its frames are short or their checksum is weak).",
    ),
    FindingCode(
        "nothing-holds",
        "line",
        "Hardly a byte belongs to a frame, from the first one on, and yet the same sequences come again and again, as in a conversation.",
        "Less than a fifth of all bytes in frames, many different values, and sequences of six bytes that repeat.",
    ),
    FindingCode(
        "begins-hold",
        "line",
        "Hardly a byte belongs to a frame, and yet frames begin as they should, again and again: the rate is right.",
        "Twenty beginnings and more of frames of one protocol, with header, id and command, in three tenths of the bytes.",
    ),
    FindingCode(
        "bits-of-another-rate",
        "line",
        "The line changes its level only every few bits of the receiver: who speaks runs slower.",
        "Of bytes that are no frame nearly all begin with a low of two bits or more, in multiples of one length.",
    ),
)

FRAMES: Final = 5

EXPLAINED, EXPLAINED_WEAK = 0.6, 0.9
"""Part of the unclaimed bytes that another protocol must explain."""

WEAK: Final = 6
"""Frames shorter than that hold by chance now and then."""

LEAST: Final = 100
"""Bytes that no protocol explains; of fewer nothing can be said."""

HELD: Final = 0.2
"""Part of the bytes that holds by chance, at most."""

VALUES: Final = 4
"""Different values: a line that is stuck gives one or two."""

NONE: Final = 0.01
PLENTY: Final = 500
"""Part of so many bytes that hold: noise that takes all frames from the first one on is no noise."""

RATES: Final = (
    1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200, 230400, 250000, 460800, 500000, 921600,
    1000000,
)  # fmt: skip
"""Rates in use; those of the protocols are added."""


def two_protocols(case: Case) -> Iterator[Finding]:
    """Say once of a bus that two protocols hold on it."""
    ledger = case.ledger
    if not ledger.is_shared or not case.speaks_first or not ledger.frames:
        return
    yield Finding(
        "two-protocols",
        None,
        case.first_ns,
        case.last_ns,
        ledger.frames,
        f"{ledger.frames} frames are {case.protocol.name}, others on the same line are not",
        (Place(0, 1, case.first_ns, f"{case.protocol.name} among others"),),
        brief="frames of two protocols on one line",
    )


def foreign_frames(case: Case) -> Iterator[Finding]:
    """Look whether another protocol explains what is unclaimed."""
    if case.ledger.is_shared:
        return
    runs = [run for run in case.ledger.unclaimed.runs if len(run.data) >= 3]
    size = sum(len(run.data) for run in runs)
    if size < 3 * FRAMES:
        return
    best: tuple[float, BusProtocol, list[tuple[int, int]]] | None = None
    data = b"".join(run.data for run in runs)
    cuts = np.cumsum([len(run.data) for run in runs])[:-1].tolist()
    for name in PROTOCOLS.built_in:
        protocol = PROTOCOLS[name]
        if protocol.name == case.protocol.name:
            continue
        spans = spans_in(protocol, data, cuts)
        covered = sum(b - a for a, b in spans) / size
        mean = covered * size / max(len(spans), 1)
        enough = EXPLAINED_WEAK if mean < WEAK else EXPLAINED
        if len(spans) >= FRAMES and covered >= enough and (best is None or covered > best[0]):
            best = covered, protocol, spans
    if best is None:
        return
    covered, protocol, spans = best
    starts = np.cumsum([0, *(len(run.data) for run in runs)])
    places = []
    for a, b in spans[:3]:
        nth = int(np.searchsorted(starts, a, "right")) - 1
        at = runs[nth].at + a - int(starts[nth])
        places.append(Place(at, b - a, runs[nth].t_ns, f"a frame of {protocol.name}"))
    yield Finding(
        "foreign-frames",
        None,
        runs[0].t_ns,
        runs[-1].t_ns,
        len(spans),
        f"{100 * covered:.0f} % of the {size} bytes that no {case.protocol.name} frame claims are "
        f"{len(spans)} frames of {protocol.name}",
        tuple(places),
        strength=min(0.6 + len(spans) / 50, 1.0),
        brief=f"frames of {protocol.name} between those of {case.protocol.name}",
    )


def nothing_holds(case: Case) -> Iterator[Finding]:
    """Look whether this is a conversation that was read at a wrong rate."""
    total, head = case.ledger.bytes, case.ledger.head
    lost = int(case.line["gap_bytes"].sum())
    # a line that is held for long behind sound talk has no frame there, and no conversation either
    talked = total - case.held_bytes
    if total < LEAST or total - lost > HELD * talked or case.ledger.is_shared:
        return
    values = Counter(head)
    if len(values) < VALUES:
        return
    again = repeated(head)
    slower = _slower(case, head)
    # bits that a wrong rate cuts anew each time repeat little, but nothing ever holds by them
    if again < REPEATS and slower is None and (total - lost > NONE * total or total < PLENTY):
        return
    t = case.line["t_first"].min(), case.line["t_last"].max()
    place = Place(0, min(total, 64), int(t[0]), "no frame")
    rate = case.baud
    yield Finding(
        "nothing-holds",
        None,
        int(t[0]),
        int(t[1]),
        lost,
        f"{100 * (1 - lost / total):.1f} % of {total} bytes are in frames, and {100 * again:.0f} % "
        f"of their sequences of {SEQUENCE} come again",
        (place,),
        strength=min(0.6 + again, 1.0),
        brief=f"nothing holds at {rate} baud",
    )
    begun = most_begun(head)
    if begun is not None:
        yield Finding(
            "begins-hold",
            None,
            int(t[0]),
            int(t[1]),
            begun.n,
            str(begun),
            (place,),
            brief="frames begin well, and do not end so",
        )
    elif slower is not None:
        times, told = slower
        yield Finding(
            "bits-of-another-rate",
            None,
            int(t[0]),
            int(t[1]),
            lost,
            f"the line changes every {times:.1f} bits of {rate} baud or more: it runs at about {told}",
            (place,),
            brief=f"the line runs at about {told} baud",
            values=(("baud", told),),
        )


def _slower(case: Case, data: bytes) -> tuple[float, int] | None:
    """Return how many times slower the line is, and the rate; None where it is not."""
    lows = Counter(first_low(data))
    total = sum(lows.values())
    if total < LEAST // 2 or lows[1] > 0.05 * total:
        return None
    times = next(n for n in sorted(lows) if sum(lows[k] for k in lows if k <= n) > 0.05 * total)
    known = sorted({*RATES, *(b for name in PROTOCOLS.built_in for b in PROTOCOLS[name].bauds)})
    return times, min(known, key=lambda rate: abs(rate * times / case.baud - 1))


RULES: Final[tuple[Rule, ...]] = (two_protocols, foreign_frames, nothing_holds)
"""The rules of this file."""
