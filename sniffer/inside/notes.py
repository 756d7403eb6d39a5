"""The marks of a capture while it is looked at: which lines they stand at."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sniffer.ground.model import InputError, OutputError
from sniffer.inside.marks import NotedMark, mark_at, marks_file, marks_of, write_marks

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.inside.index import CaptureIndex


class Notes:
    """Marks, kept beside ``capture`` (None: nowhere)."""

    def __init__(self, capture: Path | None) -> None:
        self.marks: list[NotedMark] = []
        self._capture = capture
        self._lines: dict[NotedMark, int] = {}

    def load(self) -> None:
        """Take the marks that were set before.

        Raises:
            InputError: the file is none of marks.
        """
        if self._capture is not None:
            try:
                self.marks = marks_of(self._capture)
            except InputError:
                self._capture = None  # they are not written over
                raise

    def lines(self, index: CaptureIndex) -> dict[int, str]:
        """Return the notes by line, as far as the capture is read."""
        for mark in self.marks:
            if mark not in self._lines and (line := _line(index, mark)) >= 0:
                self._lines[mark] = line
        return {self._lines[m]: m.note for m in self.marks if m in self._lines}

    def add(self, index: CaptureIndex, line: int, note: str) -> None:
        """Set a mark.

        Raises:
            OutputError: it cannot be kept.
        """
        self._keep([*self.marks, mark_at(index, line, note)])

    def remove(self, index: CaptureIndex, line: int) -> None:
        """Take the marks of a line away.

        Raises:
            OutputError: the others cannot be kept.
        """
        self._keep([m for m in self.marks if self._lines.get(m) != line])

    def _keep(self, marks: list[NotedMark]) -> None:
        self.marks = sorted(marks)
        if self._capture is None:
            raise OutputError("there is no file to keep marks beside: they end with this screen")
        write_marks(marks_file(self._capture), self.marks)


def _line(index: CaptureIndex, mark: NotedMark) -> int:
    """Return where a mark stands, -1 where that is not read yet."""
    if mark.bus not in index.buses:
        return -1
    bus, t = index.buses.index(mark.bus), index.lines["t"]
    # times of several buses are nearly in order, those of one moment stand side by side
    first, last = np.searchsorted(t, (mark.t_ns, mark.t_ns + 1))
    near = index.lines[max(first - NEAR, 0) : last + NEAR]
    found = np.flatnonzero((near["at"] == mark.offset) & (near["bus"] == bus))
    return int(found[0]) + max(int(first) - NEAR, 0) if len(found) else -1


NEAR = 256
"""Lines beside its time in which a mark is looked for."""
