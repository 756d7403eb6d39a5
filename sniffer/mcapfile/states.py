"""What servos were made known to be: messages of states, and a topic for each value alone.

A state has a field for each quantity, absent where the frame does not carry it. Who plots an absent
field as 0 needs a topic for each: those of ``FLAT`` hold a number a message, and nothing else. Of
protobuf a viewer of Rerun plots nothing by itself: those of ``PLOTS`` hold positions alone for it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.codes import OK
from sniffer.ground.distinct import distinct
from sniffer.mcapfile.cdr import NUMBERS
from sniffer.mcapfile.encoder import Encoder
from sniffer.mcapfile.fields import FIRST_VALUE, KnownValues, quantity_of, state_field
from sniffer.mcapfile.reads import ReadValues
from sniffer.mcapfile.rows import Heads, MessageRows
from sniffer.messages import CHOICES, FLAT, PLOTS, TOPICS
from sniffer.messages.servo_state_pb2 import Quantity, ServoState

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from typing import Protocol

    import numpy.typing as npt
    from google.protobuf.message import Message

    from sniffer.ground.model import I64, Batch, Mask
    from sniffer.mcapfile.kinds import MessageType
    from sniffer.mcapfile.queue import Queue
    from sniffer.mcapfile.ros2 import RosWriter
    from sniffer.protocols.base import BusProtocol

    class MessageChannels(Protocol):
        """Opens the channel of a topic of the bus, once, and returns its id."""

        def __call__(self, topic: str, message: type[Message] | MessageType, **facts: str) -> int:
            """``facts`` are what the channel says of itself."""
            ...


LISTED_NS: Final = 10_000_000
"""The index of a live recording names no more states than have each field of a servo so often.

It is 16 bytes for each one and nothing packs it. Full lines say some 700 states a second of each
servo: to name all would take as much as the raw bytes."""

RESPONSE_TIME: Final = "response_time_ms"
"""A field of a state that is no register's."""


