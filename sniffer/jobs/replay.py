"""A recording again in real time: groups of chunks handed out when their moment has come."""

from __future__ import annotations

import contextlib
import functools
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from sniffer.decoding.detect import ENOUGH, UndecidedError, detect
from sniffer.decoding.partends import BusEnds
from sniffer.decoding.pipeline import AUTO, Options
from sniffer.decoding.sink import over
from sniffer.ground.files import paths_of
from sniffer.ground.heard import SteadyTime
from sniffer.ground.limits import FALLBACK_BAUD
from sniffer.ground.model import (
    NS,
    Chunk,
    Clock,
    DamagedInputError,
    SnifferError,
)
from sniffer.ground.schedule import Schedule, checked
from sniffer.ground.timing import byte_time_ns
from sniffer.ground.wording import Sentence
from sniffer.jobs.aside import kept_aside
from sniffer.jobs.asked import Extract, refuse_part_of
from sniffer.jobs.copying import Copies
from sniffer.jobs.order import merged
from sniffer.jobs.outputs import open_all, session_facts, told_part
from sniffer.jobs.session import Ending, run_source, undecided_of
from sniffer.jobs.telling import Teller
from sniffer.sources.several import inputs_of, joined, name_of, open_capture

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from sniffer.decoding.sink import Sink
    from sniffer.jobs.session import Patience
    from sniffer.protocols.base import BusProtocol
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection

STEP_NS: Final = 50_000_000
"""Chunks within 50 ms of the recording go out together: a decoder pass costs about the same for
one chunk as for all of them, and eyes see no more."""

PAUSE_NS: Final = 200_000_000
"""From so long a wait on, what is shown waits for no more: eyes see it."""

NAP_S: Final = 0.25
"""How long a key may wait that is pressed right before a sleep."""


def peek(chunks: Iterable[Chunk], size: int) -> tuple[list[Chunk], Iterator[Chunk]]:
    """Return the first chunks, ``size`` bytes or a little more, and all of them again."""
    rest, head, damage, have = iter(chunks), list[Chunk](), None, 0
    try:
        while have < size and (chunk := next(rest, None)) is not None:
            head.append(chunk)
            have += len(chunk.data)
    except DamagedInputError as error:  # it comes again, behind what could be read
        damage = error

    def again() -> Iterator[Chunk]:
        yield from head
        if damage is not None:
            raise damage
        yield from rest

    return head, again()


