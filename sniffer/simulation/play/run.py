"""A simulated bus in real time, on a port: ``sniffer.play`` is what ``simulate`` calls."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sniffer.ground.collecting import Promptly
from sniffer.ground.files import refuse_occupied
from sniffer.ground.model import NS, SnifferError
from sniffer.ground.wording import Sentence
from sniffer.simulation.buses import simulate
from sniffer.simulation.play.opening import opened_port
from sniffer.simulation.play.outlet import FrameWriter, Written, unnoted
from sniffer.simulation.play.player import GROUP_NS, GROUPED_FROM, Player, SimulatedClock, Stop
from sniffer.simulation.play.truth import Truth
from sniffer.simulation.respond import Responder

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sniffer.simulation.play.scenario import Scenario
    from sniffer.simulation.provenance import Answered


@dataclass(frozen=True, slots=True)
class Played:
    """What was played: on the bus, on the tap if there was one, and how late the machine made it.

    ``held_up_ns`` is by how much the bus went on later because the machine was too busy.
    ``answered`` is where the values came from, where servos were to be like seen ones.
    """

    bus: Written
    tap: Written | None
    held_up_ns: int
    answered: Answered | None = None


def play(
    scenario: Scenario,
    *,
    port: str | None = None,
    transmit: bool = False,
    truth: Path | None = None,
    overwrite: bool = False,
    link: Path | None = None,
    tap: bool | None = None,
    tap_link: Path | None = None,
    stop: Stop | None = None,
    ready: Callable[[str, str | None], None] | None = None,
) -> Played:
    """Play a bus in real time until it is over.

    What is said while nobody has the port open is lost, as on a wire.

    Args:
        scenario: what is played.
        port: a port that is there; a new pseudo-terminal where None.
        transmit: it may be a serial port, and its servos may move.
        truth: a file for what really happened, as JSON lines.
        overwrite: it may be there already.
        link: a symbolic link that leads to the bus meanwhile.
        tap: with ``scenario.respond``: a second port repeats both sides of the talk (None: yes).
        tap_link: a link that leads there.
        stop: ends it from elsewhere.
        ready: takes the names of the bus and of the tap, once they can be opened.

    Raises:
        OutputError: a port, a link or the file cannot be had, or the port is a serial port and
            ``transmit`` was not said.
        SnifferError: things that do not go together were asked for.
    """
    _check(scenario, port, link, transmit=transmit, tap=tap, tap_link=tap_link)
    if truth is not None and not overwrite:
        refuse_occupied([truth])
    baud = scenario.line_baud
    with contextlib.ExitStack() as stack:
        first = stack.enter_context(opened_port(port, baud, link, transmit=transmit))
        second = None
        if scenario.respond and tap is not False:
            second = stack.enter_context(opened_port(None, baud, tap_link, transmit=False))
        stop = stop or stack.enter_context(contextlib.closing(Stop()))
        clock = SimulatedClock()
        told = None if truth is None else Truth(truth, clock)
        note = unnoted if told is None else told.add
        bus = FrameWriter(first, note if second is None else unnoted)
        repeated = None if second is None else FrameWriter(second, note)
        responder = _responder(scenario, bus) if scenario.respond else None
        if told is not None:
            told.head(scenario.facts())
            stack.callback(_close, told, repeated or bus, clock, responder)
        if ready is not None:
            ready(first.name, None if second is None else second.name)
        with Promptly():
            _play(scenario, clock, stop, bus, repeated, told, responder)
        bus.finish()
        if repeated is not None:
            repeated.finish()
        answered = _answered(responder)
    written = None if repeated is None else repeated.written
    return Played(bus.written, written, clock.lost_ns, answered)


def _responder(scenario: Scenario, bus: FrameWriter) -> Responder:
    return Responder(
        scenario.protocol,
        seed=scenario.seed,
        servo_ids=scenario.servo_ids,
        baud=scenario.line_baud,
        faults=scenario.faults,
        carried=bus.port.carries,
        models=scenario.models,
        like=scenario.like,
    )


def _answered(responder: Responder | None) -> Answered | None:
    return responder.tally.answered if responder is not None and responder.is_like else None


def _check(
    scenario: Scenario,
    port: str | None,
    link: Path | None,
    *,
    transmit: bool,
    tap: bool | None,
    tap_link: Path | None,
) -> None:
    if not scenario.respond and (tap is not None or tap_link is not None):
        raise SnifferError(Sentence("a tap repeats a talk: it needs {respond}"))
    if tap is False and tap_link is not None:
        raise SnifferError(Sentence("{tap_link} needs the tap: leave {tap:False} out"))
    if transmit and port is None:
        raise SnifferError(
            Sentence("{transmit:True} goes with {port}: a new pseudo-terminal sends nothing")
        )
    if port is not None and link is not None:
        raise SnifferError(Sentence("{port} has a name already: {link} is for a new one"))


def _play(
    scenario: Scenario,
    clock: SimulatedClock,
    stop: Stop,
    bus: FrameWriter,
    tap: FrameWriter | None,
    truth: Truth | None,
    responder: Responder | None,
) -> None:
    player = Player(clock, stop, (lambda: None) if truth is None else truth.flush)
    if responder is not None:
        note = unnoted if truth is None else truth.add
        player.respond(responder, bus, tap, note, duration_ns=scenario.duration_ns)
        return
    duration_s = None if scenario.duration_ns is None else scenario.duration_ns / NS
    player.play(
        simulate(
            scenario.protocol,
            seed=scenario.seed,
            servo_ids=scenario.servo_ids,
            baud=scenario.line_baud,
            rate_hz=scenario.cycles_hz,
            faults=scenario.faults,
            duration_s=duration_s,
            full=scenario.full,
            models=scenario.models,
        ),
        bus,
        group_ns=GROUP_NS if scenario.full or scenario.line_baud > GROUPED_FROM else 0,
        duration_ns=scenario.duration_ns,
    )


def _close(
    truth: Truth, told: FrameWriter, clock: SimulatedClock, responder: Responder | None
) -> None:
    truth.close(
        size=told.size,
        dropped=told.lost + told.overrun,
        behind_ns=clock.lost_ns,
        answered=_answered(responder),
    )
