"""What a recording tells its user: while it runs, and at its end."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS
from sniffer.ground.wording import Sentence, counted

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from sniffer.decoding.detect import Detection
    from sniffer.decoding.rates import RateSearch
    from sniffer.mcapfile.flight import FlightRecorder
    from sniffer.mcapfile.rotation import RotatingMcap
    from sniffer.tap.reader import Anchor
    from sniffer.tap.recorder import Recorder
    from sniffer.viewers.screen import Screen

MISTAKES_S: Final = 5.0
"""How often it is looked whether a bus speaks another protocol than was said."""

STEP_NS: Final = NS // 10
"""A step of the system clock that is worth a word."""

_RECORDED: Final = ": they are recorded; decode them with {protocol}, or see `sniffer doctor`"


class Teller:
    """What is told while it runs; once a screen is there, above it.

    Args:
        say: takes a line for people; it must not wait for them.
        quiet: only what went wrong is told.
    """

    def __init__(self, say: Callable[[str], None], *, quiet: bool = False) -> None:
        self.screen: Screen | None = None
        self._say = say
        self._quiet = quiet
        self._told: set[str] = set()
        self._look_at = time.monotonic() + MISTAKES_S

    def quieter(self) -> Teller:
        """Return one that says only what went wrong."""
        return Teller(self._say, quiet=True)

    def talk(self, message: str) -> None:
        """Tell something, unless quiet was asked for."""
        if not self._quiet:
            self.warn(message)

    def warn(self, message: str) -> None:
        """Tell what the user must know."""
        if self.screen is not None:
            self.screen.say(message)
        else:
            self._say(message)

    def once(self, message: str) -> None:
        """Tell what the user must know, but not again and again."""
        if message not in self._told:
            self._told.add(message)
            self.warn(message)

    def found(self, bus: str, detection: Detection) -> None:
        """Tell which protocol a bus was found to speak."""
        self.talk(f"{bus}: {detection}")

    def tuned(self, bus: str, search: RateSearch) -> None:
        """Tell which rate a bus was found to have."""
        others = ", ".join(str(baud) for baud in dict.fromkeys(search.tried))
        if not search.is_found:
            self.talk(f"{bus}: its rate was not found; read as {search.baud} bit/s")
        elif others:
            self.talk(f"{bus}: {search.baud} bit/s; nothing held at {others}")
        else:
            self.talk(f"{bus}: {search.baud} bit/s")

    def mistaken(self, recorder: Recorder) -> None:
        """Tell of buses that speak something else than was said."""
        if all(recorder.pipeline.speaks(tap.spec.bus) for tap in recorder.taps):
            for rule in recorder.pipeline.unmet():
                self.once(rule)
        for mistake in recorder.pipeline.mistaken():
            if mistake.bus not in self._told:
                self._told.add(mistake.bus)
                self.warn(f"{mistake} so far, it looks like {mistake.found}")

    def look(self, recorder: Recorder) -> None:
        """Tell what has gone wrong, once each."""
        if recorder.pipeline.failure is not None:
            self.once(str(recorder.pipeline.failure))
        if time.monotonic() >= self._look_at:
            self._look_at = time.monotonic() + MISTAKES_S
            self.mistaken(recorder)


def result(
    recorder: Recorder,
    ended: str,
    file: RotatingMcap | FlightRecorder | None,
    anchor: Anchor,
    tell: Teller,
) -> None:
    """Say what there is now; what went wrong is said also where quiet was asked for."""
    keeps_all = file is None or file.holds_all
    if ended:
        tell.talk(f"stopped: {ended}")
    taps = recorder.taps
    size = sum(tap.bytes for tap in taps)
    if not size:
        tell.warn(f"no byte was heard; `sniffer doctor {taps[0].spec.port}` tells more")
        return
    totals = recorder.pipeline.summary.buses.values()
    frames = sum(sum(b.kinds.values()) for b in totals)
    gaps = sum(b.bytes_in_gaps for b in totals)
    anomalies = sum(sum(b.codes.values()) for b in totals)
    tell.talk(
        f"{counted(size, 'byte')} {'recorded' if keeps_all else 'heard'}, "
        f"{counted(frames, 'frame')}, {counted(gaps, 'byte')} in no frame, "
        f"{anomalies} {'anomaly' if anomalies == 1 else 'anomalies'}"
        f"{_where(None if file is None else file.files)}"
    )
    by_bus: dict[str, int] = {}
    for tap in taps:
        by_bus[tap.spec.bus] = by_bus.get(tap.spec.bus, 0) + tap.bytes
        if not tap.bytes:
            port = tap.spec.port
            tell.talk(f"{tap.spec.bus}: no byte was heard; `sniffer doctor {port}` tells more")
    for bus, heard in by_bus.items():
        if heard and recorder.pipeline.speaks(bus) is None:
            told = "{bus}: its protocol could not be told from {heard} bytes"
            told += _RECORDED if keeps_all else "; `sniffer doctor` tells more"
            tell.warn(Sentence(told, bus=bus, heard=heard))
    tell.mistaken(recorder)
    if recorder.skipped:
        tell.warn(
            f"{recorder.skipped} bytes were recorded but not decoded: decode the recording again"
        )
    step = anchor.step_ns()
    if abs(step) > STEP_NS:
        tell.talk(
            f"the system clock moved by {step / NS:+.1f} s meanwhile; the stamps did not follow"
        )


def _where(files: Sequence[Path] | None) -> str:
    """Return which files there are now."""
    if files is None:
        return ""
    if not files:
        return ": nothing happened that a file was to be written for"
    last = ", ".join(str(path) for path in files[-3:])
    return f": {len(files)} files, the last {last}" if len(files) > 3 else f": {last}"
