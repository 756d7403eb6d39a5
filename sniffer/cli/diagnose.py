"""``sniffer diagnose``: what is wrong with a bus, why, and what to do next."""

from __future__ import annotations

import json

import click

from sniffer.cli.options import (
    captures_in,
    decoding,
    examples,
    with_color,
    with_files,
    with_format,
    with_quiet,
    with_together,
)
from sniffer.cli.selecting import with_part
from sniffer.cli.servos import with_alarms
from sniffer.cli.signals import patient
from sniffer.cli.statuses import DONE, status_of
from sniffer.decoding.options import Options
from sniffer.diagnosis.shared import OneWay, wires_of
from sniffer.jobs.diagnose import diagnose as diagnose_file
from sniffer.jobs.telling import Teller
from sniffer.selection.places import Window
from sniffer.sources.several import name_of


@click.command(
    short_help="Name what is wrong with a bus, and why.",
    epilog=examples(
        "sniffer diagnose run.mcap",
        "sniffer diagnose capture.log --format json",
        "sniffer diagnose run.mcap --from 10 --to 20",
        "sniffer diagnose run.mcap --why 1",
    ),
)
@with_files
@with_together
@with_part
@decoding
@with_alarms
@with_format("text", "json")
@click.option("--why", metavar="ID", help="Show how the causes of an incident were weighed.")
@with_color
@with_quiet
def diagnose(
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    output_format: str,
    why: str | None,
    together: bool,
    window: Window | None,
    color: bool | None,
    tell: Teller,
) -> int:
    """Say what is wrong on the bus in each FILE: incidents, their causes, what to do next.

    Exit status: 0 done; 2 a mistake of yours; 3 an input breaks off (what could be read is judged).
    """
    status = DONE
    captures = captures_in(files, together=together)
    wires: dict[str, OneWay] = {}
    for capture in captures:
        with patient() as patience:
            done = diagnose_file(
                capture,
                options,
                input_format=input_format,
                window=window,
                patience=patience,
                tell=tell,
            )
        status = max(status, status_of(done.ending, is_lost=False))
        if done.is_one_bus:
            wires |= {name_of(capture): wire for wire in done.one_way}
        if output_format == "json":
            click.echo(json.dumps(done.as_dict()))
            continue
        from sniffer.sinks.consoles import console_for, unfold, unpadded
        from sniffer.sinks.story import print_incidents, print_weighing

        console = console_for(color=color)
        unfold(console)
        if len(captures) > 1:
            click.echo(f"{name_of(capture)}:")
        with unpadded(console):
            if why is not None:
                print_weighing(done.incidents, why, console, done.names, is_one_bus=done.is_one_bus)
            else:
                print_incidents(
                    done.incidents,
                    done.sentence,
                    clock=done.has_clock,
                    began_ns=done.first_ns,
                    rest=done.rest,
                    console=console,
                    names=done.names,
                    shared=done.shared,
                    is_one_bus=done.is_one_bus,
                )
    for told in wires_of(wires):
        tell.warn(told)
    return status
