"""Answers that are requests as well, of servos that never gave another one: nobody was heard there.

Where an error stands in the place of the instruction, a request may fit as the answer to the one
before it: a tap that hears the controller only would find that its servos answer.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.found import Anomalies
from sniffer.ground.codes import NO_RESPONSE, OK
from sniffer.ground.distinct import within
from sniffer.ground.model import UNUSUAL

if TYPE_CHECKING:
    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol


class Unproven:
    """Learns whose answers can be nothing else.

    A protocol has as ``doubtful`` the commands for whose codes an error may be taken.
    """

    def __init__(self, protocol: BusProtocol) -> None:
        self._codes = np.array(getattr(protocol, "doubtful", ()), np.int64)
        self._proven, self._doubted = np.zeros((2, 256), bool)

    def is_doubted(self, servo_id: int) -> bool:
        """Tell whether requests to a servo were taken for its answers: what they say is lost."""
        return bool(self._doubted[servo_id & 255] and not self._proven[servo_id & 255])

    def without(self, batch: Batch) -> Batch:
        """Return a batch in which such answers are none, nor what is said of them."""
        f, t = batch.frames, batch.transactions
        if not len(self._codes) or not len(f):
            return batch
        rows = np.flatnonzero((t.outcome == OK) & (t.response >= 0))
        answer = t.response[rows]
        doubtful = within(f.status[answer], self._codes) & (
            (f.flags[answer] & UNUSUAL > 0) | (f.data_length[answer] == 0)
        )
        who = f.servo_id[answer] & 255
        self._proven[who[~doubtful]] = True
        doubtful &= ~self._proven[who]
        if not doubtful.any():
            return batch
        self._doubted[who[doubtful]] = True
        outcome = t.outcome.copy()
        outcome[rows[doubtful]] = NO_RESPONSE
        response, took = t.response.copy(), t.response_time_ns.copy()
        response[rows[doubtful]] = took[rows[doubtful]] = -1
        found = Anomalies.of(batch.anomalies)
        places = f.start[answer[doubtful]] + batch.base
        return replace(
            batch,
            transactions=replace(t, outcome=outcome, response=response, response_time_ns=took),
            anomalies=found.take(np.flatnonzero(~within(found.at, places))),
        )
