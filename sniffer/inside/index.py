"""The lines of a capture, made of batches as they are decoded: a sink that can be looked into.

    batches ─▶ pages (all that was decoded, put away)
            └▶ lines (65 bytes a frame or gap, in columns), findings (an anomaly each)

Lines are in the order of time, of all buses together. One thread fills it; others read.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.found import SEVERITY, Anomalies
from sniffer.decoding.called import ServoNames
from sniffer.decoding.sink import bus_of
from sniffer.ground.codes import NOT_EXPECTED, OK
from sniffer.ground.gaps import BLANK, NOISE, Gaps
from sniffer.inside.columns import ERROR, FOUND, GAP, LINE, NO_FINDING, NO_OUTCOME, WARN, Growing
from sniffer.inside.pages import LastValue, Page, Pages

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.sink import Part
    from sniffer.ground.model import I64, Batch, Chunk
    from sniffer.inside.columns import Table
    from sniffer.inside.pages import Board
    from sniffer.protocols.base import BusProtocol

TAIL: Final = 1 << 16
"""Lines in which the request of a late answer, or the evidence of an anomaly, is looked for."""

_SEVERITIES: Final = np.array(SEVERITY, np.uint8) + 1


class CaptureIndex:
    """Takes batches; ``settle`` shows what has come since.

    ``buses`` are the names of buses (with the protocol, where two share one), ``wires`` those that
    they have elsewhere, ``ops`` the commands met, ``protocols`` the protocol of each bus.
    """

    def __init__(self) -> None:
        self.names = ServoNames()
        """What servos are called."""
        self.buses: list[str] = []
        self.wires: list[str] = []
        self.protocols: list[BusProtocol] = []
        self.ops: list[str] = []
        self.pages = Pages()
        self.bytes = 0
        self.has_clock = False
        self.settled = 0
        """Lines of which is known what became of them and what was found; ``lines`` may have more
        by then."""
        self._lines = Growing(LINE)
        self._found = Growing(FOUND)
        self._changed = Growing(np.int64)
        self._lowest = 0
        self._waiting: list[tuple[int, int, Batch, Table]] = []
        self._boards: dict[int, Board] = {}
        self._op_of: dict[tuple[int, int], int] = {}
        self._op_names: dict[str, int] = {}

    @property
    def lines(self) -> Table:
        """What is there by now; rows are added behind it, and findings to its last rows."""
        return self._lines.rows

    @property
    def found(self) -> Table:
        """The anomalies that are known by now."""
        return self._found.rows

    @property
    def changed(self) -> I64:
        """From which line on each ``settle`` has changed lines or added some: only ever longer."""
        rows: I64 = self._changed.rows
        return rows

    def call(self, names: ServoNames) -> None:
        """Take what servos are called."""
        self.names = names

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Count bytes."""
        self.bytes += sum(len(chunk.data) for chunk in chunks)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Put a batch away; its lines wait for ``settle``."""
        number = self._bus(bus_of(bus, protocol, batch), bus, protocol)
        self.has_clock |= bool(batch.clock)
        board = self._boards.setdefault(number, {})
        page = self.pages.put(Page(number, protocol, batch, board))
        self._waiting.append((page, number, batch, self._table(batch, protocol, number, page)))
        self._learn(board, batch)

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Do that for what several protocols said in one pass."""
        for protocol, batch in parts:
            self.write(bus, protocol, batch)

    def close(self) -> None:
        """Show what waits."""
        self.settle()

    def discard(self) -> None:
        """Give the temporary files back: nothing is looked at any more."""
        self.pages.close()
        self._lines.close()
        self._found.close()
        self._changed.close()

    def settle(self) -> None:
        """Put the lines that wait in the order of time, and show them."""
        waiting, self._waiting = self._waiting, []
        if not waiting:
            return
        tables = [table for *_, table in waiting]
        every = np.concatenate(tables)
        # a bus keeps its own order, whatever its stamps say
        clock = np.concatenate(
            [np.maximum.accumulate(t["t"]) if len(t) else t["t"] for t in tables]
        )
        order = np.lexsort((every["at"], clock)) if len(waiting) > 1 else np.arange(len(every))
        self._lowest = first = len(self._lines)
        place = np.empty(len(every), np.int64)
        place[order] = np.arange(first, first + len(every))
        self._lines.append(every[order])
        begin = 0
        for page, number, batch, table in waiting:
            mine = place[begin : begin + len(table)]
            begin += len(table)
            rows = np.empty(len(batch.frames), np.int64)
            is_frame = table["kind"] != GAP
            rows[table["row"][is_frame]] = mine[is_frame]
            self._pair(batch, number, rows)
            self._judge(batch, number, page)
        # in this order: who judged a line before its finding came is told to judge it again
        self._changed.append([self._lowest])
        self.settled = len(self._lines)

    def line_at(self, bus: int, offset: I64 | int) -> I64:
        """Return the lines near the end that hold offsets of a bus, -1 where none does."""
        first = max(len(self._lines) - TAIL, 0)
        tail = self._lines.rows[first:]
        mine = np.flatnonzero(tail["bus"] == bus)
        wanted = np.atleast_1d(np.asarray(offset, np.int64))
        if not len(mine):
            return np.full(len(wanted), -1)
        k = np.searchsorted(tail["at"][mine], wanted, "right") - 1
        return np.where(k >= 0, mine[np.maximum(k, 0)] + first, -1)

    def _bus(self, name: str, wire: str, protocol: BusProtocol) -> int:
        if name not in self.buses:
            self.protocols.append(protocol)
            self.wires.append(wire)
            self.buses.append(name)
        return self.buses.index(name)

    def _table(self, batch: Batch, protocol: BusProtocol, bus: int, page: int) -> Table:
        """Return the lines of a batch in the order of the wire."""
        f, gaps = batch.frames, Gaps.of(batch.gaps)
        n = len(f)
        out = np.zeros(n + len(gaps), LINE)
        out["bus"], out["page"] = bus, page
        out["took"] = out["spread"] = out["partner"] = -1
        out["outcome"] = NO_OUTCOME
        frames, rest = out[:n], out[n:]
        frames["t"], frames["at"], frames["length"] = f.t_end, f.start + batch.base, f.length
        frames["row"], frames["kind"], frames["servo"] = np.arange(n), f.kind, f.servo_id
        frames["address"] = f.address
        frames["op"] = self._ops(f.op, protocol, bus)
        rest["t"], rest["at"], rest["length"] = gaps.t_ns, gaps.start + batch.base, gaps.length
        rest["row"], rest["kind"], rest["servo"] = np.arange(len(gaps)), GAP, gaps.servo_id
        rest["address"] = -1
        rest["op"] = self._op("no frame")
        rest["severity"] = np.where(
            gaps.kind == BLANK,
            NO_FINDING,
            np.where(gaps.kind == NOISE, WARN, ERROR),
        )
        return out[np.argsort(out["at"], kind="stable")] if len(gaps) else out

    def _op(self, name: str) -> int:
        if name not in self._op_names:
            self.ops.append(name)
            self._op_names[name] = len(self.ops) - 1
        return self._op_names[name]

    def _ops(self, op: I64, protocol: BusProtocol, bus: int) -> I64:
        """Return commands by the number of their names."""
        if not len(op):
            return op
        met, inverse = np.unique(op, return_inverse=True)
        for code in met.tolist():
            if (bus, code) not in self._op_of:
                self._op_of[bus, code] = self._op(protocol.op_name(code))
        return np.array([self._op_of[bus, code] for code in met.tolist()], np.int64)[inverse]

    def _pair(self, batch: Batch, bus: int, rows: I64) -> None:
        """Note down which lines are halves of one exchange, and what became of it."""
        t = batch.transactions
        if not len(t):
            return
        own = batch.rows_of(t.request)
        asked = np.where(own >= 0, rows[np.maximum(own, 0)] if len(rows) else -1, -1)
        earlier = (t.request < -1) & (own < 0)
        if earlier.any():
            told = batch.asked(t.request[earlier])
            asked[earlier] = self.line_at(bus, told.start + batch.base)
        said = np.where(t.response >= 0, rows[np.maximum(t.response, 0)] if len(rows) else -1, -1)
        self._touch(asked)
        self._touch(said)
        lines = self._lines.rows
        both = (asked >= 0) & (said >= 0)
        lines["partner"][asked[both]], lines["partner"][said[both]] = said[both], asked[both]
        lines["took"][said[both]] = t.response_time_ns[both]
        lines["spread"][said[both]] = t.uncertainty_ns[both]
        shown = np.where(said >= 0, said, asked)
        some = (shown >= 0) & (t.outcome != NOT_EXPECTED)
        lines["outcome"][shown[some]] = t.outcome[some]
        odd = shown[some & (t.outcome != OK)]
        lines["severity"][odd] = np.maximum(lines["severity"][odd], WARN)
        gone = (asked >= 0) & (t.outcome != OK) & (t.outcome != NOT_EXPECTED)
        lines["outcome"][asked[gone]] = t.outcome[gone]

    def _judge(self, batch: Batch, bus: int, page: int) -> None:
        """Note down what was found, and colour the lines it was found in."""
        if not len(batch.anomalies):
            return
        told = Anomalies.of(batch.anomalies)
        out = np.zeros(len(told), FOUND)
        out["t"], out["page"], out["row"] = told.t_ns, page, np.arange(len(told))
        out["code"], out["servo"] = told.code, told.servo_id
        out["severity"] = _SEVERITIES[told.code]
        out["line"] = line = self.line_at(bus, told.at)
        self._found.append(out)
        known = line >= 0
        lines = self._lines.rows
        np.maximum.at(lines["severity"], line[known], out["severity"][known])
        self._touch(line)
        self._touch(lines["partner"][line[known]])  # an exchange is shown by either half

    def _touch(self, lines: I64) -> None:
        """Note down that lines have changed; -1 is none."""
        self._lowest = min(self._lowest, int(lines[lines >= 0].min(initial=self._lowest)))

    @staticmethod
    def _learn(board: Board, batch: Batch) -> None:
        """Take the last value of each register of each servo."""
        v = batch.samples
        if not len(v):
            return
        key = v.servo_id.astype(np.int64) << 16 | v.register
        _, last = np.unique(key[::-1], return_index=True)
        for k in (len(key) - 1 - last).tolist():
            board[int(v.servo_id[k]), int(v.register[k])] = LastValue(
                int(v.t_ns[k]), int(v.raw[k]), float(v.value[k]), int(v.part[k])
            )
