"""Bars for the eye: numbers as a row of blocks, and how long answers took as a histogram."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich.cells import cell_len, set_cell_size
from rich.text import Text

from sniffer.decoding.durations import BINS_SHOWN

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rich.console import Console

    from sniffer.ground.model import I64
    from sniffer.statistics.sink import Statistics

BARS: Final = " ▁▂▃▄▅▆▇█"
"""Eighths of a line; what is not nothing has one at least."""

PLAIN_BARS: Final = " .:-=+*#@"
"""The same for a terminal that has ASCII alone."""

BESIDE: Final = 18
"""Columns before the bars of a histogram, beside the name of the servo."""


def bars(numbers: Sequence[float], most: float | None = None) -> str:
    """Return numbers as bars, the greatest (or ``most``) as high as the line."""
    top = max(numbers, default=0) if most is None else most
    if top <= 0:
        return " " * len(numbers)
    last = len(BARS) - 1
    return "".join(BARS[min(int(np.ceil(last * n / top)), last) if n > 0 else 0] for n in numbers)


def halved(numbers: Sequence[float], room: int) -> list[float]:
    """Return numbers added up so that they fit."""
    per = -(-len(numbers) // max(room, 8))
    return [sum(numbers[k : k + per]) for k in range(0, len(numbers), per)]


def print_histograms(
    bus: Mapping[str, Any], statistics: Statistics, console: Console, width: int
) -> None:
    """Print how long the answers of each servo took, on one axis."""
    sums: dict[str, tuple[I64, I64]] = {}
    lanes = statistics.collector.lanes_of(bus["bus"])
    for name in lanes:
        for c in statistics.lanes[name].commands.figures():
            if c.replies.times.count and c.servo_id >= 0:
                who = statistics.names.label(name, c.servo_id)
                who = f"{name} {who}" if len(lanes) > 1 else who
                low, high = c.replies.times.histogram()
                before = sums.get(who)
                sums[who] = (low, high) if before is None else (before[0] + low, before[1] + high)
    if not sums:
        return
    least, most = (np.sum([pair[k] for pair in sums.values()], axis=0) for k in (0, 1))
    held = np.flatnonzero(most)
    low = np.flatnonzero(least)
    low = low[low > 0]
    begin = min(int(held[0]), int(low[0]) if len(low) else int(held[0]))
    begin = max(begin - 1, int(held[0]) - 3 * BINS_SHOWN, 0)  # as a report's: three octaves of few
    size = int(held[-1]) + 2 - begin
    label = BESIDE + max(cell_len(f"servo {who}") for who in sums)
    room = max(min(width, 140) - label - 2, 16)
    per = -(-size // room)
    console.print()
    for who, (low, high) in sums.items():
        pair = [_folded(counts, begin, size, per) for counts in (low, high)]
        top = max(max(row) for row in pair)
        if pair[0] == pair[1]:
            name = set_cell_size(f"servo {who}", label - 4)
            console.print(Text(f"  {name}  {bars(pair[0], top)}"))
            continue
        for row, told in zip(pair, ("took at least", "at most"), strict=True):
            name = set_cell_size(f"servo {who}" if told != "at most" else "", label - BESIDE)
            console.print(Text(f"  {name}{told:>14}  {bars(row, top)}"))
    console.print(Text(" " * label + _axis(begin, size, per, width - label), style="dim"))


def _folded(counts: I64, begin: int, size: int, per: int) -> list[int]:
    shown = counts[begin : begin + size].copy()
    shown[0] += counts[:begin].sum()
    shown = np.pad(shown, (0, -len(shown) % per))
    out: list[int] = shown.reshape(-1, per).sum(axis=1).tolist()
    return out


def _axis(begin: int, size: int, per: int, room: int) -> str:
    """Return the times below the bars: where 1, 2 and 5 of each decade stand, in ms."""
    line = [" "] * min(-(-size // per) + 12, room)
    free = 0
    for decade in range(-6, 8):
        for digit in (1, 2, 5):
            ms = digit * 10.0**decade
            at = int((np.log2(ms * 1e6) * BINS_SHOWN - begin) // per)
            told = f"|{ms:g} ms"
            if free <= at < len(line) - len(told):
                line[at : at + len(told)] = told
                free = at + len(told) + 1
    return "".join(line).rstrip()
