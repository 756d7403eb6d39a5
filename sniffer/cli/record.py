"""``sniffer record``: listens to ports and records what is said, while it is said."""

from __future__ import annotations

import datetime
import sys
from pathlib import Path
from typing import Final, Literal

import click

from sniffer.anomalies.alarms import Alarm
from sniffer.cli.amounts import Duration, Size, port_specs, sizes_and_times, topics
from sniffer.cli.joints import with_ros2
from sniffer.cli.options import (
    SHARED,
    Finite,
    ProtocolName,
    Renamed,
    Whole,
    completing,
    examples,
    files_here,
    pipeline_options,
    with_color,
    with_force,
)
from sniffer.cli.profiles import Ports, with_profile
from sniffer.cli.selecting import with_rows
from sniffer.cli.servos import models, with_alarms, with_names, with_registers
from sniffer.cli.signals import signals
from sniffer.cli.statuses import DONE, INTERRUPTED, MISTAKE
from sniffer.cli.waits import commands_on, waited_for
from sniffer.decoding.called import Named
from sniffer.decoding.pipeline import AUTO
from sniffer.ground.limits import BAUDS
from sniffer.ground.model import NS
from sniffer.ground.naming import worded
from sniffer.ground.registers import RegisterMap
from sniffer.ground.wording import one_line
from sniffer.mcapfile.joints import RosJoint
from sniffer.selection.selection import Selection
from sniffer.tap.stops import Stops
from sniffer.tap.tap import PortSpec
from sniffer.tap.watching import Awaited

RECORDING: Final = ".mcap"
"""Suffix of the output that is the recording; the others are made of it."""

INCIDENT: Final = "incident.mcap"
"""What the files of a flight recorder are called in a folder, but for their numbers."""

POST_NS: Final = 10 * NS
"""How long a flight recorder goes on after what has happened, where nobody says."""

WORD_S: Final = 0.5
"""How long a line on standard error may take before it is left out."""


def _happenings() -> list[str]:
    from sniffer.jobs.meanings import known_names

    return known_names()


