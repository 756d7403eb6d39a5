"""The terminal table: a line a frame or gap, then the summary. Colour only on a terminal."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any, Final, TextIO

from rich.console import Console
from rich.style import Style

from sniffer.model import (
    NOT_EXPECTED,
    NS,
    OK,
    OUTCOMES,
    RESPONSE,
    WHOLE,
    Batch,
    Chunk,
    Clock,
    Severity,
)
from sniffer.protocols.base import BusProtocol
from sniffer.registers import Register
from sniffer.rows import frame_row
from sniffer.sinks.report import print_summary
from sniffer.summary import Summary

WIDE: Final = 120
"""From this width on the table has a column for the bus and one for the bytes."""

_STYLES: Final = {
    "error": Style(color="red"),
    "warn": Style(color="yellow"),
    "note": Style(color="cyan"),
    "request": Style(),
    "response": Style(color="green"),
    "head": Style(bold=True),
}


def short_value(register: Register, raw: int, value: float) -> str:
    """Return a register value as the table shows it: with its unit, its name, or plainly."""
    names = register.names(raw)
    if names is not None:
        return ",".join(names) or "none" if isinstance(names, list) else names
    if value != value:  # NaN: nothing in units
        return f"raw {raw}"
    if register.unit:
        return (
            f"{value:.4g} {register.unit}" if abs(value) < 1000 else f"{value:.0f} {register.unit}"
        )
    return f"{value:g}"


def fit(text: str, width: int) -> str:
    """Cut or pad to a width."""
    return text.ljust(width) if len(text) <= width else text[: width - 1] + "…"


class TextSink:
    """Writes to a stream; ``color`` None asks the stream whether it is a terminal."""

    def __init__(
        self, stream: TextIO, *, width: int | None = None, color: bool | None = None
    ) -> None:
        self._console = Console(file=stream, force_terminal=color, width=width, highlight=False)
        self._stream = stream
        self._color = self._console.is_terminal and not self._console.no_color
        self._width = self._console.width
        self._summary = Summary()
        self._headed = False
        self._day = ""

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Write a line for each frame and gap of the batch, in wire order."""
        self._summary.add(bus, protocol, batch)
        lines: list[tuple[int, str]] = []
        verdicts = _verdicts(batch)
        edges = _edges(batch)
        for i, start in enumerate(batch.frames.start.tolist()):
            lines.append((start, self._frame(bus, protocol, batch, i, edges, verdicts[i])))
        for g in batch.gaps:
            raw = batch.data[g.start : g.start + g.length]
            lines.append((g.start, self._gap(bus, batch, g.t_ns, g.reason, raw, g.detail)))
        lines.sort(key=lambda e: e[0])
        if not lines:
            return
        if not self._headed:
            self._headed = True
            self._stream.write(self._paint("head", self._line(HEAD, bus="bus")) + "\n")
        self._stream.write("\n".join(text for _, text in lines) + "\n")

    def close(self) -> None:
        """Write the summary."""
        print_summary(self._summary, self._console)
        self._stream.flush()

    def _frame(
        self,
        bus: str,
        protocol: BusProtocol,
        batch: Batch,
        i: int,
        edges: list[int],
        verdict: tuple[str, str, str],
    ) -> str:
        f = batch.frames
        values = range(edges[i], edges[i + 1])
        response = int(f.kind[i]) == RESPONSE
        servo = int(f.servo_id[i])
        took, word, style = verdict
        cells = (
            self._time(batch, int(f.t_end[i])),
            str(servo) if servo >= 0 else "-",
            "<" if response else ">",
            protocol.op_name(int(f.op[i])),
            self._values(protocol, batch, i, values),
            took,
            word,
        )
        start = int(f.start[i])
        raw = batch.data[start : start + int(f.length[i])]
        return self._paint(
            style or ("response" if response else "request"), self._line(cells, bus=bus, raw=raw)
        )

    def _gap(self, bus: str, batch: Batch, t_ns: int, reason: str, raw: bytes, detail: Any) -> str:
        if detail.get("blank"):
            word, style = "", "request"
        else:
            word = "bad checksum" if "checksum_expected" in detail else reason.replace("_", " ")
            style = "warn" if reason == "noise" else "error"
        told = ""
        if "checksum_expected" in detail:
            want, got = detail["checksum_expected"], detail["checksum_got"]
            told = f"sum {got:02X}, not {want:02X}: "
        cells = (self._time(batch, t_ns), "", "!", reason, told + raw.hex(" ").upper(), "", word)
        return self._paint(style, self._line(cells, bus=bus, raw=raw))

    def _values(self, protocol: BusProtocol, batch: Batch, i: int, values: range) -> str:
        f, v = batch.frames, batch.values
        told: list[str] = []
        own = int(f.servo_id[i])
        for k in values:
            register = protocol.registers[int(v.register[k])]
            who = int(v.servo_id[k])
            text = short_value(register, int(v.raw[k]), float(v.value[k]))
            if int(v.part[k]) != WHOLE:
                text = f"raw {int(v.raw[k])} (part)"
            name = register.name.removeprefix("present_")
            told.append(f"{who}: {text}" if who != own else f"{name} {text}")
        if told and own != (who := int(v.servo_id[values[0]])) and who >= 0:
            name = protocol.registers[int(v.register[values[0]])].name
            return f"{name} " + ", ".join(told)
        status = int(f.status[i])
        if status > 0:
            told.insert(0, "+".join(protocol.status_names(status)).replace("_", " "))
        if told:
            return ", ".join(told)
        fields = frame_row(batch, protocol, "", i, values).fields
        return ", ".join(_plainly(k, x) for k, x in fields.items() if x not in ("", None))

    def _time(self, batch: Batch, t_ns: int) -> str:
        digits = 6 if self._width >= WIDE else 3
        if batch.clock == Clock.NONE:
            return f"{t_ns / NS:.6f}".rjust(9 + digits)
        moment = datetime.datetime.fromtimestamp(t_ns // NS, datetime.UTC)
        return f"{moment:%H:%M:%S}.{t_ns % NS // 10 ** (9 - digits):0{digits}d}"

    def _line(self, cells: Sequence[str], *, bus: str, raw: bytes | None = None) -> str:
        time, servo, kind, op, values, took, verdict = cells
        if self._width < WIDE:
            # one column says both: how long the reply took, or what is wrong with it
            told = f"{took} ms" if verdict == "ok" and took else verdict
            left = [fit(time, 12), servo.rjust(3), kind, fit(op, 15)]
            room = max(self._width - sum(len(x) + 1 for x in left) - 14, 12)
            return " ".join([*left, fit(values, room), fit(told, 13)]).rstrip()
        left = [fit(time, 15), fit(bus, 6), servo.rjust(3), kind, fit(op, 20)]
        right = [took.rjust(8), fit(verdict, 14)]
        room = self._width - sum(len(x) + 1 for x in [*left, *right]) - 1
        bytes_width = max(24, (room - 40) // 2)
        shown = raw.hex(" ").upper() if raw is not None else "bytes"
        middle = [fit(values, room - bytes_width - 1), fit(shown, bytes_width)]
        return " ".join([*left, *middle, *right]).rstrip()

    def _paint(self, style: str, text: str) -> str:
        if not self._color:
            return text
        return _STYLES[style].render(
            text, color_system=None if not self._color else _system(self._console)
        )


HEAD: Final = ("time", "id", " ", "command", "values", "reply ms", "verdict")
"""Titles of the columns."""


def _system(console: Console) -> Any:
    return console._color_system  # noqa: SLF001 - rich offers no public way to the enumeration


def _plainly(key: str, value: Any) -> str:
    if isinstance(value, dict):
        if "names" in value:
            return f"{key} {'+'.join(map(str, value['names'])) or 'none'}"
        return f"{key} {value.get('name', value.get('value', value.get('raw', value)))}"
    return f"{key} {value}"


def _edges(batch: Batch) -> list[int]:
    import numpy as np

    edges: list[int] = np.searchsorted(batch.values.row, np.arange(len(batch.frames) + 1)).tolist()
    return edges


def _verdicts(batch: Batch) -> list[tuple[str, str, str]]:
    """Return for each frame the response time, the verdict, and the style of its line."""
    out = [("", "", "")] * len(batch.frames)
    t = batch.transactions
    late = {a.evidence[0][0] for a in batch.anomalies if a.code == "late-response"}
    for q, r, outcome, took in zip(
        *(c.tolist() for c in (t.request, t.response, t.outcome, t.response_time_ns)), strict=True
    ):
        word = OUTCOMES[outcome].replace("_", " ")
        at = r if r >= 0 else q
        shown = f"{took / 1e6:.2f}" if took >= 0 else ""
        if outcome == OK:
            slow = q >= 0 and batch.base + int(batch.frames.start[q]) in late
            out[at] = (shown, "late" if slow else "ok", "warn" if slow else "")
        elif outcome != NOT_EXPECTED:
            out[at] = (shown, word, "error")
    marks = {a.evidence[0][0]: a for a in batch.anomalies if a.group in ("protocol", "device")}
    for i, start in enumerate((batch.frames.start + batch.base).tolist()):
        found = marks.get(start)
        if found is not None and found.severity > Severity.NOTE:
            took_, word_, _ = out[i]
            code = found.code.removeprefix("device-").replace("-", " ")
            out[i] = (took_, code if word_ in ("", "ok") else word_, found.severity.name.lower())
    return out
