"""Amounts as people write them on a command line: ``10min``, ``512MB``, and ports."""

from __future__ import annotations

import math
import re
from typing import Any, Final

import click

from sniffer.model import NS
from sniffer.protocols import PROTOCOLS
from sniffer.recording.taps import PortSpec

_UNITS_NS: Final = {
    "": NS,
    "ms": NS // 1000,
    "s": NS,
    "sec": NS,
    "m": 60 * NS,
    "min": 60 * NS,
    "h": 3600 * NS,
    "d": 86400 * NS,
}
_UNITS_BYTES: Final = {
    "b": 1,
    **{prefix + "b": 1000**n for n, prefix in enumerate("kmgt", 1)},
    **{prefix + "ib": 1024**n for n, prefix in enumerate("kmgt", 1)},
}
_AMOUNT: Final = re.compile(r"([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*([a-zA-Z]*)")


def _read(text: str, units: dict[str, int]) -> int | None:
    match = _AMOUNT.fullmatch(text.strip())
    if match is None or match[2].lower() not in units:
        return None
    amount = float(match[1]) * units[match[2].lower()]
    return int(amount) if math.isfinite(amount) and amount >= 1 else None


class Duration(click.ParamType):
    """A time like ``90``, ``90s``, ``10min``, ``2h``; in ns."""

    name = "time"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Read a time."""
        ns = value if isinstance(value, int) else _read(value, _UNITS_NS)
        if ns is None:
            self.fail(f"{value!r} is no time: write it like 90s, 10min or 2h", param, ctx)
        return ns


class Size(click.ParamType):
    """A size like ``512MB``, ``1GiB``; in bytes."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Read a size."""
        size = value if isinstance(value, int) else _read(value, {**_UNITS_BYTES, "": 1})
        if size is None:
            self.fail(f"{value!r} is no size: write it like 512MB or 2GiB", param, ctx)
        return size


class SizeOrDuration(click.ParamType):
    """Either of both, by its unit: ``("bytes", n)`` or ``("ns", n)``."""

    name = "size|time"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, int]:
        """Read a size or a time."""
        if isinstance(value, tuple):
            return value
        size = _read(value, _UNITS_BYTES)
        if size is not None:
            return "bytes", size
        times = {unit: ns for unit, ns in _UNITS_NS.items() if unit}
        ns = _read(value, times)
        if ns is None:
            self.fail(f"{value!r} is no size or time: write it like 512MB or 10min", param, ctx)
        return "ns", ns


_PORT: Final = re.compile(
    r"(?:(?P<bus>[A-Za-z0-9_.-]+)=)?(?P<port>.+?)(?:=(?P<protocol>[A-Za-z0-9_-]*))?(?:@(?P<baud>\d+))?"
)
BAUDS: Final = (300, 10_000_000)


def port_spec(text: str, bus: str) -> PortSpec:
    """Read ``[NAME=]PORT[=PROTOCOL][@BAUD]``; ``bus`` is the name where none is given.

    Raises:
        click.BadParameter: it is none of these.
    """
    match = _PORT.fullmatch(text)
    if match is None:
        raise click.BadParameter(f"{text!r}: write [NAME=]PORT[=PROTOCOL][@BAUD]")
    name, port, protocol, baud = match["bus"], match["port"], match["protocol"], match["baud"]
    if name is not None and protocol is None and (port in PROTOCOLS or port == "auto"):
        name, port, protocol = None, name, port  # COM3=wck: what looked like a name is the port
    if name is not None and "://" in f"{name}:" and port.startswith("//"):
        name, port = None, f"{name}={port}"
    if protocol not in (None, "", "auto", *PROTOCOLS):
        known = ", ".join(("auto", *PROTOCOLS))
        raise click.BadParameter(f"{text!r}: no protocol {protocol!r}: one of {known}")
    rate = int(baud) if baud is not None else None
    if rate is not None and not BAUDS[0] <= rate <= BAUDS[1]:
        raise click.BadParameter(f"{text!r}: {rate} is no baud rate ({BAUDS[0]}..{BAUDS[1]})")
    return PortSpec(name or bus, port, None if protocol in ("", "auto") else protocol, rate)


def port_specs(
    context: click.Context, parameter: click.Parameter, given: tuple[str, ...]
) -> tuple[PortSpec, ...]:
    """Read all ports of a command line; those without a name are bus0, bus1 ..."""
    specs = tuple(port_spec(text, f"bus{i}") for i, text in enumerate(given))
    for i, spec in enumerate(specs):
        if spec.port in {s.port for s in specs[:i]}:
            raise click.BadParameter(f"{spec.port} is named twice")
        if spec.bus in {s.bus for s in specs[:i]}:
            raise click.BadParameter(f"two ports are called {spec.bus}: name them apart")
    return specs