@click.command(
    short_help="Listen to ports and record what is said.",
    epilog=examples(
        "sniffer record /dev/ttyUSB0",
        "sniffer record /dev/ttyUSB0=mightyzap@57600 left=/dev/ttyUSB1=wck@115200 -o run.mcap",
        "sniffer record /dev/ttyUSB0=lss --rerun --duration 10min",
        "sniffer record arm=/dev/ttyUSB0=rs30x /dev/ttyUSB1 --pair",
        "sniffer record /dev/ttyUSB0 --ring 60s --trigger any --trigger 'voltage < 9'",
        "sniffer record /dev/ttyUSB0 --quiet --rotate 512MB --keep 20 -o /var/log/bus.mcap",
    ),
)
@click.argument(
    "ports",
    shell_complete=files_here,
    cls=Ports,
    nargs=-1,
    required=True,
    callback=port_specs,
    metavar="[NAME=]PORT[=PROTOCOL][@BAUD]...",
)
@click.option(
    "--protocol",
    type=ProtocolName(AUTO),
    default=AUTO,
    show_default=True,
    help="What is spoken where a PORT does not say; auto tells it from the bytes.",
)
@click.option("--baud", type=Whole(*BAUDS), help="Where a PORT does not say.")
@click.option(
    "--model", "chosen", multiple=True, callback=models, metavar="[ID=]MODEL",
    help="Register table of a servo, or of all.",
)  # fmt: skip
@with_registers
@with_names
@with_alarms
@click.option("--latency", type=Finite(0, 1000), metavar="MS", help="What the adapter delays.")
@with_profile
@click.option(
    "--pair", is_flag=True,
    help="The two PORTs are one full-duplex bus: the controller's wire, then the servos'.",
)  # fmt: skip
@click.option(
    "--modem", type=click.Choice(["low", "keep"]), default="low", show_default=True,
    help="RTS and DTR: put low at once, or left as opening the port made them.",
)  # fmt: skip
@click.option("--shared", is_flag=True, help=SHARED)
@click.option(
    "-o", "--output", "outputs", multiple=True, type=click.Path(path_type=Path),
    help="Where to: .mcap is the recording; .jsonl .csv .parquet .rrd as in decode. May be "
    "repeated. Without it: sniffer-DATE-TIME.mcap.",
)  # fmt: skip
@with_force
@click.option(
    "--topics", callback=topics, metavar="TOPIC,...",
    help="Write only these beside the raw bytes: raw (nothing else), frames, transactions, state, "
    "gaps, anomalies, log, stats, incidents; flat, a topic for each quantity of a servo; plots, "
    "positions that `rerun FILE` draws by itself. +plots: beside the usual ones.  "
    "[default: all but flat and plots]",
)  # fmt: skip
@with_ros2
@click.option("--durable", is_flag=True, help="Wait for the disk after each round, 50 ms.")
@click.option(
    "--rotate", multiple=True, callback=sizes_and_times, metavar="SIZE|TIME",
    help="Begin a new file: 512MB, 10min.",
)  # fmt: skip
@click.option("--keep", type=Whole(1), metavar="N", help="Keep the last N files only.")
@click.option("--duration", type=Duration(), help="Stop after this time.")
@click.option("--max-size", type=Size(), help="Stop after this size, all files together.")
@click.option("--frames", type=Whole(1), metavar="N", help="Stop after N frames.")
@click.option("--idle", type=Duration(), help="Stop when no byte has come for this time.")
@click.option(
    "--until", multiple=True, callback=waited_for, metavar="WHAT",
    shell_complete=completing(_happenings),
    help="Stop when this happens: a cause (docs/causes.md), a code (docs/anomalies.md), a rule "
    "like that of --alarm, any incident.",
)  # fmt: skip
@click.option(
    "--on", "commands", multiple=True, nargs=2, callback=commands_on, metavar="WHAT COMMAND",
    help="Run a command of the shell when this happens, once an incident.",
)  # fmt: skip
@click.option(
    "--ring", multiple=True, callback=sizes_and_times, metavar="TIME|SIZE",
    help="Keep the last 60s (or 64MB) and write a file each time a --trigger is met.",
)  # fmt: skip
@click.option(
    "--trigger", "triggers", multiple=True, callback=waited_for, metavar="WHAT",
    shell_complete=completing(_happenings),
    help="With --ring: write a file when this happens, as for --until.",
)  # fmt: skip
@click.option(
    "--post", type=Duration(), help="With --ring: go on for this time after it.  [default: 10s]"
)
@click.option(
    "--ring-file", type=click.Path(path_type=Path), metavar="FILE.mcap",
    help="With --ring: keep it in this file, too, for a recorder that is killed.",
)  # fmt: skip
@click.option("--log", is_flag=True, help="Print each frame on standard output.")
@with_rows
@with_color
@click.option("-q", "--quiet", is_flag=True, help="Say nothing but what went wrong.")
@click.option("--rerun", "in_rerun", is_flag=True, help="Show it live in the Rerun viewer.")
@click.option(
    "--web", cls=Renamed, former=("--rerun-web",), is_flag=True, help="Show it live in a browser."
)
@click.option("--rerun-connect", metavar="URL", help="Show it live in a Rerun viewer elsewhere.")
@click.option("--foxglove", is_flag=True, help="Serve it live to Foxglove on this machine.")
@click.option(
    "--foxglove-at", metavar="HOST:PORT", help="Serve it there.  [default: 127.0.0.1:8765]"
)
@click.option(
    "--window", type=Finite(1), default=20.0, show_default=True, metavar="S",
    help="Seconds that the live plots show.",
)  # fmt: skip
def record(
    ports: tuple[PortSpec, ...],
    protocol: str,
    baud: int | None,
    chosen: dict[int | None, str],
    tables: tuple[RegisterMap, ...],
    names: dict[Named, str],
    alarms: tuple[Alarm, ...],
    latency: float | None,
    pair: bool,
    modem: Literal["low", "keep"],
    shared: bool,
    outputs: tuple[Path, ...],
    force: bool,
    topics: tuple[str, ...] | None,
    joints: tuple[RosJoint, ...] | None,
    durable: bool,
    rotate: dict[str, int],
    keep: int | None,
    duration: int | None,
    max_size: int | None,
    frames: int | None,
    idle: int | None,
    until: tuple[Awaited, ...],
    commands: tuple[tuple[Awaited, str], ...],
    ring: dict[str, int],
    triggers: tuple[Awaited, ...],
    post: int | None,
    ring_file: Path | None,
    log: bool,
    color: bool | None,
    quiet: bool,
    in_rerun: bool,
    web: bool,
    rerun_connect: str | None,
    foxglove: bool,
    foxglove_at: str | None,
    window: float,
    selection: Selection | None,
) -> int:
    """Listen to PORTs and record every byte, with all that can be made of it.

    Nothing is written to a port, and Linux ports are opened for reading only; what opening one may
    send by itself, docs/recording.md tells. Ctrl-C (or SIGTERM) ends the recording, SIGHUP begins a
    new file, SIGUSR1 prints statistics.
    """
    # What only this command needs is loaded only by it, and before a port is opened.
    from sniffer.jobs.files import Files, Flight
    from sniffer.jobs.record import Shown
    from sniffer.jobs.record import record as recorded_from
    from sniffer.jobs.telling import Teller
    from sniffer.tap.listen import Listening
    from sniffer.tap.recorder import Wishes
    from sniffer.viewers.outlet import write_within
    from sniffer.viewers.screen import BOARD, LOG, usual_mode

    def say(line: str) -> None:
        write_within(sys.stderr, f"sniffer: {one_line(worded(line))}\n", WORD_S)

    if log and quiet:
        raise click.UsageError("--log prints, --quiet does not: choose one")
    if selection is not None and not log and (quiet or usual_mode(sys.stderr) != BOARD):
        raise click.UsageError(
            "a selection is what --log prints and the board shows: a recording has everything"
            + ("; a bus is named with its port: arm=PORT" if "bus" in selection.columns else "")
        )
    views = {"window": in_rerun, "web": web, "connect": rerun_connect is not None}
    views["foxglove"] = foxglove or foxglove_at is not None
    if sum(views.values()) > 1:
        raise click.UsageError("choose one of --rerun, --web, --rerun-connect, --foxglove")
    said = [spec.protocol for spec in ports if spec.protocol is not None]
    wanted = (*until, *triggers, *(what for what, _ in commands))
    rules = (*alarms, *(what.alarm for what in wanted if what.alarm is not None))
    options = pipeline_options(protocol, baud, chosen, latency, tables, said, rules, names)
    paths = outputs or (Path(f"sniffer-{datetime.datetime.now():%Y%m%d-%H%M%S}.mcap"),)
    flight = None
    if ring:
        if not triggers:
            raise click.UsageError("--ring goes with --trigger: say what a file is written for")
        met = tuple(map(str, triggers))
        flight = Flight(ring.get("ns"), ring.get("bytes"), met, post or POST_NS, ring_file)
        for path in paths:
            if not (path.suffix or path.is_dir()):
                raise click.UsageError(f"there is no folder {path}: make it first")
        paths = tuple(path / INCIDENT if path.is_dir() else path for path in paths)
    elif triggers or post or ring_file:
        raise click.UsageError("--trigger, --post and --ring-file go with --ring 60s")
    recordings = [path for path in paths if path.suffix.lower() == RECORDING]
    if len(recordings) > 1:
        raise click.UsageError("one .mcap is enough: give -o only one of them")
    # An address may take long to be connected to: until then a signal ends everything.
    wishes = Wishes(is_heard=not any("://" in spec.port for spec in ports))
    with signals(wishes):
        told = recorded_from(
            ports,
            Files(
                next(iter(recordings), None),
                [path for path in paths if path not in recordings],
                rotate.get("bytes"),
                rotate.get("ns"),
                keep,
                topics=topics,
                durable=durable,
                overwrite=force,
                flight=flight,
                joints=joints,
            ),
            options,
            listening=Listening(modem, pair=pair, shared=shared),
            stops=Stops(duration, max_size, frames, idle, tuple(map(str, until))),
            shown=Shown(
                None if quiet else LOG if log else usual_mode(sys.stderr),
                next((mode for mode, wanted in views.items() if wanted), None),
                rerun_connect or foxglove_at,
                window,
                selection,
                color,
            ),
            commands=[(str(what), command) for what, command in commands],
            wishes=wishes,
            tell=Teller(say, quiet=quiet),
        )
    if told.failure is not None or told.gone:
        return MISTAKE
    return INTERRUPTED if told.hurried else DONE
