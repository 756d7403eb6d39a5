"""What the tap itself met: line errors, lost bytes, a port that went away. Codes and their rule."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.codes import NEVER, REQUEST
from sniffer.ground.memory import Remembering
from sniffer.ground.model import NS, Anomaly, MarkKind, Remark, Severity

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.ground.model import Batch, Cut

NOTE, WARN, ERROR = Severity.NOTE, Severity.WARN, Severity.ERROR

TAP_CODES: Final[dict[str, tuple[str, Severity, str, str, str]]] = {
    "line-error": (
        "framing",
        ERROR,
        "The UART of the tap found no stop bit (or a wrong parity) where one should be: a byte of the region is not what was sent.",
        "A wrong baud rate, two senders at once, noise, a bad ground, or a driver that lets the line go too early.",
        "If it is everywhere, check the baud rate; if it stands at the turn from request to reply, the direction switching. USB adapters tell the packet, not the byte.",
    ),
    "line-break": (
        "framing",
        WARN,
        "The line was held low for longer than a byte.",
        "A bus without power or bias, a short circuit, a driver that is enabled while its input is low, a controller that restarts.",
        "Look at the line with an oscilloscope; check power and bias resistors.",
    ),
    "bytes-lost": (
        "capture",
        ERROR,
        "Bytes were lost on the tap's side, not on the bus: the adapter or its driver had no room.",
        "An overloaded machine, a slow or shared USB port, or a UART without a buffer.",
        "Do not blame the servos for what is missing here. Give the adapter a USB port of its own, or the recording more processor time.",
    ),
    "port-lost": (
        "capture",
        ERROR,
        "The port went away while it was listened to.",
        "The adapter was unplugged, lost its power or was reset; or the far end was closed.",
        "Plug it in again: the recording goes on by itself, with the hole marked.",
    ),
    "port-back": (
        "capture",
        NOTE,
        "The port is back; what was said meanwhile is not in the recording.",
        "The adapter was plugged in again.",
        "Nothing to do; frames and exchanges are not paired across the hole.",
    ),
    "not-decoded": (
        "capture",
        WARN,
        "Bytes were recorded but not decoded while recording.",
        "The machine was too slow for the traffic, or the protocol was not known yet.",
        "Decode the recording again (`sniffer decode`, `sniffer replay --redecode`): every byte is in it.",
    ),
    "rate-found": (
        "capture",
        NOTE,
        "From here on the port listens at this rate: it was looked for, because nobody had said which it is.",
        "What was heard before, at other rates, says nothing of the bus; it is recorded and not decoded.",
        "Nothing to do; PORT@BAUD says the rate from the beginning.",
    ),
    "capture-end": (
        "capture",
        NOTE,
        "The capture ends in the middle of a frame, or between a request and its answer.",
        "The tap was stopped, or the capture cut, while the bus was talking.",
        "Nothing to do.",
    ),
    "late-read": (
        "capture",
        NOTE,
        "The tap came late to the port: the bytes were there for a while before they were read and stamped.",
        "A machine that was busy, suspended or stopped; no byte is missing.",
        "The uncertainty of the times says so; give the recording more processor time.",
    ),
    "reordered": (
        "capture",
        NOTE,
        "Of two taps on one bus, bytes were put in the order that cause and effect ask for, against their time stamps.",
        "Each USB adapter delays its bytes by its own latency.",
        "Lower the latency timers (`sniffer doctor`), or use one adapter with two channels.",
    ),
}
"""Group, severity, meaning, causes, remedy of each code."""

_CODE_OF: Final[Mapping[MarkKind, str]] = {
    MarkKind.FRAMING: "line-error",
    MarkKind.PARITY: "line-error",
    MarkKind.BREAK: "line-break",
    MarkKind.OVERRUN: "bytes-lost",
    MarkKind.LOST: "port-lost",
    MarkKind.BACK: "port-back",
    MarkKind.SKIPPED: "not-decoded",
    MarkKind.REORDERED: "reordered",
    MarkKind.HELD: "late-read",
    MarkKind.TUNED: "rate-found",
}

_OFTEN: Final = frozenset(
    {MarkKind.FRAMING, MarkKind.PARITY, MarkKind.BREAK, MarkKind.REORDERED, MarkKind.HELD}
)
"""Kinds that a bad line, a slow adapter or a busy machine gives with every read."""

HELD_NS: Final = NS // 20
"""A tap that came less late is not worth a word: uncertainties tell."""

QUIET_NS: Final = NS
"""Of these kinds the first is reported, and then one a second with the count of all since."""


class TapRules(Remembering):
    """Reports what the tap remarked about its bytes."""

    LASTING = ("_told", "_since")

    def __init__(self) -> None:
        self._told: dict[MarkKind, int] = {}
        self._since: dict[MarkKind, tuple[Remark, int]] = {}
        """The last one that was not told, and how many they are with it."""

    def judge(self, batch: Batch) -> Iterator[Anomaly]:
        """Report remarks, the frequent ones not more often than once a second."""
        for r in batch.remarks:
            if r.kind not in _CODE_OF or (r.kind == MarkKind.HELD and r.count < HELD_NS):
                continue
            before = 0
            if r.kind in _OFTEN:
                told = self._told.get(r.kind)
                if told is not None and r.t_ns - told < QUIET_NS:
                    waiting = self._since.get(r.kind)
                    self._since[r.kind] = r, _times(r) + (waiting[1] if waiting else 0)
                    continue
                self._told[r.kind] = r.t_ns
                _, before = self._since.pop(r.kind, (r, 0))
            yield _reported(r, before)

    def finish(self) -> list[Anomaly]:
        """Return the reports of what came since the last ones, where it is the end."""
        waiting, self._since = self._since, {}
        return [_reported(last, count - _times(last)) for last, count in waiting.values()]


def _reported(r: Remark, before: int) -> Anomaly:
    code = _CODE_OF[r.kind]
    group, severity, *_ = TAP_CODES[code]
    text = _told(r) + (f"; {before} more since the last report" if before else "")
    return Anomaly(r.t_ns, severity, group, code, None, text, ((max(r.start, 0), r.length),))


OPEN_ENDED: Final = frozenset(
    {"no-response", "damaged-response", "idle-tail", "truncated-frame", "damaged-frame", "noise"}
)
"""Codes that say no more than that the tap was stopped, where they stand at its very end."""


TORN_OFF: Final = frozenset({MarkKind.SKIPPED, MarkKind.LOST})
"""Kinds of remarks behind which anomalies are the tap's fault."""


