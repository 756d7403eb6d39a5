"""``sniffer decode``: a capture, a dump or a recording, decoded."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import click

from sniffer.cli.options import decoding, examples, pipeline_options, printed, with_force
from sniffer.jobs.session import Standard, run_source, tell_lost
from sniffer.decoding.sink import Sink
from sniffer.ground.model import Severity
from sniffer.ground.registers import RegisterMap
from sniffer.jobs.outputs import open_outputs, session_facts
from sniffer.sources import open_source


@click.command(
    short_help="Decode a capture, a dump, a log or a recording.",
    epilog=examples(
        "sniffer decode dump.hex",
        "sniffer decode capture.bin --protocol wck --baud 115200 -o capture.mcap",
        "sniffer decode capture.bin --model 3=mightyzap-12lf -o samples.parquet --summary",
        "candump-like-logger | sniffer decode - --format jsonl",
    ),
)
@click.argument("file")
@decoding
@printed
@click.option(
    "-o",
    "--output",
    "outputs",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Also write a file; its suffix says what: .jsonl .csv .parquet .mcap .rrd. "
    "May be repeated.",
)
@with_force
@click.option(
    "--fail-on",
    type=click.Choice([s.name.lower() for s in Severity]),
    help="Exit with status 1 if there are anomalies of this level or above.",
)
@click.option("--summary", is_flag=True, help="Print the summary only.")
@click.option("--quiet", is_flag=True, help="Print nothing; the files and the exit status speak.")
def decode(
    file: str,
    protocol: str,
    input_format: str,
    baud: int | None,
    models: dict[int | None, str],
    tables: tuple[RegisterMap, ...],
    latency: float | None,
    output_format: str,
    outputs: tuple[Path, ...],
    force: bool,
    fail_on: str | None,
    summary: bool,
    quiet: bool,
) -> int:
    """Decode FILE (- is standard input): raw bytes, a hex dump, a log, or a recording.

    What goes wrong on the bus is part of the output. Exit status: 0 done; 1 anomalies at or above
    --fail-on; 2 a mistake of yours; 3 the input breaks off (what could be read is written).
    """
    options = pipeline_options(protocol, baud, models, latency, tables)
    source = open_source(file, input_format)
    options = options.with_facts(source.facts(), source.tables)
    facts = session_facts(file, options, source.facts())
    sinks: list[Sink] = open_outputs(outputs, facts, file, force=force)
    if not quiet and not summary:
        sinks.append(Standard(_printer(output_format), alone=not outputs))
    name = "standard input" if file == "-" else file
    pipeline, status = run_source(source, options, sinks, name=name, quiet=quiet)
    lost = tell_lost(outputs)
    status = status or lost
    if summary and not quiet and output_format == "jsonl":
        click.echo(json.dumps(pipeline.summary.as_dict()))
    elif summary and not quiet:
        from rich.console import Console

        from sniffer.sinks.report import print_summary

        print_summary(pipeline.summary, Console(highlight=False))
    worst = pipeline.summary.worst()
    if not status and fail_on and worst is not None and worst >= Severity[fail_on.upper()]:
        return 1
    return status


def _printer(output_format: str) -> Sink:
    if output_format == "jsonl":
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(encoding="utf-8", newline="\n")  # whatever the terminal speaks
        from sniffer.sinks.jsonl import JsonlSink

        return JsonlSink(sys.stdout)
    from sniffer.sinks.text import TextSink

    return TextSink(sys.stdout)
