"""``sniffer diagnose``: what is wrong with a bus, why, and what to do next."""

from __future__ import annotations

import json

import click

from sniffer.cli.options import decoding, examples, pipeline_options
from sniffer.cli.session import run_source
from sniffer.diagnosis import Diagnosis
from sniffer.ground.registers import RegisterMap
from sniffer.sources import open_source


@click.command(
    short_help="Name what is wrong with a bus, and why.",
    epilog=examples(
        "sniffer diagnose run.mcap",
        "sniffer diagnose capture.log --format json",
        "sniffer diagnose run.mcap --why 1",
    ),
)
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
@decoding
@click.option(
    "--format",
    "output_format",
    type=click.Choice(["text", "json"]),
    default="text",
    show_default=True,
    help="What is printed.",
)
@click.option("--why", metavar="ID", help="Show how the causes of an incident were weighed.")
def diagnose(
    files: tuple[str, ...],
    protocol: str,
    input_format: str,
    baud: int | None,
    models: dict[int | None, str],
    tables: tuple[RegisterMap, ...],
    latency: float | None,
    output_format: str,
    why: str | None,
) -> int:
    """Say what is wrong on the bus in each FILE: incidents, their causes, what to do next."""
    worst = 0
    for file in files:
        options = pipeline_options(protocol, baud, models, latency, tables)
        source = open_source(file, input_format)
        options = options.with_facts(source.facts(), source.tables)
        diagnosis = Diagnosis()
        name = "standard input" if file == "-" else file
        _, status = run_source(source, options, [diagnosis], name=name, quiet=False)
        worst = max(worst, status)
        incidents = diagnosis.incidents()
        if output_format == "json":
            told = {"incidents": [i.as_dict() for i in incidents], "judged": diagnosis.judged()}
            click.echo(json.dumps(told))
            continue
        from sniffer.sinks.story import print_incidents, print_weighing

        if why is not None:
            print_weighing(incidents, why)
        else:
            print_incidents(incidents, diagnosis.sentence(), clock=diagnosis.has_clock)
    return worst
