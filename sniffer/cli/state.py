"""``sniffer state``: what each register of each servo held."""

from __future__ import annotations

import json

import click

from sniffer.cli.options import decoding, examples, with_files, with_format, with_quiet
from sniffer.cli.selecting import say_selected, with_part, with_rows
from sniffer.cli.signals import patient
from sniffer.cli.statuses import status_of
from sniffer.decoding.options import Options
from sniffer.jobs.held import registers_held
from sniffer.jobs.telling import Teller
from sniffer.selection.places import Window
from sniffer.selection.selection import Selection


@click.command(
    short_help="Tell what each register of each servo held.",
    epilog=examples(
        "sniffer state run.mcap",
        "sniffer state run.mcap --servo 3 --to 10",
        "sniffer state run.mcap --where \"role = 'config'\"",
        "sniffer state run.mcap --format jsonl",
    ),
)
@with_files
@with_part
@with_rows
@decoding
@with_format("text", "jsonl", about="What is printed: a line a register (jsonl).")
@with_quiet
def state(
    files: tuple[str, ...],
    options: Options,
    input_format: str,
    output_format: str,
    window: Window | None,
    selection: Selection | None,
    tell: Teller,
) -> int:
    """Tell what was first and last read or written of each register of each servo in FILE.

    Several are one capture, read in the order of their times: such as the files of a rotation.

    And how often it was, and how often it changed: settings, goals and commands, what was measured.
    Servos of which the same was said stand together, so a setting that one of them has otherwise,
    or that changed more often there, is a line of its own. `sniffer registers MODEL` shows what
    there is.

    Exit status: 0 done; 2 a mistake of yours; 3 an input breaks off (what could be read is told).
    """
    with patient() as patience:
        done = registers_held(
            files,
            options,
            input_format=input_format,
            window=window,
            selection=selection,
            patience=patience,
            tell=tell,
        )
    say_selected(done.summary, tell)
    if output_format == "jsonl":
        for record in done.as_dicts():
            click.echo(json.dumps(record, ensure_ascii=False))
    elif done.registers:
        from sniffer.sinks.held import print_held

        print_held(done.registers, done.summary.names, done.began_ns)
    else:
        is_part = selection is not None or (window is not None and window.is_part)
        where = " in what is asked for" if is_part else ""
        click.echo(f"no register was read or written{where}, as far as a table names them")
        if selection is not None and (why := selection.lacking_in("samples")):
            tell.warn(why)
    return status_of(done.ending, is_lost=False)
