"""``sniffer simulate``: a bus without hardware, on a pseudo-terminal."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sniffer.cli.amounts import Duration
from sniffer.cli.options import ProtocolName, Whole, completing, examples, files_here, with_force
from sniffer.cli.playback import told_bytes
from sniffer.cli.servos import ids_in, models
from sniffer.cli.signals import ended_by_signals
from sniffer.cli.streams import say
from sniffer.ground.limits import BAUDS
from sniffer.ground.model import SnifferError

if TYPE_CHECKING:
    from sniffer.simulation import Fault
    from sniffer.simulation.play.run import Played
    from sniffer.simulation.play.scenario import Scenario

MAX = "max"
"""The ``--rate`` of a line that is loaded as far as it goes."""

RATE_MOST = 100_000


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


def _servos(
    context: click.Context, parameter: click.Parameter, given: str | None
) -> int | tuple[int, ...] | None:
    """Read ``1,2,5``, ``1-8`` or a number of servos."""
    if given is None:
        return None
    words = [word.strip() for word in given.split(",") if word.strip()]
    if not words or not set("".join(words)) <= set("0123456789-"):
        raise click.BadParameter(f"{given!r}: write ids as 1,2,5 or 1-8, or how many")
    ids = ids_in(words)
    if "," in given or "-" in given or ids == (0,):  # no servo would be no bus: that is an id
        return ids
    return ids[0]


def _kinds() -> list[str]:
    from sniffer.simulation.faults import FAULTS, spelled

    return [spelled(kind) for kind in FAULTS]


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
        "sniffer simulate --like recording.mcap --link /tmp/bus",
    ),
)
@click.argument("protocol", type=ProtocolName(plugins=False), required=False)
@click.option(
    "--like",
    metavar="FILE",
    shell_complete=files_here,
    help="Play the servos that a recording shows, or any capture: as they answered then. With "
    "PROTOCOL, --baud and --model it is decoded so; implies --respond.",
)
@click.option("--bus", "buses", multiple=True, metavar="NAME", help="With --like: which bus.")
@click.option(
    "--servos",
    "--servo",
    metavar="IDS|N",
    callback=_servos,
    help="Who is on the bus: 1,2,5 or 1-8, or how many.",
)
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
    metavar="KIND[:SERVO][:RATE%][@FROM[+FOR]]", shell_complete=completing(_kinds),
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
@click.option(
    "--port",
    "device",
    metavar="DEV",
    help="Play on a port that is there: a pseudo-terminal, or with --yes-transmit a serial port.",
)
@click.option(
    "--yes-transmit", "transmit", is_flag=True,
    help="With --port: play on a serial port, too: it is sent on its bus, and servos may move.",
)  # fmt: skip
def simulate(
    protocol: str | None,
    like: str | None,
    buses: tuple[str, ...],
    servos: int | tuple[int, ...] | None,
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
    transmit: bool,
) -> None:
    """Play a PROTOCOL's bus in real time: a controller and servos that move, or those of --like.

    The port to listen to (sniffer record PORT) is printed first. What is said while nobody has it
    open is lost, as on a wire. Ctrl-C ends it.
    """
    from sniffer.simulation.play.player import Stop
    from sniffer.simulation.play.run import play
    from sniffer.simulation.play.scenario import Scenario

    if like is not None:
        if servos is not None:
            raise click.UsageError("--like tells which servos there are: leave --servos out")
        scenario = _like(like, protocol, baud, chosen, buses)
    elif protocol is None:
        raise click.UsageError("Missing argument 'PROTOCOL', or --like FILE.")
    elif buses:
        raise click.UsageError("--bus goes with --like")
    else:
        scenario = Scenario(protocol, servos=servos, baud=baud, respond=respond, models=chosen)
    scenario = replace(
        scenario,
        seed=seed,
        duration_ns=duration,
        faults=(*scenario.faults, *faults),
        rate_hz=rate if isinstance(rate, int) else None,
        full=full or rate == MAX,
    )

    def ready(bus: str, tap: str | None) -> None:
        if scenario.respond:
            click.echo(f"bus {bus}" + ("" if tap is None else f"\ntap {tap}"))
        else:
            click.echo(bus)
        sys.stdout.flush()

    with contextlib.closing(Stop()) as stop, ended_by_signals(stop.ask):
        played = play(
            scenario,
            port=device,
            transmit=transmit,
            truth=truth,
            overwrite=force,
            link=link,
            tap=tap,
            tap_link=tap_link,
            stop=stop,
            ready=ready,
        )
    _report(played)


def _like(
    file: str,
    protocol: str | None,
    baud: int | None,
    models: Mapping[int | None, str],
    buses: tuple[str, ...],
) -> Scenario:
    from sniffer.decoding.options import AUTO, Options
    from sniffer.jobs.like import scenario_like
    from sniffer.jobs.telling import Teller

    options = Options(protocol=protocol or AUTO, baud=baud, models=models)
    return scenario_like(file, options, buses=buses, tell=Teller(say))


def _report(played: Played) -> None:
    """Say what became of the bytes."""
    ports = {"": played.bus} if played.tap is None else {"bus: ": played.bus, "tap: ": played.tap}
    for name, written in ports.items():
        say(told_bytes(name, written))
    if played.answered is not None:
        say(str(played.answered))
    if played.held_up_ns:
        say(
            f"held up for {played.held_up_ns / 1e6:.0f} ms in all, and went on later by as much: "
            "this machine is too busy"
        )
