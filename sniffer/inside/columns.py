"""Columns that grow, in a temporary file that the system keeps in memory as far as it has room."""

from __future__ import annotations

import tempfile
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.model import Severity

if TYPE_CHECKING:
    import numpy.typing as npt

FIRST: Final = 1 << 16
"""Rows there is room for at first; it doubles."""

LINE: Final = np.dtype(
    [
        ("t", np.int64),
        ("at", np.int64),
        ("took", np.int64),
        ("spread", np.int64),
        ("partner", np.int64),
        ("page", np.int32),
        ("row", np.int32),
        ("length", np.int32),
        ("address", np.int32),
        ("servo", np.int16),
        ("op", np.uint16),
        ("kind", np.uint8),
        ("severity", np.uint8),
        ("bus", np.uint16),
        ("outcome", np.uint8),
    ]
)
"""A line of the list, 65 bytes: end in ns, offset in its bus, response time in ns (-1: not known)
and its uncertainty, line of the other half of its exchange (-1: none), where the rest of it is
(``row`` of the page's frames or gaps), bytes, address (-1), servo (-1), command
(``CaptureIndex.ops``), who speaks, ``NO_FINDING`` or a severity + 1, bus (``CaptureIndex.buses``),
outcome or ``NO_OUTCOME``."""

FOUND: Final = np.dtype(
    [
        ("t", np.int64),
        ("line", np.int64),
        ("page", np.int32),
        ("row", np.int32),
        ("code", np.int16),
        ("servo", np.int16),
        ("severity", np.uint8),
    ]
)
"""An anomaly: its time, the line of its first piece of evidence, where the rest of it is, its code
(``anomalies.found.CODES``), servo (-1) and severity + 1."""

GAP: Final = 2
"""``kind`` of bytes that no frame claims; below it are ``codes.Kind``."""

NO_FINDING: Final = 0
"""Of ``severity``; what was found has one more than the level itself."""

ERROR: Final = Severity.ERROR + 1
WARN: Final = Severity.WARN + 1
NO_OUTCOME: Final = 255

Table = Any
"""Rows of ``LINE`` or ``FOUND``."""


class Growing:
    """Rows of one kind; one thread appends, any may read what ``rows`` returned."""

    def __init__(self, dtype: npt.DTypeLike) -> None:
        self._dtype = np.dtype(dtype)
        self._file = tempfile.TemporaryFile(prefix="sniffer-")  # noqa: SIM115 - as long as this
        self._count = 0
        self._room = self._mapped(FIRST)
        self.rows: Table = self._room[:0]
        """What is there."""

    def __len__(self) -> int:
        return self._count

    def append(self, more: Table) -> None:
        """Add rows."""
        end = self._count + len(more)
        if end > len(self._room):
            size = len(self._room)
            while size < end:
                size *= 2
            self._room = self._mapped(size)
        self._room[self._count : end] = more
        self._count = end
        self.rows = self._room[:end]

    def close(self) -> None:
        """Give the file back; rows that somebody has stay as they are."""
        self._file.close()

    def _mapped(self, rows: int) -> Table:
        self._file.truncate(rows * self._dtype.itemsize)
        return np.memmap(self._file, self._dtype, "r+", shape=(rows,))
