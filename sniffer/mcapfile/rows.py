"""Message records: many of one length in an array, or one by one; what their heads say in columns.

Their log times are written last, when the order in the file is known.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode

from sniffer.mcapfile.cdr import ONE_NUMBER
from sniffer.mcapfile.structs import HEAD, MESSAGE

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from google.protobuf.message import Message

    from sniffer.ground.model import F64, I64, Mask

U16 = npt.NDArray[np.uint16]
Void = npt.NDArray[np.void]

_FIELDS: Final = [
    ("opcode", "u1"),
    ("size", "<u8"),
    ("channel", "<u2"),
    ("sequence", "<u4"),
    ("log", "<u8"),
    ("publish", "<u8"),
]
_RECORD: Final = np.dtype(_FIELDS)
_NUMBER: Final = np.dtype([*_FIELDS, ("begin", f"V{len(ONE_NUMBER)}"), ("value", "<f8")])
"""A record whose message is an array of one number, as ROS 2 has it."""

LOG_AT: Final = 15
"""Where the log time stands in a record: it is written last, when the order is known."""


@dataclass(frozen=True, slots=True)
class Heads:
    """What the records' heads say, one entry a row.

    ``log`` decides the order in the file, and ``rank`` among rows of one time.
    """

    channel: U16
    sequence: npt.NDArray[np.uint32]
    log: I64
    publish: I64
    rank: I64

    def take(self, rows: I64 | Mask) -> Heads:
        """Return the heads of ``rows``."""
        return Heads(
            self.channel[rows],
            self.sequence[rows],
            self.log[rows],
            self.publish[rows],
            self.rank[rows],
        )

    @classmethod
    def concat(cls, parts: Sequence[Heads]) -> Heads:
        """Join heads."""
        columns = ([getattr(p, f.name) for p in parts] for f in fields(cls))
        return cls(*map(np.concatenate, columns))


@dataclass(frozen=True, slots=True)
class MessageRows:
    """Message records of equal length; their log times are not written yet."""

    data: Void
    heads: Heads

    @classmethod
    def of_numbers(cls, values: F64, heads: Heads) -> MessageRows:
        """Return records of arrays of ROS 2, one number each."""
        rows = np.zeros(len(values), _NUMBER)
        rows["opcode"] = Opcode.MESSAGE
        rows["size"] = _NUMBER.itemsize - HEAD.size
        rows["channel"], rows["sequence"] = heads.channel, heads.sequence
        rows["publish"] = heads.publish
        rows["begin"] = np.frombuffer(ONE_NUMBER, f"V{len(ONE_NUMBER)}")
        rows["value"] = values
        return cls(rows.view(f"V{_NUMBER.itemsize}"), heads)

    @property
    def widths(self) -> I64:
        """Length of each record."""
        return np.full(len(self.data), self.data.dtype.itemsize)

    def take(self, mask: Mask) -> MessageRows:
        """Return the rows that the mask selects."""
        return MessageRows(self.data[mask], self.heads.take(mask))

    def place(self, out: memoryview, at: I64) -> None:
        """Write each record to its place in ``out``."""
        width = self.data.dtype.itemsize
        np.ndarray((len(out) - width + 1,), self.data.dtype, out, 0, (1,))[at] = self.data


@dataclass(frozen=True, slots=True)
class Loose:
    """Message records of any length; their log times are not written yet."""

    data: list[bytes]
    heads: Heads

    @classmethod
    def of(cls, messages: Iterable[Message], heads: Heads) -> Loose:
        """Return records of messages that were built one by one."""
        return cls.holding((message.SerializeToString() for message in messages), heads)

    @classmethod
    def holding(cls, encoded: Iterable[bytes], heads: Heads) -> Loose:
        """Return records of messages in any encoding."""
        bodies = list(encoded)
        before = np.zeros(len(bodies), _RECORD)
        before["opcode"] = Opcode.MESSAGE
        before["size"] = np.fromiter(map(len, bodies), np.int64, len(bodies))
        before["size"] += MESSAGE.size - HEAD.size
        before["channel"], before["sequence"] = heads.channel, heads.sequence
        before["publish"] = heads.publish
        begins = before.view(f"V{MESSAGE.size}").tolist()
        return cls(list(map(operator.add, begins, bodies)), heads)

    @property
    def widths(self) -> I64:
        """Length of each record."""
        return np.fromiter(map(len, self.data), np.int64, len(self.data))

    def take(self, mask: Mask) -> Loose:
        """Return the rows that the mask selects."""
        chosen = [d for d, is_chosen in zip(self.data, mask.tolist(), strict=True) if is_chosen]
        return Loose(chosen, self.heads.take(mask))

    def place(self, out: memoryview, at: I64) -> None:
        """Write each record to its place in ``out``."""
        for data, a in zip(self.data, at.tolist(), strict=True):
            out[a : a + len(data)] = data


@dataclass(frozen=True, slots=True)
class Blob:
    """A bytes field: each row's part of ``data``."""

    name: str
    data: bytes
    start: I64
    length: I64

    def take(self, rows: I64, size: int) -> Void:
        """Return the bytes of ``rows``, all of one size."""
        data = np.frombuffer(self.data, np.uint8)
        return np.ndarray((len(data) - size + 1,), f"V{size}", data, 0, (1,))[self.start[rows]]

    def each(self, rows: I64) -> list[bytes]:
        """Return the bytes of ``rows``, each of its own size."""
        at = zip(self.start[rows].tolist(), self.length[rows].tolist(), strict=True)
        return [self.data[a : a + size] for a, size in at]
