"""``sniffer stats``: load, rates, response times, following errors, anomalies, in numbers."""

from __future__ import annotations

import csv
import json
import sys

import click

from sniffer.cli.options import (
    captures_in,
    decoding,
    examples,
    with_every,
    with_files,
    with_format,
    with_quiet,
    with_together,
)
from sniffer.cli.selecting import say_selected, with_part, with_rows
from sniffer.cli.servos import with_alarms
from sniffer.cli.signals import patient
from sniffer.cli.statuses import DONE, status_of
from sniffer.decoding.options import Options
from sniffer.jobs.stats import stats as count
from sniffer.jobs.telling import Teller
from sniffer.selection.places import Window
from sniffer.selection.selection import Selection
from sniffer.statistics.flat import COLUMNS, NAMED_COLUMNS, rows
from sniffer.statistics.slices import FINEST_NS


@click.command(
    short_help="Count and measure: load, rates, times, errors.",
    epilog=examples(
        "sniffer stats run.mcap",
        "sniffer stats run.mcap --from 10 --to 20",
        "sniffer stats run.mcap --servo 3 --op store_data",
        "sniffer stats run.mcap --every 1s",
        "sniffer stats run.mcap --alarm 'temperature > 60'",
        "sniffer stats a.log b.log --format csv > figures.csv",
    ),
)
@with_files
@with_together
@with_part
@with_rows
@decoding
@with_alarms
@with_format(
    "text", "json", "csv", about="What is printed: a line a file (json), a row a figure (csv)."
)
@with_every(
    FINEST_NS,
    "Also tell load, missing answers, anomalies and response times slice by slice of time: 1s, "
    "100ms, 1min.",
)
@click.option("--all", "all_rows", is_flag=True, help="Print all rows of long tables.")
@with_quiet
def stats(
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    output_format: str,
    every_ns: int | None,
    all_rows: bool,
    together: bool,
    window: Window | None,
    selection: Selection | None,
    tell: Teller,
) -> int:
    """Count and measure what each FILE holds.

    Of each bus its load and where the bytes went; of each servo and command how often, how
    regularly, how fast and how much is missing; of each servo how far it is from its goals, how
    soon it begins to move, how its goals settle, which it never reached, and its extremes; of each
    anomaly when and how often. With --alarm RULE also how long each servo met the rule; with
    --every 1s load, missing answers, anomalies and response times second by second. Of a selection
    (--servo, --where ...) what is selected is counted: rates and loads of that, over all the time.

    Exit status: 0 done; 2 a mistake of yours; 3 an input breaks off (what could be read is
    counted).
    """
    status = DONE
    captures = captures_in(files, together=together)
    for number, capture in enumerate(captures):
        with patient() as patience:
            done = count(
                capture,
                options,
                input_format=input_format,
                window=window,
                selection=selection,
                every_ns=every_ns,
                patience=patience,
                tell=tell,
            )
        status = max(status, status_of(done.ending, is_lost=False))
        figures = done.as_dict()
        if output_format != "text":
            say_selected(done.summary, tell)
        if output_format == "json":
            click.echo(json.dumps(figures))
        elif output_format == "csv":
            if not number:  # which columns there are, the first capture decides
                columns = NAMED_COLUMNS if done.statistics.names else COLUMNS
                table = csv.DictWriter(
                    sys.stdout, columns, lineterminator="\n", extrasaction="ignore"
                )
                table.writeheader()
            table.writerows(rows(figures))
        else:
            from sniffer.sinks.stats import MOST, print_stats

            if len(captures) > 1:
                click.echo(f"{done.source}:")
            if done.summary.shown:
                from sniffer.sinks.report import selected

                click.echo(selected(done.summary))
            most = None if all_rows else MOST
            print_stats(
                figures,
                done.statistics,
                began_ns=done.summary.began_ns,
                most=most,
                how=": --all shows them",
            )
    return status
