"""``sniffer.play_back``: a recording on a port: its line, its servos, or its controller."""

from __future__ import annotations

import contextlib
import enum
import functools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from sniffer.decoding.detect import ENOUGH
from sniffer.decoding.pipeline import AUTO, Options, Pipeline
from sniffer.ground.collecting import Promptly
from sniffer.ground.files import paths_of
from sniffer.ground.model import DamagedInputError, InputError, SnifferError
from sniffer.ground.schedule import checked
from sniffer.ground.timing import byte_time_ns
from sniffer.ground.wording import Sentence
from sniffer.jobs.asked import buses_of, only_bus
from sniffer.jobs.copying import Copies
from sniffer.jobs.cut import part_of
from sniffer.jobs.derived import Derived
from sniffer.jobs.order import merged
from sniffer.jobs.outputs import open_all, session_facts
from sniffer.jobs.replay import peek, spoken_by, timed, usual_baud
from sniffer.jobs.session import Ending, run_source, undecided_of
from sniffer.jobs.telling import Teller
from sniffer.playback.controller import ControllerPlayer
from sniffer.playback.exchanges import ExchangeSink
from sniffer.playback.line import PIECE_NS, LinePlayer
from sniffer.playback.outlets import await_listeners, check_ports, opened_ports
from sniffer.playback.servos import RecordedServos
from sniffer.reports.differing import differences
from sniffer.reports.runs import RunFigures
from sniffer.simulation.play.opening import opened_port
from sniffer.simulation.play.outlet import FrameWriter, unnoted
from sniffer.simulation.play.player import Player, SimulatedClock, Stop
from sniffer.sources.several import inputs_of, joined, name_of, open_capture

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.sink import Sink
    from sniffer.ground.model import Batch, Chunk
    from sniffer.playback.controller import ServosHeard
    from sniffer.playback.line import Pacing
    from sniffer.playback.servos import ServoAnswers
    from sniffer.protocols.base import BusProtocol
    from sniffer.reports.differing import RunDifference
    from sniffer.selection.places import Window
    from sniffer.simulation.play.outlet import Written
    from sniffer.sources import Source


class PlayedRole(enum.Enum):
    """What of a recording speaks."""

    LINE = "line"
    """Everything, as it was heard."""
    SERVOS = "servos"
    CONTROLLER = "controller"


@dataclass(frozen=True, slots=True)
class PlayedPorts:
    """Where it is played.

    Args:
        to: a port for each bus, in the order in which they first speak: a path, or ``"pty"`` for a
            pseudo-terminal that is made for it; one ``"pty"`` is for all of them.
        links: symbolic links that lead to new pseudo-terminals meanwhile, one a bus.
        transmit: a serial port may be among them, and its servos may move.
        tap: with servos: a second port repeats both sides of the talk.
        tap_link: a link that leads there.
        ready: takes what each port is called (a bus, or ``"bus"`` and ``"tap"``) and its name.
    """

    to: Sequence[str]
    links: Sequence[Path] = ()
    transmit: bool = False
    tap: bool | None = None
    tap_link: Path | None = None
    ready: Callable[[Mapping[str, str]], None] = lambda names: None


@dataclass(frozen=True, slots=True)
class PlayedBack:
    """What was played, and how the reading of the recording ended.

    ``ports`` says what became of the bytes for each port, by bus, or for ``bus`` and ``tap``.
    ``pacing`` is there for a line and a controller, ``answers`` for servos; for a controller
    ``hearing``, and ``slower``, where response times differ from those of the recording.
    """

    ports: Mapping[str, Written]
    ending: Ending
    pacing: Pacing | None = None
    answers: ServoAnswers | None = None
    hearing: ServosHeard | None = None
    slower: tuple[RunDifference, ...] = ()

    @property
    def as_recorded(self) -> bool:
        """Whether nothing was asked that the recording does not know, and all was answered."""
        known = self.answers is None or not self.answers.unknown
        return known and (self.hearing is None or self.hearing.all_answered)


