"""``sniffer fleet``: many captures become one data set."""

from __future__ import annotations

import re
import sys
from typing import Final

import click

from sniffer.cli.options import Whole, decoding_unnamed, examples, files_here
from sniffer.cli.selecting import with_rows
from sniffer.cli.statuses import DAMAGED, DONE, INTERRUPTED
from sniffer.cli.streams import say
from sniffer.decoding.called import ServoNames
from sniffer.decoding.options import Options
from sniffer.fleet.engines import ENGINES, load_for
from sniffer.fleet.progress import FleetProgress
from sniffer.fleet.rows import STATUSES
from sniffer.fleet.run import ROBOT, FleetRun, decode_fleet
from sniffer.ground.loading import Loading
from sniffer.ground.wording import counted
from sniffer.jobs.telling import Teller
from sniffer.selection.selection import Selection

FAILURES: Final = 1
"""The exit status where nothing could be read of some captures."""

TERMINAL_S: Final = 0.2
"""How often a terminal shows how far it is, in seconds."""

LOG_S: Final = 30.0
"""How often a line says so where there is no terminal, in seconds."""

SLOW: Final = 1e5
"""Bytes a second below which captures are counted: it is their number that takes the time."""

TOLD: Final = 5
"""Reasons that are told one by one."""


def _shard(
    context: click.Context, parameter: click.Parameter, given: str | None
) -> tuple[int, int] | None:
    """Read ``2/8``."""
    if given is None:
        return None
    match = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", given)
    if match is None or not 1 <= int(match[1]) <= int(match[2]):
        raise click.BadParameter(f"{given!r}: parts are counted from 1, as 1/4 to 4/4 of four")
    return int(match[1]), int(match[2])


@click.command(
    short_help="Make one data set of many captures.",
    epilog=examples(
        "sniffer fleet captures/ -o dataset",
        "sniffer fleet 'logs/**/*.mcap' -o dataset --robot 'logs/([^/]+)/'",
        "sniffer fleet captures/ -o dataset --where \"quantity = 'voltage'\"",
        "sniffer fleet captures/ -o /shared/dataset --shard 3/16",
    ),
)
@click.argument("inputs", metavar="INPUT...", nargs=-1, required=True, shell_complete=files_here)
@click.option(
    "-o", "--output", "dataset", required=True, metavar="DATASET",
    help="The folder of the data set; it may be there already.",
)  # fmt: skip
@with_rows
@decoding_unnamed
@click.option(
    "--robot", default=ROBOT, show_default=True, metavar="REGEX",
    help="Whose a capture is: the first group of a regular expression, on the capture's path.",
)  # fmt: skip
@click.option(
    "--engine", type=click.Choice(list(ENGINES)), default="local", show_default=True,
    help="Who decodes.",
)  # fmt: skip
@click.option("--workers", type=Whole(1, 4096), help="Processes.  [default: one a processor]")
@click.option("--scheduler", metavar="ADDRESS", help="Of a cluster, for engines that have one.")
@click.option(
    "--shard", callback=_shard, metavar="I/N",
    help="Only the I-th of N parts of the captures, for machines that share a disk.",
)  # fmt: skip
@click.option("--retry-failed", is_flag=True, help="Try captures again that failed before.")
@click.option("-q", "--quiet", is_flag=True, help="Say only what goes wrong.")
def fleet(
    inputs: tuple[str, ...],
    dataset: str,
    options: Options,
    input_format: str,
    selection: Selection | None,
    robot: str,
    engine: str,
    workers: int | None,
    scheduler: str | None,
    shard: tuple[int, int] | None,
    retry_failed: bool,
    quiet: bool,
) -> int:
    """Decode each INPUT (a capture, a pattern, a folder) into the tables of DATASET.

    The tables are samples, frames, transactions and anomalies, in Parquet by robot and day;
    captures.parquet says what became of each capture. Captures that are in DATASET are skipped, so
    the same command goes on where it was ended, whatever ended it. Those that were changed, or
    decoded otherwise, are decoded again and replaced.

    Exit status: 0 all captures are in it; 1 some failed: they hold nothing that can be read; 2 a
    mistake of yours; 3 some were not done: run it again.
    """
    with Loading():
        load_for(engine)
    shown = Progress(quiet=quiet)
    done = decode_fleet(
        inputs,
        dataset,
        options,
        input_format=input_format,
        selection=selection and selection.named(ServoNames()),
        robot=robot,
        engine=engine,
        workers=workers,
        scheduler=scheduler,
        shard=shard,
        retry_failed=retry_failed,
        progress=shown.progress,
        tell=Teller(say, quiet=quiet),
    )
    shown.end()
    for told in (done.reasons, () if quiet else done.troubles):
        for line in told[:TOLD]:
            say(line)
        if len(told) > TOLD:
            named = ": captures.parquet names them" if told is done.troubles else ""
            say(f"and {len(told) - TOLD} more{named}")
    if not quiet:
        click.echo(_told(done))
    if not done.is_whole:
        ended = "interrupted: " if done.is_interrupted else ""
        left = f"{counted(len(done.undone), 'capture')} not done" if done.undone else "not all done"
        say(f"{ended}{left}: what is in {dataset} stays; run it again to go on")
        return INTERRUPTED if done.is_interrupted else DAMAGED
    return FAILURES if done.failures else DONE


def _told(done: FleetRun) -> str:
    """Return what a run did, in a line."""
    statuses = (f"{done.statuses[s]} {s}" for s in STATUSES if done.statuses[s])
    became = ", ".join(statuses) or "none done"
    how = f"{done.decoded} decoded, {done.skipped} there already"
    return f"{counted(done.captures, 'capture')}: {became} ({how})"


class Progress:
    """How far it is: a line that changes on a terminal, a line now and then elsewhere.

    ``of`` is what is counted.
    """

    def __init__(self, *, quiet: bool, of: str = "captures") -> None:
        self._of = of
        self._is_live = sys.stderr.isatty()
        self._every_s = TERMINAL_S if self._is_live else LOG_S
        self._next_s = self._every_s
        self._is_shown = False
        self._quiet = quiet

    def progress(self, so_far: FleetProgress) -> None:
        """Take how far it is."""
        if self._quiet or so_far.seconds < self._next_s:
            return
        self._next_s = so_far.seconds + self._every_s
        line = _line(so_far, self._of)
        if self._is_live:
            click.echo(f"\r{line}\x1b[K", nl=False, err=True)
            self._is_shown = True
        else:
            say(line)

    def end(self) -> None:
        """Take the line away."""
        if self._is_shown:
            click.echo("\r\x1b[K", nl=False, err=True)


def _line(so_far: FleetProgress, of: str) -> str:
    rate = f"{so_far.bytes_per_second / 1e6:.1f} MB/s"
    if so_far.bytes_per_second < SLOW:
        rate = _frequency(so_far.captures, so_far.seconds)
    left = so_far.seconds_left
    told = "" if left is None else f", {_duration(left)} left"
    return f"{so_far.captures} of {so_far.of_captures} {of}, {rate}{told}"


def _frequency(captures: int, seconds: float) -> str:
    """Return how often there is one, in a number that is not 0."""
    if 0 < captures < seconds:
        return f"{_duration(seconds / captures)} each"
    return f"{captures / seconds:.0f} a second"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
