"""Figures of a capture as people read them: tables, the worst first, and bars for the eye."""

from __future__ import annotations

import datetime
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from sniffer.decoding.durations import Bounds
from sniffer.ground.model import NS
from sniffer.ground.wording import counted, plain, short
from sniffer.sinks.bars import BARS, PLAIN_BARS, bars, halved, print_histograms
from sniffer.sinks.consoles import NARROWEST, console_for, room_in

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from rich.console import Console

    from sniffer.statistics.sink import Statistics

WIDE: Final = 140
"""Columns of what goes into a pipe or a file, unless ``COLUMNS`` says otherwise."""

MOST: Final = 24
"""Rows of a table, unless all are asked for: what is worst and what is most fits on a screen."""

BARS_MOST: Final = 64
"""Bars of a line at most; where there are more slices, a bar is several."""

BARS_LEAST: Final = 16
"""Bars over time that are shorter show nothing."""

COUNTED_OF: Final = {"missing": "transactions", "errors": "anomalies", "warnings": "anomalies"}
"""The rows that a column over time counts, where that is not the frames."""

REPLY_FIGURES: Final = ("p50", "p95", "max")
SPARED: Final = ("bytes", "frames", "reply max")
"""Columns over time that are left out where there is no room, these first: load says as much."""

ROOMY: Final = 100
"""From so many columns on there are two blanks between those of a table, and bars over time."""

_COLOUR: Final = {"error": "red", "warn": "yellow", "note": "cyan"}

Row = tuple[Any, ...]


def print_stats(
    figures: Mapping[str, Any],
    statistics: Statistics,
    console: Console | None = None,
    *,
    most: int | None = MOST,
    how: str = "",
) -> None:
    """Print all figures, bus by bus; ``figures`` are those of ``statistics`` as a dictionary.

    ``most``: so many rows of each table; all of them where None. ``how``: what is said of
    those that are left out, behind how many they are.
    """
    console = console or console_for()
    tables = figures.get("selection", {}).get("tables")
    room = room_in(console)  # None: nobody's window, nothing is folded
    console.width = WIDE if room is None else max(room, NARROWEST)
    with console.capture() as printed:
        for nth, bus in enumerate(figures["buses"]):
            if nth:
                console.print()
            _print_bus(bus, statistics, console, most, how, tables)
    # tables are padded to their width: nobody wants that in a file
    text = "".join(line.rstrip() + "\n" for line in printed.get().splitlines())
    if not console.encoding.lower().startswith("utf"):
        text = text.translate(str.maketrans(BARS, PLAIN_BARS))
    console.file.write(text)


def _print_bus(
    bus: Mapping[str, Any],
    statistics: Statistics,
    console: Console,
    most: int | None,
    how: str,
    tables: Sequence[str] | None,
) -> None:
    title = f"{bus['bus']}: {' + '.join(bus['protocols'])} at {bus['baud']} baud"
    console.print(Text(short(plain(title)), style="bold"))
    for line in _about(bus, console.width):
        console.print(Padding(Text(line), (0, 0, 0, 2)))
    many = len(bus["protocols"]) > 1
    first = bus["first_ns"] or 0
    for heading, table in (
        ("over time (response times in ms)", _over_time(bus, console.width, tables)),
        (
            "traffic, most bus time first (jitter: 95 % of periods change by less)",
            _traffic(bus, many=many),
        ),
        ("answers that are missing, worst first", _missing(bus, many=many)),
        ("response times in ms, slowest first", _replies(bus, first, console.width, many=many)),
        ("following error (goal less position), greatest first", _errors(bus, first)),
        ("goal steps, slowest to settle first", _steps(bus)),
        ("values", _values(bus, first)),
        ("your rules", _alarms(bus)),
        ("anomalies", _anomalies(bus, first, console.width)),
    ):
        if table is not None:
            console.print()
            console.print(Text(f" {heading}", style="dim"))
            console.print(table.table(most, console.width))
            left = 0 if most is None else len(table.rows) - most
            if left > 0:
                console.print(Text(f"  ... and {left} more{how}", style="dim"))
        if table is not None and heading.startswith("response"):
            print_histograms(bus, statistics, console)