def without_our_fault(batch: Batch, found: list[Anomaly], tail_ns: int) -> list[Anomaly]:
    """Return the anomalies of a batch without those that only the tap is to blame for.

    Where the tap was torn off within ``tail_ns`` of the last byte, an unanswered request and half a
    frame say nothing about the bus; of what the end of the tap cut it is said once that it was cut.
    """
    for r in batch.remarks:
        if r.kind == MarkKind.SKIPPED or (
            r.kind == MarkKind.LOST and r.t_ns - _heard_ns(batch, r.start) <= tail_ns
        ):
            begins = _open_before(batch, r.start)
            found = [a for a in found if not _is_open(a, begins, r.start)]
    if batch.cut is None:
        return found
    cut = [a for a in found if _is_cut(a, batch, batch.cut)]
    if not cut:
        return found
    group, severity, *_ = TAP_CODES["capture-end"]
    text = f"the capture ends before this was over: {cut[0].detail}"
    begins = min(min(a.evidence)[0] for a in cut)
    at = (begins, batch.base + len(batch.data) - begins)
    note = Anomaly(cut[0].t_ns, severity, group, "capture-end", cut[0].servo_id, text, (at,))
    return [*(a for a in found if a not in cut), note]


def _is_cut(anomaly: Anomaly, batch: Batch, cut: Cut) -> bool:
    """Tell whether an anomaly says no more than that the capture ends here."""
    start, length = min(anomaly.evidence)
    if anomaly.code not in OPEN_ENDED:
        return False
    if anomaly.code not in ("no-response", "damaged-response"):
        return start >= cut.torn
    # Of an answer that is there, but damaged, nothing is open any more.
    behind = (g for g in batch.gaps if start + length <= batch.base + g.start < cut.torn)
    return start >= cut.asked and all(g.reason == "noise" for g in behind)


def _heard_ns(batch: Batch, place: int) -> int:
    """Return when the last byte before an offset of the stream came."""
    place -= batch.base
    ends = [(g.start + g.length, g.t_ns) for g in batch.gaps if g.start + g.length <= place]
    f = batch.frames
    before = int(np.searchsorted(f.end, place, "right")) - 1
    if before >= 0:
        ends.append((int(f.end[before]), int(f.t_end[before])))
    return max(ends)[1] if ends else 0


def _open_before(batch: Batch, place: int) -> int:
    """Return where that begins what may have been open at an offset of the stream."""
    f = batch.frames
    before = int(np.searchsorted(f.start, place - batch.base)) - 1
    if before < 0:
        return batch.base
    asks = f.kind[before] == REQUEST and f.reply[before] != NEVER
    return batch.base + int(f.start[before] if asks else f.end[before])


def _is_open(anomaly: Anomaly, begins: int, end: int) -> bool:
    return anomaly.code in OPEN_ENDED and begins <= min(anomaly.evidence)[0] < end


def _times(remark: Remark) -> int:
    return 1 if remark.kind in (MarkKind.REORDERED, MarkKind.HELD) else remark.count


def _told(r: Remark) -> str:
    errors = "error" if r.count == 1 else "errors"
    where = f"in {r.length} bytes" if r.length > 1 else "in one byte" if r.length else "hereabouts"
    match r.kind:
        case MarkKind.FRAMING:
            return f"{r.count} framing {errors} {where}"
        case MarkKind.PARITY:
            return f"{r.count} parity {errors} {where}"
        case MarkKind.BREAK:
            return f"the line was held low ({r.count} x) {where}"
        case MarkKind.OVERRUN:
            return f"the driver counts {r.count} losses {where}: bytes are missing on our side"
        case MarkKind.LOST:
            return "the port went away: waiting for it to come back"
        case MarkKind.BACK:
            return f"the port is back after {r.count / NS:.1f} s; what was said then is missing"
        case MarkKind.SKIPPED:
            return f"{r.count} bytes before this place were recorded, but not decoded"
        case MarkKind.TUNED:
            return f"listening at {r.count} bit/s from here on"
        case MarkKind.HELD:
            return f"{r.length} bytes were read up to {r.count / 1e6:.0f} ms after they came"
        case _:
            return f"{r.length} bytes moved by {r.count / 1e6:.2f} ms to where they belong"
