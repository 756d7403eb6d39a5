"""A line of the list in words."""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnostics.found import CODES
from sniffer.ground.codes import NO_RESPONSE, OK, OUTCOMES, RESPONSE
from sniffer.ground.model import NS, Severity
from sniffer.ground.wording import plain
from sniffer.inside.columns import GAP, NO_OUTCOME
from sniffer.sinks.words import took_in_words, values_in_words

if TYPE_CHECKING:
    from sniffer.inside.index import CaptureIndex
    from sniffer.inside.pages import Page

ABSOLUTE, DELTA, SINCE_MARK = range(3)
TIMES: Final = ("time", "delta", "since mark")
"""How the time of a line is told: of the day, since the line above it, since the last mark."""


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
    verdict = _verdict(index, number)
    if partner >= 0:
        other = index.lines[partner]
        severity = max(severity, int(other["severity"]))
        there = index.pages.get(int(other["page"]))
        answer = stated(there, int(other["kind"]), int(other["row"]))
        # what was read says more than that it was asked for
        writes = bool((page.batch.values.row == int(one["row"])).any())
        values = " → ".join(p for p in (values, answer) if p) if writes else answer or values
        verdict = _verdict(index, partner) or verdict
    return LineWords(
        int(one["t"]),
        plain(index.buses[int(one["bus"])]),
        int(one["at"]),
        str(servo) if servo >= 0 else "-",
        "!" if kind == GAP else "<" if kind == RESPONSE else ">",
        index.ops[int(one["op"])],
        values,
        verdict,
        severity,
    )


def stated(page: Page, kind: int, row: int) -> str:
    """Return what a frame states, or the bytes that are none."""
    batch = page.batch
    if kind == GAP:
        gap = batch.gaps[row]
        detail = gap.detail
        raw = batch.data[gap.start : gap.start + min(gap.length, 16)].hex(" ").upper()
        sums = ""
        if "checksum_expected" in detail:
            sums = f"sum {detail['checksum_got']:02X} not {detail['checksum_expected']:02X}: "
        return sums + raw
    values = page.batch.values.row
    first, last = np.searchsorted(values, (row, row + 1)).tolist()
    whose = f"{page.protocol.name}: " if batch.is_shared else ""
    return whose + values_in_words(page.protocol, batch, row, range(first, last))


def _verdict(index: CaptureIndex, number: int) -> str:
    """Return how long an answer took, or what is wrong."""
    one = index.lines[number]
    severity, outcome = int(one["severity"]), int(one["outcome"])
    if int(one["kind"]) == GAP:
        page = index.pages.get(int(one["page"]))
        gap = page.batch.gaps[int(one["row"])]
        if gap.detail.get("blank"):
            return ""
        sums = "checksum_expected" in gap.detail
        return "bad checksum" if sums else gap.reason.replace("_", " ")
    if outcome not in (OK, NO_OUTCOME, NO_RESPONSE):
        return OUTCOMES[outcome].replace("_", " ")
    if severity > Severity.WARN:
        codes = codes_of(index, number)
        if codes:
            return codes[0].removeprefix("device-").replace("-", " ")
    if outcome == NO_RESPONSE:
        return "no response"
    took = int(one["took"])
    return took_in_words(took, int(one["spread"]), "") if took >= 0 else ""


def codes_of(index: CaptureIndex, number: int) -> list[str]:
    """Return the codes of what was found in a line, the worst first."""
    found = index.found
    mine = found[np.flatnonzero(found["line"] == number)]
    order = np.argsort(-mine["severity"].astype(np.int64), kind="stable")
    return [CODES[c] for c in mine["code"][order].tolist()]


def time_of_day(t_ns: int, digits: int = 3) -> str:
    """Return a time as people read it, UTC."""
    moment = datetime.datetime.fromtimestamp(t_ns // NS, datetime.UTC)
    return f"{moment:%H:%M:%S}.{t_ns % NS // 10 ** (9 - digits):0{digits}d}"


def since(ns: int) -> str:
    """Return a difference in seconds, with its sign where it is negative."""
    return f"{ns / NS:+.6f}" if ns < 0 else f"{ns / NS:.6f}"
