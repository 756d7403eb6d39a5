"""Figures of a capture as people read them: tables, the worst first, and bars for the eye."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich.padding import Padding
from rich.text import Text

from sniffer.decoding.called import SERVO_NAME
from sniffer.decoding.summary import UNTIMED
from sniffer.ground.model import NS
from sniffer.ground.moments import with_day
from sniffer.ground.units import word_of
from sniffer.ground.wording import counted, plain, short
from sniffer.sinks.bars import BARS, PLAIN_BARS, bars, halved, print_histograms
from sniffer.sinks.cells import left_of, ms_of, seconds_of, who_of
from sniffer.sinks.consoles import console_for, tables_in, unpadded
from sniffer.sinks.motions import (
    error_table,
    lag_table,
    start_table,
    step_table,
    unreached_table,
)
from sniffer.sinks.overtime import BARS_MOST, heading_of, over_time
from sniffer.sinks.tabulated import ROOMY, ServoCell, Tabulated, called, number, percent
from sniffer.statistics.goalsteps import HELD_NS
from sniffer.statistics.told import HAVING, OF_SERVOS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from rich.console import Console

    from sniffer.statistics.sink import Statistics

MOST: Final = 24
"""Rows of a table, unless all are asked for: what is worst and what is most fits on a screen."""

_ENDS: Final = ("first_answer", "last_answer")

_COLOUR: Final = {"error": "red", "warn": "yellow", "note": "cyan"}

Row = tuple[Any, ...]


def print_stats(
    figures: Mapping[str, Any],
    statistics: Statistics,
    *,
    began_ns: int | None = None,
    most: int | None = MOST,
    how: str = "",
) -> None:
    """Print all figures, bus by bus; ``figures`` are those of ``statistics`` as a dictionary.

    ``began_ns``: when the capture began, which seconds count from as those of ``--from`` do; where
    None, each bus has its own. ``most``: so many rows of each table; all of them where None.
    ``how``: what is said of those that are left out, behind how many they are.
    """
    console = console_for()
    tables = figures.get("selection", {}).get("tables")
    width = tables_in(console)
    has_bars = console.encoding.lower().startswith("utf")
    with unpadded(console, None if has_bars else str.maketrans(BARS, PLAIN_BARS)):
        for nth, bus in enumerate(figures["buses"]):
            if nth:
                console.print()
            first = (bus["first_ns"] or 0) if began_ns is None else began_ns
            _print_bus(bus, statistics, console, width, first, most, how, tables)


def _print_bus(
    bus: Mapping[str, Any],
    statistics: Statistics,
    console: Console,
    width: int,
    first: int,
    most: int | None,
    how: str,
    tables: Sequence[str] | None,
) -> None:
    title = f"{bus['bus']}: {' + '.join(bus['protocols'])} at {bus['baud']} baud"
    console.print(Text(short(plain(title)), style="bold"))
    shown = _tables(bus, first, width, tables)
    lines = [*_about(bus, first, width, tables)]
    if any(table is not None and table.lacks_names(most, width) for _, table in shown):
        lines.append(_named(bus))
    for line in lines:
        console.print(Padding(Text(line), (0, 0, 0, 2)))
    for heading, table in shown:
        if table is not None:
            console.print()
            console.print(Text(f" {heading}", style="dim"))
            console.print(table.table(most, width))
            left = 0 if most is None else len(table.rows) - most
            if left > 0:
                console.print(Text(f"  ... and {left} more{how}", style="dim"))
        if table is not None and heading.startswith("response"):
            print_histograms(bus, statistics, console, width)


def _tables(
    bus: Mapping[str, Any], first: int, width: int, tables: Sequence[str] | None
) -> Sequence[tuple[str, Tabulated | None]]:
    """Return the tables of a bus with their headings."""
    many = len(bus["protocols"]) > 1
    return (
        (heading_of(bus, tables), over_time(bus, width, tables)),
        (
            "traffic, most bus time first (jitter: 95 % of periods change by less)",
            _traffic(bus, many=many),
        ),
        (
            "answers that are missing, worst first"
            if any(c["missing_interval"] for c in bus["commands"])
            else "answers that are missing, most first (selected by what came of them: no share)",
            _missing(bus, many=many),
        ),
        (
            "when each servo was heard, silent longest first"
            if tables is None
            else "when each servo said what is selected, longest ago first",
            _heard(bus, first, width, many=many, silent=tables is None),
        ),
        ("response times in ms, slowest first", _replies(bus, first, width, many=many)),
        ("following error (goal less position), greatest first", error_table(bus, first)),
        ("lag behind goals that move, longest first", lag_table(bus)),
        ("goal steps, slowest to settle first", step_table(bus)),
        ("first motion behind a goal that came at rest, slowest first", start_table(bus, first)),
        (
            f"goals not reached in {HELD_NS / NS:g} s and more, furthest off first",
            unreached_table(bus, first),
        ),
        ("values", _values(bus, first)),
        ("your rules", _alarms(bus, first)),
        ("anomalies", _anomalies(bus, first, width)),
    )


def _about(
    bus: Mapping[str, Any], first: int, width: int, tables: Sequence[str] | None
) -> Iterable[str]:
    if tables is not None and not bus["bytes"]:  # none of what nobody asked for is no finding
        if not any(bus[name] for name in HAVING):
            yield "nothing that it said is selected"
        return
    held = np.floor(10000 * bus["bytes_in_frames"] / bus["bytes"]) / 100 if bus["bytes"] else 0.0
    gaps = ", ".join(f"{n} {reason}" for reason, n in bus["gaps"].items())
    line = f"{counted(bus['bytes'], 'byte')} = {bus['bytes_in_frames']} in "
    line += f"{counted(bus['frames'], 'frame')} ({held:.2f} %) + {bus['bytes_in_gaps']} in gaps"
    yield line + (f" ({gaps})" if gaps else "")
    load = bus["load"]
    if load is None:
        why = UNTIMED if bus["frames"] else "no frame in it"
        yield f"{why}: no rates and no times"
        return
    yield f"over {bus['seconds']:.3f} s{_silent(bus, first)}"
    told, shares, width_ns = f"load {percent(load['mean'])}", load["shares"], load["slice_ns"]
    if max(shares) > load["mean"]:  # else nothing was heard in a whole slice
        told += f", at most {percent(load['peak'])} in "
        told += f"{width_ns / 1e6:.0f} ms" if width_ns < NS else f"{width_ns / NS:g} s"
    per = -(-len(shares) // BARS_MOST)
    drawn = bars([n / per for n in halved(shares, BARS_MOST)], 1.0)
    together = len(told) + len(drawn) + 4 <= width
    yield f"{told}  {drawn}" if together else told
    if not together:
        yield drawn


def _silent(bus: Mapping[str, Any], first: int) -> str:
    """Return for how long nothing was heard at most, and since when."""
    silence = bus["longest_silence"]
    if silence is None:
        return ""
    since = seconds_of(silence["t_ns"], first, bus)
    return f", silent for {ms_of(silence, 'value_ns')} ms at most, from second {since} on"


def _named(bus: Mapping[str, Any]) -> str:
    """Return what the servos of a bus are called."""
    rows = (row for key in OF_SERVOS for row in bus[key] if SERVO_NAME in row)
    return called({row["servo_id"]: row[SERVO_NAME] for row in rows})


def _traffic(bus: Mapping[str, Any], *, many: bool) -> Tabulated | None:
    clocked = bus["load"] is not None
    # answers alone may be selected: such as those that state a value
    heading, key = ("sent", "requests")
    if not any(c["requests"] for c in bus["commands"]):
        heading, key = "answers", "responses"
    columns = (heading, "per s", "bus time") if clocked else (heading, "bytes")
    table = Tabulated("servo", "command", *columns, left=left_of(bus, "command"))
    timed = any(c["loop"] for c in bus["commands"])
    for column in ("period ms", "longest", "jitter") if timed else ():
        table.add_column(column)
    for c in sorted(bus["commands"], key=lambda c: (-c["bytes"], c["servo_id"] or -1, c["op"])):
        row = [who_of(c, many=many), c["op"], str(c[key])]
        if clocked:
            row += [number(c[key] / bus["seconds"]), percent(c["bus_time_share"])]
        else:
            row.append(percent(c["bytes_share"]))
        if timed:
            loop = c["loop"] or {"period_ns": None, "jitter_ns": None}
            row += [ms_of(loop["period_ns"], "p50"), ms_of(c["longest_period"], "value_ns")]
            row += [ms_of(loop["jitter_ns"], "p95")]
        table.add_row(*row)
    return table if bus["commands"] else None


def _missing(bus: Mapping[str, Any], *, many: bool) -> Tabulated | None:
    asked = [c for c in bus["commands"] if c["asked"]]
    worst = [c for c in asked if c["failed"] or c["retries"]]
    if not asked:
        return None
    shared = any(c["missing_interval"] for c in asked)
    columns = ("asked", "missing", *(("share", "95 % sure") if shared else ()))
    table = Tabulated("servo", "command", *columns, left=left_of(bus, "command"))
    for column in ("damaged", "failed", "retries"):
        table.add_column(column)

    def rank(c: Mapping[str, Any]) -> tuple[float, int]:
        return -(c["missing_interval"][0] if shared else c["missing"]), -c["failed"]

    for c in sorted(worst, key=rank):
        counts = [str(c["asked"]), str(c["missing"])]
        if shared:
            low, high = c["missing_interval"]
            counts += [percent(c["missing_share"]), f"{number(100 * low)}-{percent(high)}"]
        damaged = percent(c["damaged"] / c["asked"]) if shared else str(c["damaged"])
        counts += [damaged, str(c["failed"]), str(c["retries"] or "")]
        table.add_row(who_of(c, many=many), c["op"], *counts)
    if not shared:
        return table if worst else None
    sound = len(asked) - len(worst)
    if sound:
        from sniffer.statistics.commands import wilson

        n = sum(c["asked"] for c in asked if c not in worst)
        told = f"at most {percent(wilson(0, n)[1])}"
        name = "all others" if worst else "all"
        table.add_row("", name, str(n), "0", "0 %", told, "0 %", "0", "")
    return table


def _heard(
    bus: Mapping[str, Any], first: int, width: int, *, many: bool, silent: bool
) -> Tabulated | None:
    """Return when servos answered; ``silent``: also those that never did."""
    servos = [s for s in bus["servos"] if silent or s["last_answer"] is not None]
    if bus["load"] is None or not servos:
        return None
    clock = ("last at",) if width >= ROOMY else ()
    table = Tabulated("servo", "answers", "first s", "last s", *clock, left=left_of(bus))
    for column in ("since then s", "longest pause ms", "from s"):
        table.add_column(column)

    def ended(s: Mapping[str, Any]) -> int:
        return int(first if s["last_answer"] is None else s["last_answer"]["t_ns"])

    for s in sorted(servos, key=ended):
        last, pause = s["last_answer"], s["longest_pause"]
        row = [str(s["responses"]), "never", "", *([""] * len(clock))]
        if last is not None:
            row[1:3] = (seconds_of(s[end]["t_ns"], first, bus) for end in _ENDS)
            row[3:] = [with_day(last["t_ns"], first)] * len(clock)
        row.append(f"{(bus['last_ns'] - ended(s)) / NS:.3f}")
        if pause is not None:
            row += [ms_of(pause, "value_ns"), seconds_of(pause["t_ns"], first, bus)]
        table.add_row(who_of(s, many=many), *row)
    return table


def _replies(bus: Mapping[str, Any], first: int, width: int, *, many: bool) -> Tabulated | None:
    timed = [c for c in bus["commands"] if c["response_time_ns"]]
    if not timed:
        return None
    names = ("min", "p50", "p95", "p99", "max")
    table = Tabulated("servo", "command", "answers", *names, left=left_of(bus, "command"))
    places = ("at s", "at byte") if width >= ROOMY else ("at s",)
    for column in places if any(c["slowest"] for c in timed) else ():
        table.add_column(column)
    for c in sorted(timed, key=lambda c: [-c["response_time_ns"][n][1] for n in reversed(names)]):
        q, worst = c["response_time_ns"], c["slowest"]
        row = [who_of(c, many=many), c["op"], str(q["count"]), *(ms_of(q, n) for n in names)]
        if worst:
            row += [seconds_of(worst["t_ns"], first, bus), str(worst["offset"])][: len(places)]
        table.add_row(*row)
    return table


def _values(bus: Mapping[str, Any], first: int) -> Tabulated | None:
    rows: list[Row] = [(v["quantity"], s, v) for s in bus["servos"] for v in s["values"]]
    if not rows:
        return None
    table = Tabulated(
        "quantity",
        "servo",
        "values",
        "least",
        "at s",
        "greatest",
        "at s",
        "unit",
        left=left_of(bus, "quantity", "unit"),
    )
    told = ""
    for quantity, s, v in sorted(rows, key=lambda r: (r[0], r[2]["unit"], -r[2]["max"]["value"])):
        ends = (v["min"], v["max"])
        cells = [x for e in ends for x in (number(e["value"]), seconds_of(e["t_ns"], first, bus))]
        name = quantity if quantity != told else ""
        table.add_row(name, who_of(s), str(v["count"]), *cells, word_of(v["unit"]))
        told = quantity
    return table


def _alarms(bus: Mapping[str, Any], first: int) -> Tabulated | None:
    if not bus["alarms"]:
        return None
    clocked = bus["load"] is not None
    long = ("met for s", "of s") if clocked else ("met by", "of values")
    ends = ("first s", "last s") if clocked else ("at byte",)
    table = Tabulated("rule", "servo", "times", *long, *ends, "worst", left=left_of(bus, "rule"))
    for e in bus["alarms"]:
        low, high = e["met_ns"]
        lasted = f"{low / NS:.3f}" if low == high else f"{low / NS:.3f}-{high / NS:.3f}"
        worst = "" if e["worst"] is None else f"{number(e['worst']['value'])} {word_of(e['unit'])}"
        told = [lasted, f"{e['heard_ns'] / NS:.3f}"] if clocked else [e["met"], e["values"]]
        if e["first"] is None:
            told += [""] * len(ends)
        elif clocked:
            told += [seconds_of(e[end]["t_ns"], first, bus) for end in ("first", "last")]
        else:
            told.append(e["first"]["offset"])
        table.add_row(e["rule"], who_of(e), str(e["times"]), *map(str, told), worst)
    return table


def _anomalies(bus: Mapping[str, Any], first: int, width: int) -> Tabulated | None:
    if not bus["anomalies"]:
        return None
    drawn = "over time" if width >= ROOMY else ""
    columns = ("anomaly", "servo", "count", "per s", "first s", "last s", "at byte")
    table = Tabulated(*columns, left=left_of(bus, "anomaly"))
    if drawn:
        table.add_column(drawn, left=True)
    for a in bus["anomalies"]:
        name = Text(a["code"], style=_COLOUR[a["severity"]])
        rate = "" if a["rate_hz"] is None else number(a["rate_hz"])
        ends = [seconds_of(a[k], first, bus) for k in ("first_ns", "last_ns")]
        row: list[Text | str | ServoCell] = [name, who_of(a), str(a["count"]), rate, *ends]
        row.append(str(a["offsets"][0]))
        if drawn:
            row.append(bars(halved(a["over_time"]["counts"], width - 80)))
        table.add_row(*row)
    return table