def play_back(
    source: str | Path | Sequence[str | Path],
    ports: PlayedPorts,
    options: Options | None = None,
    *,
    role: PlayedRole = PlayedRole.LINE,
    input_format: str = "auto",
    window: Window | None = None,
    buses: Sequence[str] = (),
    speed: float = 1.0,
    loop: bool = False,
    echo: bool = False,
    outputs: str | Path | Sequence[str | Path] = (),
    overwrite: bool = False,
    stop: Stop | None = None,
    tell: Teller | None = None,
) -> PlayedBack:
    """Let a recording, or any capture, speak on ports; return what became of it.

    A line begins when somebody has opened the pseudo-terminals that are made for it.

    Args:
        source: a path, or ``"-"`` for standard input; several are one capture, read in the order
            of their times.
        ports: where.
        options: how it is decoded.
        role: who of the recording speaks.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        window: which part of it; all of it where None.
        buses: which of its buses; all of them where none is named.
        speed: times real time, of a line or a controller; 0: as fast as it goes.
        loop: the line begins again at its end, until it is stopped.
        echo: servos: who speaks hears itself, as with an adapter that does not mute itself.
        outputs: controller: files of its talk with the servos, as for ``convert``.
        overwrite: files that are there already are replaced.
        stop: ends it from elsewhere.
        tell: takes what should be told.

    Raises:
        InputError: the input cannot be read, its protocol cannot be told, or nothing is there.
        OutputError: a port cannot be had, or is a serial port and ``transmit`` was not said.
        SnifferError: things that do not go together were asked for.
    """
    outputs = paths_of(outputs)
    options = options or Options()
    options.check()
    tell = tell or Teller(lambda line: None, quiet=True)
    inputs = inputs_of(source)
    _check(role, ports, loop=loop, echo=echo, speed=speed)
    if outputs and role != PlayedRole.CONTROLLER:
        raise SnifferError("only a controller's talk with servos is new, and can be written")
    with contextlib.ExitStack() as stack:
        opened: Source = stack.enter_context(
            open_capture(inputs, input_format, again=True, wiring=options.wired)
        )
        if window is not None:
            opened, options = part_of(opened, joined(inputs), window, options, tell)
        else:
            options = options.with_facts(opened.facts(), opened.tables)
        stop = stop or stack.enter_context(contextlib.closing(Stop()))
        heard = Derived(opened, functools.partial(_until, stop), opened.facts())
        stack.enter_context(Promptly())
        stage = _Stage(heard, tuple(inputs), options, tuple(buses), ports, stop, tell)
        try:
            if role == PlayedRole.LINE:
                return _line(stage, speed, loop=loop)
            if role == PlayedRole.CONTROLLER:
                return _controller(stage, speed, outputs, overwrite=overwrite)
            return _servos(stage, echo=echo)
        except InputError:
            if stop.asked:  # before there was anything to play
                return PlayedBack({}, Ending.INTERRUPTED)
            raise


class _Stage(NamedTuple):
    """What is played, where, and who is told."""

    opened: Source
    inputs: tuple[str | Path, ...]
    options: Options
    buses: tuple[str, ...]
    ports: PlayedPorts
    stop: Stop
    tell: Teller

    @property
    def source(self) -> str:
        """The inputs, as they were named."""
        return joined(self.inputs)

    def merged(self, tell: Teller) -> Iterable[Sequence[Chunk]]:
        """Return all groups of chunks, in order."""
        return merged(self.opened, self.opened, self.options, tell)

    def refuse_if_stopped(self) -> None:
        """Play nothing of what was read in part only."""
        if self.stop.asked:
            raise InputError("stopped before anything was played")


def _until(stop: Stop, groups: Iterable[list[Chunk]]) -> Iterator[list[Chunk]]:
    """Yield groups as long as nobody wants it to stop."""
    for group in groups:
        if stop.asked:
            return
        yield group


