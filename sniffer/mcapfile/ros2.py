"""What ROS 2 understands of a bus, beside our own topics: joint states and diagnostics.

``/joint_states`` has a message each time a servo says where it is, with its one joint, in radians
or metres; ``/diagnostics`` one for each anomaly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.called import ServoNames, names_in
from sniffer.ground.distinct import distinct
from sniffer.ground.model import Severity
from sniffer.ground.wording import and_
from sniffer.mcapfile.cdr import (
    DIAGNOSTICS,
    JOINT_STATE,
    DiagnosticStatus,
    diagnostics,
    joint_state,
)
from sniffer.mcapfile.fields import quantity_of, unit_of
from sniffer.mcapfile.joints import SI, RosJoint, joint_facts
from sniffer.mcapfile.rows import Heads, Loose

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from sniffer.decoding.called import Named
    from sniffer.ground.model import I64, Anomaly
    from sniffer.mcapfile.fields import KnownValues
    from sniffer.mcapfile.kinds import MessageType
    from sniffer.mcapfile.queue import Queue, Sorted

JOINTS: Final = "/joint_states"
ANOMALIES: Final = "/diagnostics"
"""The topics that programs of ROS 2 listen to."""

KIND: Final = "ros2"
"""What these records are among those that wait."""

POSITION: Final = "position"
SPEED: Final = "speed_deg_per_s"
"""Which values of a servo are a joint's, where its file says nothing else."""

_QOS: Final = {"offered_qos_profiles": ""}
"""What rosbag2 wants to be said of a channel; none: its own."""

_LEVELS: Final = {Severity.NOTE: 0, Severity.WARN: 1, Severity.ERROR: 2}


class _JointField(NamedTuple):
    """What of a servo's values is where a joint is, by numbers of fields; -1: nothing."""

    position: int
    scale: float
    velocity: int


class JointPlaces:
    """Which servos are joints, and which of their values says where they are.

    Several files of a recording share it.

    Args:
        joints: which servos are joints; empty: all whose position has a physical unit.
        names: of servos, for joints where none are given; else ``<bus>_servo<id>``.
    """

    def __init__(self, joints: Sequence[RosJoint], names: Mapping[Named, str]) -> None:
        self._joints = {(joint.bus, joint.servo): joint for joint in joints}
        self._names = ServoNames(names)
        self._places: dict[tuple[str, int], _JointField] = {}
        self._left: dict[tuple[str, int], str] = {}

    @classmethod
    def of(
        cls, joints: Sequence[RosJoint] | JointPlaces, session: Mapping[str, str]
    ) -> JointPlaces:
        """Return what is known of joints: by another file of the recording, or from now on."""
        return joints if isinstance(joints, JointPlaces) else cls(joints, names_in(session))

    def facts(self) -> dict[str, str]:
        """Return what a recording says of them, so that it can be mended."""
        return joint_facts(self._joints.values())

    def joint(self, bus: str, servo: int) -> RosJoint:
        """Return the joint that a servo is."""
        name = self._names.of(bus, servo) or f"{bus}_servo{servo}"
        return self._joints.get((bus, servo), RosJoint(bus, servo, name))

    def place(
        self, bus: str, servo: int, names: Sequence[str], mine: KnownValues
    ) -> _JointField | None:
        """Return what is a joint's place, as its servo's first words decide; None: it has none."""
        key = (bus, servo)
        if key in self._places:
            return self._places[key]
        joint = self.joint(bus, servo)
        wanted = joint.quantity or POSITION
        stated = distinct(mine.field)[0].tolist()
        fits = [i for i in stated if wanted in (names[i], quantity_of(names[i]))]
        if servo < 0 or not fits:
            return None
        if self._joints and key not in self._joints:
            self._left[key] = "not among the joints"
            return None
        # a scale is meant for what has none of its own
        fits.sort(key=lambda i: (unit_of(names[i]) in SI) == (joint.scale is not None))
        unit = unit_of(names[fits[0]])
        scale = SI.get(unit) if joint.scale is None else joint.scale
        if scale is None:
            self._left[key] = f"its {names[fits[0]]} has no physical unit: it takes a scale"
            return None
        is_angle = joint.scale is None and unit == "deg" and SPEED in names
        place = _JointField(fits[0], scale, names.index(SPEED) if is_angle else -1)
        self._places[key] = place
        return place

    def told(self) -> list[str]:
        """Return in sentences which joints there are, and what was left out, and why."""
        found = sorted(self.joint(*key).name for key in self._places)
        out = [f"{JOINTS} has {and_(found)}" if found else f"{JOINTS} has no joint"]
        left = dict(self._left)
        for (bus, servo), joint in self._joints.items():
            if (bus, servo) not in self._places:
                left.setdefault((bus, servo), f"{joint.name} never said where it is")
        alike: dict[tuple[str, str], list[str]] = {}
        for (bus, servo), reason in sorted(left.items()):
            if (bus, servo) not in self._places:
                alike.setdefault((bus, reason), []).append(str(servo))
        why = [
            f"servo{'s' * (len(ids) > 1)} {and_(ids)} of {bus} ({reason})"
            for (bus, reason), ids in alike.items()
        ]
        return [*out, *([f"left out of {JOINTS}: {and_(why)}"] if why else [])]


