"""Incidents that are open: a file that begins while they are says so."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.diagnosis.tracking import Stage

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.diagnosis.tracking import IncidentChange


class OpenIncidents:
    """Remembers the last change of each incident that is not over."""

    def __init__(self) -> None:
        self._last: dict[int, IncidentChange] = {}

    @property
    def changes(self) -> Sequence[IncidentChange]:
        """The changes, in the order of the incidents."""
        return list(self._last.values())

    def take(self, changes: Iterable[IncidentChange]) -> None:
        """Take what has become of incidents."""
        for change in changes:
            if change.stage in (Stage.OPENED, Stage.CHANGED):
                self._last[change.incident.number] = change
            else:
                self._last.pop(change.incident.number, None)
