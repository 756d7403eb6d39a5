"""``sniffer doctor``: is this port fit to be recorded from?"""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import textwrap
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final, Literal, Protocol, cast, runtime_checkable

import click
from rich.console import Console
from rich.text import Text

from sniffer.cli.amounts import port_spec
from sniffer.cli.options import (
    SHARED,
    Finite,
    ProtocolName,
    Whole,
    examples,
    printed,
)
from sniffer.cli.streams import say
from sniffer.decoding.names import protocols_named
from sniffer.decoding.pipeline import AUTO
from sniffer.doctor import (
    Finding,
    Level,
    Listened,
    Trial,
    about_echo,
    diagnose,
    understand,
    usual_bauds,
    worst,
)
from sniffer.ground.limits import BAUDS, FALLBACK_BAUD
from sniffer.ground.model import NS, Chunk, Clock, InputError
from sniffer.ports import Port, PortLostError, PortOptions, open_port
from sniffer.ports.listing import port_at

TRIAL_S: Final = 1.0
"""How long another baud is listened at."""

TRIAL_BYTES: Final = 1000
"""Bytes that are enough to tell whether it is the right one, though it begins within a frame."""

_STYLES: Final = {Level.OK: "green", Level.NOTE: "cyan", Level.WARN: "yellow", Level.BAD: "red"}
_ABOUT: Final = 6
_TEXT: Final = 16
"""Columns at which a verdict's topic and its text begin."""


@runtime_checkable
class Tunable(Port, Protocol):
    """A port whose baud can be changed while it stays open: RTS and DTR stay as they are."""

    def set_baud(self, baud: int) -> None:
        """Listen at another baud; what has come and was not read is thrown away."""


@click.command(
    short_help="Check whether a port is fit to record from.",
    epilog=examples(
        "sniffer doctor /dev/ttyUSB0",
        "sniffer doctor /dev/ttyUSB0=mightyzap@57600 --seconds 30",
        "sniffer doctor /dev/ttyUSB0 --baud 115200 --format jsonl",
        "sniffer doctor /dev/ttyUSB0 --prepare",
    ),
)
@click.argument("port", metavar="PORT[=PROTOCOL][@BAUD]")
@click.option(
    "--seconds",
    type=Finite(0.1, 3600),
    default=5.0,
    show_default=True,
    metavar="S",
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
    is_flag=True,
    help="Only set PORT up, so that it echoes nothing when it is opened again. For before the bus "
    "is connected; it holds until the adapter is unplugged.",
)
@printed
def doctor(
    port: str,
    seconds: float,
    baud: int | None,
    protocol: str,
    modem: str,
    shared: bool,
    prepare: bool,
    output_format: str,
) -> int:
    """Listen to PORT for a while and judge: wiring, baud, protocol, errors, latency, times.

    Nothing is written to it; what opening a port does by itself, it tells. Exit status: 0 nothing
    is bad; 1 something is; 2 a mistake of yours.
    """
    spec = port_spec(port, "")
    if spec.protocol is not None and protocol not in (AUTO, spec.protocol):
        raise click.UsageError(f"{port} and --protocol {protocol} differ: which one is it?")
    if spec.baud is not None and baud not in (None, spec.baud):
        raise click.UsageError(f"{port} and --baud {baud} differ: which one is it?")
    spoken = spec.protocol if isinstance(spec.protocol, str) else protocol
    mode = cast('Literal["low", "keep"]', modem)
    how = PortOptions(_first_baud(spoken, spec.baud or baud), mode, shared=shared)
    if prepare:
        return _prepare(spec.port, how, output_format)
    is_named = (spec.baud or baud) is not None
    heard = examine(spec.port, spoken, how, seconds, baud_is_named=is_named)
    verdicts = diagnose(heard)
    if output_format == "jsonl":
        for record in (*(v.as_dict() for v in verdicts), _summary(heard, verdicts)):
            click.echo(json.dumps(record, ensure_ascii=False))
    else:
        console = Console(highlight=False, soft_wrap=True)
        for line in lines(heard, verdicts, console.width):
            console.print(line)
    return 1 if worst(verdicts) == Level.BAD else 0


def _first_baud(protocol: str, baud: int | None) -> int:
    return baud or (protocols_named(protocol)[0].baud if protocol != AUTO else FALLBACK_BAUD)


def _prepare(name: str, how: PortOptions, output_format: str) -> int:
    """Open a port and let go of it: the kernel keeps the settings."""
    with contextlib.closing(open_port(name, how)) as port:
        verdict = about_echo(port.facts())
    if verdict is None:
        raise InputError(f"{name} is no port of this machine: its echo is not ours to switch off")
    if output_format == "jsonl":
        click.echo(json.dumps(verdict.as_dict(), ensure_ascii=False))
    else:
        click.echo(f"{name}: prepared; its echo was {verdict.numbers['echo_at_open']} before")
    return 0


def examine(
    name: str, protocol: str, how: PortOptions, seconds: float, *, baud_is_named: bool
) -> Listened:
    """Open a port, listen, and let go of it.

    Args:
        name: the port.
        protocol: what is spoken there, or ``auto``.
        how: how to open it.
        seconds: how long.
        baud_is_named: whether its baud was named; else the usual ones are tried if it is not right.

    Raises:
        InputError: the port cannot be opened.
    """
    info = port_at(name)
    with contextlib.closing(open_port(name, how)) as port:
        about = Listened(
            path=name,
            chunks=(),
            seconds=seconds,
            baud=how.baud,
            protocol=protocol,
            marks_errors=port.marks_errors,
            latency_ns=port.latency_ns,
            facts=port.facts(),
            info=info,
            has_line=_has_line(name),
            counts_errors=port.counts_errors,
        )
        return hear(port, about, baud_is_named=baud_is_named)


