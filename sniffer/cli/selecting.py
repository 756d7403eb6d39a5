"""``--where``, its shorthands, ``--from`` and ``--to``: the same on every command that reads."""

from __future__ import annotations

import itertools
import re
from typing import TYPE_CHECKING, Any, Final

import click

from sniffer.cli.options import Command, completing, gathered
from sniffer.cli.servos import ids_in
from sniffer.ground.amounts import time_in
from sniffer.ground.model import InputError
from sniffer.ground.naming import worded

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sniffer.decoding.summary import Summary
    from sniffer.jobs.telling import Teller
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection


def _listed(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[str, ...]:
    """Read values that are joined by commas or given one by one."""
    words = [[word.strip() for word in text.split(",") if word.strip()] for text in given]
    if not all(words):  # a variable of a script that is empty does not mean all there is
        raise click.BadParameter("it is empty: leave it out to take all of them")
    return tuple(itertools.chain.from_iterable(words))


def _codes() -> Iterable[str]:
    from sniffer.anomalies.catalogue import CATALOGUE

    return CATALOGUE


_IDS: Final = re.compile("[0-9.-]+|0[xX][0-9A-Fa-f]+")
"""What is meant as ids; anything else is a name."""


def _ids(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[int | str, ...]:
    """Read servo ids, and names of servos; ``3-6`` are four of them."""
    out: list[int | str] = []
    for word in _listed(context, parameter, given):
        out += ids_in([word]) if _IDS.fullmatch(word) else [word]
    return tuple(dict.fromkeys(out))


def _place(context: click.Context, parameter: click.Parameter, given: str | None) -> str | None:
    """Refuse what is no place, before anything is opened."""
    if given is not None:
        from sniffer.selection.places import place_in

        try:
            place_in(given)
        except InputError as error:
            raise click.BadParameter(worded(error)) from None
    return given


def _around(context: click.Context, parameter: click.Parameter, given: str | None) -> int | None:
    """Read a time."""
    ns = None if given is None else time_in(given, bare=True)
    if given is not None and ns is None:
        raise click.BadParameter(f"{given!r} is no time: write it like 200ms, 2s or 1min")
    return ns


def _places_and_ports(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[str | None, tuple[str, ...]]:
    """Tell the place where a part ends from the ports that it is played on."""
    from sniffer.selection.places import names_port

    ports = tuple(text for text in given if names_port(text))
    places = [text for text in given if not names_port(text)]
    if len(places) > 1:
        raise click.BadParameter(f"{places[0]!r} and {places[1]!r}: a part ends at one place")
    return _place(context, parameter, places[0] if places else None), ports


_FROM = click.option(
    "--from",
    "start",
    callback=_place,
    metavar="PLACE",
    help="Begin there: 10 (seconds), 10min, 20:35:20.5, an ISO time, @first-error (of what is "
    "selected), @first-error:servo=3, @no-response (the first), @no-response:3, @anomaly:7, "
    "@byte:12175 (of several buses @byte:arm:12175), -5s (before the end), @first-error-100ms "
    "(so long before it; +2s: behind).",
)
_AROUND = click.option(
    "--around",
    callback=_around,
    metavar="TIME",
    help="Widen it on both sides: --from @first-error --around 200ms.",
)
_PART = (
    _FROM,
    click.option("--to", "stop", callback=_place, metavar="PLACE", help="End there."),
    _AROUND,
)
_PARTS = (
    *_PART,
    click.option(
        "--from-b",
        "start_b",
        callback=_place,
        metavar="PLACE",
        help="Begin there in B, if its part is another one; as long as that of A, where both are "
        "in seconds.",
    ),
    click.option("--to-b", "stop_b", callback=_place, metavar="PLACE", help="End there in B."),
)
_PART_AND_PORTS = (
    _FROM,
    click.option(
        "--to", "stop", multiple=True, callback=_places_and_ports, metavar="PLACE|PORT",
        help="End there; or, where it is a port (pty: a new pseudo-terminal, a path with / such as "
        "/dev/pts/3 or ./bus, COM3), play on that. Both: --to 20s --to pty.",
    ),
    _AROUND,
)  # fmt: skip

_BUSES = click.option(
    "--bus", "buses", multiple=True, callback=_listed, metavar="NAME,...", help="Only these buses."
)

_ROWS = (
    click.option(
        "--where",
        metavar="EXPR",
        help="Take what an expression selects, as WHERE of SQL: \"servo_id = 3 AND value > 10\".",
    ),
    click.option(
        "--servo", "servos", multiple=True, callback=_ids, metavar="ID|NAME,...",
        help="Only these servos: 3,5 or 3-6, arm:3 of several buses, or left_knee, as --name or "
        "the recording calls them.",
    ),
    click.option(
        "--op", "ops", multiple=True, callback=_listed, metavar="NAME,...",
        help="Only these commands, such as store_data.",
    ),
    click.option(
        "--kind", "kinds", multiple=True, callback=_listed, metavar="KIND",
        help="Only request or only response frames.",
    ),
    click.option(
        "--code", "codes", multiple=True, callback=_listed, metavar="CODE,...",
        shell_complete=completing(_codes),
        help="Only anomalies of these codes, such as no-response.",
    ),
    _BUSES,
)  # fmt: skip


def with_both_parts(command: Command) -> Command:
    """Add the options that say which part of two runs is meant; ``windows`` are what they say."""
    return gathered(command, _PARTS, _windows)


def with_buses(command: Command) -> Command:
    """Add the option that takes some buses alone; ``buses`` is what it says."""
    return _BUSES(command)


def with_start(command: Command) -> Command:
    """Add the option that says where to begin in a capture; ``start`` is what it says."""
    return _FROM(command)


def with_part(command: Command) -> Command:
    """Add the options that say which part of a capture is meant; ``window`` is what they say."""
    return gathered(command, _PART, _window)


def with_part_and_ports(command: Command) -> Command:
    """Add the same, and ports to play on; ``window`` and ``to`` are what they say."""
    return gathered(command, _PART_AND_PORTS, _window_and_ports)


def with_rows(command: Command) -> Command:
    """Add the options that say which records are shown; ``selection`` is what they say."""
    return gathered(command, _ROWS, _selection)


def row_options() -> frozenset[str]:
    """Return what the options are called that say which records are shown."""
    selecting = click.command()(with_rows(lambda: None))
    return frozenset(name for option in selecting.params for name in option.opts)


def say_selected(summary: Summary, tell: Teller) -> None:
    """Say beside what is printed for programs that it is of a selection, and of how much."""
    if summary.shown:
        from sniffer.sinks.report import selected

        tell.talk(selected(summary))


def _window(given: dict[str, Any]) -> dict[str, Any]:
    start, stop, around = (given.pop(name) for name in ("start", "stop", "around"))
    window: Window | None = None
    if start is not None or stop is not None or around is not None:
        from sniffer.selection.places import Window

        window = Window(start or 0.0, stop, around or 0)
        window.places()  # what is wrong with it is told before anything is opened
    return {**given, "window": window}


def _windows(given: dict[str, Any]) -> dict[str, Any]:
    start, stop = (given.pop(name) for name in ("start_b", "stop_b"))
    given = _window(given)
    a = given.pop("window")
    if start is None and stop is None:
        return {**given, "windows": (a, None)}
    from sniffer.selection.places import Window

    b = (a or Window()).elsewhere(start, stop)
    b.places()
    return {**given, "windows": (a, b)}


def _window_and_ports(given: dict[str, Any]) -> dict[str, Any]:
    given["stop"], to = given["stop"]
    return {**_window(given), "to": to}


def _selection(given: dict[str, Any]) -> dict[str, Any]:
    asked = {
        name: given.pop(name) for name in ("where", "servos", "ops", "kinds", "codes", "buses")
    }
    selection: Selection | None = None
    if any(value is not None and value != () for value in asked.values()):
        from sniffer.selection.selection import Selection

        selection = Selection.of(asked.pop("where"), **asked)
    return {**given, "selection": selection}
