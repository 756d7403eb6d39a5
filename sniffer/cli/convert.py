"""``sniffer convert``: a capture as other files, by their suffixes."""

from __future__ import annotations

from pathlib import Path

import click

from sniffer.cli.amounts import topics as topics_of
from sniffer.cli.joints import with_ros2
from sniffer.cli.options import (
    decoding,
    examples,
    files_here,
    with_anonymise,
    with_every,
    with_force,
    with_quiet,
)
from sniffer.cli.selecting import say_selected, with_part, with_rows
from sniffer.cli.servos import with_alarms
from sniffer.cli.signals import patient
from sniffer.cli.statuses import status_of
from sniffer.cli.streams import wrote
from sniffer.decoding.options import Options
from sniffer.jobs.convert import convert as made
from sniffer.jobs.outputs import Contents, Wide
from sniffer.jobs.session import undecided_of
from sniffer.jobs.telling import Teller
from sniffer.mcapfile.joints import RosJoint
from sniffer.selection.places import Window
from sniffer.selection.selection import Selection
from sniffer.sinks import RECORDING
from sniffer.sinks.spaced import FINEST_NS
from sniffer.sources.several import name_of


@click.command(
    short_help="Make other files of a capture, by their suffixes.",
    epilog=examples(
        "sniffer convert run.mcap run.log",
        "sniffer convert capture.log capture.mcap capture.rrd",
        "sniffer convert run.mcap run.pcapng",
        "sniffer convert run.mcap wide.csv --wide --hold",
        "sniffer convert run.mcap at-50-hz.csv --wide --hold --every 20ms",
        "sniffer convert --together run-001.mcap run-002.mcap -o run.csv",
        "sniffer convert run.mcap plot.mcap --topics flat",
        "sniffer convert run.mcap ros.mcap --ros2 --joints joints.toml",
        "sniffer convert run.mcap shared.mcap --anonymise",
        "sniffer convert run.mcap three.csv --servo 3 --from 10 --to 20",
    ),
)
@click.argument("file", shell_complete=files_here)
@click.argument("outputs", metavar="OUT...", nargs=-1, type=click.Path(path_type=Path))
@click.option(
    "-o", "--output", "also", metavar="OUT", multiple=True, type=click.Path(path_type=Path),
    help="The same as OUT, as other commands have it.",
)  # fmt: skip
@click.option(
    "--together",
    is_flag=True,
    help="Several FILEs, and each OUT behind -o: they are one capture, read in the order of their "
    "times, as decode takes them, such as those of a rotation.",
)
@with_part
@with_rows
@decoding
@with_alarms
@click.option(
    "--wide",
    is_flag=True,
    help="Tables (.csv .parquet) have a column for each quantity of a servo, blank where nothing "
    "was said.",
)
@click.option("--hold", is_flag=True, help="With --wide: a blank repeats the last value.")
@with_every(
    FINEST_NS,
    "With --wide: a row each such step of time, with the last values said in it: 20ms.",
)
@click.option(
    "--topics", callback=topics_of, metavar="TOPIC,...",
    help="What an .mcap has beside the raw bytes, as in `sniffer record`; flat: a topic for each "
    "quantity of a servo, for plots that take what was not said for 0; plots, positions that "
    "`rerun FILE` draws by itself. +plots adds to the usual ones, plots is all there is.",
)  # fmt: skip
@with_ros2
@with_anonymise
@with_force
@with_quiet
def convert(
    file: str,
    outputs: tuple[Path, ...],
    also: tuple[Path, ...],
    together: bool,
    options: Options,
    input_format: str,
    wide: bool,
    hold: bool,
    every_ns: int | None,
    topics: tuple[str, ...] | None,
    joints: tuple[RosJoint, ...] | None,
    anonymise: bool,
    force: bool,
    tell: Teller,
    window: Window | None,
    selection: Selection | None,
) -> int:
    """Make each OUT of FILE (- is standard input); its suffix says what.

    The bytes alone: .log (lines as candump -L writes them), .bin, .hex. What they mean: .jsonl
    .csv .parquet. Both: .mcap, and .pcapng for Wireshark. Plots: .rrd. Of a selection (--servo,
    --where ...) what is made has the selected rows, and bytes are those of the frames that the
    table of `sniffer decode` shows: the selected ones and those of selected transactions and
    samples, so of --servo 3 also a write to many that has a value for servo 3.

    Exit status: 0 done; 2 a mistake of yours; 3 the input breaks off (what could be read is
    written).
    """
    files = (file, *map(str, outputs)) if together else (file,)
    if together:
        outputs = ()
    elif (read := _taken_for_out(file, outputs, also)) is not None:
        raise click.UsageError(
            f"FILE is one capture, and {name_of(str(read))} would be written, not read; "
            "`sniffer merge A B -o OUT` makes one recording of several, --together reads several "
            "as one capture; what is to be written anew stands behind -o each"
        )
    outputs = (*outputs, *also)
    if not outputs:
        where = "behind -o, " if together else ""
        raise click.UsageError(
            f"name OUT, {where}a file whose suffix says what to make: run.mcap, run.csv"
        )
    for name, is_given in (("--hold", hold), ("--every", every_ns is not None)):
        if is_given and not wide:
            raise click.UsageError(f"{name} goes with --wide")
    if wide and not any(out.suffix.lower() in (".csv", ".parquet") for out in outputs):
        raise click.UsageError("--wide is about tables: name a .csv or a .parquet")
    if topics is not None and not any(out.suffix.lower() == RECORDING for out in outputs):
        raise click.UsageError("--topics is about a recording: name an .mcap")
    if joints is not None and not any(out.suffix.lower() == RECORDING for out in outputs):
        raise click.UsageError("--ros2 is about a recording: name an .mcap")
    with patient() as patience, undecided_of(name_of(files)):
        done = made(
            files,
            outputs,
            options,
            input_format=input_format,
            overwrite=force,
            wide=Wide(hold, every_ns) if wide else None,
            contents=Contents(topics, joints) if joints is not None or topics else None,
            anonymise=anonymise,
            selection=selection,
            window=window,
            patience=patience,
            tell=tell,
        )
    status = status_of(done.ending, is_lost=bool(done.gone))
    if not status:
        say_selected(done.summary, tell)
        if (untimed := done.summary.untimed()) is not None:
            tell.talk(untimed)
        tell.talk(wrote(outputs))
    return status


def _taken_for_out(file: str, outputs: tuple[Path, ...], also: tuple[Path, ...]) -> Path | None:
    """Return the first of the captures that a shell put for a pattern: they stand where OUT does.

    With all that is to be made behind -o it is any file that is there; else one of several OUTs
    that is of FILE's form: to make that of FILE is nothing that somebody asks for.
    """
    if also:
        there = [out for out in outputs if out.exists()]
    elif len(outputs) > 1:
        kind = Path(file).suffix
        there = [out for out in outputs if out.suffix == kind and out.exists()]
    else:
        there = []
    return there[0] if there else None
