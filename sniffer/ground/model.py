"""The records every floor of the house speaks of.

Records that are many (frames, transactions, samples) are *columns*: one frozen dataclass of numpy
arrays a kind, one row a record. Gaps and anomalies are named tuples, made when somebody looks at
them (``gaps.Lazy``): on a bad line they are not so rare.
Times are integer nanoseconds (Unix, or counted from the first byte where the input has no clock).
Offsets inside a batch count from ``Batch.data[0]``; ``Batch.base`` makes them absolute.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from sniffer.ground.asked import own_rows
from sniffer.ground.columnar import Columns, column_names

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

I64 = npt.NDArray[np.int64]
I16 = npt.NDArray[np.int16]
U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
F64 = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

NS: Final = 1_000_000_000
MS: Final = 1_000_000
NEVER_NS: Final = 1 << 62
"""Later than any stamp."""

GAP_MAX: Final = 1024
"""Longest run of unclaimed bytes explained in one go, in bytes: it bounds memory and latency."""


class Clock(enum.IntEnum):
    """Where a chunk's time comes from; it decides how far the time may be trusted."""

    NONE = 0  # the input has no times: they are counted from the bytes at the nominal baud
    FILE = 1  # timestamps in a text file
    READ = 2  # a live read of a serial port
    SAMPLE = 3  # a logic analyser


class Direction(enum.IntEnum):
    """Which wire a chunk came from, where two taps were merged."""

    UNKNOWN = 0
    TX = 1  # controller -> servo
    RX = 2  # servo -> controller


class MarkKind(enum.IntEnum):
    """What a live tap knows about its bytes that the bytes do not say."""

    FRAMING = 1  # the UART saw no stop bit (or, where the driver cannot tell, a parity error)
    PARITY = 2
    BREAK = 3  # the line was low for longer than a byte; it stands in the stream as 00
    OVERRUN = 4  # bytes were lost on the tap's side: in the adapter, the driver or its buffer
    LOST = 5  # the port went away
    BACK = 6  # the port is back; ``count`` is how long it was away, in ns
    REORDERED = 7  # put where causality wants it; ``count`` is by how much, in ns
    SKIPPED = 8  # the recorder had no time to decode what stands before; ``count`` bytes
    ENDED = 9  # the recording was stopped here: what is open was not waited for
    HELD = 10  # the tap itself came late: these bytes may be older than stamped by ``count`` ns
    MERGED = 11  # of two taps' lines in a log, merged: each stamp may lag by ``count`` ns
    SILENT = 12  # the line was taken for silent here: what was open was ended, whatever came later
    TUNED = 13  # the port listens at another rate from here on; ``count`` is the rate
    SENT = 14  # stamped before they were sent; what stands behind was heard ``count`` ns later
    COARSE = 15  # stamped by a clock that shows ``count`` ns at once: they may be older by as much


class Mark(NamedTuple):
    """One remark about a chunk.

    ``start`` counts from the chunk's first byte, negative where bytes before it are meant;
    ``length`` 0 stands for a place between two. They are a region of doubt: many adapters tell that
    there was an error in a packet, not where. ``count``: what a driver's counter told, or by kind.
    """

    kind: MarkKind
    start: int
    length: int = 0
    count: int = 1  # type: ignore[assignment]  # hides tuple.count, which nobody asks a mark for


@dataclass(frozen=True, slots=True, init=False)
class Chunk:
    """Bytes as one read delivered them; ``t_ns`` is the arrival time of the LAST byte.

    A chunk with marks may have no bytes.
    """

    data: bytes
    t_ns: int | None = None
    clock: Clock = Clock.NONE
    bus: str = "bus0"
    direction: Direction = Direction.UNKNOWN
    marks: tuple[Mark, ...] = ()

    def __init__(
        self,
        data: bytes,
        t_ns: int | None = None,
        clock: Clock = Clock.NONE,
        bus: str = "bus0",
        direction: Direction = Direction.UNKNOWN,
        marks: tuple[Mark, ...] = (),
    ) -> None:
        # A frozen dataclass sets its fields through object.__setattr__, which takes twice as long;
        # of a log with a line a packet a third of the time was that.
        _set_data(self, data)
        _set_t_ns(self, t_ns)
        _set_clock(self, clock)
        _set_bus(self, bus)
        _set_direction(self, direction)
        _set_marks(self, marks)


