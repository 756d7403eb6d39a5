"""The process beside a recording that serves it to Foxglove.

Started as ``python -m sniffer.viewers.companion.serving``; decodes as the one for Rerun does.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

from sniffer.decoding.pipeline import Pipeline
from sniffer.sinks.foxglove import FoxgloveSink
from sniffer.viewers.companion.child import Watcher, main
from sniffer.viewers.companion.parcels import SAY, address_in

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.viewers.companion.parcels import IncidentWord


class FoxgloveWatcher(Watcher):
    """Decodes what comes through the pipe and serves it. Nobody need look on."""

    @contextlib.contextmanager
    def _target(self) -> Iterator[str]:
        """Listen; yield where."""
        setup = self._setup
        bauds = dict.fromkeys(setup.buses, setup.options.baud) | {**setup.options.bauds}
        known = {bus: baud for bus, baud in bauds.items() if baud is not None}
        self._served = FoxgloveSink(setup.buses, known, *address_in(setup.address))
        self._tell(SAY, f"Foxglove finds the recording at {self._served.address}")
        yield self._served.address

    def _open(self, address: str) -> None:
        self._pipeline = Pipeline(self._setup.options, [self._served], live=True)

    def _incident(self, bus: str, word: IncidentWord) -> None:
        self._served.incident(bus, word.t_ns, word.severity, word.text)

    def _flush(self) -> None:
        """Send what was decoded; who looks on too slowly is left behind, and nobody waits."""
        self._served.flush()

    def _leave(self) -> None:
        self._served.close()


if __name__ == "__main__":
    main(FoxgloveWatcher)