def _check(role: PlayedRole, ports: PlayedPorts, *, loop: bool, echo: bool, speed: float) -> None:
    servos = role == PlayedRole.SERVOS
    if not servos and (ports.tap is not None or ports.tap_link is not None):
        raise SnifferError(Sentence("a tap repeats a talk: it needs {role:servos}"))
    if ports.tap is False and ports.tap_link is not None:
        raise SnifferError(Sentence("{tap_link} needs the tap: leave {tap:False} out"))
    if echo and not servos:
        raise SnifferError(Sentence("{echo} is for who speaks to {role:servos}"))
    if loop and role != PlayedRole.LINE:
        raise SnifferError(Sentence("{loop} is for a line: leave {role} out"))
    if checked(speed) != 1 and servos:
        raise SnifferError(
            Sentence("{speed} is for what keeps its own time: {role:servos} does not")
        )


def _line(stage: _Stage, speed: float, *, loop: bool) -> PlayedBack:
    """Play all bytes in their time."""
    ports, stop, tell = stage.ports, stage.stop, stage.tell
    bauds = _bauds(stage, _buses(stage))
    check_ports(ports.to, ports.links, list(bauds))
    ending = Ending.DONE
    with opened_ports(ports.to, ports.links, bauds, transmit=ports.transmit) as outlets:
        ports.ready({bus: outlet.port.name for bus, outlet in outlets.items()})
        await_listeners(list(outlets.values()), stop)
        player = LinePlayer(outlets, stop)
        again = True
        while again and not stop.asked:
            try:
                player.play(_timed(stage.merged(tell.quieter()), bauds), speed)
            except DamagedInputError as error:
                ending = Ending.DONE if stage.opened.format == "mcap" else Ending.DAMAGED
                tell.once(f"{error}: played as far as it goes")
            again = loop
        player.finish()
    return PlayedBack(_written(outlets), ending, pacing=player.pacing)


def _written(outlets: Mapping[str, FrameWriter]) -> dict[str, Written]:
    return {name: outlet.written for name, outlet in outlets.items()}


def _timed(groups: Iterable[Sequence[Chunk]], bauds: Mapping[str, int]) -> Iterator[Chunk]:
    """Yield the chunks of the buses that are played, all with times."""
    mine = (chunk for group in groups for chunk in group if chunk.bus in bauds)
    # an input without times has one bus
    yield from timed(mine, next(iter(bauds.values())), PIECE_NS)


def _buses(stage: _Stage) -> list[str]:
    """Return the buses that are to be played, in the order in which they first speak.

    Raises:
        InputError: nothing is in it, or not what is wanted.
    """
    found: dict[str, None] = {}
    with contextlib.suppress(DamagedInputError):  # it comes again when it is played
        for group in stage.merged(stage.tell):
            found |= {chunk.bus: None for chunk in group if chunk.data}
    stage.refuse_if_stopped()
    return buses_of(stage.source, list(found), stage.buses)


def _bauds(stage: _Stage, buses: Sequence[str]) -> dict[str, int]:
    """Return the rate of each bus: as stated, or as usual for what it speaks."""
    options = stage.options
    stated = [options.bauds.get(bus, options.baud) for bus in buses]
    if options.protocol == AUTO and None in stated:
        head, _ = peek((chunk for group in stage.opened for chunk in group), ENOUGH)
        told = {**spoken_by(head, options, stage.tell), **options.protocols}
        options = replace(options, protocols=told)
    return {bus: usual_baud(options, bus) for bus in buses}


def _heard(stage: _Stage, others: Sequence[Sink] = ()) -> tuple[ExchangeSink, str, Ending]:
    """Decode a recording; return its exchanges, and the one bus that is to be played.

    Raises:
        InputError: there is nothing to play.
        SnifferError: there is more than one bus.
    """
    sink = ExchangeSink()
    every = [sink, *others]
    with undecided_of(name_of(stage.source)):
        _, ending = run_source(
            stage.opened, stage.options, every, name=stage.source, tell=stage.tell
        )
    stage.refuse_if_stopped()
    bus = only_bus(stage.source, list(sink.buses), stage.buses)
    if not sink.buses[bus]:
        raise InputError(f"{stage.source}: no request was heard: there is nothing to play")
    return sink, bus, ending


