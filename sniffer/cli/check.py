"""``sniffer check``: captures held to rules, for CI."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

import click

from sniffer.cli.options import (
    captures_in,
    decoding,
    examples,
    with_files,
    with_force,
    with_format,
    with_quiet,
    with_together,
)
from sniffer.cli.selecting import with_part
from sniffer.cli.signals import patient
from sniffer.cli.statuses import DONE, INTERRUPTED, MISTAKE, status_of
from sniffer.cli.streams import say
from sniffer.decoding.options import Options
from sniffer.ground.files import open_text, writing
from sniffer.ground.model import InputError
from sniffer.ground.naming import worded
from sniffer.ground.wording import plain
from sniffer.jobs.check import Checked
from sniffer.jobs.check import check as hold
from sniffer.jobs.outputs import check_outputs
from sniffer.jobs.session import Ending
from sniffer.jobs.telling import Teller
from sniffer.reports.judging import Decision, tally
from sniffer.reports.junit import Suite, junit
from sniffer.reports.rules import example, read_rules
from sniffer.selection.places import Window
from sniffer.sources.several import name_of

BROKEN: Final = 1
"""Exit status: a rule is not kept."""


def _example(context: click.Context, parameter: click.Parameter, asked: bool) -> None:
    """Print the example and end the command."""
    if asked and not context.resilient_parsing:
        click.echo(example(), nl=False)
        context.exit()


@click.command(
    short_help="Hold captures to rules, for CI.",
    epilog=examples(
        "sniffer check --example > rules.toml",
        "sniffer check run.mcap --rules rules.toml",
        "sniffer check captures/*.log --rules rules.toml --junit verdicts.xml",
        "sniffer check run.mcap --rules rules.toml --format jsonl | jq 'select(.holds == false)'",
    ),
)
@with_files
@click.option(
    "--rules",
    "rules_file",
    type=click.Path(path_type=Path),
    required=True,
    metavar="RULES.toml",
    help="What is asked of a capture.",
)
@with_together
@with_part
@decoding
@click.option(
    "--junit",
    "junit_file",
    type=click.Path(path_type=Path),
    metavar="FILE.xml",
    help="Also write the verdicts as JUnit XML.",
)
@with_force
@with_format("text", "jsonl")
@click.option(
    "--example",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_example,
    help="Print a file of rules to begin with, and exit.",
)
@with_quiet
def check(
    files: tuple[str, ...],
    rules_file: Path,
    options: Options,
    input_format: str,
    junit_file: Path | None,
    force: bool,
    output_format: str,
    together: bool,
    window: Window | None,
    tell: Teller,
) -> int:
    """Hold each FILE to the rules of a TOML file: no incident of a cause, answers in time, ...

    Each rule passes, fails, or cannot be decided; what cannot be decided fails, unless the rules
    say that it passes. Exit status: 0 all rules are kept; 1 one is not; 2 a mistake of yours; 3 an
    input breaks off (the rules are held against what could be read).
    """
    rules = read_rules(rules_file)
    if junit_file is not None:
        check_outputs([junit_file], [*files, str(rules_file)], force=force, later=True)
    for file in files:
        if file != "-" and not Path(file).exists():
            raise InputError(f"{file}: there is no such file")  # before anything is judged
    suites: list[Suite] = []
    status = DONE
    for capture in captures_in(files, together=together):
        name = name_of(capture)
        try:
            with patient() as patience:
                done = hold(
                    capture,
                    rules,
                    options,
                    input_format=input_format,
                    window=window,
                    patience=patience,
                    tell=tell,
                )
        except InputError as error:
            say(worded(error))
            if output_format == "jsonl":
                _print_line({"type": "error", "source": name, "detail": worded(error)})
            suites.append(Suite(name, (), worded(error)))
            status = max(status, MISTAKE)
            continue
        ended = status_of(done.ending)
        suites.append(Suite(name, done.verdicts, _why(done)))
        if output_format == "jsonl":
            _print_lines(name, done)
        else:
            _print(name, done)
        status = max(status, ended, DONE if done.holds else BROKEN)
        if ended == INTERRUPTED:
            break
    if junit_file is not None:
        with writing(junit_file), open_text(junit_file) as xml:
            xml.write(junit(suites))
    return status


def _why(done: Checked) -> str:
    """Return why a capture was not judged to its end; empty: it was."""
    if done.ending == Ending.MISTAKEN:
        return "nothing of it can be read by the protocol that was named"
    return "" if done.ending == Ending.DONE else done.damage


def _print_lines(name: str, done: Checked) -> None:
    """Print a capture's verdicts for programs, and what they come to."""
    for judged in done.verdicts:
        told = judged.as_dict()
        _print_line({"type": told.pop("type"), "source": name, **told})
    counts = {v.name.lower(): sum(j.verdict == v for j in done.verdicts) for v in Decision}
    broken = _why(done) or None
    _print_line(
        {"type": "summary", "source": name, "holds": done.holds, **counts, "broken_off": broken}
    )


def _print_line(told: dict[str, Any]) -> None:
    click.echo(json.dumps(told, ensure_ascii=False))


def _print(name: str, done: Checked) -> None:
    """Print a capture's verdicts, a line each, and how many there are of each kind."""
    click.echo(plain(name))
    width = max(len(judged.word) for judged in done.verdicts)
    for judged in done.verdicts:
        click.echo(plain(f"  {judged.word:{width}}  {judged.rule.name}: {judged.figure}"))
    click.echo(f"  {tally(done.verdicts)}")
