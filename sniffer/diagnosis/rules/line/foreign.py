"""What is said on the line by another protocol."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.holding import spans_in
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.protocols.base import BusProtocol

KEEP_APART: Final = "Both are decoded. Make sure that neither's servos obey the other's bytes."
DECODE_AS_THAT: Final = "Decode it as the protocol that is spoken: `--protocol` with its name."

FINDINGS: Final = (
    FindingCode(
        "two-protocols",
        "Frames of two protocols hold on one line.",
        "The decoder explains the bytes by two protocols, each byte by one of them.",
        remedy=KEEP_APART,
        settle=KEEP_APART,
    ),
    FindingCode(
        "foreign-frames",
        "What no frame of the protocol claims holds as frames of another one.",
        "Five frames or more of another protocol, which explain three fifths of the unclaimed runs (nine tenths where its frames are short or their checksum is weak).",
    ),
    FindingCode(
        "other-protocol",
        "Hardly a byte is a frame of the protocol that the capture is read by, and nearly all are frames of another.",
        "As `foreign-frames`, with less than a fiftieth of all bytes in frames of the protocol.",
        remedy=DECODE_AS_THAT,
        settle=DECODE_AS_THAT,
    ),
)

FRAMES: Final = 5

EXPLAINED, EXPLAINED_WEAK = 0.6, 0.9
"""Part of the unclaimed bytes that another protocol must explain."""

WEAK: Final = 6
"""Frames shorter than that hold by chance now and then."""

CHANCE: Final = 0.02
"""Part of the bytes that are frames of a protocol which nobody speaks, at most: wCK's, whose checksum
has seven bits, are 0.003 of what mightyZAP says in a sample, 0.013 of what RS30x says."""


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
    ours = case.protocol.name
    held = case.ledger.bytes - int(case.line["gap_bytes"].sum())
    alone = held < CHANCE * case.ledger.bytes
    yield Finding(
        "other-protocol" if alone else "foreign-frames",
        None,
        runs[0].t_ns,
        runs[-1].t_ns,
        len(spans),
        f"{100 * covered:.0f} % of the {size} bytes that no {ours} frame claims are "
        f"{len(spans)} frames of {protocol.name}",
        tuple(places),
        strength=min(0.6 + len(spans) / 50, 1.0),
        brief=f"{protocol.name} is spoken, not {ours}"
        if alone
        else f"frames of {protocol.name} between those of {ours}",
    )


RULES: Final[tuple[Rule, ...]] = (two_protocols, foreign_frames)
"""The rules of this file."""