def _servos(stage: _Stage, *, echo: bool) -> PlayedBack:
    """Let the servos answer a controller until it is stopped."""
    ports, stop = stage.ports, stage.stop
    sink, bus, ending = _heard(stage)
    if sink.echoes.get(bus) and not echo:
        told = "its controller heard itself, by its adapter's echo: {echo:True} plays that, too"
        stage.tell.talk(Sentence(told))
    check_ports(ports.to, ports.links, [bus])
    baud = sink.bauds[bus]
    with contextlib.ExitStack() as stack:
        opened = opened_ports(ports.to, ports.links, {bus: baud}, transmit=ports.transmit)
        outlets = {"bus": stack.enter_context(opened)[bus]}
        if ports.tap is not False:
            tap = opened_port(None, baud, ports.tap_link, transmit=False)
            outlets["tap"] = FrameWriter(stack.enter_context(tap))
        ports.ready({name: outlet.port.name for name, outlet in outlets.items()})
        servos = RecordedServos(
            sink.protocols[bus],
            sink.buses[bus],
            baud=baud,
            carried=outlets["bus"].port.carries,
            models=stage.options.models,
        )
        player = Player(SimulatedClock(), stop, lambda: None)
        player.respond(servos, outlets["bus"], outlets.get("tap"), unnoted, echo=echo)
        for outlet in outlets.values():
            outlet.finish()
    return PlayedBack(_written(outlets), ending, answers=servos.answers)


def _controller(
    stage: _Stage, speed: float, outputs: Sequence[Path], *, overwrite: bool
) -> PlayedBack:
    """Let the controller ask again; compare what is answered with what was."""
    ports, stop, tell = stage.ports, stage.stop, stage.tell
    then, now = RunFigures(), RunFigures()
    sink, bus, ending = _heard(stage, [_OneBus(then, stage.buses)])
    check_ports(ports.to, ports.links, [bus])
    baud, protocol = sink.bauds[bus], sink.protocols[bus]
    options = replace(stage.options, protocols={bus: protocol}, bauds={}, baud=baud)
    facts = session_facts(stage.source, options)
    # a port that is refused replaces no file
    with opened_ports(ports.to, ports.links, {bus: baud}, transmit=ports.transmit) as outlets:
        decoded, raw = open_all(outputs, facts, [*map(str, stage.inputs)], force=overwrite)
        copies = Copies(raw)
        pipeline = Pipeline(options, [now, *decoded])

        def heard(chunks: Sequence[Chunk]) -> None:
            for group in copies.of([chunks]):
                pipeline.feed(group)

        try:
            outlet = outlets[bus]
            ports.ready({bus: outlet.port.name})
            await_listeners([outlet], stop)
            byte_ns = byte_time_ns(baud)
            player = ControllerPlayer(outlet, protocol, byte_ns, bus=bus, stop=stop, heard=heard)
            player.play(sink.buses[bus], speed)
            outlet.finish()
            pipeline.close()
        finally:
            pipeline.finish()
            copies.finish(tell)
    found = differences(then, now).told
    slower = tuple(one for one in found if one.about == "response_time")
    written = _written(outlets)
    return PlayedBack(written, ending, pacing=player.pacing, hearing=player.hearing, slower=slower)


class _OneBus:
    """A sink that gets what is said on some buses only; all where none is named."""

    def __init__(self, sink: Sink, buses: Sequence[str]) -> None:
        self._sink = sink
        self._buses = buses

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Hand a batch on."""
        if not self._buses or bus in self._buses:
            self._sink.write(bus, protocol, batch)

    def close(self) -> None:
        """Do nothing."""
