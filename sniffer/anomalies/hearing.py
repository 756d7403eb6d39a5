"""Does the tap hear both sides? Until it has, what only one side says is no fault of a servo.

Where the first answer has not come yet, unanswered requests are held back, not many of them: then
it is plain whether one servo is silent or all of them are. Where the first request has not come
yet, answers are those to requests before the capture.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.anomalies.found import NUMBER, Anomalies
from sniffer.anomalies.rules import anomaly
from sniffer.ground.codes import REQUEST, RESPONSE
from sniffer.ground.distinct import numbers
from sniffer.ground.gaps import BLANK, NOISE, Gaps
from sniffer.ground.memory import Remembering
from sniffer.ground.model import NEVER_NS, Anomaly, Direction

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.ground.model import Batch

ENOUGH: Final = 8
"""Requests without any answer (answers without any request) from which on only one side is heard.
Above what a client tries before it gives up (3 to 5 times), far below what annoys."""

SHOWN: Final = 5
"""Servos that are named."""


class Hearing(Remembering):
    """Remembers whether requests and answers were heard, and what is held back until both are."""

    LASTING = (
        *("_hears_requests", "_hears_answers", "_answers", "_held", "_count"),
        *("_servos", "_told", "_wires", "_broken"),
    )

    def __init__(self) -> None:
        self._hears_requests = self._hears_answers = False
        self._answers = 0  # without a request so far
        self._held: list[Anomaly] = []
        self._count = 0  # requests that should have been answered, none so far
        self._servos: set[int] = set()
        self._told = False
        self._wires: set[int] = set()
        self._broken = -1  # where the bytes before the batch end, if they are a broken frame

    def matters(self, at: int) -> Mapping[str, Any]:
        """Return that both sides are heard, once they are: then nothing is held back any more."""
        both = self._hears_requests and self._hears_answers
        return {"held": self._held} if both else super().matters(at)

    def judge(self, batch: Batch, found: Anomalies) -> Anomalies:
        """Return the anomalies without those that follow from hearing one side only."""
        if self._hears_requests and self._hears_answers:
            return found
        f = batch.frames
        self._wires.update(numbers(f.direction).tolist())
        asked = self._first(batch, REQUEST, heard=self._hears_requests)
        answered = self._first(batch, RESPONSE, heard=self._hears_answers)
        found = found.take(np.lexsort((found.length, found.at)))
        stray = (found.code == NUMBER["unsolicited-response"]) & (found.at < asked)
        early = (found.code == NUMBER["no-response"]) & (found.at < answered)
        here = stray | early
        place, told = [np.flatnonzero(~here)], [found.take(np.flatnonzero(~here))]
        rows = np.flatnonzero(here)
        torn = self._torn_ends(batch)
        columns = (rows, stray[rows], found.at[rows], found.servo_id[rows])
        for i, is_stray, at, who in zip(*(c.tolist() for c in columns), strict=True):
            is_torn = is_stray and at in torn
            # Of a wire alone there may be millions: what is only counted needs no object.
            if is_stray and not is_torn and self._answers >= ENOUGH:
                self._answers += 1
                continue
            if not is_stray and self._is_known(who):
                self._count += 1
                continue
            a = found[i]
            new = self._unasked(a, is_torn=is_torn) if is_stray else self._unanswered(a)
            place.append(np.full(len(new), i))
            told.append(Anomalies.of(new))
        if batch.data:
            gaps, whole = Gaps.of(batch.gaps), len(batch.data)
            ends = len(gaps) > 0 and gaps.start[-1] + gaps.length[-1] == whole
            broken = ends and gaps.kind[-1] not in (NOISE, BLANK)
            self._broken = batch.base + whole if broken else -1
        self._hears_requests |= asked < NEVER_NS
        if answered < NEVER_NS:
            self._hears_answers = True
            held = Anomalies.of(self.finish())
            place.append(np.full(len(held), len(found)))
            if len(held):
                held.told_at = np.maximum(held.known_at, answered)
            told.append(held)
        order = np.argsort(np.concatenate(place), kind="stable")
        return Anomalies.joined(told).take(order)

    def finish(self) -> list[Anomaly]:
        """Return what is held back: nothing more will tell."""
        held, self._held = self._held, []
        return held

    @staticmethod
    def _first(batch: Batch, kind: int, *, heard: bool) -> int:
        """Return where in the stream the first frame of a kind stands."""
        rows = np.flatnonzero(batch.frames.kind == kind)
        if heard:
            return -1
        return batch.base + int(batch.frames.start[rows[0]]) if len(rows) else NEVER_NS

    def _torn_ends(self, batch: Batch) -> frozenset[int]:
        """Return where broken frames end: of an answer right behind one the request is damaged."""
        gaps = Gaps.of(batch.gaps)
        torn = (gaps.kind != NOISE) & (gaps.kind != BLANK)
        ends = (gaps.start + gaps.length)[torn] + batch.base
        return frozenset((*ends.tolist(), self._broken))

    def _is_known(self, servo_id: int) -> bool:
        """Tell whether one more request without an answer is nothing new."""
        no_news = servo_id < 0 or servo_id in self._servos
        return self._told or (self._count >= ENOUGH and no_news)

    def _unasked(self, a: Anomaly, *, is_torn: bool) -> Sequence[Anomaly]:
        """Judge an answer before the first request."""
        if is_torn:
            return (a,)
        self._answers += 1
        who = -1 if a.servo_id is None else a.servo_id
        if self._answers == 1:
            text = "the capture begins between a request and its answer"
            return (anomaly("capture-start", a.t_ns, who, text, *a.evidence),)
        if self._answers != ENOUGH:
            return ()
        text = (
            f"{ENOUGH} answers and no request so far: the tap hears only the servos' wire"
            f"{self._marked(Direction.RX)}"
        )
        return (anomaly("no-request-heard", a.t_ns, -1, text, *a.evidence),)

    def _unanswered(self, a: Anomaly) -> Sequence[Anomaly]:
        """Judge an unanswered request before the first answer."""
        self._count += 1
        if a.servo_id is not None:
            self._servos.add(a.servo_id)
        if self._told:
            return ()
        if self._count < ENOUGH:
            self._held.append(a)
            return ()
        first, *_ = [*self.finish(), a]
        if len(self._servos) > 1:
            self._told = True
            text = (
                f"none of {self._count} requests, to {self._named()}, was answered: the tap hears "
                f"only the controller's wire, or no servo answers{self._marked(Direction.TX)}"
            )
            return (anomaly("no-answer-heard", a.t_ns, -1, text, *first.evidence, *a.evidence),)
        if self._count > ENOUGH:
            return ()
        text = f"{first.detail}, nor the {ENOUGH - 1} requests behind it"
        return (first._replace(t_ns=a.t_ns, detail=text, evidence=(*first.evidence, *a.evidence)),)

    def _named(self) -> str:
        servos = sorted(self._servos)
        more = f" and {len(servos) - SHOWN} more" if len(servos) > SHOWN else ""
        return f"servos {', '.join(map(str, servos[:SHOWN]))}{more}"

    def _marked(self, wire: Direction) -> str:
        """Tell where the input itself says that all came from one wire."""
        return f" (all of it is marked {wire.name})" if self._wires == {wire} else ""
