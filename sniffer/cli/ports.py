"""``sniffer ports``: the serial ports of this machine."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import click

from sniffer.cli.options import examples, with_format
from sniffer.cli.streams import say, width_of_terminal
from sniffer.ports.listing import READY, REFUSED, PortInfo
from sniffer.ports.listing import ports as listed

WIDE: Final = 120
"""From this width on a port's maker and name stand on its own line."""

SLOW_MS: Final = 2
"""Latency timers above this are worth a word: a short reply comes within a millisecond."""

NONE_FOUND: Final = (
    "no serial port: plug the adapter in (`dmesg` tells which driver took it; a container must be "
    "given the device), or make a bus without hardware with `sniffer simulate`"
)

_INDENT: Final = " " * 4


@click.command(
    short_help="List the serial ports.",
    epilog=examples("sniffer ports", "sniffer ports --format jsonl"),
)
@with_format("text", "jsonl")
def ports(output_format: str) -> None:
    """List the serial ports: adapter, driver, latency timer, who has it open, lasting name.

    Nothing is opened. Ports without hardware behind them are left out.
    """
    show(listed(Path("/")), output_format)


def show(found: Sequence[PortInfo], output_format: str) -> None:
    """Print the ports; where there are none, say what to do."""
    if not found:
        say(NONE_FOUND)
    elif output_format == "jsonl":
        for info in found:
            click.echo(json.dumps(as_dict(info), ensure_ascii=False))
    else:
        for line in lines(found, width_of_terminal()):
            click.echo(line)


def as_dict(info: PortInfo) -> dict[str, Any]:
    """Return a port as one JSON object; what is not known is null."""
    out: dict[str, Any] = {"type": "port"}
    out |= {k: None if v == "" else v for k, v in dataclasses.asdict(info).items()}
    for key in ("vendor_id", "product_id"):
        out[key] = None if out[key] is None else f"{out[key]:04x}"
    return out


def lines(found: Sequence[PortInfo], width: int) -> list[str]:
    """Return the table, and below it what to do about what stands in it."""
    wide = width >= WIDE
    rows = [("port", "chip", "driver", *(("usb",) if wide else ()), "timer", "state")]
    rows += [_row(info, wide=wide) for info in found]
    columns = zip(*rows, strict=True)
    widths = [max(map(len, column)) for column in columns]
    devices = [*(("adapter",) if wide else ("",)), *(info.device for info in found)]
    names = ["", *(info.stable for info in found)]
    out = []
    for row, device, stable in zip(rows, devices, names, strict=True):
        line = "  ".join(map(str.ljust, row, widths))
        if wide:
            out.append(f"{line}  {device}".rstrip())
        else:
            out.append(line.rstrip())
            out += [_INDENT + device] if device else []
        out += [_INDENT + stable] if stable else []
    remarks = _remarks(found)
    return [*out, *([""] if remarks else []), *remarks]


def _row(info: PortInfo, *, wide: bool) -> tuple[str, ...]:
    usb = "-" if info.vendor_id is None else f"{info.vendor_id:04x}:{info.product_id or 0:04x}"
    timer = "-" if info.latency_ms is None else f"{info.latency_ms} ms"
    cells = (info.path, info.chip or "-", info.driver or "-", *((usb,) if wide else ()), timer)
    return (*cells, state(info))


def state(info: PortInfo) -> str:
    """Return whether a port can be opened, in a few words."""
    if info.access != READY:
        return info.access
    if info.holders:
        return "open in " + ", ".join(f"{h.name} ({h.pid})" for h in info.holders)
    return "free" if info.all_seen else "free?"


def _remarks(found: Sequence[PortInfo]) -> list[str]:
    out = []
    refused = [info for info in found if info.access == REFUSED]
    if refused:
        out.append(f"no permission: {permission_advice(refused[0])}")
    slow = [info for info in found if (info.latency_ms or 0) > SLOW_MS]
    if slow:
        path = slow[0].path
        out.append(f"timer {slow[0].latency_ms} ms: `sniffer doctor {path}` tells how to lower it")
    if any(state(info) == "free?" for info in found):
        out.append("free?: programs of other users cannot be seen without root")
    return out


def permission_advice(info: PortInfo) -> str:
    """Return what lets a user read the port."""
    if info.group and info.group != "root":
        return f"sudo usermod -aG {info.group} $USER, then log in again"
    return f"sudo chmod a+r {info.path}"
