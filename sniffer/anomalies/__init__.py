"""What is wrong on the bus: one small rule a function, over the columns of a batch.

Rules return anomalies in any order; they are sorted by the last of their evidence: only then they
are known. Those of which a bad line has many come in columns (``found.Anomalies``). What a rule
remembers across batches does not depend on how the stream was cut.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sniffer.anomalies.answers import PairingRules
from sniffer.anomalies.device import DeviceRules
from sniffer.anomalies.doubled import DoubledAnswers
from sniffer.anomalies.found import Anomalies
from sniffer.anomalies.hearing import Hearing
from sniffer.anomalies.losses import TapLosses
from sniffer.anomalies.models import ModelRules
from sniffer.anomalies.rules import CaptureRules, gap_anomalies, protocol_anomalies
from sniffer.anomalies.tap import TORN_OFF, TapRules, without_our_fault
from sniffer.anomalies.thresholds import AlarmRules
from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.anomalies.alarms import Alarm
    from sniffer.anomalies.learned import Meaning
    from sniffer.ground.model import Anomaly, Batch
    from sniffer.protocols.base import BusProtocol


class WireRules(Remembering):
    """What concerns the wire, whoever speaks on it: clocks, directions, what the tap met."""

    PARTS = ("_capture", "_tap")

    def __init__(self) -> None:
        self._capture = CaptureRules()
        self._tap = TapRules()

    def judge(self, batch: Batch) -> list[Anomaly]:
        """Return what is wrong."""
        return [*self._capture.judge(batch), *self._tap.judge(batch)]

    def finish(self) -> list[Anomaly]:
        """Return what was held back until the end."""
        return self._tap.finish()


class AnomalyRules(Remembering):
    """Runs all rules over batch after batch of one bus.

    ``alarms`` are rules of the user's own. ``is_alone``: no other protocol is on the wire, so that
    what concerns the wire is told here.
    """

    PARTS = (
        *("_pairing", "_device", "_models", "_alarms", "_wire"),
        *("_doubled", "_losses", "_hearing"),
    )

    def __init__(
        self, protocol: BusProtocol, *, alarms: Sequence[Alarm] = (), is_alone: bool = True
    ) -> None:
        self._protocol = protocol
        self._pairing = PairingRules(protocol)
        self._device = DeviceRules(protocol)
        self._models = ModelRules(protocol)
        self._alarms = AlarmRules(protocol, alarms)
        self._wire = WireRules() if is_alone else None
        self._doubled = DoubledAnswers(protocol)
        self._losses = TapLosses(protocol.reach)
        self._hearing = Hearing()

    def judge(
        self,
        batch: Batch,
        meaning: Meaning | None = None,
        losses: Sequence[tuple[int, int]] = (),
    ) -> Batch:
        """Return the batch with its anomalies.

        Args:
            batch: what was decided.
            meaning: what was learned about the servos.
            losses: from where to where the tap lost bytes, as far as that is news.
        """
        few = [
            *(self._models.judge(batch, meaning) if meaning is not None else ()),
            *(self._wire.judge(batch) if self._wire is not None else ()),
            *self._alarms.judge(batch),
        ]
        found = Anomalies.joined(
            [
                gap_anomalies(batch),
                protocol_anomalies(batch, self._protocol),
                *self._pairing.judge(batch),
                *self._device.judge(batch, meaning),
                Anomalies.of(few),
            ]
        )
        found = _without_repeats(found)
        found = self._doubled.judge(batch, found)
        found = self._losses.without(batch, found, losses)
        if batch.cut is not None or any(r.kind in TORN_OFF for r in batch.remarks):
            tail_ns = self._protocol.tail_ns
            found = Anomalies.of(without_our_fault(batch, list(found), tail_ns))
        found = self._hearing.judge(batch, found)
        if not len(found):
            return batch
        # What was held back stands where it was let go, however the stream was cut.
        order = np.lexsort((found.code, found.t_ns, found.told_at))
        return replace(batch, anomalies=found.take(order))

    def finish(self, batch: Batch) -> Batch:
        """Return the last batch with what was held back until the end."""
        held = [*self._hearing.finish(), *(self._wire.finish() if self._wire is not None else ())]
        if not held:
            return batch
        ends = [a for a in batch.anomalies if a.code == "capture-end"]
        found = [a for a in batch.anomalies if a.code != "capture-end"]
        return replace(batch, anomalies=(*found, *held, *ends))


def _without_repeats(found: Anomalies) -> Anomalies:
    """Leave out that an answer differs from its request, where it may be that to another one."""
    unsure = found.rows("ambiguous-response")
    differs = found.rows("echo-mismatch") if len(unsure) else unsure
    if not len(differs):
        return found
    answers = {found[i].evidence[-1] for i in unsure.tolist()}
    gone = [i for i in differs.tolist() if found[i].evidence[0] in answers]
    return found.take(np.delete(np.arange(len(found)), gone))
