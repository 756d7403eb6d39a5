"""What a recording does when something is seen: it ends, a file is written, a command runs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sniffer.mcapfile.flight import FlightRecorder, Happening
from sniffer.tap.watching import Awaited, Watch, awaited_in
from sniffer.viewers.commands import Commands, Errand

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sniffer.decoding.pipeline import Options
    from sniffer.jobs.files import Files, RecordingFiles
    from sniffer.jobs.telling import Teller
    from sniffer.tap.recorder import Recorder
    from sniffer.tap.stops import Stops
    from sniffer.tap.watching import Sighting


@dataclass(frozen=True, slots=True)
class Waits:
    """What is waited for: to end by, to write a file by, and which command to run by it."""

    until: tuple[Awaited, ...] = ()
    triggers: tuple[Awaited, ...] = ()
    commands: tuple[tuple[Awaited, str], ...] = ()

    @classmethod
    def of(cls, stops: Stops, files: Files, commands: Iterable[tuple[str, str]]) -> Waits:
        """Read what was asked for.

        Raises:
            InputError: something is nothing that can be waited for.
        """
        triggers = files.flight.triggers if files.flight is not None else ()
        return cls(
            tuple(map(awaited_in, stops.until)),
            tuple(map(awaited_in, triggers)),
            tuple((awaited_in(what), command) for what, command in commands),
        )

    @property
    def every(self) -> tuple[Awaited, ...]:
        """All of it."""
        return (*self.until, *self.triggers, *(wanted for wanted, _ in self.commands))

    def judged(self, options: Options) -> Options:
        """Return options by which the rules among it are judged."""
        rules = [wanted.alarm for wanted in self.every if wanted.alarm is not None]
        return replace(options, alarms=tuple(dict.fromkeys((*options.alarms, *rules))))


class Reactions:
    """Looks at what was seen, once a round, and does what it was asked for.

    Args:
        waits: what is waited for.
        file: what the recording goes to: a flight recorder writes a file where a trigger is met.
        tell: takes what commands say.
    """

    def __init__(self, waits: Waits, file: RecordingFiles | None, tell: Teller) -> None:
        self.watch = Watch(waits.every)
        self._waits = waits
        self._flight = file if isinstance(file, FlightRecorder) else None
        self._tell = tell
        self._commands = Commands(tell.talk, tell.warn) if waits.commands else None

    def look(self, recorder: Recorder) -> None:
        """React to what was seen since.

        Raises:
            OutputError: a file cannot be begun.
        """
        for seen in self.watch.take():
            if seen.wanted in self._waits.until and recorder.wishes.stop is None:
                recorder.wishes.stop = f"{seen.name} on {seen.bus}: {seen.what}"
            if self._flight is not None and seen.wanted in self._waits.triggers:
                self._flight.happened(_happening(seen))
            if seen.is_new:
                self._run(seen)

    def close(self) -> None:
        """Wait a little for commands that run."""
        if self._commands is None:
            return
        self._commands.close()
        if self._commands.left_out:
            self._tell.warn(f"{self._commands.left_out} commands were left out: too many were due")

    def _run(self, seen: Sighting) -> None:
        for wanted, command in self._waits.commands:
            if wanted == seen.wanted and self._commands is not None:
                told = {
                    "SNIFFER_CAUSE": seen.name,
                    "SNIFFER_SERVOS": " ".join(map(str, seen.servo_ids)),
                    "SNIFFER_BUS": seen.bus,
                    "SNIFFER_T_NS": str(seen.t_ns),
                    "SNIFFER_WHAT": seen.what,
                }
                self._commands.run(Errand(str(wanted), command, told))


def _happening(seen: Sighting) -> Happening:
    return Happening(
        seen.t_ns,
        seen.bus,
        f"{seen.name} on {seen.bus}: {seen.what}",
        str(seen.wanted),
        seen.servo_ids,
        seen.last_ns,
        seen.is_new,
    )
