"""Recordings that speak: played in threads of the tests' own process, and who listens to them."""

from __future__ import annotations

import contextlib
import os
import queue
import threading
from typing import TYPE_CHECKING, Any

from sniffer.decoding.options import Options
from sniffer.jobs.playback import PlayedBack, PlayedPorts, PlayedRole, play_back
from sniffer.simulation.play.player import Stop
from tests.simulations import DEADLINE_S
from tests.terminals import wait
from tests.transcripts import ROOT

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

CAPTURES = ROOT / "sample_captures"
CLEAN = {
    "mightyzap": CAPTURES / "mightyzap_clean.log",
    "lss": CAPTURES / "lss_clean.bin",
    "wck": CAPTURES / "wck_clean.log",
    "rs30x": CAPTURES / "rs30x_clean.hex",
}
DAMAGED = {name: CAPTURES / f"{name}_damaged.log" for name in CLEAN}


class Playing:
    """A recording that is played in a thread; ``names`` are its ports."""

    def __init__(
        self,
        source: Path,
        protocol: str,
        role: PlayedRole = PlayedRole.SERVOS,
        *,
        to: tuple[str, ...] = ("pty",),
        ports: Mapping[str, Any] | None = None,
        **more: Any,
    ) -> None:
        self._stop = Stop()
        self._names: queue.Queue[Mapping[str, str]] = queue.Queue()
        self._done: PlayedBack | BaseException | None = None
        place = PlayedPorts(to, ready=self._names.put, **(ports or {}))
        options = Options(protocol=protocol)

        def run() -> None:
            try:
                self._done = play_back(source, place, options, role=role, stop=self._stop, **more)
            except BaseException as error:  # raised where it is waited for
                self._done = error
            self._names.put({})

        self._thread = threading.Thread(target=run)
        self._thread.start()
        self.names = self._names.get(timeout=DEADLINE_S)

    def wait(self) -> PlayedBack:
        """Wait until it is over by itself."""
        self._thread.join(DEADLINE_S)
        assert not self._thread.is_alive()
        if not isinstance(self._done, PlayedBack):
            assert self._done is not None
            raise self._done
        return self._done

    def end(self) -> PlayedBack:
        """Stop it."""
        self._stop.ask()
        return self.wait()

    def close(self) -> None:
        """Give everything back."""
        self._stop.ask()
        self._thread.join(DEADLINE_S)
        self._stop.close()


@contextlib.contextmanager
def playing(*arguments: Any, **more: Any) -> Iterator[Playing]:
    it = Playing(*arguments, **more)
    try:
        yield it
    finally:
        it.close()


def wait_for_recorder(path: str) -> None:
    """Wait until a recorder has set a pseudo-terminal up."""
    import termios

    def is_set() -> bool:
        try:
            fd = os.open(path, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:  # it is reserved
            return True
        try:
            return bool(termios.tcgetattr(fd)[0] & termios.PARMRK)
        finally:
            os.close(fd)

    wait(is_set, "nobody records")