def timed(chunks: Iterable[Chunk], baud: int, step_ns: int = STEP_NS) -> Iterator[Chunk]:
    """Yield chunks that all have a time: where there is no clock, the wire's own pace.

    Such chunks may be large: they come in pieces no longer than a step.
    """
    byte_ns = byte_time_ns(baud)
    piece = max(1, step_ns // byte_ns)
    last = 0
    for chunk in chunks:
        if chunk.t_ns is not None:
            last = chunk.t_ns
            yield chunk
            continue
        for at in range(0, len(chunk.data), piece):
            data = chunk.data[at : at + piece]
            last += len(data) * byte_ns
            yield replace(chunk, data=data, t_ns=last)


def steps(chunks: Iterable[Chunk]) -> Iterator[list[Chunk]]:
    """Group chunks into steps of the recording's time; what came before damage is not lost."""
    group: list[Chunk] = []
    try:
        for chunk in chunks:
            if group and (chunk.t_ns or 0) - (group[0].t_ns or 0) >= STEP_NS:
                yield group
                group = []
            group.append(chunk)
    except DamagedInputError:
        if group:
            yield group
        raise
    if group:
        yield group


def nap(seconds: float, sleep: Callable[[float], None] = time.sleep) -> None:
    """Sleep in pieces: Ctrl-C that comes right before Python begins to sleep is heard behind it.

    Handlers of signals run between two steps of the interpreter. One that comes when the last of
    them is over, and the system call has not begun, cuts no sleep short.
    """
    until = time.monotonic() + seconds
    while (left := until - time.monotonic()) > 0:
        sleep(min(left, NAP_S))


def paced(
    groups: Iterable[list[Chunk]],
    speed: float,
    *,
    ends: BusEnds | None = None,
    now: Callable[[], int] = time.monotonic_ns,
    sleep: Callable[[float], None] = nap,
    pausing: Callable[[int], None] = lambda until_ns: None,
) -> Iterator[list[Chunk]]:
    """Yield each group at its own moment; ``speed`` 0 does not wait at all.

    What lies outside ``ends``, those of the part that is shown, is not waited for.
    ``pausing`` is told before a long wait up to which time nothing more was said.

    Moments are those of a ``Schedule``, counted from the first group.
    """
    schedule, steady = Schedule(speed), SteadyTime()
    for group in groups:
        t = group[-1].t_ns or 0
        if ends is not None and not ends.have(t, steady.at(t) - t):
            pass
        elif speed > 0:
            wait = schedule.due_ns(t, now()) - now()
            if wait > PAUSE_NS:
                pausing(group[0].t_ns or 0)
            if wait > 0:
                sleep(wait / NS)
        # a pace given for want of a clock is no time to be decoded
        yield [replace(k, t_ns=None) if k.clock == Clock.NONE else k for k in group]


def replay(
    source: str | Path | Sequence[str | Path],
    show: Callable[[], Sink],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    window: Window | None = None,
    selection: Selection | None = None,
    speed: float = 1.0,
    loop: bool = False,
    outputs: str | Path | Sequence[str | Path] = (),
    overwrite: bool = False,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Ending:
    """Play a recording, or any capture, again in real time; return how it ended.

    Args:
        source: a path, or ``"-"`` for standard input; several are one capture, read in the order
            of their times.
        show: opens what it is shown in; called once each time that it is played.
        options: how it is decoded.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        window: which part of it; all of it where None.
        selection: which records are shown.
        speed: times real time; 0 does not wait at all.
        loop: begin again at the end, until it is interrupted.
        outputs: files that what is played is written to, too, as for ``convert``.
        overwrite: files that are there already are replaced.
        patience: takes interruptions.
        tell: takes what should be told.

    Raises:
        InputError: the input cannot be read, its protocol cannot be told, or the window is empty.
        OutputError: a file cannot be written.
        SnifferError: standard input can be read only once.
    """
    outputs = paths_of(outputs)
    if loop and outputs:
        raise SnifferError(Sentence("{loop} plays the same again: it is written once, without"))
    inputs = inputs_of(source)
    if loop and "-" in map(str, inputs):
        raise SnifferError(Sentence("{loop} needs a file: standard input can be read only once"))
    checked(speed)
    options = options or Options()
    options.check()
    asked = Extract.of(selection, window)
    refuse_part_of(asked, [path.suffix.lower() for path in outputs])
    tell = tell or Teller(lambda line: None, quiet=True)
    again = tell.quieter()
    name = name_of(inputs)
    ending, played = Ending.DONE, False
    while ending == Ending.DONE and (loop or not played):
        now = again if played else tell
        twice = asked is not None and asked.seeks
        opened = open_capture(inputs, input_format, again=twice, wiring=options.wired)
        facts = opened.facts()
        if (about := told_part(facts)) is not None:
            now.talk(about)
        options = options.with_facts(facts, opened.tables)
        if asked is not None:
            asked = asked.sought_in(opened, options)
        heard = merged(opened, opened, options, now)
        chunks: Iterable[Chunk] = (chunk for group in heard for chunk in group)
        # looked at beforehand: what is to be played in real time cannot wait for it
        head, chunks = peek(chunks, ENOUGH)
        if options.protocol == AUTO and not played:
            told = {**spoken_by(head, options, now), **options.protocols}
            options = replace(options, protocols=told)
        ends = None if asked is None else BusEnds(asked.ends(_first_time(head)))
        baud = usual_baud(options, head[0].bus if head else "")
        sink = show()
        pausing = functools.partial(_pause, sink)
        groups = paced(steps(timed(chunks, baud)), speed, ends=ends, pausing=pausing)
        session = session_facts(opened.origin(joined(inputs)), options, facts)
        with kept_aside() as aside:
            decoded, raw = open_all(
                outputs, session, [*map(str, inputs)], force=overwrite, aside=aside
            )
            copies = Copies(raw)
            try:
                with undecided_of(name):
                    _, ending = run_source(
                        opened,
                        options,
                        [sink, *decoded],
                        name=name,
                        tell=now,
                        patience=patience,
                        groups=copies.of(groups) if raw else groups,
                        ahead=head,
                        asked=asked,
                    )
            finally:
                copies.finish(now)
        played = True
    return ending


def _pause(sink: Sink, until_ns: int) -> None:
    """Have shown what waits for other buses: in a long pause nobody says anything before it."""
    over(sink, until_ns=until_ns, open_buses=())


def _first_time(head: Iterable[Chunk]) -> int | None:
    """Return the time of the first byte, None where there is no clock."""
    return next((chunk.t_ns for chunk in head if chunk.data), None)


def spoken_by(
    head: Iterable[Chunk], options: Options, tell: Teller
) -> dict[str, str | BusProtocol]:
    """Return the protocol of each bus, and say so; what cannot be told yet is left out.

    What a recording says of itself is known: the bytes are not asked against it.
    """
    by_bus: dict[str, list[Chunk]] = {}
    for chunk in head:
        by_bus.setdefault(chunk.bus, []).append(chunk)
    out: dict[str, str | BusProtocol] = {}
    for bus, chunks in by_bus.items():
        with contextlib.suppress(UndecidedError):
            found = detect(chunks, options.bauds.get(bus, options.baud))
            if options.protocols.get(bus, found.protocol) == found.protocol:
                tell.found(bus, found)
            out[bus] = found.protocol
    return out


def usual_baud(options: Options, bus: str) -> int:
    """Return the rate of a bus without times: what was said, or what its protocol has."""
    if stated := options.bauds.get(bus, options.baud):
        return stated
    named = options.protocols.get(bus, options.protocol)
    return FALLBACK_BAUD if named == AUTO else options.all_spoken(named)[0].baud
