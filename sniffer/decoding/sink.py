"""What a sink is: it takes raw chunks and decoded batches, and is closed once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from sniffer.ground.model import Batch, InputError, OutputError
from sniffer.protocols.base import BusProtocol

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.called import ServoNames
    from sniffer.decoding.pacing import Pace
    from sniffer.decoding.rates import Rate
    from sniffer.ground.model import Chunk


Part = tuple[BusProtocol, Batch]
"""What one protocol said in a pass."""


class Sink(Protocol):
    """An output. Raises OutputError where it cannot write."""

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks as they came, before they are decoded."""
        ...

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided."""
        ...

    def close(self) -> None:
        """Finish the output; called once, also after an interruption."""
        ...


@runtime_checkable
class Together(Protocol):
    """A sink that writes in wire order, also where two protocols share the wire.

    Others are given what each of them says, one after the other, with ``Batch.is_shared``.
    """

    def write_together(self, bus: str, parts: Sequence[Part]) -> None:
        """Take what one pass decided of each protocol, all of it of the same bytes."""
        ...


def bus_of(bus: str, protocol: BusProtocol, batch: Batch) -> str:
    """Return what tells a bus's records apart by protocol, where it has two: ``bus0.lss``."""
    return f"{bus}.{protocol.name}" if batch.is_shared else bus


@runtime_checkable
class Paced(Protocol):
    """A sink that wants to know by which rate and latency a bus is timed."""

    def pace(self, bus: str, told: Pace) -> None:
        """Take what a bus is timed by; called once, before its first record."""
        ...


@runtime_checkable
class Tuned(Protocol):
    """A sink that wants to know which rate a recorder has found."""

    def tuned(self, bus: str, rate: Rate) -> None:
        """Take the rate of a bus; called once, before its first record."""
        ...


@runtime_checkable
class Timely(Protocol):
    """A sink that tells what several buses say in the order of time."""

    def passed(self, until_ns: int | None, open_buses: Collection[str]) -> None:
        """Learn that a pass is over.

        All that was said before ``until_ns`` was told, but for what is not decided yet of
        ``open_buses``. None: there are no times.
        """
        ...


@runtime_checkable
class Narrowed(Protocol):
    """A sink that says of what it writes that it is not all there is."""

    def narrow(self, told: Mapping[str, Any]) -> None:
        """Take what was asked for.

        Of a selection ``where``, its expression, ``tables``, those it speaks of, and ``context``,
        how many lines are shown around each of its rows, where any are; of a part of a capture
        ``part``, in words, with ``from_ns`` and ``to_ns``, None for the capture's own ends,
        and ``first_ns``, when its first record was, None without a clock.
        """
        ...


@runtime_checkable
class Calling(Protocol):
    """A sink that shows servos to people, by the names that they have."""

    def call(self, names: ServoNames) -> None:
        """Take what servos are called; called once, before the first record."""
        ...


@runtime_checkable
class Ruled(Protocol):
    """A sink that says how long rules of the user's own were met."""

    def rule(self, alarms: Sequence[Alarm]) -> None:
        """Take the rules, those of the recording among them; called once, as ``call`` is."""
        ...


def introduced(
    sinks: Iterable[Sink], names: ServoNames, alarms: Sequence[Alarm] = ()
) -> list[Sink]:
    """Return sinks that have been told names of servos and rules, if they want to know."""
    out = list(sinks)
    for sink in out:
        if isinstance(sink, Calling):
            sink.call(names)
        if isinstance(sink, Ruled):
            sink.rule(alarms)
    return out


def act(what: Callable[[Sink], None], sink: Sink) -> None:
    """Do something with a sink; what nobody has foreseen is its failure, not that of the others.

    Raises:
        InputError: it can do nothing with what is decoded.
        OutputError: it failed.
        BrokenPipeError: nobody reads what it writes.
    """
    try:
        what(sink)
    except (InputError, OutputError, BrokenPipeError):
        raise
    except Exception as error:
        why = f"{type(error).__name__}: {error}"[:200]
        raise OutputError(f"{type(sink).__name__} failed ({why}); it is left as it is") from error


def taken(sink: Sink, *, bus: str, chunks: Sequence[Chunk]) -> None:
    """Hand chunks to a sink."""
    sink.raw(bus, chunks)


def written(sink: Sink, *, bus: str, parts: Sequence[Part]) -> None:
    """Hand to a sink what one pass decided."""
    if len(parts) > 1 and isinstance(sink, Together):
        sink.write_together(bus, parts)
        return
    for protocol, batch in parts:
        sink.write(bus, protocol, batch)


def over(sink: Sink, *, until_ns: int | None, open_buses: Collection[str]) -> None:
    """Tell a sink that a pass is over, if it wants to know."""
    if isinstance(sink, Timely):
        sink.passed(until_ns, open_buses)


def closed(sink: Sink) -> None:
    """Close a sink."""
    sink.close()
