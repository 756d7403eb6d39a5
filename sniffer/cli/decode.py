"""``sniffer decode``: a capture, a dump or a recording, decoded."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from sniffer.cli.options import (
    decoding,
    examples,
    with_color,
    with_files,
    with_force,
    with_format,
    with_times,
)
from sniffer.cli.selecting import with_part, with_rows
from sniffer.cli.servos import with_alarms
from sniffer.cli.signals import patient
from sniffer.cli.statuses import status_of
from sniffer.cli.streams import say
from sniffer.decoding.sink import Sink
from sniffer.ground.model import Severity
from sniffer.jobs.convert import convert
from sniffer.jobs.telling import Teller
from sniffer.sinks.standard import Standard

if TYPE_CHECKING:
    from sniffer.decoding.options import Options
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection

STDOUT: Final = "-"

JOBS_MOST: Final = 256
"""Processes of one capture at most: a mistyped number starts no more."""

CONTEXT_MOST: Final = 10_000
"""Lines around a selected one at most: so many wait of each bus."""


@click.command(
    short_help="Decode a capture, a dump, a log or a recording.",
    epilog=examples(
        "sniffer decode dump.hex",
        "sniffer decode run-001.mcap run-002.mcap --summary",
        "sniffer decode capture.bin --protocol wck --baud 115200 -o capture.mcap",
        "sniffer decode capture.bin --model 3=mightyzap-12lf -o samples.parquet --summary",
        "sniffer decode run.mcap --code no-response --context 3",
        "sniffer decode run.mcap --servo 3,5 --from @first-error --around 200ms",
        "sniffer decode run.mcap --where \"quantity = 'voltage' AND value < 9\"",
        "sniffer decode run.mcap --where \"memory = 'non-volatile' AND kind = 'request'\"",
        "sniffer decode walk.mcap --alarm 'temperature > 70 for 2s' --fail-on warn",
        "candump-like-logger | sniffer decode - --format jsonl",
        "sniffer decode run.mcap --format pcapng | wireshark -k -i -",
        "sniffer decode week.bin --protocol mightyzap --jobs 8 -q -o week.jsonl",
    ),
)
@with_files
@with_part
@with_rows
@click.option(
    "-C",
    "--context",
    type=click.IntRange(0, CONTEXT_MOST),
    default=0,
    metavar="N",
    help="Of a selection, show N lines of the same bus before and behind each, as grep does: what "
    "is selected has a * in front (in JSON lines the others have a key context), -- is between.",
)
@decoding
@with_alarms
@with_format("text", "jsonl", "pcapng")
@with_times
@with_color
@click.option(
    "-o",
    "--output",
    "outputs",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Also write a file; its suffix says what: .jsonl .csv .parquet .mcap .rrd .pcapng. "
    "May be repeated. - is standard output, to which goes what --format says.",
)
@with_force
@click.option(
    "--jobs",
    type=click.IntRange(1, JOBS_MOST),
    default=1,
    show_default=True,
    help="Decode by so many processes, with the same result: for huge files of raw bytes. "
    "JSON lines gain most, one Parquet file nothing: see `sniffer fleet`.",
)
@click.option(
    "--fail-on",
    type=click.Choice([s.name.lower() for s in Severity]),
    help="Exit with status 1 if there are anomalies of this level or above.",
)
@click.option("--summary", is_flag=True, help="Print the summary only.")
@click.option(
    "-v",
    "--verbose",
    is_flag=True,
    help="In the summary, list the anomalies that an incident explains.",
)
@click.option(
    "-q", "--quiet", is_flag=True, help="Print nothing; the files and the exit status speak."
)
def decode(
    files: tuple[str, ...],
    options: Options,
    context: int,
    input_format: str,
    output_format: str,
    times: str,
    color: bool | None,
    outputs: tuple[Path, ...],
    force: bool,
    jobs: int,
    fail_on: str | None,
    summary: bool,
    verbose: bool,
    quiet: bool,
    window: Window | None,
    selection: Selection | None,
) -> int:
    """Decode FILE (- is standard input): raw bytes, a hex dump, a log, or a recording.

    Several are one capture, read in the order of their times: such as the files of a rotation.

    What goes wrong on the bus is part of the output. Exit status: 0 done; 1 anomalies at or above
    --fail-on; 2 a mistake of yours; 3 the input breaks off (what could be read is written).
    """
    if context and selection is None:
        raise click.UsageError("--context N goes with a selection, such as --code no-response")
    outputs = _files(outputs, output_format, is_silent=quiet or summary)
    printed: list[Sink] = []
    diagnosis = None
    if summary and not quiet and output_format == "text":
        from sniffer.diagnosis import Diagnosis

        printed.append(diagnosis := Diagnosis())
    if not quiet and not summary:
        printed.append(
            Standard(
                _printer(output_format, times, color, " ".join(files), options),
                sys.stdout,
                alone=not outputs,
            )
        )
    with patient() as patience:
        done = convert(
            files,
            outputs,
            options,
            input_format=input_format,
            overwrite=force,
            sinks=printed,
            selection=selection,
            window=window,
            context=context,
            jobs=jobs,
            patience=patience,
            tell=Teller(say, quiet=quiet),
        )
    status = status_of(done.ending, is_lost=bool(done.gone))
    if summary and not quiet and output_format == "jsonl":
        click.echo(json.dumps(done.summary.as_dict()))
    elif diagnosis is not None:
        from sniffer.sinks.consoles import console_for, unfold
        from sniffer.sinks.report import print_summary, selected

        incidents = () if verbose else diagnosis.incidents()
        console = console_for(color=color)
        unfold(console)
        print_summary(done.summary, console, incidents)
        if done.summary.narrowed:
            click.echo(f"\n{selected(done.summary)}")
    worst = done.summary.worst()
    if not status and fail_on and worst is not None and worst >= Severity[fail_on.upper()]:
        return 1
    return status


def _files(outputs: tuple[Path, ...], output_format: str, *, is_silent: bool) -> tuple[Path, ...]:
    """Return the outputs that are files; ``-`` is what is printed anyhow."""
    if output_format == "pcapng" and is_silent:
        raise click.UsageError("--format pcapng goes to standard output: leave --summary or -q out")
    files = tuple(path for path in outputs if str(path) != STDOUT)
    if len(files) < len(outputs) and (output_format == "text" or is_silent):
        raise click.UsageError(
            "-o - writes to standard output what --format says: pcapng for "
            "`| wireshark -k -i -`, or jsonl"
        )
    return files


def _printer(
    output_format: str, times: str, color: bool | None, source: str, options: Options
) -> Sink:
    if output_format == "pcapng":
        if sys.stdout.isatty():
            raise click.UsageError(
                "--format pcapng is no text: pipe it into `wireshark -k -i -`, or write a file "
                "with -o x.pcapng"
            )
        from sniffer.jobs.outputs import session_facts
        from sniffer.pcapfile.sink import PcapngSink

        return PcapngSink(sys.stdout.buffer, session_facts(source, options))
    if output_format == "jsonl":
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(encoding="utf-8", newline="\n")  # whatever the terminal speaks
        from sniffer.sinks.jsonl import JsonlSink

        return JsonlSink(sys.stdout)
    from sniffer.sinks.text import TextSink

    return TextSink(sys.stdout, color=color, times=times)
