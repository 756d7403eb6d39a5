"""``sniffer doctor``: is this port fit to be recorded from?"""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterator
from dataclasses import replace
from typing import Final, Literal

import click
from click.core import ParameterSource
from rich.text import Text

from sniffer.cli.amounts import Duration, port_spec
from sniffer.cli.options import (
    SHARED,
    ProtocolName,
    Renamed,
    Whole,
    examples,
    files_here,
    with_color,
    with_format,
)
from sniffer.cli.profiles import Ports, with_profile
from sniffer.cli.streams import say
from sniffer.decoding.pipeline import AUTO
from sniffer.doctor.examine import Examined, examine, prepare
from sniffer.doctor.records import Level, Observation
from sniffer.ground.limits import BAUDS
from sniffer.ground.model import NS
from sniffer.ground.naming import worded
from sniffer.sinks.consoles import console_for, unfold

_STYLES: Final = {Level.OK: "green", Level.NOTE: "cyan", Level.WARN: "yellow", Level.BAD: "red"}
_ABOUT: Final = 6
_TEXT: Final = 16
"""Columns at which a verdict's topic and its text begin."""


@click.command(
    short_help="Check whether a port is fit to record from.",
    epilog=examples(
        "sniffer doctor /dev/ttyUSB0",
        "sniffer doctor /dev/ttyUSB0=mightyzap@57600 --duration 30s",
        "sniffer doctor /dev/ttyUSB0 --baud 115200 --format jsonl",
        "sniffer doctor /dev/ttyUSB0 --prepare",
    ),
)
@click.argument("port", shell_complete=files_here, cls=Ports, metavar="PORT[=PROTOCOL][@BAUD]")
@click.option(
    "--duration",
    cls=Renamed,
    former=("--seconds",),
    type=Duration(0.1, 3600),
    default="5s",
    show_default=True,
    help="How long to listen.",
)
@click.option("--baud", type=Whole(*BAUDS), help="Bits per second.")
@click.option(
    "--protocol",
    type=ProtocolName(AUTO),
    default=AUTO,
    show_default=True,
    help="What is spoken on the bus; auto tells it from the bytes.",
)
@click.option(
    "--modem",
    type=click.Choice(["low", "keep"]),
    default="low",
    show_default=True,
    help="What becomes of RTS and DTR, which the system raises.",
)
@click.option("--shared", is_flag=True, help=SHARED)
@click.option(
    "--prepare",
    "only_prepare",
    is_flag=True,
    help="Only set PORT up, so that it echoes nothing when it is opened again. For before the bus "
    "is connected; it holds until the adapter is unplugged.",
)
@with_profile
@with_format("text", "jsonl")
@with_color
def doctor(
    port: str,
    duration: int,
    baud: int | None,
    protocol: str,
    modem: Literal["low", "keep"],
    shared: bool,
    only_prepare: bool,
    output_format: str,
    color: bool | None,
) -> int:
    """Listen to PORT for a while and judge: wiring, baud, protocol, errors, latency, times.

    Nothing is written to it; what opening a port does by itself, it tells. Exit status: 0 nothing
    is bad; 1 something is; 2 a mistake of yours.
    """
    spec = port_spec(port, "")

    def is_said(name: str) -> bool:
        """Return whether the command line says it: what a profile says gives way to the port."""
        source = click.get_current_context().get_parameter_source(name)
        return source is ParameterSource.COMMANDLINE

    if spec.protocol is not None and is_said("protocol") and protocol not in (AUTO, spec.protocol):
        raise click.UsageError(f"{port} and --protocol {protocol} differ: which one is it?")
    if spec.baud is not None and is_said("baud") and baud not in (None, spec.baud):
        raise click.UsageError(f"{port} and --baud {baud} differ: which one is it?")
    spoken = spec.protocol if isinstance(spec.protocol, str) else protocol
    rate = spec.baud or baud
    if only_prepare:
        verdict = prepare(spec.port, spoken, baud=rate, modem=modem, shared=shared)
        if output_format == "jsonl":
            click.echo(json.dumps(verdict.as_dict(), ensure_ascii=False))
        else:
            before = verdict.numbers["echo_at_open"]
            click.echo(f"{spec.port}: prepared; its echo was {before} before")
        return 0
    told = examine(
        spec.port, spoken, baud=rate, seconds=duration / NS, modem=modem, shared=shared, tell=say
    )
    if output_format == "jsonl":
        for record in (*(v.as_dict() for v in _worded(told)), told.summary()):
            click.echo(json.dumps(record, ensure_ascii=False))
    else:
        console = console_for(color=color)
        unfold(console)
        for line in lines(told, console.width):
            console.print(line, soft_wrap=True)
    return 1 if told.level == Level.BAD else 0


def _worded(told: Examined) -> list[Observation]:
    """Return the verdicts in the words of the command line."""
    return [replace(v, text=worded(v.text), advice=worded(v.advice)) for v in told.verdicts]


def lines(told: Examined, width: int) -> Iterator[Text]:
    """Yield the verdicts as people read them."""
    heard = told.heard
    yield Text(f"{heard.path}: {heard.seconds:.1f} s at {heard.baud} baud", style="bold")
    yield Text()
    for verdict in _worded(told):
        word = verdict.level.name.lower()
        head = word.ljust(_ABOUT) + verdict.about.ljust(_TEXT - _ABOUT)
        first_line, *rest = _wrapped(verdict.text, width, head, " " * _TEXT)
        first = Text(first_line)
        first.stylize(_STYLES[verdict.level], 0, len(word))
        yield first
        if verdict.advice:
            arrow = " " * _TEXT + "→ "
            rest += _wrapped(verdict.advice, width, arrow, " " * len(arrow))
        # commands stay whole: they are there to be copied
        rest += [" " * _ABOUT + command for command in verdict.commands]
        yield from map(Text, rest)
    yield Text()
    yield from map(Text, _conclusion(told, width))


def _wrapped(text: str, width: int, head: str, indent: str) -> list[str]:
    """Break a text between words; a path or an option is one word."""
    return textwrap.wrap(
        text,
        width,
        initial_indent=head,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def _conclusion(told: Examined, width: int) -> list[str]:
    level, heard = told.level, told.heard
    topics = ", ".join(v.about for v in told.verdicts if v.level == level)
    if level == Level.BAD:
        return _wrapped(f"not fit to record from: {topics}", width, "", "")
    doubts = f", with doubts about {topics}" if level == Level.WARN else ""
    command = f"sniffer record {heard.path}={heard.named(told.found.protocol)}@{heard.baud}"
    return [*_wrapped(f"fit to record from{doubts}", width, "", ""), " " * _ABOUT + command]