class States:
    """Writes the values of the servos of one bus.

    Args:
        protocol: what they speak.
        queue: takes the records.
        channel: opens a topic of the bus.
        count_up: returns the next sequence numbers of a channel.
        bus: its name.
        ros2: writes what ROS 2 understands of it, None: nobody does.
        live: of states the index names no more than it must, see ``LISTED_NS``.
    """

    def __init__(
        self,
        protocol: BusProtocol,
        queue: Queue,
        channel: MessageChannels,
        count_up: Callable[[int, int], npt.NDArray[np.uint32]],
        bus: str,
        ros2: RosWriter | None,
        *,
        live: bool,
    ) -> None:
        self.seen: dict[str, set[str]] = {}
        """Fields that the states of a topic had so far."""
        self._queue = queue
        self._channel = channel
        self._bus, self._ros2 = bus, ros2
        self._count_up = count_up
        self._live = live
        fields = [state_field(register) for register in protocol.registers]
        self.names = [*sorted({name for name in fields if name is not None}), RESPONSE_TIME]
        at = {name: i for i, name in enumerate(self.names[:-1])}
        self._field_of = np.array([at[n] if n is not None else -1 for n in fields], np.int64)
        declared = {f.name for f in ServoState.DESCRIPTOR.fields if f.number >= FIRST_VALUE}
        self._is_declared = np.array([name in declared for name in self.names])
        self._is_position = np.array([quantity_of(name) == "position" for name in self.names])
        self._states, self._quantities = Encoder(ServoState), Encoder(Quantity)
        self._held = ReadValues.none()

    def write(self, batch: Batch, log: I64, publish: I64, read: I64) -> None:
        """Queue what a batch made known; ``log`` and ``publish`` are the times of its frames.

        ``read`` is the offset behind the read that each frame ended in, -1 where nobody knows.
        """
        told = self._told(batch)
        if self._queue.wants("state"):
            mine = self._is_declared[told.field]
            stated = told if mine.all() else told.take(mine)
            self._held = self._held.then(self._known(batch, stated, log, publish, read))
        if self._queue.wants(FLAT):
            timed = self._with_times(batch, told)
            heads = self._alone(timed, log, publish, Quantity, "servo/{}/{}")
            if len(timed.row):
                rows = self._quantities.encode(heads, {"value": timed.value}, {})
                self._queue.add(FLAT, *rows)
        if self._queue.wants(PLOTS):
            places = told.take(self._is_position[told.field])
            heads = self._alone(places, log, publish, NUMBERS, f"{PLOTS}/servo_{{}}_{{}}")
            if len(places.row):
                self._queue.add(PLOTS, MessageRows.of_numbers(places.value, heads))
        if self._ros2 is not None:
            self._ros2.states(self._bus, self.names, told, log, publish)

    def _told(self, batch: Batch) -> KnownValues:
        v = batch.values
        field = self._field_of[v.register.astype(np.intp)]
        known = KnownValues(v.row, v.servo_id.astype(np.int64), field, v.value)
        mine = v.accepted & (field >= 0) & ~np.isnan(v.value)
        return known if mine.all() else known.take(np.flatnonzero(mine))

    def settle(self, done: int | None) -> None:
        """Queue the states of reads that are decoded to their end: up to ``done``, None: all."""
        held, n = self._held, len(self._held)
        is_open = np.zeros(n, bool) if done is None else held.read > done
        over = int(is_open.argmax()) if is_open.any() else n
        if over:
            self._held = held.part(over, n)
            self._write_states(held.part(0, over))

    def _known(
        self, batch: Batch, told: KnownValues, log: I64, publish: I64, read: I64
    ) -> ReadValues:
        """Return what each frame made known of each servo."""
        if not len(told.row):
            return ReadValues.none()
        frames, t = batch.frames, batch.transactions
        new = np.ones(len(told.row), bool)
        new[1:] = (told.row[1:] != told.row[:-1]) | (told.servo[1:] != told.servo[:-1])
        begins = np.flatnonzero(new)
        row = told.row[begins]
        took = np.full(len(frames), -1)
        paired = t.outcome == OK
        took[t.response[paired]] = t.response_time_ns[paired]
        return ReadValues(
            servo=told.servo[begins],
            read=read[row],
            log=log[row],
            publish=publish[row],
            offset=batch.base + frames.start[row],
            kind=frames.kind[row].astype(np.int64),
            took=took[row],
            row=np.repeat(np.arange(len(begins)), np.diff(begins, append=len(new))),
            field=told.field,
            value=told.value,
        )

    def _write_states(self, known: ReadValues) -> None:
        message, last = known.messages()
        servo, n = known.servo[last], len(last)
        took = np.full(n, -1)
        timed = known.took >= 0
        took[message[timed]] = known.took[timed]
        optional: dict[str, tuple[Any, Any]] = {
            "response_time_ns": (took, took >= 0),
            RESPONSE_TIME: (took / 1e6, took >= 0),
        }
        for i in distinct(known.field)[0].tolist():
            which = np.flatnonzero(known.field == i)
            at = message[known.row[which]]
            there, column = np.zeros(n, bool), np.zeros(n)
            there[at] = True
            column[at] = known.value[which]
            optional[self.names[i]] = (column, there)
        channel, sequence = np.empty(n, np.uint16), np.empty(n, np.uint32)
        servos, place, _ = distinct(servo)
        for k, number in enumerate(servos.tolist()):
            which = np.flatnonzero(place == k)
            topic = f"servo/{_who(number)}/state"
            channel[which] = self._channel(topic, ServoState, servo_id=_who(number))
            sequence[which] = self._count_up(int(channel[which[0]]), len(which))
            seen = self.seen.setdefault(topic, set())
            seen.update(name for name, (_, there) in optional.items() if there[which].any())
        ranks = self._queue.ranks(n)
        log = known.log[last]
        heads = Heads(channel, sequence, log, known.publish[last], ranks)
        numbers: dict[str, Any] = {"offset": known.offset[last], "kind": known.kind[last]}
        fields = (there for _, there in optional.values())
        listed = _listed(place, log, fields) if self._live and n else None
        self._queue.add("state", *self._states.encode(heads, numbers, optional), listed=listed)

    def _alone(
        self,
        told: KnownValues,
        log: I64,
        publish: I64,
        message: type[Message] | MessageType,
        called: str,
    ) -> Heads:
        """Return the heads of a message for each value; ``called`` makes topics of id and field."""
        n = len(told.row)
        width = len(self.names)
        channel, sequence = np.empty(n, np.uint16), np.empty(n, np.uint32)
        keys, place, _ = distinct((told.servo + 1) * width + told.field)
        for k, key in enumerate(keys.tolist()):
            which = np.flatnonzero(place == k)
            who = _who(key // width - 1)
            topic = called.format(who, flat_name(self.names[key % width]))
            channel[which] = self._channel(topic, message, servo_id=who)
            sequence[which] = self._count_up(int(channel[which[0]]), len(which))
        ranks = self._queue.ranks(n)
        return Heads(channel, sequence, log[told.row], publish[told.row], ranks)

    def _with_times(self, batch: Batch, told: KnownValues) -> KnownValues:
        """Return values with the response times among them, which answers have that state none."""
        t = batch.transactions
        timed = (t.outcome == OK) & (t.response_time_ns >= 0)
        row = t.response[timed]
        servo = batch.frames.servo_id[row]
        field = np.full(len(row), len(self.names) - 1)
        both = KnownValues(
            np.concatenate([told.row, row]),
            np.concatenate([told.servo, servo]),
            np.concatenate([told.field, field]),
            np.concatenate([told.value, t.response_time_ns[timed] / 1e6]),
        )
        return both.take(np.argsort(both.row, kind="stable"))


def _listed(servo: I64, log: I64, fields: Iterable[Mask]) -> Mask:
    """Return which messages an index must name to name each field every ``LISTED_NS``.

    ``servo`` counts the servos, ``fields`` tells for each one which messages have it. Three reads
    of one servo within that time: goal, position | position | position, load. The first and the
    last are named.
    """
    period = np.cumsum(np.diff(log // LISTED_NS, prepend=0) != 0)
    key = period * (int(servo.max()) + 1) + servo
    first = np.empty(int(key.max()) + 1, np.int64)
    listed = np.zeros(len(log), bool)
    for there in fields:
        late_first = np.flatnonzero(there)[::-1]
        keys = key[late_first]
        first[keys] = late_first  # of one key the last one stays, which is the earliest
        listed[first[keys]] = True
    return listed


def flat_name(field: str) -> str:
    """Return the last part of the topic of a field's values, which is no other topic's."""
    return f"{field}_" if field in CHOICES else field


def kind_of(topic: str) -> str:
    """Return the last part of a topic, or what single values of servos are."""
    before, _, last = topic.rpartition("/")
    if before.endswith(f"/{PLOTS}") and last not in TOPICS:  # a bus may have that name
        return PLOTS
    is_servos = before.rpartition("/")[0].endswith("/servo")
    return FLAT if is_servos and last not in TOPICS else last


def _who(servo: int) -> str:
    return str(servo) if servo >= 0 else "unknown"
