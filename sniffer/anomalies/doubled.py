"""A second answer that has no header: bytes behind an answer which would be another one.

Where answers have headers the second one is a frame, and pairing tells. A bare one is nothing but
bytes behind an answer: once it is noise, time and again behind one servo's answers it is a servo.
"""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sniffer.anomalies.found import Anomalies
from sniffer.anomalies.rules import anomaly
from sniffer.ground.codes import OK, REQUEST, RESPONSE
from sniffer.ground.framing import Block
from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ground.model import I16, I64, Anomaly, Batch, Spans
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


class DoubledAnswers(Remembering):
    """Remembers for each servo which of its answers were followed by another."""

    LASTING = ("_count", "_twice", "_twins")
    PASSING = ("_last",)

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._count = np.zeros(256, np.int64)  # answers of each servo
        self._twice: dict[int, list[int]] = {}  # servo -> numbers of its last doubled answers
        self._twins: dict[int, int] = {}  # servo -> offset from which on it is known to be two
        self._last: _Exchange | None = None

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return how many answers ago each was doubled, not how many there were in all."""
        last = self._last if self._last is not None and self._last.end >= at else None
        if last is not None:
            last = last._replace(number=last.number - int(self._count[last.servo_id & 255]))
        ago = {s: [int(self._count[s]) - n for n in told] for s, told in self._twice.items()}
        return {
            "twice": {s: near for s, told in ago.items() if (near := _near(told))},
            "twins": set(self._twins),
            "last": last,
        }

    def judge(self, batch: Batch, found: Anomalies) -> Anomalies:
        """Return the anomalies with noise that is a second answer called so."""
        twice = found.rows("duplicate-response")
        for i in twice[np.argsort(found.known_at[twice], kind="stable")].tolist():
            if found.servo_id[i] >= 0:
                self._twins.setdefault(int(found.servo_id[i]), int(found.known_at[i]))
        t, f = batch.transactions, batch.frames
        rows = np.flatnonzero((t.outcome == OK) & (t.response >= 0) & (t.request != -1))
        answers = t.response[rows]
        if len(rows) > 1 and (answers[1:] < answers[:-1]).any():
            rows = rows[np.argsort(answers, kind="stable")]  # nearly sorted: that is seen to
            answers = t.response[rows]
        who = f.servo_id[answers] & 255
        stray = found.rows("noise")
        behind = self._behind(batch, found, stray, rows, answers, who) if len(stray) else []
        if len(rows):
            self._count += np.bincount(who, minlength=len(self._count))
            self._last = _exchange(batch, int(rows[-1]), int(self._count[who[-1]]) - 1)
        elif len(f) or (self._last is not None and self._last.end < batch.base + len(batch.data)):
            self._last = None
        if not behind:
            return found
        spans = [(answer, int(found.at[i]), int(found.length[i])) for answer, i in behind]
        gone: list[int] = []
        new: list[Anomaly] = []
        many = self._answers(batch, spans)
        for (answer, i), (_, at, length), more in zip(behind, spans, many, strict=True):
            if not more:
                continue
            servo = answer.servo_id
            before = self._twice.get(servo, [])
            often = [n for n in (*before, answer.number) if answer.number - n < WITHIN]
            self._twice[servo] = often[-OFTEN:]
            if len(often) < OFTEN and self._twins.get(servo, at) >= at:
                continue
            self._twins.setdefault(servo, at)
            shown = batch.data[at - batch.base : at - batch.base + length].hex(" ").upper()
            times = "twice" if more == 1 else f"{more + 1} times"
            text = f"servo {servo} answered {times}: {shown} stands right behind its answer"
            span = answer.start, answer.end - answer.start
            gone.append(i)
            t_ns = int(found.t_ns[i])
            new.append(anomaly("duplicate-response", t_ns, servo, text, span, (at, length)))
        kept = np.delete(np.arange(len(found)), gone)
        order = np.argsort(np.concatenate([kept, np.array(gone, np.int64)]), kind="stable")
        return Anomalies.joined([found.take(kept), Anomalies.of(new)]).take(order)

    def _behind(
        self, batch: Batch, found: Anomalies, stray: I64, rows: I64, answers: I64, who: I16
    ) -> list[tuple[_Exchange, int]]:
        """Return the rows of noise that may be answers, with the exchange each stands behind."""
        stray = stray[np.argsort(found.at[stray], kind="stable")]
        f = batch.frames
        size = f.length[answers]
        ends = f.start[answers] + size + batch.base
        at, length = found.at[stray], found.length[stray]
        out: list[tuple[_Exchange, int]] = []
        last = self._last
        # Where the noise begins the batch, the last answer of the one before stands before it.
        edge = last is not None and last.end == at[0] == batch.base
        if last is not None and edge and _may_be(int(length[0]), last.end - last.start):
            out.append((last, int(stray[0])))
        place = np.minimum(np.searchsorted(ends, at), len(ends) - 1)
        if len(ends):
            near = (ends[place] == at) & _may_be(length, size[place])
            if near.any():
                numbers = self._count[who] + _ranks(who)
                for i, k in zip(stray[near].tolist(), place[near].tolist(), strict=True):
                    out.append((_exchange(batch, int(rows[k]), int(numbers[k])), i))
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
        whole, torn = self._whole(tries), self._headless(batch, behind)
        return [
            b - a if b > a and all(whole[a:b]) and not is_asked else 0
            for (a, b), is_asked in zip(itertools.pairwise([0, *edges]), torn, strict=True)
        ]

    def _headless(self, batch: Batch, behind: list[tuple[_Exchange, int, int]]) -> list[bool]:
        """Tell which bytes are the next request but for its first byte, which was torn.

        Behind that stands the answer to it, so that all may be as long as two answers and more.
        """
        runs = [
            answer.request[:1] + batch.data[at - batch.base + 1 : at - batch.base + length]
            for answer, at, length in behind
        ]
        spans, _, ends = self._framed(runs)
        begins = ends - [len(run) for run in runs]
        headless: list[bool] = np.isin(begins, spans.start[spans.kind == REQUEST]).tolist()
        return headless

    def _whole(self, tries: list[bytes]) -> list[bool]:
        """Tell which are a request with its answer right behind it, and nothing else."""
        if not tries:
            return []
        spans, block, ends = self._framed(tries)
        answers = spans.end[spans.kind == RESPONSE]
        covered = np.zeros(len(tries), np.int64)
        np.add.at(covered, block.segment(spans.start), spans.end - spans.start)
        whole: list[bool] = (np.isin(ends, answers) & (covered == [len(t) for t in tries])).tolist()
        return whole

    def _framed(self, runs: list[bytes]) -> tuple[Spans, Block, I64]:
        """Return what the protocol frames in each of some runs of bytes, and where each ends."""
        ends = np.cumsum([len(one) for one in runs])
        block = Block(np.frombuffer(b"".join(runs), np.uint8), ends[:-1], True)
        return self._protocol.frame(block)[0], block, ends


def _near(ago: list[int]) -> list[int]:
    """Return what counts with the last answer, which may be doubled itself, or with the next."""
    return [n for n in ago if n <= WITHIN]


def _may_be(length: Any, size: Any) -> Any:
    """Tell whether so many bytes may be answers of one size; of numbers or columns."""
    return (length % size == 0) & (length // size <= MOST)


def _exchange(batch: Batch, row: int, number: int) -> _Exchange:
    t, f = batch.transactions, batch.frames
    q, r = int(batch.rows_of(t.request[row : row + 1])[0]), int(t.response[row])
    # Bare answers stand right behind their requests: of one in an earlier batch no byte is missed.
    asked = batch.data[int(f.start[q]) : int(f.start[q]) + int(f.length[q])] if q >= 0 else b""
    start = batch.base + int(f.start[r])
    return _Exchange(int(f.servo_id[r]), number, asked, start, start + int(f.length[r]))


def _ranks(key: I16) -> I64:
    """Return for each row how many rows with its key came before."""
    order = np.argsort(key, kind="stable")
    alike = key[order]
    begins = np.concatenate([[0], np.flatnonzero(alike[1:] != alike[:-1]) + 1])
    out = np.empty(len(key), np.int64)
    out[order] = np.arange(len(key)) - np.repeat(begins, np.diff(begins, append=len(key)))
    return out
