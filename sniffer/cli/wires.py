"""Options that say how the wires of a logic capture are read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import click

from sniffer.ground.wiring import Wiring


def _channels(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> Mapping[str, str]:
    """Read ``--channel NAME`` (a bus of its own) and ``--channel NAME=BUS``."""
    out: dict[str, str] = {}
    for text in given:
        name, equals, bus = text.partition("=")
        if not name or (equals and not bus):
            raise click.BadParameter(f"{text[:40]!r}: write NAME, or NAME=BUS")
        if name in out:
            raise click.BadParameter(f"{name[:40]!r} is named twice")
        out[name] = bus
    return out


WIRES: Final = (
    click.option(
        "--channel",
        "channels",
        multiple=True,
        callback=_channels,
        metavar="NAME[=BUS]",
        help="Of a logic capture: a channel to read, and whose wire it is; may be repeated.",
    ),
    click.option("--invert", is_flag=True, help="Of a logic capture: its lines idle low."),
    click.option(
        "--glitch",
        type=click.FloatRange(0, 1e6),
        metavar="US",
        help="Of a logic capture: pulses that are shorter do not count.  [default: 0.3 of a bit]",
    ),
)
"""Of every command that reads captures."""


def wiring_of(given: dict[str, Any]) -> Wiring:
    """Take what these options say out of what a command was given."""
    return Wiring(
        channels=given.pop("channels", {}),
        invert=given.pop("invert", False),
        glitch_us=given.pop("glitch", None),
    )