_set_data, _set_t_ns, _set_clock, _set_bus, _set_direction, _set_marks = (
    vars(Chunk)[f.name].__set__ for f in fields(Chunk)
)


# Frames.alt_id: the second id that may answer a request
NO_ALT: Final = -1
ANY_ID: Final = -2

DEPTH: Final = 16
"""A request is closed once as many others have asked after it. No controller asks so many servos in
one go; and they are few enough to close a request that nobody answered."""

# Frames.flags
MALFORMED: Final = 1  # checksum good, body not as the command's grammar has it
UNKNOWN: Final = 2  # checksum good, command not in the manual
RESETS: Final = 4  # the servo goes back to its defaults
ECHO_DIFFERS: Final = 8  # a reply that should repeat the request does not
UNUSUAL: Final = 16  # legal, but not in the form the manual gives
STAGED: Final = 32  # its values take effect with a later frame ...
RELEASES: Final = 64  # ... this one
ECHO: Final = 128  # an adapter's echo of the request before: judged as if it were not there


@dataclass(frozen=True, slots=True)
class Spans(Columns):
    """What framing alone knows, relative to the block."""

    start: I64
    end: I64
    kind: U8


@dataclass(frozen=True, slots=True)
class Frames(Columns):
    """Frames that hold, in wire order.

    ``token`` is what pairing compares: a request says which token its reply carries, a response
    its own (-1: fits any; ON_ITS_OWN: none). ``address``, ``status``, ``servo_id``: -1 is none.
    """

    start: I64
    length: I64
    kind: U8
    servo_id: I16
    op: I64
    address: I64
    data_start: I64
    data_length: I64
    status: I16
    reply: U8
    token: I64
    alt_id: I16
    flags: U8
    t_start: I64
    t_end: I64
    uncertainty: I64
    direction: U8

    @property
    def end(self) -> I64:
        """Offset behind each frame's last byte."""
        return self.start + self.length

    @classmethod
    def blank(cls, n: int) -> Self:
        """Return ``n`` rows that name nobody, state nothing and expect no reply, at time zero."""
        like = cls.empty()
        return cls(*(_unstated(name, n, getattr(like, name).dtype) for name in column_names(cls)))

    @classmethod
    def stating(cls, **columns: npt.NDArray[Any]) -> Self:
        """Return ``blank`` rows ``having`` these columns; nothing is laid out that they replace."""
        n, like = len(columns["start"]), cls.empty()
        out = []
        for name in column_names(cls):
            dtype = getattr(like, name).dtype
            told = columns.pop(name, None)
            out.append(
                _unstated(name, n, dtype) if told is None else told.astype(dtype, copy=False)
            )
        if columns:
            raise TypeError(f"frames have no {', '.join(columns)}")
        return cls(*out)


