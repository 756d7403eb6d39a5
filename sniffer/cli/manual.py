"""``sniffer manual``: all commands with all their options as a page of the system's manual."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

import click

from sniffer import __version__
from sniffer.cli.options import examples
from sniffer.cli.profiles import VARIABLE

EXITS: Final = {
    0: "Done.",
    1: "What was asked about is so: anomalies as grave as --fail-on says, a rule that is not kept, "
    "bytes that are no frame, recordings that differ.",
    2: "A mistake of the user's, told in one line.",
    3: "The input is damaged; what could be read was written.",
}
"""The statuses that all commands share."""

ENVIRONMENT: Final = {
    "NO_COLOR, FORCE_COLOR": "No colours; colours in pipes, too. --color wins over both.",
    "COLUMNS": "How wide text is laid out, in pipes, too.",
    VARIABLE: "The profile where --profile names none.",
    "XDG_CONFIG_HOME": "Where sniffer/config.toml lies, in place of ~/.config.",
    "SNIFFER_DEBUG": "Set to anything, faults of the program are shown with their traceback.",
}

FILES: Final = {
    "sniffer.toml": "Profiles, of the folder where the command runs.",
    "~/.config/sniffer/config.toml": "Profiles of the user.",
}


@click.command(
    short_help="Print the manual page.",
    epilog=examples(
        "sniffer manual | man -l -",
        "sniffer manual > ~/.local/share/man/man1/sniffer.1",
    ),
)
def manual() -> None:
    """Print the page sniffer(1) of the manual, made from the commands as they are."""
    from sniffer.cli import cli

    click.echo("\n".join(_page(cli)))


def _page(group: click.Group) -> Iterator[str]:
    top = click.Context(group, info_name="sniffer")
    yield f'.TH SNIFFER 1 "" "sniffer {__version__}" "User Commands"'
    yield from (".SH NAME", rf"sniffer \- {_plain(group.help or '')}")
    yield from (".SH SYNOPSIS", r".B sniffer", r"\fICOMMAND\fR [\fIOPTIONS\fR] ...")
    yield ".SH COMMANDS"
    for name, command in sorted(group.commands.items()):
        yield from _command(command, click.Context(command, top, info_name=name))
    told = {str(k): v for k, v in EXITS.items()}
    for title, facts in (("EXIT STATUS", told), ("ENVIRONMENT", ENVIRONMENT), ("FILES", FILES)):
        yield f".SH {title}"
        for what, text in facts.items():
            yield from (".TP", rf"\fB{_plain(what)}\fR", _plain(text))


def _command(command: click.Command, context: click.Context) -> Iterator[str]:
    usage = " ".join((context.command_path, *command.collect_usage_pieces(context)))
    yield f".SS {_plain(usage)}"
    for nth, paragraph in enumerate(re.split(r"\n\s*\n", (command.help or "").strip())):
        if nth:
            yield ".PP"
        yield _plain(paragraph)
    for param in command.get_params(context):
        record = param.get_help_record(context)
        if record is not None and isinstance(param, click.Option):
            yield from (".TP", rf"\fB{_plain(record[0])}\fR", _plain(record[1]))
    lines = [line.strip() for line in (command.epilog or "").splitlines()[2:]]
    if lines:
        yield from (".PP", "Examples:", ".PP", ".nf", *(_plain(line) for line in lines), ".fi")


def _plain(text: str) -> str:
    """Return a text as roff prints it as it is, in one line."""
    line = " ".join(text.replace("\b", "").split()).replace("\\", r"\e").replace("-", r"\-")
    return rf"\&{line}" if line.startswith((".", "'")) else line
