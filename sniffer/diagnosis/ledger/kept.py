"""What the tables of a ledger keep of each bucket: their columns, and how rows become one.

Times are in ns; ``at``, ``end`` and ``length`` are places in the stream of the bus.
"""

from __future__ import annotations

from typing import Final

TRAFFIC: Final = {
    "frames": "sum",
    "requests": "sum",
    "bytes": "sum",
    "at": "first",
    "end": "last",
    "t_first": "first",
    "t_last": "last",
}
ANSWERS: Final = {
    "asked": "sum",
    "ok": "sum",
    "missing": "sum",
    "damaged": "sum",
    "mismatched": "sum",
    "unsolicited": "sum",
    "took_n": "sum",
    "took_sum": "sum",
    "took_min": "min",
    "took_max": "max",
    "told_max": "max",
    "spread_max": "max",
    "at": "min",
    "t_first": "min",
    "t_last": "max",
}
LINE: Final = {
    "bytes": "sum",
    "gap_bytes": "sum",
    "gaps": "sum",
    "pause_max": "max",
    "at": "min",
    "t_first": "min",
    "t_last": "max",
}
VALUES: Final = {
    "n": "sum",
    "low": "min",
    "high": "max",
    "total": "sum",
    "first": "first",
    "last": "last",
    "step": "max",
    "at": "first",
    "t_first": "first",
    "t_last": "last",
}
ALARMS: Final = {
    "n": "sum",
    "at": "first",
    "length": "first",
    "t_first": "first",
    "t_last": "last",
}