def _unstated(name: str, n: int, dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    """Return a column of frames that say nothing of it."""
    nothing = {"servo_id": -1, "address": -1, "status": -1, "alt_id": NO_ALT}.get(name, 0)
    return np.full(n, nothing, dtype) if nothing else np.zeros(n, dtype)


@dataclass(frozen=True, slots=True)
class Transactions(Columns):
    """A request with its response: row numbers in the batch's frames, -1 for none.

    A request of ``-2 - k`` is row k of ``Batch.before``: no row of the batch's own.
    ``response_time_ns`` is -1 where it is not known.
    """

    request: I64
    response: I64
    outcome: U8
    response_time_ns: I64
    uncertainty_ns: I64


@dataclass(frozen=True, slots=True)
class Samples(Columns):
    """Values by register; ``value`` is NaN where the packet states none in units.

    ``accepted`` is false for what a frame states without it becoming true: a refused write.
    """

    t_ns: I64
    servo_id: I16
    register: I16
    role: U8
    raw: I64
    value: F64
    provenance: U8
    part: U8
    row: I64
    accepted: Mask


class Gap(NamedTuple):
    """Bytes that no frame claims, and why.

    ``reason``: damaged, truncated, noise or idle_tail. ``detail`` holds the numbers.
    """

    start: int
    length: int
    reason: str
    detail: Mapping[str, Any] = MappingProxyType({})
    t_ns: int = 0


class Severity(enum.IntEnum):
    """How much an anomaly matters, in wireshark's words."""

    NOTE = 0
    WARN = 1
    ERROR = 2


class Anomaly(NamedTuple):
    """What the listener found; ``evidence`` is a tuple of (absolute offset, length).

    ``remedy`` is what to try in this very case; empty: what the catalogue says of its code.
    """

    t_ns: int
    severity: Severity
    group: str
    code: str
    servo_id: int | None
    detail: str
    evidence: tuple[tuple[int, int], ...]
    remedy: str = ""

    @property
    def known_at(self) -> int:
        """Offset of the last piece of evidence; the first may lie in an earlier batch."""
        return max(self.evidence)[0]


class Remark(NamedTuple):
    """A ``Mark`` at its place in the stream: ``start`` is absolute, ``t_ns`` its chunk's time."""

    kind: MarkKind
    start: int
    length: int
    count: int  # type: ignore[assignment]  # as in Mark
    t_ns: int

    @property
    def end(self) -> int:
        """Offset behind the region of doubt."""
        return self.start + self.length


class Cut(NamedTuple):
    """What the end of a capture leaves open, as absolute offsets.

    From ``asked`` on a request may still have been answered, from ``torn`` on a frame have begun.
    """

    asked: int
    torn: int


@dataclass(frozen=True, slots=True)
class Batch:
    """All that one pass decided: ``data`` is the bytes it accounts for."""

    base: int
    data: bytes
    clock: Clock
    frames: Frames
    gaps: Sequence[Gap]
    transactions: Transactions
    values: Samples
    anomalies: Sequence[Anomaly] = ()
    remarks: tuple[Remark, ...] = ()
    cut: Cut | None = None
    """Set where the capture ends with this batch and nobody knows of a silence behind it."""
    before: Frames | None = None
    """Requests that are no row here: of earlier batches, or what a list asks of each servo."""
    slower_ns: int = 0
    """By how much a byte may have taken longer than it is laid out for: nobody stated the rate."""
    models: Mapping[int, tuple[str, int]] = field(default_factory=dict)
    """Of servos met here whose model is not just assumed: its name, and on what grounds it is taken
    (``PROFILE``: it was named, ``OBSERVED``: the wire showed it), as the batch ends."""
    is_shared: bool = False
    """Another protocol is on the wire: what else ``data`` holds is in its batch of this pass."""
    chosen: Callable[[str], Mask] | None = None
    """Which rows are shown, by the name of their table (``selection``); None: all. Samples are the
    rows of ``values``. Whatever is counted, paired or judged takes all rows."""
    around: tuple[Mask, Mask] | None = None
    """Frames and gaps with which a selection is shown, its own among them; None: those alone."""

    def shows(self, table: str, count: int) -> Mask:
        """Return which of the ``count`` rows of a table are shown."""
        return np.ones(count, bool) if self.chosen is None else self.chosen(table)

    @property
    def samples(self) -> Samples:
        """The values that became true, of a selection those that are shown."""
        if self.chosen is not None:
            return self.values.take(self.chosen("samples"))
        if self.values.accepted.all():
            return self.values
        return self.values.take(self.values.accepted)

    def asked(self, request: I64) -> Frames:
        """Return the requests that ``Transactions.request`` names (not -1), also earlier ones."""
        return Frames.take(*self.asking(request))

    def asking(self, request: I64) -> tuple[Frames, I64]:
        """Return the same as frames and rows of theirs: for those who need few columns."""
        earlier = request < 0
        if self.before is None or not earlier.any():
            return self.frames, request
        both = Frames.concat([self.frames, self.before])
        return both, np.where(earlier, len(self.frames) - 2 - request, request)

    def rows_of(self, request: I64) -> I64:
        """Return which of its rows says each request; -1: none of them."""
        before = request[:0] if self.before is None else self.before.start
        return own_rows(self.frames.start, before, request)


class SnifferError(Exception):
    """Base of all errors the package raises for its callers: wrong call, unreadable file.

    Damage on the bus is never an exception, it is data.
    """


class DeclarationError(TypeError):
    """A protocol is declared in a form that there is none of; the sentence says what to write."""


class InputError(SnifferError):
    """The input cannot be read at all: what to do instead is in the message."""


class DamagedInputError(SnifferError):
    """The input broke off or is damaged beyond use; what could be read has been delivered."""


class OutputError(SnifferError):
    """An output cannot be written."""
