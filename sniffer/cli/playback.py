"""What ``sniffer replay --to PORT`` does: a recording speaks, and what became of that is told."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from sniffer.cli.options import Command, gathered
from sniffer.cli.signals import ended_by_signals
from sniffer.cli.statuses import status_of
from sniffer.cli.streams import say

if TYPE_CHECKING:
    from sniffer.decoding.options import Options
    from sniffer.jobs.playback import PlayedBack
    from sniffer.jobs.telling import Teller
    from sniffer.selection.places import Window
    from sniffer.simulation.play.outlet import Written

OTHERWISE: Final = 1
"""The status where a controller asked what the recording has nothing like, or where servos answer
less than they did."""

_ROWS: Final = ("where", "servos", "ops", "kinds", "codes")

_PLAYBACK: Final = (
    click.option(
        "--as", "role", type=click.Choice(("line", "servos", "controller")),
        help="With --to PORT, who speaks: everybody, or the servos, which answer a controller, or "
        "the controller, which asks servos.  [default: line]",
    ),
    click.option(
        "--link", "links", multiple=True, type=click.Path(path_type=Path),
        help="Make a symbolic link to a new pseudo-terminal; once for each bus.",
    ),
    click.option(
        "--tap/--no-tap", default=None,
        help="With --as servos: repeat both sides on a second port, for record.  [default: tap]",
    ),
    click.option("--tap-link", type=click.Path(path_type=Path), help="Make a link to the tap."),
    click.option(
        "--echo", is_flag=True,
        help="With --as servos: let the controller hear itself, as through an adapter with echo.",
    ),
    click.option(
        "--yes-transmit", "transmit", is_flag=True,
        help="Play on a serial port, too: it is sent on its bus, and servos may move.",
    ),
)  # fmt: skip


def with_playback(command: Command) -> Command:
    """Add the options of a recording that speaks; ``playback`` is what they say."""
    names = ("role", "links", "tap", "tap_link", "echo", "transmit")

    def gather(given: dict[str, Any]) -> dict[str, Any]:
        return {"playback": {name: given.pop(name) for name in names}, **given}

    return gathered(command, _PLAYBACK, gather)


def refuse_without_port(playback: Mapping[str, Any]) -> None:
    """Refuse options that are about a port where none is named.

    Raises:
        UsageError: there is one.
    """
    told = {"role": "--as", "links": "--link", "tap": "--tap", "tap_link": "--tap-link"}
    told |= {"echo": "--echo", "transmit": "--yes-transmit"}
    for name, option in told.items():
        if playback[name] not in (None, (), False):
            raise click.UsageError(f"{option} goes with a port to play on: --to pty, --to DEV")


def refuse_with_port(given: Mapping[str, Any]) -> None:
    """Refuse options of a replay that is looked at where it is played on a port.

    Raises:
        UsageError: there is one.
    """
    shows = {"in_rerun": "--rerun", "redecode": "--redecode"}
    if given["role"] != "controller":
        shows["outputs"] = "-o"
    for name, option in shows.items():
        if given[name]:
            raise click.UsageError(f"--to PORT plays, {option} shows or writes: choose one")
    for name in _ROWS:
        if given[name]:
            raise click.UsageError("--to PORT plays all that was said: rows are not chosen")


def play_on(
    files: tuple[str, ...],
    to: tuple[str, ...],
    options: Options,
    playback: Mapping[str, Any],
    *,
    input_format: str,
    window: Window | None,
    buses: tuple[str, ...],
    speed: float,
    loop: bool,
    outputs: tuple[Path, ...],
    force: bool,
    tell: Teller,
) -> int:
    """Play a recording on ports; return the exit status."""
    from sniffer.jobs.playback import PlayedPorts, PlayedRole, play_back
    from sniffer.simulation.play.player import Stop

    def ready(names: Mapping[str, str]) -> None:
        several = len(names) > 1
        click.echo("\n".join(f"{bus} {n}" if several else n for bus, n in names.items()))
        sys.stdout.flush()

    role = PlayedRole(playback["role"] or "line")
    ports = PlayedPorts(
        to,
        links=playback["links"],
        transmit=playback["transmit"],
        tap=playback["tap"],
        tap_link=playback["tap_link"],
        ready=ready,
    )
    with contextlib.closing(Stop()) as stop, ended_by_signals(stop.ask):
        done = play_back(
            files,
            ports,
            options,
            role=role,
            input_format=input_format,
            window=window,
            buses=buses,
            speed=speed,
            loop=loop,
            echo=playback["echo"],
            outputs=outputs,
            overwrite=force,
            stop=stop,
            tell=tell,
        )
    return _told(done)


def _told(done: PlayedBack) -> int:
    """Say what became of it; return the exit status."""
    for name, written in done.ports.items():
        say(told_bytes(f"{name}: " if len(done.ports) > 1 else "", written))
    if done.pacing is not None and done.pacing.pieces:
        mean, worst = done.pacing.mean_ns / 1e6, done.pacing.worst_ns / 1e6
        say(f"written {mean:.2f} ms late on average, {worst:.2f} ms at most")
    if done.answers is not None:
        for line in done.answers.lines():
            say(line)
    if done.hearing is not None:
        for line in done.hearing.lines():
            say(line)
        if done.slower:
            say("response times differ: A is the recording, B what was heard now")
        for one in done.slower:
            for line in one.lines():
                click.echo(line)
    return status_of(done.ending) or (0 if done.as_recorded else OTHERWISE)


def told_bytes(label: str, written: Written) -> str:
    """Return what became of the bytes for a port, in words."""
    told = f"{label}{written.size} bytes written"
    if written.lost:
        told += f", {written.lost} that nobody read"
    if written.overrun:
        told += f", {written.overrun} lost because the reader was too slow"
    return told
