"""A line that something holds: low for long, one value over and over, or falling all the time."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.case import BUCKET_NS
from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.hit import torn_answers
from sniffer.diagnosis.ledger.damage import HELD, IN_IDLE, IN_REPLY, REST, STRAY
from sniffer.diagnosis.model import Finding, Place
from sniffer.diagnosis.physics.uart import FALLS
from sniffer.ground.medians import median, quantile
from sniffer.ground.model import MS, NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "held-low",
        "The line falls low, and nobody says anything for long: a byte of 00, then silence.",
        "At least twice a 00 that no frame claims, behind which it is silent for longer than the controller ever is (in half of the cases at least no answer is cut, or all are and it never waits for one so long, and half of what is torn beside a servo that alone is hit are these), or stray bytes that are nearly all 00 and breaks.",
    ),
    FindingCode(
        "held-value",
        "One value is heard over and over: the line is held at a level.",
        "Six bytes or more of one value in a row that no frame claims, sixteen in all.",
    ),
    FindingCode(
        "line-babbles",
        "The line falls all the time, for moments, and hardly a frame gets by meanwhile, or the falls begin and end at once.",
        "Quarters of a second with 120 bytes and more that are short falls of an idle line, half of what is no frame at least, which hold nearly all of them, with hardly any between, and in which few frames get by, or beside which there are none at all; without a clock: rows of sixteen bytes and more, nearly all ones.",
    ),
)

TWICE: Final = 2

LONG_NS: Final = 20_000_000
"""A shorter silence is a controller's that waits for an answer."""

LONGER: Final = 1.5
"""How many times the controller's own pauses a silence must be."""

FAILED: Final = 20
MOST: Final = 0.9
"""Answers that failed from which on it is known how long the controller waits behind such, and the part
of them behind which it does not wait longer."""

NEARLY: Final = 0.7
"""Part of the stray bytes that must be 00."""

BYTES: Final = 16
"""Bytes in all of one value, or in a row of a babbling line."""

MANY: Final = 64
"""Bytes of FF that are too many for short falls of the line."""

STOPS: Final = 0.9
"""Part of the usual frames that may get by in a quarter second in which the line babbles."""

DENSE: Final = 120
"""Falls in a quarter second of a line that babbles: noise and sparks have tens."""

FULL: Final = 60
SOME: Final = 25
"""Falls in a quarter second that it begins or ends in."""

OFTEN: Final = 8
SHARP: Final = 0.01
SHARE: Final = 0.5
"""Part of what is no frame that is short falls where hardly a frame gets by: of frames torn some are left."""

PURE: Final = 0.9
"""Quarters of a second that are full, and part of the falls elsewhere, where it does not matter
that frames get by, as short ones of a slow loop do: what begins and ends so has a switch. Most falls
stand in rows that are nothing else: frames that nobody knows, or that run together, have some."""

NEARLY_ALL: Final = 0.95
"""Part of all falls that must be in such moments: it babbles, or it is well."""

FADES: Final = 5
FADING: Final = 0.1
"""Quarters of a second with some falls, apart from those that are full of them, and how many there
may be for each of those: what comes with the motors comes in every strength."""

ONES: Final = 0.8
"""Part of the bits that are ones: in frames half of them are."""


def held_low(case: Case) -> Iterator[Finding]:
    """Find moments in which the line was low for long."""
    zeros = [d for d in case.damages if d.got and d.got[-1] == 0 and d.length <= len(d.got)]
    usual = case.ledger.exchanges.idle.at(0, 0.98)
    least = max(LONG_NS, LONGER * (usual.high if usual is not None else LONG_NS))
    # who rests already is kept from nothing: a supply that is switched on makes a pulse, too
    least += case.latency_ns
    silent = [d for d in zeros if d.until_ns > least >= d.since_ns] if case.has_clock else []
    idle, longer = sum(d.turn == IN_IDLE for d in silent), _in_vain(case)
    is_sure = all(d.turn == IN_IDLE or d.until_ns > longer for d in silent)
    if idle < len(silent) / 2 and not (is_sure and 2 * len(silent) >= _torn_of_nobody(case)):
        silent = []  # torn answers end as they may, and a controller waits behind them
    alone = [d for d in zeros if d.got == b"\0" and d.turn == IN_IDLE]
    strays = sum(d.turn == IN_IDLE for d in case.damages)
    breaks = int(case.line_errors["breaks"].sum()) or case.count("line-break")
    lone = alone if len(alone) >= NEARLY * strays and breaks >= TWICE else []
    found = sorted({d.at: d for d in (*silent, *lone)}.values(), key=lambda d: d.at)
    if len(found) < TWICE:
        return
    longest = max((d.until_ns for d in silent), default=0)
    pauses = (
        f"silent for up to {longest / MS:.0f} ms behind {len(silent)} of them" if silent else ""
    )
    lows = f"{breaks} breaks were told" if breaks else ""
    yield _finding(
        "held-low",
        found,
        f"{len(found)} times a 00 that is nobody's: " + ", ".join(filter(None, (pauses, lows))),
        f"the line falls low {len(found)} times",
        min(0.4 + 0.15 * len(silent) + 0.1 * len(lone), 1.0),
        max(d.until_ns for d in found),
    )


def _torn_of_nobody(case: Case) -> int:
    """Return how many places are torn, apart from the answers of servos that alone are hit."""
    hit = torn_answers(case)
    return sum(d.turn not in (IN_REPLY, REST) or d.servo_id not in hit for d in case.damages)