def _about(bus: Mapping[str, Any], width: int) -> Iterable[str]:
    held = np.floor(10000 * bus["bytes_in_frames"] / bus["bytes"]) / 100 if bus["bytes"] else 0.0
    gaps = ", ".join(f"{n} {reason}" for reason, n in bus["gaps"].items())
    line = f"{counted(bus['bytes'], 'byte')} = {bus['bytes_in_frames']} in "
    line += f"{counted(bus['frames'], 'frame')} ({held:.2f} %) + {bus['bytes_in_gaps']} in gaps"
    yield line + (f" ({gaps})" if gaps else "")
    load = bus["load"]
    if load is None:
        yield "no clock in the input: no rates and no times"
        return
    yield f"over {bus['seconds']:.3f} s"
    told = f"load {_percent(load['mean'])}, at most {_percent(load['peak'])} "
    width_ns = load["slice_ns"]
    told += f"in {width_ns / 1e6:.0f} ms" if width_ns < NS else f"in {width_ns / NS:g} s"
    shares = load["shares"]
    per = -(-len(shares) // BARS_MOST)
    drawn = bars([n / per for n in halved(shares, BARS_MOST)], 1.0)
    together = len(told) + len(drawn) + 4 <= width
    yield f"{told}  {drawn}" if together else told
    if not together:
        yield drawn


def _over_time(
    bus: Mapping[str, Any], width: int, tables: Sequence[str] | None
) -> _Tabulated | None:
    slices = bus.get("slices")
    if slices is None:
        return None
    first_ns, width_ns, shares = slices["first_ns"], slices["slice_ns"], bus["load"]["shares"]
    columns = {
        "from": [_of_day(first_ns + k * width_ns, width_ns) for k in range(len(shares))],
        "load": [_percent(share) for share in shares],
    }
    for name, column in slices.items():
        # none of what nobody asked for is no finding
        if isinstance(column, list) and (
            tables is None or COUNTED_OF.get(name, tables[0]) in tables
        ):
            columns[name] = [*map(str, column)]
    replies = slices["response_time_ns"]
    for name in REPLY_FIGURES if any(replies["count"]) else ():
        columns[f"reply {name}"] = ["" if q is None else Bounds(*q).ms() for q in replies[name]]
    apart = 2 if width >= ROOMY else 1
    for name in ("", *SPARED):  # a number that is cut off says something else
        columns.pop(name, None)
        taken = sum(max(map(len, [name, *cells])) + apart for name, cells in columns.items()) + 1
        if taken <= width:
            break
    table = _Tabulated(*columns)
    drawn = min(width - taken - apart, BARS_MOST)
    if width >= ROOMY and drawn >= BARS_LEAST:
        table.add_column("", left=True)
        columns[""] = ["█" * int(np.ceil(min(share, 1.0) * drawn)) for share in shares]
    for row in zip(*columns.values(), strict=True):
        table.add_row(*row)
    return table


def _of_day(t_ns: int, step_ns: int) -> str:
    """Return a time of day (UTC) as finely as steps need it."""
    digits = next((n for n in (0, 3) if step_ns % 10 ** (9 - n) == 0), 6)
    part = f".{t_ns % NS // 10 ** (9 - digits):0{digits}}" if digits else ""
    return f"{datetime.datetime.fromtimestamp(t_ns // NS, datetime.UTC):%H:%M:%S}{part}"


class _Tabulated:
    """Rows under headings: what is a word stands left and is folded, numbers stand right."""

    def __init__(self, *columns: str, left: Iterable[str] = ()) -> None:
        self._columns = [*columns]
        self._left = frozenset(left)
        self.rows: list[tuple[Text | str, ...]] = []

    def add_column(self, name: str, *, left: bool = False) -> None:
        self._columns.append(name)
        self._left |= {name} if left else set()

    def add_row(self, *cells: Text | str) -> None:
        self.rows.append(cells)

    def table(self, most: int | None, width: int) -> Table:
        """Return the first rows."""
        out = Table(box=None, pad_edge=True, padding=(0, 0, 0, 2 if width >= ROOMY else 1))
        for column in self._columns:
            if column in self._left:
                out.add_column(column, overflow="fold")
            else:
                out.add_column(column, justify="right", no_wrap=True)
        for row in self.rows[:most]:
            out.add_row(*row)
        return out


def _who(row: Mapping[str, Any], *, many: bool = False) -> str:
    who = "-" if row["servo_id"] is None else str(row["servo_id"])
    return f"{row['protocol']} {who}" if many else who


def _traffic(bus: Mapping[str, Any], *, many: bool) -> _Tabulated | None:
    clocked = bus["load"] is not None
    columns = ("sent", "per s", "bus time") if clocked else ("sent", "bytes")
    table = _Tabulated("servo", "command", *columns, left=("command",))
    timed = any(c["period_ns"] for c in bus["commands"])
    for column in ("period ms", "longest", "jitter") if timed else ():
        table.add_column(column)
    for c in sorted(bus["commands"], key=lambda c: (-c["bytes"], c["servo_id"] or -1, c["op"])):
        row = [_who(c, many=many), c["op"], str(c["requests"])]
        if clocked:
            row += [_number(c["rate_hz"]), _percent(c["bus_time_share"])]
        else:
            row.append(_percent(c["bytes_share"]))
        if timed:
            row += [_ms(c["period_ns"], "p50"), _ms(c["period_ns"], "max")]
            row += [_ms(c["jitter_ns"], "p95")]
        table.add_row(*row)
    return table if bus["commands"] else None


def _missing(bus: Mapping[str, Any], *, many: bool) -> _Tabulated | None:
    asked = [c for c in bus["commands"] if c["asked"]]
    worst = [c for c in asked if c["failed"] or c["retries"]]
    if not asked:
        return None
    table = _Tabulated(
        "servo", "command", "asked", "missing", "share", "95 % sure", left=("command",)
    )
    for column in ("failed", "retries"):
        table.add_column(column)
    for c in sorted(worst, key=lambda c: (-c["missing_interval"][0], -c["failed"])):
        low, high = c["missing_interval"]
        told = f"{100 * low:.2g}-{_percent(high)}"
        counts = str(c["asked"]), str(c["missing"]), _percent(c["missing_share"]), told
        table.add_row(
            _who(c, many=many), c["op"], *counts, str(c["failed"]), str(c["retries"] or "")
        )
    sound = len(asked) - len(worst)
    if sound:
        from sniffer.statistics.commands import wilson

        n = sum(c["asked"] for c in asked if c not in worst)
        told = f"at most {_percent(wilson(0, n)[1])}"
        name = "all others" if worst else "all"
        table.add_row("", name, str(n), "0", "0 %", told, "0", "")
    return table


def _replies(bus: Mapping[str, Any], first: int, width: int, *, many: bool) -> _Tabulated | None:
    timed = [c for c in bus["commands"] if c["response_time_ns"]]
    if not timed:
        return None
    names = ("min", "p50", "p95", "p99", "max")
    table = _Tabulated("servo", "command", "answers", *names, left=("command",))
    places = ("at s", "at byte") if width >= ROOMY else ("at s",)
    for column in places if any(c["slowest"] for c in timed) else ():
        table.add_column(column)
    for c in sorted(timed, key=lambda c: [-c["response_time_ns"][n][1] for n in reversed(names)]):
        q, worst = c["response_time_ns"], c["slowest"]
        row = [_who(c, many=many), c["op"], str(q["count"]), *(_ms(q, n) for n in names)]
        if worst:
            row += [_seconds(worst["t_ns"], first, bus), str(worst["offset"])][: len(places)]
        table.add_row(*row)
    return table


def _errors(bus: Mapping[str, Any], first: int) -> _Tabulated | None:
    rows: list[Row] = [(s, e) for s in bus["servos"] for e in s["following_error"]]
    if not rows:
        return None
    table = _Tabulated("servo", "unit", "values", "p50", "p95", "max", "at s", "at byte")
    for s, e in sorted(rows, key=lambda r: -r[1]["size"]["max"][1]):
        size, worst = e["size"], e["worst"]
        half = [_middle(size[name]) for name in ("p50", "p95")]
        place = _seconds(worst["t_ns"], first, bus), str(worst["offset"])
        values = str(size["count"]), *half, _number(worst["value"])
        table.add_row(_who(s), e["unit"], *values, *place)
    return table


def _steps(bus: Mapping[str, Any]) -> _Tabulated | None:
    rows: list[Row] = [(s, e) for s in bus["servos"] for e in s["steps"] if e["count"]]
    if not rows:
        return None
    columns = ("servo", "steps", "settled", "in ms p50", "max", "overshoot p50", "max", "not")
    table = _Tabulated(*columns, left=("not",))

    def rank(row: Row) -> tuple[float, ...]:
        settled = row[1]["fates"].get("settled", 0) / row[1]["count"]
        return settled, -(row[1]["settle_ns"] or {"max": [0, 0]})["max"][1]

    for s, e in sorted(rows, key=rank):
        past = e["overshoot_percent"]
        beyond = [f"{_middle(past[n])} %" if past else "" for n in ("p50", "max")]
        others = [f"{n} {k.replace('_', ' ')}" for k, n in e["fates"].items() if k != "settled"]
        settled = str(e["fates"].get("settled", 0))
        times = [_ms(e["settle_ns"], n) for n in ("p50", "max")]
        table.add_row(_who(s), str(e["count"]), settled, *times, *beyond, ", ".join(others))
    return table


def _values(bus: Mapping[str, Any], first: int) -> _Tabulated | None:
    rows: list[Row] = [(v["quantity"], s, v) for s in bus["servos"] for v in s["values"]]
    if not rows:
        return None
    table = _Tabulated(
        "quantity",
        "servo",
        "values",
        "least",
        "at s",
        "greatest",
        "at s",
        "unit",
        left=("quantity", "unit"),
    )
    told = ""
    for quantity, s, v in sorted(rows, key=lambda r: (r[0], r[2]["unit"], -r[2]["max"]["value"])):
        ends = (v["min"], v["max"])
        cells = [x for e in ends for x in (_number(e["value"]), _seconds(e["t_ns"], first, bus))]
        name = quantity if quantity != told else ""
        table.add_row(name, _who(s), str(v["count"]), *cells, v["unit"])
        told = quantity
    return table


def _alarms(bus: Mapping[str, Any]) -> _Tabulated | None:
    if not bus["alarms"]:
        return None
    table = _Tabulated("rule", "servo", "times", "met for s", "of s", "worst", left=("rule",))
    for e in bus["alarms"]:
        low, high = e["met_ns"]
        lasted = f"{low / NS:.3f}" if low == high else f"{low / NS:.3f}-{high / NS:.3f}"
        worst = "" if e["worst"] is None else f"{_number(e['worst']['value'])} {e['unit']}"
        heard = f"{e['heard_ns'] / NS:.3f}"
        table.add_row(e["rule"], _who(e), str(e["times"]), lasted, heard, worst)
    return table


def _anomalies(bus: Mapping[str, Any], first: int, width: int) -> _Tabulated | None:
    if not bus["anomalies"]:
        return None
    drawn = "over time" if width >= ROOMY else ""
    columns = ("anomaly", "servo", "count", "per s", "first s", "last s", "at byte")
    table = _Tabulated(*columns, left=("anomaly",))
    if drawn:
        table.add_column(drawn, left=True)
    for a in bus["anomalies"]:
        name = Text(a["code"], style=_COLOUR[a["severity"]])
        rate = "" if a["rate_hz"] is None else _number(a["rate_hz"])
        ends = [_seconds(a[k], first, bus) for k in ("first_ns", "last_ns")]
        row: list[Text | str] = [name, _who(a), str(a["count"]), rate, *ends]
        row.append(str(a["offsets"][0]))
        if drawn:
            row.append(bars(halved(a["over_time"]["counts"], width - 80)))
        table.add_row(*row)
    return table


def _seconds(t_ns: int, first: int, bus: Mapping[str, Any]) -> str:
    return "" if bus["load"] is None else f"{(t_ns - first) / NS:.3f}"


def _ms(q: Mapping[str, Any] | None, name: str) -> str:
    return "" if q is None else Bounds(*q[name]).ms()


def _middle(bounds: Sequence[float]) -> str:
    """Return a number that is known to 2 %; what is no more than a thousandth is nothing."""
    return _number(sum(bounds) / 2 if bounds[1] > 1e-3 else 0.0)


def _percent(share: float) -> str:
    return f"{_number(100 * share)} %"


def _number(value: float) -> str:
    """Return a number with three digits, more where it is longer."""
    if value == 0:
        return "0"
    digits = max(0, 2 - int(np.floor(np.log10(abs(value)))))
    shown = f"{value:.{min(digits, 6)}f}"
    return shown.rstrip("0").rstrip(".") if "." in shown else shown
