"""A line of the list in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.found import CODES
from sniffer.ground.codes import NO_RESPONSE, OK, OUTCOMES, RESPONSE
from sniffer.ground.model import NS, Severity
from sniffer.ground.wording import plain, sums_in_words
from sniffer.inside.columns import GAP, NO_OUTCOME
from sniffer.sinks.words import took_in_words, values_in_words

if TYPE_CHECKING:
    from sniffer.ground.model import I64
    from sniffer.inside.index import CaptureIndex
    from sniffer.inside.pages import Page

TIMES: Final = ("time", "delta", "since mark")
"""How the time of a line is told: of the day, since the line above it, since the last mark."""

DELTA: Final = TIMES.index("delta")


@dataclass(frozen=True, slots=True)
class LineWords:
    """The cells of a line; ``severity`` is a severity + 1, 0 for none."""

    t_ns: int
    bus: str
    offset: int
    servo: str
    kind: str
    op: str
    values: str
    verdict: str
    severity: int


def line_words(index: CaptureIndex, number: int, *, exchange: bool = False) -> LineWords:
    """Return the cells of a line; ``exchange``: with what became of the request."""
    one = index.lines[number]
    page = index.pages.get(int(one["page"]))
    servo, kind = int(one["servo"]), int(one["kind"])
    partner = int(one["partner"]) if exchange else -1
    severity = int(one["severity"])
    values = stated(page, kind, int(one["row"]))
    became = _verdict(index, number)
    if partner >= 0:
        other = index.lines[partner]
        severity = max(severity, int(other["severity"]))
        there = index.pages.get(int(other["page"]))
        answer = stated(there, int(other["kind"]), int(other["row"]))
        writes = bool((page.batch.values.row == int(one["row"])).any())
        values = both(values, answer, writes=writes)
        became = _verdict(index, partner) or became
    return LineWords(
        int(one["t"]),
        plain(index.buses[int(one["bus"])]),
        int(one["at"]),
        index.names.label(index.buses[int(one["bus"])], servo) if servo >= 0 else "-",
        "!" if kind == GAP else "<" if kind == RESPONSE else ">",
        index.ops[int(one["op"])],
        values,
        became,
        severity,
    )


def both(asked: str, answer: str, *, writes: bool) -> str:
    """Return what an exchange states: what was read says more than that it was asked for."""
    return " → ".join(p for p in (asked, answer) if p) if writes else answer or asked


def stated(page: Page, kind: int, row: int) -> str:
    """Return what a frame states, or the bytes that are none."""
    batch = page.batch
    if kind == GAP:
        gap = batch.gaps[row]
        detail = gap.detail
        raw = batch.data[gap.start : gap.start + min(gap.length, 16)].hex(" ").upper()
        sums = ""
        if "checksum_expected" in detail:
            told = sums_in_words(detail["checksum_got"], detail["checksum_expected"])
            sums = f"sum {told}: "
        return sums + raw
    values = page.batch.values.row
    first, last = np.searchsorted(values, (row, row + 1)).tolist()
    whose = f"{page.protocol.name}: " if batch.is_shared else ""
    return whose + values_in_words(page.protocol, batch, row, range(first, last))


def _verdict(index: CaptureIndex, number: int) -> str:
    """Return how long an answer took, or what is wrong."""
    one = index.lines[number]
    if int(one["kind"]) == GAP:
        return gap_verdict(index.pages.get(int(one["page"])), int(one["row"]))
    severity, outcome = int(one["severity"]), int(one["outcome"])
    codes = codes_of(index, number) if severity > Severity.WARN else ()
    return verdict(severity, outcome, int(one["took"]), int(one["spread"]), *codes[:1])


def gap_verdict(page: Page, row: int) -> str:
    """Return why bytes are no frame; empty where they only fill a line."""
    gap = page.batch.gaps[row]
    if gap.detail.get("blank"):
        return ""
    sums = "checksum_expected" in gap.detail
    return "bad checksum" if sums else gap.reason.replace("_", " ")


def verdict(severity: int, outcome: int, took: int, spread: int, code: str = "") -> str:
    """Return how long the answer of a frame took, or what is wrong: ``code`` is the worst of it."""
    if outcome not in (OK, NO_OUTCOME, NO_RESPONSE):
        return OUTCOMES[outcome].replace("_", " ")
    if severity > Severity.WARN and code:
        return code.removeprefix("device-").replace("-", " ")
    if outcome == NO_RESPONSE:
        return "no response"
    return took_in_words(took, spread, "") if took >= 0 else ""


def codes_of(index: CaptureIndex, number: int) -> list[str]:
    """Return the codes of what was found in a line, the worst first."""
    found = index.found
    mine = found[np.flatnonzero(found["line"] == number)]
    order = np.argsort(-mine["severity"].astype(np.int64), kind="stable")
    return [CODES[c] for c in mine["code"][order].tolist()]


def worst_codes(index: CaptureIndex, numbers: I64) -> dict[int, str]:
    """Return the worst code of each of some lines in which something was found."""
    found = index.found
    if not len(numbers) or not len(found):
        return {}
    mine = found[(found["line"] >= numbers.min()) & (found["line"] <= numbers.max())]
    # the worst is put down last, and of equals the first one
    order = np.lexsort((-np.arange(len(mine)), mine["severity"]))
    lines, codes = mine["line"][order].tolist(), mine["code"][order].tolist()
    return {line: CODES[code] for line, code in zip(lines, codes, strict=True)}


def since(ns: int) -> str:
    """Return a difference in seconds, with its sign where it is negative."""
    return f"{ns / NS:+.6f}" if ns < 0 else f"{ns / NS:.6f}"