def _in_vain(case: Case) -> float:
    """Return for how long the controller hardly ever waits behind answers that failed."""
    waits = [f.wait_ns for f in case.ledger.exchanges.failed]
    if len(waits) < FAILED:
        return math.inf
    return LONGER * float(quantile(waits, MOST)) + case.latency_ns


def held_value(case: Case) -> Iterator[Finding]:
    """Find rows of one value."""
    held = [d for d in case.damages if d.turn == HELD]
    size = sum(d.length for d in held)
    low = sum(d.length for d in held if d.got[0] == 0)
    # short falls of an idle line are FF, too: a row of them is no proof
    if low < BYTES and (size < MANY or size < NEARLY * sum(d.length for d in case.damages)):
        return
    values = sorted({f"{d.got[0]:02X}" for d in held})
    yield _finding(
        "held-value",
        held,
        f"{size} bytes of {', '.join(values)} in {len(held)} rows",
        f"{size} bytes of {', '.join(values)}",
        min(0.5 + size / 200, 1.0),
    )


def babbles(case: Case) -> Iterator[Finding]:
    """Find moments in which the line falls all the time."""
    if case.has_clock:
        rows, shown = _falls(case)
    else:
        rows = [d for d in case.damages if d.length >= BYTES and d.turn != HELD]
        rows = [d for d in rows if _ones(d) >= ONES]
        shown = f"{len(rows)} rows of {BYTES} bytes and more, and no frame in them"
    if len(rows) < TWICE:
        return
    size = sum(d.length for d in rows)
    yield _finding(
        "line-babbles",
        rows,
        f"{size} bytes that are short falls of the line: {shown}",
        f"the line babbles {len(rows)} times",
        min(0.5 + size / 400, 1.0),
    )


def _falls(case: Case) -> tuple[Sequence[Damage], str]:
    """Return what nobody said in quarters of a second that are full of it, where those hold all.

    What falls that often leaves no frame alone; sparks and noise let most of them by, and come in
    quieter moments, too.
    """
    line, traffic = case.line, case.traffic
    count = len(line["bucket"])
    frames, falls, said = np.zeros(count), np.zeros(count), np.zeros(count)
    where = np.searchsorted(line["bucket"], traffic["bucket"])
    known = where < count
    np.add.at(frames, where[known], traffic["frames"][known])
    torn = [d for d in case.damages if d.got and d.turn != HELD]
    at = np.searchsorted(line["bucket"], np.array([d.t_ns // BUCKET_NS for d in torn], np.int64))
    at = np.minimum(at, count - 1)
    short = [_more_falls(d) * d.length / len(d.got) for d in torn]
    np.add.at(falls, at, short)
    np.add.at(said, at, [d.length for d in torn])
    if not (frames > 0).any():
        return (), ""
    usual = float(median(frames[frames > 0]))
    dense = falls >= DENSE
    full = falls >= max(FULL, float(median(falls[dense])) / 2 if dense.any() else FULL)
    if dense.sum() < TWICE or falls[falls >= SOME].sum() < NEARLY_ALL * falls.sum():
        return (), ""
    let_by = float(frames[full].mean())
    beside = np.convolve(full, np.ones(3, np.int64), "same") > 0
    # frames that nobody recognises are full of 00 and FF, and of other bytes
    few = let_by <= STOPS * usual and falls[full].sum() >= SHARE * said[full].sum()
    rows_of = sum(n for n, d in zip(short, torn, strict=True) if n >= max(PURE * d.length, STRAY))
    sharp = full.sum() >= OFTEN and falls[~beside].sum() <= SHARP * falls.sum()
    sharp = sharp and 2 * rows_of >= falls.sum()  # nor is it a stray at each turn
    if not (few or sharp) or (~beside & (falls >= FADES)).sum() > FADING * full.sum():
        return (), ""
    rows = [d for d, k in zip(torn, at.tolist(), strict=True) if full[k]]
    per_s = falls[full].mean() * NS / BUCKET_NS
    there = "and few frames there" if few else "and none elsewhere"
    return rows, f"{per_s:.0f} a second in {full.sum()} quarters of a second, {there}"


def _more_falls(d: Damage) -> int:
    """Return how many short falls stand in a place beyond those that are bytes of a frame.

    Frames have 00 and FF of their own, packets of goals and states by the dozen: a torn one is not
    a line that falls.
    """
    falls, own = (sum(byte in FALLS for byte in data) for data in (d.got, d.expected))
    return max(falls - own, 0)


def _ones(d: Damage) -> float:
    return sum(byte.bit_count() for byte in d.got) / (8 * len(d.got))


def _finding(
    code: str, places: Sequence[Damage], what: str, brief: str, strength: float, more_ns: int = 0
) -> Finding:
    return Finding(
        code,
        None,
        places[0].t_ns,
        places[-1].t_ns + max(more_ns, 0),
        len(places),
        what,
        tuple(Place(d.at, d.length, d.t_ns, "the line is held") for d in places[:3]),
        strength=strength,
        brief=brief,
        episodes=tuple((d.t_ns, d.t_ns + max(d.until_ns, 0)) for d in places),
    )


RULES: Final[tuple[Rule, ...]] = (held_low, held_value, babbles)
"""The rules of this area."""