class RosWriter:
    """Writes the topics of ROS 2 of all buses of a file.

    Args:
        places: which servos are joints.
        queue: takes the records.
        open_channel: opens a channel (topic, message type, metadata) and returns its id.
    """

    def __init__(
        self,
        places: JointPlaces,
        queue: Queue,
        open_channel: Callable[[str, MessageType, Mapping[str, str]], int],
    ) -> None:
        self.places = places
        self._queue = queue
        self._open = open_channel
        self._sequences: dict[str, int] = {}
        self._until = 0

    def take(self) -> Sorted | None:
        """Return what waits, of all buses in the order of time, and nothing before what was taken.

        It is all that waits: what else there was has been taken kind by kind.
        """
        waiting = self._queue.take(None)
        if waiting is None:
            return None
        rows = waiting.sorted(self._until)
        self._until = int(rows.log[-1])
        return rows

    def states(
        self, bus: str, names: Sequence[str], told: KnownValues, log: I64, publish: I64
    ) -> None:
        """Write where servos said they are; ``log`` and ``publish`` are the times of the frames."""
        found: list[tuple[int, bytes]] = []
        for servo in distinct(told.servo)[0].tolist():
            mine = told.take(told.servo == servo)
            place = self.places.place(bus, servo, names, mine)
            if place is None:
                continue
            joint = self.places.joint(bus, servo)
            at = mine.take(mine.field == place.position)
            fast = mine.take(mine.field == place.velocity)
            speeds = dict(zip(fast.row.tolist(), fast.value.tolist(), strict=True))
            for row, value in zip(at.row.tolist(), at.value.tolist(), strict=True):
                speed = speeds.get(row)
                data = joint_state(
                    int(publish[row]),
                    joint.name,
                    joint.sign * value * place.scale + joint.offset,
                    None if speed is None else joint.sign * speed * SI["deg_per_s"],
                )
                found.append((row, data))
        found.sort(key=lambda one: one[0])
        rows = np.array([row for row, _ in found], np.int64)
        self._add(JOINTS, JOINT_STATE, [data for _, data in found], log[rows], publish[rows])

    def anomalies(self, bus: str, found: Sequence[Anomaly], times: I64) -> None:
        """Write what was found."""
        messages = []
        for a in found:
            who = bus if a.servo_id is None else f"{bus} servo {a.servo_id}"
            values = [("code", a.code), ("group", a.group)]
            told = DiagnosticStatus(_LEVELS[a.severity], who, f"{a.detail} [{a.code}]", who, values)
            messages.append(diagnostics(a.t_ns, told))
        self._add(ANOMALIES, DIAGNOSTICS, messages, times, times)

    def _add(
        self, topic: str, kind: MessageType, messages: Sequence[bytes], log: I64, publish: I64
    ) -> None:
        n = len(messages)
        if not n:
            return
        channel, first = self._open(topic, kind, _QOS), self._sequences.get(topic, 0)
        self._sequences[topic] = first + n
        sequence = np.arange(first, first + n).astype(np.uint32)
        ids = np.full(n, channel, np.uint16)
        heads = Heads(ids, sequence, log, publish, self._queue.ranks(n))
        self._queue.add(KIND, Loose.holding(messages, heads))
