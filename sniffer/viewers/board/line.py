"""The live board where there is no terminal: a line a second, and statistics when asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.model import Severity
from sniffer.ground.wording import plain
from sniffer.viewers.board.picture import Picture
from sniffer.viewers.board.remembered import by_bus

if TYPE_CHECKING:
    from sniffer.tap.status import Status
    from sniffer.viewers.board.board import Board

WIDTH: Final = 160
HEIGHT: Final = 1 << 16
"""Of statistics: there is no terminal whose size would count."""


def line(status: Status, board: Board) -> str:
    """Return how the recording is going in one line of ``key=value``, always in the same order.

    ``elapsed`` in s; ``bytes`` read; ``frames`` decoded and ``frames_per_s`` over the last 3 s;
    ``load.BUS`` in percent of the line's time over the last 2 s, one a bus; ``missing`` replies;
    anomalies as ``errors``, ``warnings`` and ``notes``; ``incidents`` that are open; ``lost``:
    times that bytes were lost on the tap's side; ``line_errors``, or ``unknown`` where no bus
    tells; how many buses are ``silent`` and ``away``; bytes ``waiting`` to be decoded; frames
    ``not_shown``, which are missing in the counts of this line alone; ``size`` in bytes of the
    ``file``, which is last and may hold blanks.
    Blanks and ``=`` in a bus's name stand as ``_``.
    """
    end_ns = board.end_ns(status)
    status = by_bus(status)
    spoken = (b.bus for b in board.apart(status).buses)
    tallies = [board.buses[bus] for bus in spoken if bus in board.buses]
    rates = [tally.frame_rate.until(end_ns) for tally in tallies]
    levels = board.troubles.severities
    errors = [b.line_errors for b in status.buses if b.line_errors is not None]
    states = [b.state for b in status.buses]
    told: dict[str, object] = {
        "elapsed": f"{status.elapsed_s:.1f}",
        "bytes": sum(b.bytes for b in status.buses),
        "frames": sum(tally.frames for tally in tallies),
        "frames_per_s": f"{sum(int(n[0]) / seconds for n, seconds in rates):.1f}",
        **{f"load.{_key(b.bus)}": f"{min(board.load(b, end_ns), 100):.1f}" for b in status.buses},
        "missing": sum(int(tally.servos.missing.sum()) for tally in tallies),
        "errors": levels[Severity.ERROR],
        "warnings": levels[Severity.WARN],
        "notes": levels[Severity.NOTE],
        "incidents": sum(not one.is_over for one in board.incidents),
        "lost": sum(b.lost for b in status.buses),
        "line_errors": sum(errors) if errors else "unknown",
        "silent": states.count("silent"),
        "away": states.count("away"),
        "waiting": status.waiting,
        "not_shown": board.left_out,
        "size": status.size,
        "file": plain(status.file),
    }
    return " ".join(f"{key}={value}" for key, value in told.items())


def statistics(status: Status, board: Board) -> str:
    """Return everything the board knows, in lines of plain text: all buses, servos, anomalies."""
    lines = Picture(board, board.apart(status), WIDTH, HEIGHT, hint="").lines()
    return "\n".join("".join(text for text, _ in cells).rstrip() for cells in lines)


def _key(bus: str) -> str:
    return "".join("_" if c.isspace() or c == "=" else c for c in plain(bus))
