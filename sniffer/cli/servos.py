"""Options that say what the servos are: models, register tables, names, and rules on values."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from sniffer.cli.profiles import flat_names
from sniffer.ground.limits import IDS, OF_BUS, number_in
from sniffer.ground.model import InputError
from sniffer.ground.registers import RegisterMap

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.called import Named


_HEX: Final = re.compile("0[xX][0-9A-Fa-f]{1,2}")
"""An id as frames are drawn, and manuals have it."""


def ids_in(words: Iterable[str]) -> tuple[int, ...]:
    """Return the servo ids that words say, each once: ``3-6`` are four of them.

    Raises:
        click.BadParameter: a word is neither an id nor a range, or an id is greater than 255.
    """
    out: list[int] = []
    kind: Any = click.IntRange(0, IDS - 1)
    for word in words:
        word = str(int(word, 16)) if _HEX.fullmatch(word) else word
        first, dash, last = word.partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise click.BadParameter(f"{word!r} is no servo id: write ids as 3,5 or 3-6")
        low = kind.convert(first, None, None)
        high = kind.convert(last, None, None) if dash else low
        if high < low:
            raise click.BadParameter(f"{word!r}: write the lower id first, as in 3-6")
        out += range(low, high + 1)
    return tuple(dict.fromkeys(out))


def models(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> dict[int | None, str]:
    """Read ``--model ID=MODEL`` (one servo) or ``--model MODEL`` (all of them)."""
    out: dict[int | None, str] = {}
    for text in given:
        who, equals, model = text.rpartition("=")
        servo = number_in(who, 0, IDS - 1)
        if equals and servo is None:
            raise click.BadParameter(
                f"{text[:40]!r}: write ID=MODEL with an id of 0..255, or MODEL"
            )
        out[servo] = model
    # what is said of one servo wins over what is said of all
    return dict(sorted(out.items(), key=lambda e: e[0] is not None))


def names_of(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> dict[Named, str]:
    """Read ``--name 3=left_knee``, ``arm:3=left_knee``, and files with a table ``[names]``."""
    from sniffer.decoding.called import NAME_MOST, is_name, named_in

    out: dict[Named, str] = {}
    for text in given:
        who, equals, name = text.partition("=")
        told = {who: name} if equals else _table_of_names(text)
        for servo, name in told.items():
            key = named_in(servo, OF_BUS)
            if key is None or not isinstance(name, str) or not is_name(name):
                wrong = f"{servo[:20]}={str(name)!r:.80}"
                how = f"an id of 0..255 and a name of at most {NAME_MOST} signs"
                if not equals:
                    why = f"{text}: {wrong} in its table [names]: a line has {how}"
                    raise click.BadParameter(why)
                raise click.BadParameter(
                    f"{wrong}: write ID=NAME or BUS:ID=NAME with {how}, or name a file that has a "
                    "table [names]"
                )
            out[key] = name
    return out


def _table_of_names(path: str) -> dict[str, Any]:
    import tomllib

    try:
        with Path(path).open("rb") as file:
            told = tomllib.load(file).get("names")
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else error
        raise click.BadParameter(
            f"{path[:60]!r} is neither ID=NAME nor a TOML file that can be read ({why})"
        ) from None
    if not isinstance(told, dict):
        raise click.BadParameter(f'{path[:60]}: it has no table [names] with lines 3 = "knee"')
    return flat_names(told)


with_names = click.option(
    "--name",
    "names",
    multiple=True,
    callback=names_of,
    metavar="[BUS:]ID=NAME|FILE.toml",
    help="What a servo or its joint is called wherever it is shown: 3=left_knee, arm:3=left_knee, "
    "or a file with a table [names]; may be repeated.",
)
"""Of every command that shows servos."""


def tables_of(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[RegisterMap, ...]:
    """Read ``--registers FILE.toml``."""
    return tuple(RegisterMap.from_toml(path) for path in given)


with_registers = click.option(
    "--registers",
    "tables",
    multiple=True,
    callback=tables_of,
    metavar="FILE.toml",
    help="A register table of your own, for --model; may be repeated.",
)
"""Of every command that has ``--model``, but ``simulate``."""


def alarms_of(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[Alarm, ...]:
    """Read ``--alarm 'temperature > 70 for 2s'``."""
    from sniffer.anomalies.alarms import alarm_in

    try:
        return tuple(map(alarm_in, given))
    except InputError as error:
        raise click.BadParameter(str(error)) from None


with_alarms = click.option(
    "--alarm",
    "alarms",
    multiple=True,
    callback=alarms_of,
    metavar="RULE",
    help="A rule of your own, such as 'temperature > 70 for 2s', '3.voltage < 9' (arm:3 of several "
    "buses, or left_knee) or 'position_error > 5'; may be repeated.",
)
"""Of every command that judges values by rules of the user's own."""
