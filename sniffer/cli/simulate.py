"""``sniffer simulate``: a bus without hardware, on a pseudo-terminal."""

from __future__ import annotations

import contextlib
import math
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sniffer import __version__
from sniffer.cli.amounts import Duration
from sniffer.cli.options import ProtocolName, Whole, check_models, examples, models, with_force
from sniffer.cli.streams import say
from sniffer.ground.files import refuse_occupied
from sniffer.ground.limits import BAUDS
from sniffer.ground.model import NS, OutputError, SnifferError

if TYPE_CHECKING:
    from sniffer.simulation import Fault, TrueFrame
    from sniffer.simulation.play.outlet import FrameWriter
    from sniffer.simulation.play.player import SimulatedClock, Stop
    from sniffer.simulation.play.ports import PlayPort
    from sniffer.simulation.play.truth import Truth

MAX = "max"
"""The ``--rate`` of a line that is loaded as far as it goes."""

RATE_MOST = 100_000


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be played, and where."""

    protocol: str
    servo_ids: tuple[int, ...]
    baud: int
    rate_hz: int | None
    full: bool
    seed: int
    duration_ns: int | None
    faults: tuple[Fault, ...]
    respond: bool
    device: str | None
    models: Mapping[int | None, str]

    def facts(self) -> dict[str, Any]:
        """Return the first line of the truth."""
        struck = [
            {
                "kind": f.kind,
                "rate": f.rate,
                "servo_id": f.servo_id,
                "first_s": f.first_s,
                "last_s": None if math.isinf(f.last_s) else f.last_s,
            }
            for f in self.faults
        ]
        return {
            "version": __version__,
            "protocol": self.protocol,
            "baud": self.baud,
            "seed": self.seed,
            "servos": list(self.servo_ids),
            "models": {"all" if who is None else str(who): m for who, m in self.models.items()},
            "faults": struck,
            "rate_hz": self.rate_hz,
            "full": self.full,
            "respond": self.respond,
        }


def _rate(
    context: click.Context, parameter: click.Parameter, given: str | None
) -> int | str | None:
    """Read cycles per second, or ``max``."""
    if given is None or given == MAX:
        return given
    short = given.isdecimal() and len(given) <= 9  # int() refuses long ones
    if not short or not 1 <= int(given) <= RATE_MOST:
        told = repr(given if len(given) < 30 else f"{given[:30]}...")
        raise click.BadParameter(f"{told}: write a number of 1..{RATE_MOST}, or {MAX}")
    return int(given)


def _faults(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[Fault, ...]:
    from sniffer.simulation.faults import read_fault

    try:
        return tuple(read_fault(text) for text in given)
    except SnifferError as error:
        raise click.BadParameter(str(error)) from None


@click.command(
    short_help="Play a bus without hardware.",
    epilog=examples(
        "sniffer simulate mightyzap --link /tmp/bus",
        "sniffer simulate wck --baud 921600 --full --truth truth.jsonl --duration 10s",
        "sniffer simulate lss --servos 1,2,5 --fault drop-reply:5:10% --fault noise",
        "sniffer simulate mightyzap --fault stall:2@5s+3s --fault dead:3@20s",
        "sniffer simulate rs30x --respond --link /tmp/bus --tap-link /tmp/tap",
    ),
)
@click.argument("protocol", type=ProtocolName(plugins=False))
@click.option("--servos", metavar="IDS|N", help="Who is on the bus: 1,2,5, or how many.")
@click.option(
    "--model", "chosen", multiple=True, callback=models, metavar="[ID=]MODEL",
    help="What a servo is (or all of them): mightyzap-12lf; may be repeated.",
)  # fmt: skip
@click.option("--baud", type=Whole(*BAUDS), help="Bits per second.")
@click.option(
    "--rate",
    callback=_rate,
    metavar="HZ|max",
    help="Cycles of the controller per second; max: --full.",
)
@click.option("--full", is_flag=True, help="Cycle after cycle: load the line as far as it goes.")
@click.option("--seed", type=int, default=0, show_default=True, help="Another one, another run.")
@click.option("--duration", type=Duration(), help="Stop after this time: 10s, 5min.")
@click.option(
    "--fault", "faults", multiple=True, callback=_faults,
    metavar="KIND[:SERVO][:RATE%][@FROM[+FOR]]",
    help="What goes wrong, how often at each chance, and when. On the line: drop-reply, flip, cut, "
    "late, noise, duplicate-id, brownout. A servo: limp, stall, overheat, overload, dead, absent, "
    "slow, reset-loop, refuse, chatty. The controller: hang, jitter, impatient, nv-wear. May be "
    "repeated.",
)  # fmt: skip
@click.option(
    "--truth", type=click.Path(path_type=Path), help="Write what really happened, as JSON lines."
)
@with_force
@click.option("--link", type=click.Path(path_type=Path), help="Make a symbolic link to the bus.")
@click.option("--respond", is_flag=True, help="Play the servos only: they answer a controller.")
@click.option(
    "--tap/--no-tap", default=None,
    help="With --respond: repeat both sides on a second port, for record.  [default: tap]",
)  # fmt: skip
@click.option("--tap-link", type=click.Path(path_type=Path), help="Make a link to the tap.")
@click.option("--port", "device", metavar="DEV", help="Play on a serial port that is there.")
def simulate(
    protocol: str,
    servos: str | None,
    chosen: dict[int | None, str],
    baud: int | None,
    rate: int | str | None,
    full: bool,
    seed: int,
    duration: int | None,
    faults: tuple[Fault, ...],
    truth: Path | None,
    force: bool,
    link: Path | None,
    respond: bool,
    tap: bool | None,
    tap_link: Path | None,
    device: str | None,
) -> None:
    """Play a PROTOCOL's bus in real time: a controller and servos that move.

    The port to listen to (sniffer record PORT) is printed first. What is said while nobody has it
    open is lost, as on a wire. Ctrl-C ends it.
    """
    if respond and (full or rate is not None):
        raise click.UsageError("--respond plays no controller: --rate and --full say nothing")
    if not respond and (tap is not None or tap_link is not None):
        raise click.UsageError("a tap repeats a talk: it needs --respond")
    if tap is False and tap_link is not None:
        raise click.UsageError("--tap-link needs the tap: leave --no-tap out")
    if device is not None and link is not None:
        raise click.UsageError("--port has a name already: --link is for a new one")
    if truth is not None and not force:
        refuse_occupied([truth])
    try:
        from sniffer.simulation.play import ports
    except ImportError:
        raise OutputError("this system has no pseudo-terminals: use Linux or macOS") from None
    from sniffer.simulation import BUSES
    from sniffer.simulation.faults import CONTROLLER_FAULTS, spelled

    if protocol not in BUSES:
        known = ", ".join(BUSES)
        raise click.UsageError(f"{protocol} has no simulator: there is one of {known}")
    check_models(chosen)
    kind = BUSES[protocol]
    wishes = Wanted(
        protocol=protocol,
        servo_ids=_servos(servos, protocol),
        baud=baud or kind.baud,
        rate_hz=None if full or rate == MAX or respond else int(rate or kind.rate_hz),
        full=full or rate == MAX,
        seed=seed,
        duration_ns=duration,
        faults=faults,
        respond=respond,
        device=device,
        models=_played(chosen, protocol),
    )
    for servo_id in chosen:
        if servo_id not in (None, *wishes.servo_ids):
            here = ", ".join(map(str, wishes.servo_ids))
            named = f"--model {servo_id}={chosen[servo_id]}"
            raise click.BadParameter(f"{named}: that servo is not on the bus, only {here}")
    for fault in faults:
        if fault.servo_id not in (None, *wishes.servo_ids):
            named = f"--fault {spelled(fault.kind)}:{fault.servo_id}"
            here = ", ".join(map(str, wishes.servo_ids))
            raise click.BadParameter(f"{named}: that servo is not on the bus, only {here}")
        if respond and fault.kind in CONTROLLER_FAULTS:
            kept = spelled(fault.kind)
            raise click.UsageError(f"--respond plays no controller: --fault {kept} says nothing")
        if fault.kind in kind.unknown_faults:
            named = f"--fault {spelled(fault.kind)}"
            raise click.BadParameter(f"{named}: nothing on a {protocol} bus would show that")
    with contextlib.ExitStack() as stack:
        port: PlayPort = ports.Device(device, wishes.baud) if device else ports.Pty()
        stack.callback(port.close)
        second = ports.Pty() if respond and tap is not False else None
        if second is not None:
            stack.callback(second.close)
        _run(wishes, port, second, truth, {port.name: link, **_named(second, tap_link)})


def _named(port: PlayPort | None, link: Path | None) -> dict[str, Path | None]:
    return {} if port is None else {port.name: link}


def _played(chosen: dict[int | None, str], protocol: str) -> dict[int | None, str]:
    """Check that the models speak the protocol."""
    from sniffer.simulation import BUSES

    for model in chosen.values():
        if model not in BUSES[protocol].tables:
            known = ", ".join(BUSES[protocol].tables)
            raise click.BadParameter(f"--model {model} is none of the {protocol} models: {known}")
    return chosen


def _servos(text: str | None, protocol: str) -> tuple[int, ...]:
    """Read ``1,2,5`` or a number of servos."""
    from sniffer.simulation import BUSES

    kind = BUSES[protocol]
    if text is None:
        return kind.servo_ids
    parts = [part.strip() for part in text.split(",") if part.strip()]
    if not parts or not all(part.isdecimal() and len(part) < 4 for part in parts):
        raise click.BadParameter(f"--servos {text!r}: write ids as 1,2,5, or how many")
    ids = sorted({int(part) for part in parts})
    if "," not in text and ids != [0]:  # no servo would be no bus: that is an id
        first = max(kind.ids.start, min(kind.servo_ids))
        ids = list(range(first, first + ids[0]))
    if not 1 <= len(ids) <= kind.most:
        raise click.BadParameter(f"--servos {text}: {protocol} has room for 1..{kind.most}")
    for servo_id in ids:
        if servo_id not in kind.ids:
            known = f"{kind.ids.start}..{kind.ids.stop - 1}"
            raise click.BadParameter(f"--servos {text}: {protocol} has the ids {known}")
    return tuple(ids)


def _run(
    wishes: Wanted,
    port: PlayPort,
    second: PlayPort | None,
    truth_path: Path | None,
    links: dict[str, Path | None],
) -> None:
    """Play until it is over; whatever ends it, the truth and the links are put in order."""
    from sniffer.simulation.play.link import linked
    from sniffer.simulation.play.outlet import FrameWriter
    from sniffer.simulation.play.player import SimulatedClock, Stop
    from sniffer.simulation.play.truth import Truth

    clock = SimulatedClock()
    with contextlib.ExitStack() as stack:
        for name, path in links.items():
            stack.enter_context(linked(path, name))
        stop = stack.enter_context(contextlib.closing(Stop()))
        stack.enter_context(_stopped_by_signals(stop))
        truth = None if truth_path is None else Truth(truth_path, clock)
        note = _silent if truth is None else truth.add
        bus = FrameWriter(port, note if second is None else _silent)
        tap = None if second is None else FrameWriter(second, note)
        told = tap or bus
        if truth is not None:
            truth.head(wishes.facts())
            stack.callback(_close, truth, told, clock)
        if wishes.respond:
            click.echo(f"bus {port.name}" + ("" if tap is None else f"\ntap {tap.port.name}"))
        else:
            click.echo(port.name)
        sys.stdout.flush()
        _play(wishes, clock, stop, bus, tap, truth)
        bus.finish()
        if tap is not None:
            tap.finish()
    _report(wishes, bus, tap, clock)


def _play(
    wishes: Wanted,
    clock: SimulatedClock,
    stop: Stop,
    bus: FrameWriter,
    tap: FrameWriter | None,
    truth: Truth | None,
) -> None:
    from sniffer.simulation.play.player import GROUP_NS, GROUPED_FROM, Player

    player = Player(clock, stop, (lambda: None) if truth is None else truth.flush)
    if wishes.respond:
        from sniffer.simulation.respond import Responder

        responder = Responder(
            wishes.protocol,
            seed=wishes.seed,
            servo_ids=wishes.servo_ids,
            baud=wishes.baud,
            faults=wishes.faults,
            carried=bus.port.carries,
            models=wishes.models,
        )
        note = _silent if truth is None else truth.add
        player.respond(responder, bus, tap, note, duration_ns=wishes.duration_ns)
        return
    from sniffer.simulation import simulate as frames

    duration_s = None if wishes.duration_ns is None else wishes.duration_ns / NS
    player.play(
        frames(
            wishes.protocol,
            seed=wishes.seed,
            servo_ids=wishes.servo_ids,
            baud=wishes.baud,
            rate_hz=wishes.rate_hz,
            faults=wishes.faults,
            duration_s=duration_s,
            full=wishes.full,
            models=wishes.models,
        ),
        bus,
        group_ns=GROUP_NS if wishes.full or wishes.baud > GROUPED_FROM else 0,
        duration_ns=wishes.duration_ns,
    )


def _silent(frame: TrueFrame, offset: int | None) -> None:
    """Note nothing."""


def _close(truth: Truth, told: FrameWriter, clock: SimulatedClock) -> None:
    truth.close(size=told.size, dropped=told.lost + told.overrun, behind_ns=clock.lost_ns)


@contextlib.contextmanager
def _stopped_by_signals(stop: Stop) -> Iterator[None]:
    """Let Ctrl-C, a polite kill and a closed terminal end it; only the main thread hears them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {
        number: signal.signal(number, lambda *_: stop.ask())
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _report(
    wishes: Wanted, bus: FrameWriter, tap: FrameWriter | None, clock: SimulatedClock
) -> None:
    """Say what became of the bytes."""
    named = {"bus: " if wishes.respond else "": bus} | ({"tap: ": tap} if tap else {})
    for name, outlet in named.items():
        told = f"{name}{outlet.size} bytes written"
        if outlet.lost:
            told += f", {outlet.lost} that nobody read"
        if outlet.overrun:
            told += f", {outlet.overrun} lost because the reader was too slow"
        say(told)
    if clock.lost_ns:
        say(
            f"held up for {clock.lost_ns / 1e6:.0f} ms in all, and went on later by as much: this "
            "machine is too busy"
        )
