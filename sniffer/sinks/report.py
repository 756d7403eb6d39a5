"""The summary as people read it: bytes, frames per servo and command, times, anomalies."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from sniffer.diagnostics.catalogue import CATALOGUE
from sniffer.summary import BusTotals, Summary

_COLOUR = {"error": "red", "warn": "yellow", "note": "cyan"}


def _ms(ns: int | None) -> str:
    return "" if ns is None else f"{ns / 1e6:.2f}"


def print_summary(summary: Summary, console: Console) -> None:
    """Print the totals of every bus."""
    for name, bus in summary.buses.items():
        _print_bus(name, bus, console)


def _print_bus(name: str, b: BusTotals, console: Console) -> None:
    frames, gaps = sum(b.kinds.values()), sum(b.gaps.values())
    share = 100 * b.bytes_in_frames / b.bytes if b.bytes else 0.0
    length = b.seconds
    console.print()
    console.print(Text(f"{name}: {b.protocol}", style="bold"))
    console.print(
        f"  {b.bytes} bytes = {b.bytes_in_frames} in {frames} frames ({share:.2f} %) "
        f"+ {b.bytes_in_gaps} in {gaps} gaps"
        + (f", over {length:.3f} s" if length else ", no clock in the input: times are nominal"),
        soft_wrap=True,
    )
    outcomes = ", ".join(f"{n} {k.replace('_', ' ')}" for k, n in b.outcomes.items() if n)
    if outcomes:
        console.print(f"  exchanges: {outcomes}", soft_wrap=True)
    if b.by_command:
        console.print(_commands(b))
    if b.codes:
        console.print(_anomalies(b))
    else:
        console.print("  no anomalies")


def _commands(b: BusTotals) -> Table:
    table = Table(box=None, pad_edge=True, padding=(0, 2, 0, 0))
    for title, side in (
        ("servo", "right"),
        ("frames", "right"),
        ("reply p50 ms", "right"),
        ("p99", "right"),
        ("max", "right"),
        ("missing", "right"),
    ):
        table.add_column(title, justify=side)  # type: ignore[arg-type]
    table.add_column("commands", overflow="fold")
    for servo in sorted({k[0] for k in b.by_command}):
        mine = {(op, kind): n for (who, op, kind), n in b.by_command.items() if who == servo}
        ops: dict[str, list[int]] = {}
        for (op, kind), n in mine.items():
            ops.setdefault(op, [0, 0])[kind == "response"] += n
        told = ", ".join(
            f"{op} {asked}" + (f"/{got}" if got else "")
            for op, (asked, got) in sorted(ops.items(), key=lambda e: -sum(e[1]))
        )
        q = b.times.get(servo)
        times = (_ms(q.at(0.5)), _ms(q.at(0.99)), _ms(q.most)) if q else ("", "", "")
        missing = b.bad_by_servo.get(servo, 0)
        table.add_row(
            str(servo) if servo >= 0 else "-",
            str(sum(mine.values())),
            *times,
            str(missing) if missing else "",
            told,
        )
    return table


def _anomalies(b: BusTotals) -> Table:
    table = Table(box=None, pad_edge=True, padding=(0, 2, 0, 0))
    table.add_column("anomaly")
    table.add_column("count", justify="right")
    table.add_column("first at byte", justify="right")
    table.add_column("first", overflow="fold")
    for code, n in sorted(b.codes.items(), key=lambda e: (-CATALOGUE[e[0]].severity, -e[1])):
        style = _COLOUR[CATALOGUE[code].severity.name.lower()]
        first = b.first[code]
        table.add_row(Text(code, style=style), str(n), str(first.evidence[0][0]), first.detail)
    return table
