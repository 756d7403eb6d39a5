"""Incidents while they happen: said, shown, recorded, and looked at by who waits for them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.tap.diagnosing import Diagnosing

if TYPE_CHECKING:
    from sniffer.jobs.files import RecordingFiles
    from sniffer.jobs.telling import Teller
    from sniffer.tap.reader import Anchor
    from sniffer.tap.recorder import Recorder
    from sniffer.tap.watching import Watch
    from sniffer.viewers.board.board import Board
    from sniffer.viewers.companion.parent import LiveView


class LiveIncidents:
    """Has the buses diagnosed while they are recorded, and hands on what becomes of incidents.

    Args:
        anchor: the clock of the recording.
        file: the recording.
        tell: says it in lines.
        board: shows those that are open.
        view: shows them in Rerun.
        watch: looks out for causes that somebody waits for.
        is_followed: whether somebody looks at them before they are in the file.
    """

    def __init__(
        self,
        anchor: Anchor,
        file: RecordingFiles | None,
        tell: Teller,
        *,
        board: Board | None = None,
        view: LiveView | None = None,
        watch: Watch | None = None,
        is_followed: bool = True,
    ) -> None:
        self.sink = Diagnosing(anchor.now, is_followed=is_followed)
        self._file = file
        self._tell = tell
        self._board = board
        self._view = view
        self._watch = watch
        self.sink.start()

    def look(self, recorder: Recorder) -> None:
        """Hand on what has become of incidents since.

        Raises:
            OutputError: the recording cannot be written.
        """
        changes = self.sink.take()
        if self._board is not None:
            self._board.incidents = self.sink.known()
        if not changes:
            return
        names = recorder.pipeline.summary.names
        for change in changes:
            self._tell.talk(names.sentence(change.incident.bus, str(change)))
        if self._watch is not None:
            self._watch.incidents(changes)
        if self._view is not None:
            self._view.incidents(changes)
        if self._file is not None and recorder.pipeline.has(self._file):
            self._file.incidents(changes)

    def finish(self, recorder: Recorder) -> None:
        """Judge what was decoded last, and hand that on.

        Raises:
            OutputError: the recording cannot be written.
        """
        self.sink.finish()
        self.look(recorder)
        if self.sink.failure is not None:
            self._tell.warn(f"the diagnosis stopped by itself: {self.sink.failure!r}")
        if self.sink.left_out:
            self._tell.talk(
                f"there was no time to diagnose {self.sink.left_out} bytes: `sniffer diagnose` does"
            )
