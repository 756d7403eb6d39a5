"""A line that somebody holds, or that nobody does: low for long, or wandering for long."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.damage import AT_TURN, HELD, IN_IDLE
from sniffer.diagnosis.model import Finding, Place
from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "line-held-low",
        "line",
        "The line goes low while nobody speaks and stays there: one zero byte, and then nothing for long.",
        "Two zero bytes or more, each with nothing behind it for 40 ms, and hardly another stray byte.",
    ),
    FindingCode(
        "line-wanders",
        "line",
        "The level of the line wanders for many bytes in a row, as that of a line that is held and let go, or that nobody drives.",
        "Runs of 24 unclaimed bytes or more, in which two thirds have no edge or but one, 100 bytes in all.",
    ),
)

LONG_NS: Final = 40 * NS // 1000
"""Longer than any answer takes, and than most controllers wait."""

ONLY: Final = 0.7
"""Part of the stray places that must be zeros: noise gives other bytes, too."""

RUN: Final = 24
"""Bytes in a row: longer than what is left of frames that were torn once."""

FLAT: Final = 0.6
"""Part of such bytes with one edge at most; of any 256 bytes nine have so few."""

ENOUGH: Final = 100

_FLAT: Final = frozenset((0xFF00 >> k) & 0xFF for k in range(9))
"""Ones behind zeros, the first bits first, and nothing else."""


def held_low(case: Case) -> Iterator[Finding]:
    """Find where the line is low for long."""
    stray = [d for d in case.damages if d.turn in (IN_IDLE, AT_TURN, HELD)]
    zeros = [d for d in stray if d.got and not any(d.got)]
    long = [d for d in zeros if d.until_ns >= LONG_NS or d.turn == HELD]
    if len(long) < 2 or len(zeros) < ONLY * len(stray):
        return
    total_ns = sum(max(d.until_ns, 0) for d in long)
    yield Finding(
        "line-held-low",
        None,
        long[0].t_ns,
        long[-1].t_ns,
        len(long),
        f"{len(long)} times the line goes low while nobody speaks, and nothing is said for "
        f"{total_ns / NS:.2f} s behind them",
        tuple(Place(d.at, d.length, d.t_ns, "low, and then nothing") for d in long[:3]),
        strength=min(0.6 + len(long) / 10, 1.0),
        brief="the line is held low",
    )


def wanders(case: Case) -> Iterator[Finding]:
    """Find long runs of bytes with hardly an edge."""
    if case.ledger.bytes == 0 or not case.ledger.frames:
        return
    runs = [r for r in case.ledger.unclaimed.runs if len(r.data) >= RUN]
    flat = [r for r in runs if sum(b in _FLAT for b in r.data) >= FLAT * len(r.data)]
    size = sum(len(r.data) for r in flat)
    if size < ENOUGH or 2 * size < sum(len(r.data) for r in runs):
        return
    yield Finding(
        "line-wanders",
        None,
        flat[0].t_ns,
        flat[-1].t_ns,
        len(flat),
        f"{len(flat)} runs of {RUN} bytes or more, {size} in all, have hardly an edge: "
        f"{flat[0].data[:8].hex(' ').upper()} ...",
        tuple(Place(r.at, len(r.data), r.t_ns, "the line wanders") for r in flat[:3]),
        strength=min(0.7 + size / 1000, 1.0),
        brief="the line wanders",
    )


RULES: Final[tuple[Rule, ...]] = (held_low, wanders)
"""The rules of this file."""
