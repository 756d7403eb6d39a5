"""``sniffer explain``: one frame drawn byte by byte, or what a code means."""

from __future__ import annotations

import os
import re
import textwrap
from typing import TYPE_CHECKING, Final

import click

from sniffer.cli.options import ProtocolName, examples, files_here
from sniffer.cli.servos import with_names, with_registers
from sniffer.cli.streams import width_of_terminal
from sniffer.decoding.called import Named, ServoNames
from sniffer.decoding.options import AUTO, Options
from sniffer.ground.model import InputError
from sniffer.ground.registers import RegisterMap
from sniffer.ground.wording import plain
from sniffer.jobs.explain import explain_bytes, read_hex

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

_NAME: Final = re.compile(r"[a-z][a-z0-9-]{3,}")
_HEX: Final = re.compile(r"(0x)?[0-9a-f]+|[0-9a-f]{2}(-[0-9a-f]{2})+")
"""How codes, findings and causes are spelled; none can be read as hex, a test holds that."""


def _names_or_files(
    context: click.Context, parameter: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Have a shell complete codes, findings and causes, or files where none begins so."""
    from click.shell_completion import CompletionItem

    from sniffer.jobs.meanings import known_names

    named = [name for name in known_names() if name.startswith(incomplete.lower())]
    if incomplete and named:
        return [CompletionItem(name) for name in named]
    return files_here(context, parameter, incomplete)


@click.command(
    short_help="Draw one frame byte by byte, or tell what a code means.",
    epilog=examples(
        "sniffer explain FF FF FF 00 02 F1 0C",
        "sniffer explain FFFFFF010400D0078F --after 'FF FF FF 01 04 F2 8C 02 7A'",
        "sniffer explain '#5D1800'",
        "sniffer explain run.mcap@12175",
        "sniffer explain run.mcap@first-error --name 3=left_knee",
        "sniffer explain no-response",
    ),
)
@click.argument(
    "hex_bytes",
    metavar="HEX|FILE@PLACE|CODE",
    nargs=-1,
    required=True,
    shell_complete=_names_or_files,
)
@click.option("--after", metavar="HEX", help="The request this answers: replies need it.")
@click.option(
    "--protocol",
    type=ProtocolName(AUTO),
    default=AUTO,
    show_default=True,
    help="Whose frame it is; auto tells it from the bytes.",
)
@click.option("--model", metavar="MODEL", help="Register table to read by.")
@with_registers
@with_names
def explain(
    hex_bytes: tuple[str, ...],
    after: str | None,
    protocol: str,
    model: str | None,
    tables: tuple[RegisterMap, ...],
    names: dict[Named, str],
) -> int:
    """Draw the frame HEX byte by byte: offsets, fields, values, units, checksum arithmetic.

    FILE@12175 draws the frame of a capture that has this byte, behind the request that it answers;
    FILE@arm:12175 where there are several buses. FILE@first-error, FILE@first-error:servo=3,
    FILE@no-response:3 and FILE@anomaly:7 draw what was wrong there; FILE@-5s, FILE@20:35:20.5 and
    FILE@12.5 what was said first from that time on.

    Exit status 1: not every byte belongs to a frame that holds; what is wrong with it is shown.
    LSS lines may be given as text.

    CODE is an anomaly, a finding or a cause, as decode and diagnose name them: what it means, what
    is behind it, what to do.
    """
    if len(hex_bytes) == 1 and "@" in hex_bytes[0]:
        from sniffer.jobs.explain_at import explain_at, place_of

        if after:
            raise click.UsageError("--after goes with HEX: a capture has what came before")
        models: dict[int | None, str] = {None: model} if model else {}
        options = Options(protocol, models=models, tables=tables, names=names)
        held, lines = explain_at(*place_of(hex_bytes[0]), options)
        for line in lines:
            click.echo(line)
        return 0 if held else 1
    if len(hex_bytes) == 1 and _is_name(hex_bytes[0]):
        return _tell_meaning(hex_bytes[0])
    try:
        data = read_hex(" ".join(hex_bytes))
    except InputError:
        _refuse_file(" ".join(hex_bytes))
        raise
    before = read_hex(after) if after else b""
    held, lines = explain_bytes(data, before, protocol=protocol, model=model, tables=tables)
    called = ServoNames(names)
    for line in lines:
        click.echo(called.sentence("", line))  # bytes alone are of no bus
    return 0 if held else 1


def _refuse_file(text: str) -> None:
    """Refuse a file, of which some byte has to be named.

    Raises:
        UsageError: it is one.
    """
    if os.path.isfile(text):  # noqa: PTH113 - Path's refuses what is too long for a name
        raise click.UsageError(
            f"{plain(text)} is a file: name a byte of it, as in {plain(text)}@12175"
        )


def _is_name(text: str) -> bool:
    """Return whether this names something: it is a word, and no hex digits."""
    return bool(_NAME.fullmatch(text.lower())) and not _HEX.fullmatch(text.lower())


def _tell_meaning(text: str) -> int:
    name = text.lower()
    from sniffer.jobs.meanings import PAGES, known_names, meanings, speaking_of

    found = meanings(name)
    if not found:
        _refuse_file(text)
        import difflib

        pages = f"see {', '.join(PAGES.values())}"
        near = speaking_of(name)[:3] or difflib.get_close_matches(name, known_names(), 3)
        advice = f"did you mean {' or '.join(near)}?" if near else pages
        raise click.UsageError(
            f"{name[:60]!r} is no code and no cause ({advice}), and no bytes: "
            "write these as FF FF FF 01 02 F1 0B"
        )
    width = width_of_terminal()
    for nth, meaning in enumerate(found):
        if nth:
            click.echo()
        level = f", {meaning.level}" if meaning.level else ""
        click.echo(f"{meaning.name}: {meaning.kind}{level} ({meaning.title})")
        click.echo(textwrap.fill(meaning.means, width, initial_indent="  ", subsequent_indent="  "))
        told = {title: text for title, text in meaning.facts.items() if text}
        head = max(map(len, told), default=0) + 2
        for title, text in told.items():
            click.echo(
                textwrap.fill(
                    text,
                    width,
                    initial_indent=f"  {title:{head}}",
                    subsequent_indent=" " * (head + 2),
                    break_on_hyphens=False,
                )
            )
    return 0
