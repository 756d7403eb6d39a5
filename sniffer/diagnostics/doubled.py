"""A second answer that has no header: bytes behind an answer which would be another one.

Where answers have headers the second one is a frame, and pairing tells. A bare one is nothing but
bytes behind an answer: once it is noise, time and again behind one servo's answers it is a servo.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.diagnostics.rules import anomaly
from sniffer.ground.framing import Block
from sniffer.ground.model import OK, RESPONSE

if TYPE_CHECKING:
    from sniffer.ground.model import I16, I64, Anomaly, Batch
    from sniffer.protocols.base import BusProtocol

OFTEN: Final = 3
WITHIN: Final = 16
"""So many answers of a servo's last ones with a second one behind them are no chance: noise comes
with any length, and behind anybody. What is reported before that is noise, as it looks."""

MOST: Final = 4
"""Second answers behind one: more servos than that on one id are noise."""


class _Exchange(NamedTuple):
    """An answer and what asked for it; ``end`` is absolute."""

    servo_id: int
    number: int  # how many answers of this servo came before
    request: bytes
    start: int
    end: int


class DoubledAnswers:
    """Remembers for each servo which of its answers were followed by another."""

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._count = np.zeros(256, np.int64)  # answers of each servo
        self._twice: dict[int, list[int]] = {}  # servo -> numbers of its last doubled answers
        self._twins: dict[int, int] = {}  # servo -> offset from which on it is known to be two
        self._last: _Exchange | None = None

    def judge(self, batch: Batch, found: list[Anomaly]) -> list[Anomaly]:
        """Return the anomalies with noise that is a second answer called so."""
        twice = [a for a in found if a.code == "duplicate-response" and a.servo_id is not None]
        for a in sorted(twice, key=lambda a: a.known_at):
            assert a.servo_id is not None
            self._twins.setdefault(a.servo_id, a.known_at)
        t, f = batch.transactions, batch.frames
        rows = np.flatnonzero((t.outcome == OK) & (t.response >= 0) & (t.request != -1))
        answers = t.response[rows]
        if len(rows) > 1 and (answers[1:] < answers[:-1]).any():
            rows = rows[np.argsort(answers)]
            answers = t.response[rows]
        who = f.servo_id[answers] & 255
        stray = {a.evidence[0]: i for i, a in enumerate(found) if a.code == "noise"}
        behind: list[tuple[_Exchange, int, int]] = []
        if stray:
            size = f.length[answers]
            ends = f.start[answers] + size + batch.base
            begins = np.array([at for at, _ in stray])
            near = np.flatnonzero(np.isin(ends, begins))
            lengths = dict(stray.keys())
            places = {
                end: k
                for k, end, n in zip(near.tolist(), ends[near].tolist(), size[near], strict=True)
                if _may_be(lengths[end], n)
            }
            numbers = self._count[who] + _ranks(who) if places else self._count
            for at, length in sorted(stray):
                k, last = places.get(at), self._last
                if k is not None:
                    last = _exchange(batch, int(rows[k]), int(numbers[k]))
                elif last is None or not last.end == at == batch.base:
                    continue
                if _may_be(length, last.end - last.start):
                    behind.append((last, at, length))
        if len(rows):
            self._count += np.bincount(who, minlength=len(self._count))
            self._last = _exchange(batch, int(rows[-1]), int(self._count[who[-1]]) - 1)
        elif len(f) or (self._last is not None and self._last.end < batch.base + len(batch.data)):
            self._last = None
        if not behind:
            return found
        out = list(found)
        for (answer, at, length), many in zip(behind, self._answers(batch, behind), strict=True):
            if not many:
                continue
            servo = answer.servo_id
            before = self._twice.get(servo, [])
            often = [n for n in (*before, answer.number) if answer.number - n < WITHIN]
            self._twice[servo] = often[-OFTEN:]
            if len(often) < OFTEN and self._twins.get(servo, at) >= at:
                continue
            self._twins.setdefault(servo, at)
            i = stray[at, length]
            shown = batch.data[at - batch.base : at - batch.base + length].hex(" ").upper()
            times = "twice" if many == 1 else f"{many + 1} times"
            text = f"servo {servo} answered {times}: {shown} stands right behind its answer"
            span = answer.start, answer.end - answer.start
            out[i] = anomaly("duplicate-response", out[i].t_ns, servo, text, span, (at, length))
        return out

    def _answers(self, batch: Batch, behind: list[tuple[_Exchange, int, int]]) -> list[int]:
        """Return how many answers the bytes behind each answer would be; 0: they are none.

        The protocol tells: it frames each request anew with those bytes instead of its answer.
        """
        tries: list[bytes] = []
        edges: list[int] = []
        for answer, at, length in behind:
            run = batch.data[at - batch.base : at - batch.base + length]
            size = answer.end - answer.start
            tries += [answer.request + run[k : k + size] for k in range(0, length, size)]
            edges.append(len(tries))
        whole = self._whole(tries)
        return [
            b - a if b > a and all(whole[a:b]) else 0 for a, b in itertools.pairwise([0, *edges])
        ]

    def _whole(self, tries: list[bytes]) -> list[bool]:
        """Tell which are a request with its answer right behind it, and nothing else."""
        if not tries:
            return []
        ends = np.cumsum([len(one) for one in tries])
        block = Block(np.frombuffer(b"".join(tries), np.uint8), ends[:-1], True)
        spans, _ = self._protocol.frame(block)
        answers = spans.end[spans.kind == RESPONSE]
        covered = np.zeros(len(tries), np.int64)
        np.add.at(covered, block.segment(spans.start), spans.end - spans.start)
        whole: list[bool] = (np.isin(ends, answers) & (covered == [len(t) for t in tries])).tolist()
        return whole


def _may_be(length: int, size: int) -> bool:
    """Tell whether so many bytes may be answers of one size."""
    return length % size == 0 and length // size <= MOST


def _exchange(batch: Batch, row: int, number: int) -> _Exchange:
    t, f = batch.transactions, batch.frames
    q, r = int(t.request[row]), int(t.response[row])
    # Bare answers stand right behind their requests: of one in an earlier batch no byte is missed.
    asked = batch.data[int(f.start[q]) : int(f.start[q]) + int(f.length[q])] if q >= 0 else b""
    start = batch.base + int(f.start[r])
    return _Exchange(int(f.servo_id[r]), number, asked, start, start + int(f.length[r]))


def _ranks(key: I16) -> I64:
    """Return for each row how many rows with its key came before."""
    order = np.argsort(key, kind="stable")
    out = np.empty(len(key), np.int64)
    out[order] = np.arange(len(key)) - np.searchsorted(key[order], key[order])
    return out
