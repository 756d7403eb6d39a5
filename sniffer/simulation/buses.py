"""A simulated bus on a wire: timed frames whose truth is known. Bytes and times, no I/O.

``simulate`` is an endless iterator (or one of ``duration_s``); who plays it on a port keeps the
time.
"""

from __future__ import annotations

import random
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS, SnifferError
from sniffer.ground.wording import offered
from sniffer.simulation.faults import WEAR, Fault, Mischief
from sniffer.simulation.line import Wire
from sniffer.simulation.lss import LssBus
from sniffer.simulation.mightyzap import MightyZapBus
from sniffer.simulation.nerves import Nerves
from sniffer.simulation.rs30x import Rs30xBus
from sniffer.simulation.talk import USUAL, Bus, TrueFrame, Wait
from sniffer.simulation.wck import WckBus

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

BUSES: Final[Mapping[str, type[Bus]]] = MappingProxyType(
    {b.name: b for b in (MightyZapBus, LssBus, WckBus, Rs30xBus)}
)
"""The simulated protocols by name."""


def simulate(
    protocol: str,
    *,
    seed: int = 0,
    servo_ids: Sequence[int] | None = None,
    baud: int | None = None,
    rate_hz: int | None = None,
    faults: Sequence[Fault] = (),
    start_ns: int = 0,
    duration_s: float | None = None,
    full: bool = False,
    models: Mapping[int | None, str] = USUAL,
) -> Iterator[TrueFrame]:
    """Yield the frames of a bus in wire order.

    Args:
        protocol: a name of ``BUSES``.
        seed: the same seed gives the same frames.
        servo_ids: who is on the bus; the protocol's usual ids where None.
        baud: bits per second; the protocol's usual rate where None.
        rate_hz: cycles of the controller per second; it skips what the line has no time for.
        faults: what goes wrong.
        start_ns: the time of the first frame.
        duration_s: bus time after which nothing new is asked; None for ever.
        full: cycle after cycle with a bit between two frames, so that the line is loaded as far as
            it goes; ``rate_hz`` and the times of the manuals do not count then.
        models: servo id (None: all) -> model; the protocol's usual one where nothing is said.

    Raises:
        SnifferError: no such protocol, or no such model of it.
    """
    bus = put_up(
        protocol, seed=seed, servo_ids=servo_ids, baud=baud, rate_hz=rate_hz, models=models
    )
    if full:
        bus.cycle_ns = 1
    drawn = mischief(protocol, faults, seed)
    line = Wire(bus, drawn, seed, start_ns=start_ns, packed=full)
    nerves = Nerves(bus, drawn)
    return _talk(bus, line, nerves, None if duration_s is None else int(duration_s * NS))


def put_up(
    protocol: str,
    *,
    seed: int = 0,
    servo_ids: Sequence[int] | None = None,
    baud: int | None = None,
    rate_hz: int | None = None,
    models: Mapping[int | None, str] = USUAL,
) -> Bus:
    """Return a bus with its servos; what is None is as usual for the protocol.

    Raises:
        SnifferError: no such protocol, or no such model of it.
    """
    if protocol not in BUSES:
        raise SnifferError(f"no simulation of {protocol!r}: {offered(protocol, BUSES)}")
    kind = BUSES[protocol]
    for model in models.values():
        if model not in kind.tables:
            known = offered(model, kind.tables)
            raise SnifferError(f"no {protocol} simulation of the model {model!r}: {known}")
    return kind(
        seed,
        baud=baud or kind.baud,
        rate_hz=rate_hz or kind.rate_hz,
        servo_ids=servo_ids or kind.servo_ids,
        models=models,
    )


def mischief(protocol: str, faults: Sequence[Fault], seed: int) -> Mischief:
    """Return what draws the faults of a bus.

    Raises:
        SnifferError: nothing on a line of this protocol shows one of them.
    """
    for fault in faults:
        if fault.kind in BUSES[protocol].unknown_faults:
            raise SnifferError(f"{fault.kind}: nothing on a {protocol} bus would show that")
    return Mischief(faults, random.Random(f"{protocol} faults {seed}"))


def _talk(bus: Bus, line: Wire, nerves: Nerves, duration_ns: int | None) -> Iterator[TrueFrame]:
    talk = bus.talk()
    step = next(talk)
    while duration_ns is None or line.free_ns < duration_ns:
        heard = True
        if isinstance(step, Wait):
            yield from line.settle()
            for exchange in nerves.wear(line.free_ns):
                yield from (_marked(frame, WEAR) for frame in line.exchange(exchange))
                line.pause()
            line.free_ns = max(line.free_ns, nerves.waits(step.until_ns, line.free_ns))
        else:
            said = line.exchange(step)
            if nerves.struck is not None:  # the first frame of the cycle comes as it should not
                yield _marked(next(said), nerves.struck)
                nerves.struck = None
            heard = yield from said
            line.pause()
        line.pass_time(line.free_ns)
        step = talk.send(heard)


def _marked(frame: TrueFrame, fault: str) -> TrueFrame:
    """Return a frame that says what struck it, if nothing else did."""
    return frame if frame.fault else frame._replace(fault=fault)
