"""Amounts as people write them on a command line: ``10min``, ``512MB``, and ports."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from sniffer.decoding.names import AND, apart, is_known, joined, protocols_named
from sniffer.decoding.pipeline import AUTO
from sniffer.ground.amounts import size_in, time_in
from sniffer.ground.limits import BAUDS
from sniffer.ground.model import NS
from sniffer.ground.wording import offered
from sniffer.messages import CHOICES, TOPICS
from sniffer.protocols import PROTOCOLS, is_file, protocol_named
from sniffer.tap.tap import PortSpec

if TYPE_CHECKING:
    _Number = click.ParamType[int]
else:
    _Number = click.ParamType  # click 8.1 has no other name for it


class Duration(_Number):
    """A time like ``90``, ``90s``, ``10min``, ``2h``; in ns. Its bounds are in seconds."""

    name = "time"

    def __init__(self, least: float = 0, most: float = math.inf) -> None:
        self._least, self._most = least, most

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Read a time."""
        ns = value if isinstance(value, int) else time_in(value, bare=True)
        if ns is None:
            self.fail(f"{value!r} is no time: write it like 90s, 10min or 2h", param, ctx)
        if not self._least * NS <= ns <= self._most * NS:
            between = f"{self._least:g} to {self._most:g} s"
            self.fail(f"{value!r} is not in the range of {between}", param, ctx)
        return ns


class Size(_Number):
    """A size like ``512MB``, ``1GiB``; in bytes."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Read a size."""
        size = value if isinstance(value, int) else size_in(value, bare=True)
        if size is None:
            self.fail(f"{value!r} is no size: write it like 512MB or 2GiB", param, ctx)
        return size


def sizes_and_times(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> dict[str, int]:
    """Read either of both, or one of each: ``bytes`` and ``ns`` by their units."""
    out: dict[str, int] = {}
    for text in given:
        read = {"bytes": size_in(text, bare=False), "ns": time_in(text, bare=False)}
        told = {kind: amount for kind, amount in read.items() if amount is not None}
        if not told:
            raise click.BadParameter(f"{text!r} is no size or time: write it like 512MB or 10min")
        if told.keys() & out.keys():
            raise click.BadParameter(f"{text!r}: one size and one time at most")
        out |= told
    return out


FORM: Final = "[NAME=]PORT[=PROTOCOL][@BAUD]"
_NAME: Final = re.compile(r"[A-Za-z0-9_.-]+")


def port_spec(text: str, bus: str) -> PortSpec:
    """Read ``[NAME=]PORT[=PROTOCOL][@BAUD]``; ``bus`` is the name where none is given.

    Raises:
        click.BadParameter: it is none of these.
    """
    if text and Path(text).exists():
        return PortSpec(bus, text)  # whatever stands in its name
    rest, at, number = text.rpartition("@")
    rate: int | None = None
    if at and number.isdecimal():
        rate = int(number[:12])  # more digits make no more sense, and int() refuses thousands
        if not BAUDS[0] <= rate <= BAUDS[1]:
            raise _mistake(text, f"{number[:12]} is no baud rate ({BAUDS[0]}..{BAUDS[1]})")
    else:
        rest = text
    rest, protocol = _protocol(text, rest)
    name, equals, port = rest.partition("=")
    if not equals or not _NAME.fullmatch(name) or port.startswith("//"):
        name, port = "", rest
    if not port:
        raise _mistake(text, f"there is no port in it: write {FORM}")
    return PortSpec(name or bus, port, protocol, rate)


def _protocol(text: str, rest: str) -> tuple[str, str | None]:
    """Take the protocol off the end of ``NAME=PORT=PROTOCOL``, if there is one."""
    before, equals, last = rest.rpartition("=")
    if not equals or "?" in before:  # an address may have options behind a question mark
        return rest, None
    if last == AUTO or last in PROTOCOLS or (is_file(last) and len(apart(last)) == 1):
        if last != AUTO:
            protocol_named(last)  # what is wrong with a plug-in is told before a port is opened
        return before, last
    if AND in last and is_known(last):
        return before, joined(protocols_named(last))
    if _NAME.fullmatch(before) and last:
        return rest, None  # left=/dev/ttyUSB0
    known = offered(last, (AUTO, *PROTOCOLS))
    raise _mistake(text, f"no protocol {last!r}: {known}" if last else f"write {FORM}")


def _mistake(text: str, why: str) -> click.BadParameter:
    return click.BadParameter(f"{text!r}: {why}")


def port_specs(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[PortSpec, ...]:
    """Read all ports of a command line; those without a name are bus0, bus1 ..."""
    specs = tuple(port_spec(text, f"bus{i}") for i, text in enumerate(given))
    for i, spec in enumerate(specs):
        if spec.bus in {s.bus for s in specs[:i]}:
            raise click.BadParameter(f"two ports are called {spec.bus}: name them apart")
        for other in specs[:i]:
            if _real(spec.port) == _real(other.port):
                same = "" if spec.port == other.port else f", as {other.port} too"
                raise click.BadParameter(f"{spec.port} is named twice{same}")
    return specs


def topics(
    context: click.Context, parameter: click.Parameter, given: str | None
) -> tuple[str, ...] | None:
    """Read which topics a recording is to have; ``+plots`` adds to the usual ones."""
    if given is None:
        return None
    written = [name.strip() for name in given.split(",")]
    names = [name.removeprefix("+") for name in written]
    for name in names:
        if name not in CHOICES:
            raise click.BadParameter(f"{name!r} is no topic: {offered(name, CHOICES)}")
    added = [name.startswith("+") for name in written]
    if any(added) and not all(added):
        raise click.BadParameter(
            f"{given!r}: write a + before each, to add them to the usual ones, or before none"
        )
    return tuple(dict.fromkeys([*TOPICS, *names])) if any(added) else tuple(names)


def _real(port: str) -> str:
    """Return the one name of a port that has several."""
    return port if "://" in port else os.path.realpath(port)
