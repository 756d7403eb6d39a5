"""A bus slice by slice of time, as people read it: ``sniffer stats --every``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.decoding.durations import Bounds
from sniffer.ground.moments import of_day
from sniffer.ground.wording import and_
from sniffer.sinks.tabulated import ROOMY, Tabulated, percent

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

BARS_MOST: Final = 64
"""Bars of a line at most; where there are more slices, a bar is several."""

BARS_LEAST: Final = 16
"""Bars over time that are shorter show nothing."""

COUNTED_OF: Final = {"missing": "transactions", "errors": "anomalies", "warnings": "anomalies"}
"""The rows that a column over time counts, where that is not the frames."""

REPLY_FIGURES: Final = ("p50", "p95", "max")
"""Response times that have a column."""

PARTLY: Final = 20
"""A slice of which more than one in so many parts was not heard has a load that looks too small."""

SPARED: Final = ("bytes", "frames", "reply max")
"""Columns over time that are left out where there is no room, these first: load says as much."""


def over_time(bus: Mapping[str, Any], width: int, tables: Sequence[str] | None) -> Tabulated | None:
    """Return a row a slice, as wide as there is room; None: nobody asked for slices.

    ``tables`` are those that rows were selected of, None: all.
    """
    slices = bus.get("slices")
    if slices is None:
        return None
    first_ns, width_ns, shares = slices["first_ns"], slices["slice_ns"], bus["load"]["shares"]
    digits = next((n for n in (0, 3) if width_ns % 10 ** (9 - n) == 0), 6)  # as slices need them
    columns = {"from": [of_day(first_ns + k * width_ns, digits) for k in range(len(shares))]}
    has_bytes = _has_bytes(tables)
    if has_bytes:
        columns["load"] = [percent(share) for share in shares]
    for name, column in slices.items():
        of = COUNTED_OF.get(name)
        told = has_bytes if of is None else tables is None or of in tables
        if isinstance(column, list) and told:
            columns[name] = [*map(str, column)]
    replies = slices["response_time_ns"]
    for name in REPLY_FIGURES if has_replies(bus) else ():
        columns[f"reply {name}"] = ["" if q is None else Bounds(*q).ms() for q in replies[name]]
    apart = 2 if width >= ROOMY else 1
    for name in ("", *SPARED):  # a number that is cut off says something else
        columns.pop(name, None)
        taken = sum(max(map(len, [name, *cells])) + apart for name, cells in columns.items()) + 1
        if taken <= width:
            break
    table = Tabulated(*columns)
    drawn = min(width - taken - apart, BARS_MOST)
    if has_bytes and width >= ROOMY and drawn >= BARS_LEAST:
        table.add_column("", left=True)
        columns[""] = ["█" * int(np.ceil(min(share, 1.0) * drawn)) for share in shares]
    for row in zip(*columns.values(), strict=True):
        table.add_row(*row)
    return table


def _has_bytes(tables: Sequence[str] | None) -> bool:
    """Tell whether something with bytes was asked for: of anomalies alone no load is a finding."""
    return tables is None or any(table != "anomalies" for table in tables)


def heading_of(bus: Mapping[str, Any], tables: Sequence[str] | None) -> str:
    """Return what stands above the rows: what their figures are of."""
    told = ["response times in ms"] if has_replies(bus) else []
    if "slices" in bus and _has_bytes(tables):
        first_ns, width_ns = bus["slices"]["first_ns"], bus["slices"]["slice_ns"]
        end_ns = first_ns + len(bus["load"]["shares"]) * width_ns
        part = width_ns // PARTLY
        edges = ("first", bus["first_ns"] - first_ns), ("last", end_ns - bus["last_ns"])
        if partly := [name for name, lacks_ns in edges if lacks_ns > part]:
            told.append(f"{and_(partly)} slice heard in part")
    return f"over time ({'; '.join(told)})" if told else "over time"


def has_replies(bus: Mapping[str, Any]) -> bool:
    """Tell whether response times stand over time."""
    slices = bus.get("slices")
    return slices is not None and any(slices["response_time_ns"]["count"])