def _has_line(name: str) -> bool:
    """Tell whether a UART keeps the baud that is asked for."""
    if "://" in name:
        return name.lower().startswith("rfc2217://")
    return not os.path.realpath(name).startswith("/dev/pts/")


def hear(port: Port, about: Listened, *, baud_is_named: bool) -> Listened:
    """Listen at the baud of ``about``; if it may be wrong, at others, too.

    If nobody has named a baud and one of the others is right, that one is listened at to the end.
    """
    heard = _listen(port, about)
    found = understand(heard.chunks, heard.protocol, heard.line_baud)
    if not heard.has_line:
        if not baud_is_named and found.protocol is not None:
            heard = replace(heard, baud=protocols_named(found.protocol)[0].baud)
        return heard
    silent = not heard.size and not heard.line_errors
    if found.good or silent or heard.gone_s is not None or not isinstance(port, Tunable):
        return heard
    trials = _trials(port, heard)
    best = max(trials, key=lambda t: t.found.share, default=None)
    if not baud_is_named and best is not None and best.found.good:
        port.set_baud(best.baud)
        return _listen(port, replace(about, baud=best.baud))
    return replace(heard, trials=tuple(trials))


def _listen(port: Port, about: Listened, enough: int | None = None) -> Listened:
    """Listen for ``about.seconds``, or until there are ``enough`` bytes."""
    if enough is None:
        say(f"listening to {about.path} for {about.seconds:g} s at {about.baud} baud")
    before = port.counters()
    chunks: list[Chunk] = []
    began = time.monotonic_ns()
    until = began + int(about.seconds * NS)
    gone_s = None
    size = 0
    try:
        for t_ns, raw in _reads(port, until):
            data, marks = port.unmark(raw)
            chunks.append(Chunk(data, t_ns, Clock.READ, marks=marks))
            size += len(data)
            if enough is not None and size >= enough:
                break
    except PortLostError:
        gone_s = (time.monotonic_ns() - began) / NS
    after = None if gone_s is not None else port.counters()
    return replace(
        about,
        chunks=chunks,
        seconds=(time.monotonic_ns() - began) / NS,
        risen=after.since(before) if before is not None and after is not None else None,
        gone_s=gone_s,
    )


def _reads(port: Port, until: int) -> Iterator[tuple[int, bytes]]:
    """Yield each read and its time, as soon as it can be had."""
    with selectors.DefaultSelector() as selector:
        if port.pollable:
            selector.register(port.fileno(), selectors.EVENT_READ)
        while (now := time.monotonic_ns()) < until:
            if port.pollable and not selector.select((until - now) / NS):
                return
            raw = port.read()
            if raw:
                yield time.monotonic_ns(), raw


def _trials(port: Tunable, heard: Listened) -> list[Trial]:
    """Listen at the other usual bauds until one is right."""
    bauds = usual_bauds(heard.protocol, heard.baud)
    say(f"{heard.baud} baud are not understood: trying {', '.join(map(str, bauds))}")
    out: list[Trial] = []
    for baud in bauds:
        try:
            port.set_baud(baud)
        except InputError:  # the adapter cannot do it, so nobody speaks to it that way
            continue
        tried = _listen(port, replace(heard, baud=baud, seconds=TRIAL_S), TRIAL_BYTES)
        if tried.gone_s is not None:
            break
        out.append(Trial(baud, understand(tried.chunks, heard.protocol, baud)))
        if out[-1].found.good:
            break
    return out


def _summary(heard: Listened, verdicts: Sequence[Finding]) -> dict[str, Any]:
    found = understand(heard.chunks, heard.protocol, heard.line_baud)
    return {
        "type": "summary",
        "level": worst(verdicts).name.lower(),
        "port": heard.path,
        "protocol": found.protocol,
        "baud": heard.baud,
        "seconds": round(heard.seconds, 3),
        "bytes": heard.size,
    }


def lines(heard: Listened, verdicts: Sequence[Finding], width: int) -> Iterator[Text]:
    """Yield the verdicts as people read them."""
    yield Text(f"{heard.path}: {heard.seconds:.1f} s at {heard.baud} baud", style="bold")
    yield Text()
    for verdict in verdicts:
        word = verdict.level.name.lower()
        head = word.ljust(_ABOUT) + verdict.about.ljust(_TEXT - _ABOUT)
        told, *rest = _wrapped(verdict.text, width, head, " " * _TEXT)
        first = Text(told)
        first.stylize(_STYLES[verdict.level], 0, len(word))
        yield first
        if verdict.advice:
            arrow = " " * _TEXT + "→ "
            rest += _wrapped(verdict.advice, width, arrow, " " * len(arrow))
        # commands stay whole: they are there to be copied
        rest += [" " * _ABOUT + command for command in verdict.commands]
        yield from map(Text, rest)
    yield Text()
    yield from map(Text, _conclusion(heard, verdicts, width))


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


def _conclusion(heard: Listened, verdicts: Sequence[Finding], width: int) -> list[str]:
    level = worst(verdicts)
    topics = ", ".join(v.about for v in verdicts if v.level == level)
    if level == Level.BAD:
        return _wrapped(f"not fit to record from: {topics}", width, "", "")
    doubts = f", with doubts about {topics}" if level == Level.WARN else ""
    found = understand(heard.chunks, heard.protocol, heard.line_baud)
    command = f"sniffer record {heard.path}={heard.named(found.protocol)}@{heard.baud}"
    return [*_wrapped(f"fit to record from{doubts}", width, "", ""), " " * _ABOUT + command]
