"""``make soak``: recorders killed, who waits for one, a minute beside its truth, an hour's memory.

All of it goes into RESULTS.md; a figure that must not be ends it with status 1.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.hours import SAMPLE_S
from bench.results import LIVE, put
from bench.survives import ALLOWED_NS, BAUD, survive
from bench.truths import buses, play
from bench.truths import complaints as differences
from bench.waits import complaints as too_long
from bench.waits import measure

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bench.survives import Left
    from bench.truths import Compared
    from bench.waits import Wait

TIMES: Final = 50
TRUTH_S: Final = 60.0
PATIENCE_S: Final = 600.0
GROWTH_MB: Final = 5.0
"""By how much the memory may grow in an hour."""


def _killed(lefts: Sequence[Left]) -> list[str]:
    lost = [left.lost_ns / 1e6 for left in lefts]
    files = sum(len(left.files) for left in lefts)
    held = max(left.held_up_ns for left in lefts) / 1e6
    return [
        f"{LIVE}: killed in full flight",
        "",
        (
            f"{len(lefts)} recorders of a fully loaded line at {BAUD}, killed (SIGKILL) at random "
            "moments, four at a time: all protocols, named and found, with `--durable` and "
            "`--rotate` among them. The first byte that is missing was written "
            f"{statistics.median(lost):.0f} ms (median) and {max(lost):.0f} ms (at worst) before "
            f"the kill; {ALLOWED_NS // 1_000_000} ms are allowed. `view -o`, `replay --speed 0` "
            f"and `recover` take each of the {files} files; a recovered one is whole and has the "
            f"same bytes. The machine kept the writer from running for {held:.0f} ms at worst."
        ),
        "",
    ]


def _waited(found: Sequence[Wait]) -> list[str]:
    return [
        f"{LIVE}: nobody waits",
        "",
        (
            "`python -m bench.waits`: how long the recorder, or who listens to it, is kept waiting "
            "at the worst, and how long it may be."
        ),
        "",
        "| | worst ms | allowed ms |",
        "|---|---|---|",
        *(f"| {it.what} | {it.worst:.0f} | {it.allowed:.0f} |" for it in found),
        "",
    ]


def _true(found: Sequence[Compared]) -> list[str]:
    lines = [
        f"{LIVE}: beside the truth",
        "",
        (
            f"`sniffer simulate --truth` for {TRUTH_S:.0f} s, all heard by one `sniffer record`. "
            "*Otherwise*: recorded and not among the undamaged frames; each touches damaged bytes "
            "or answers nothing that was heard. The raw bytes of each bus decode to what was "
            "recorded live."
        ),
        "",
        "| bus | faults | bytes | undamaged frames | recorded | missed | otherwise |",
        "|---|---|---|---|---|---|---|",
    ]
    rows = (
        f"| {it.bus.protocol} | {sum(it.faults.values())} | {len(it.said)} | "
        f"{len(it.whole)} | {len(it.recorded)} | {len(it.missed)} | {len(it.invented)} |"
        for it in found
    )
    return [*lines, *rows, ""]


def an_hour() -> dict[str, float]:
    """Record an hour in a process of its own, whose memory holds nothing else."""
    command = [sys.executable, "-m", "bench.hours", "--hours", "1"]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, timeout=PATIENCE_S)
    told: dict[str, float] = json.loads(done.stdout)
    return told


def _grown(it: Mapping[str, float]) -> list[str]:
    return [
        f"{LIVE}: memory",
        "",
        (
            f"`python -m bench.hours`: an hour of a fully loaded line at 57600, "
            f"{it['bytes'] / 1e6:.0f} MB in {it['rounds']} rounds, on a clock that is put forward "
            "where the recorder would sleep; a read every millisecond. Resident memory, looked at "
            f"every {SAMPLE_S:.0f} s: {it['first_mb']:.0f} MB at first, {it['last_mb']:.0f} MB at "
            f"the end; in the second half it grows by {it['growth_mb_per_hour']:.1f} MB an hour. "
            f"The work is {it['cpu_percent']:.1f} % of a core, the file {it['file_mb']:.0f} MB."
        ),
        "",
    ]


def main() -> None:
    """Do all of it, or what the arguments name."""
    parser = argparse.ArgumentParser(description=__doc__)
    parts = ("killed", "waits", "truth", "memory")
    for part in parts:
        parser.add_argument(f"--{part}", action="store_true", help="this one only")
    given = parser.parse_args()
    chosen = [part for part in parts if getattr(given, part)] or parts
    wrong: list[str] = []
    if "killed" in chosen:
        ends = survive(TIMES, say)
        wrong += (f"{left}: {what}" for left, found in ends for what in found)
        put(_killed([left for left, _ in ends]), title=f"{LIVE}: killed")
    if "waits" in chosen:
        waits = measure(say)
        wrong += too_long(waits)
        put(_waited(waits), title=f"{LIVE}: nobody")
    if "truth" in chosen:
        with tempfile.TemporaryDirectory() as folder:
            heard = play(Path(folder), buses(), TRUTH_S)
        for it in heard:
            say(str(it))
            wrong += (f"{it}: {what}" for what in differences(it))
        put(_true(heard), title=f"{LIVE}: beside")
    if "memory" in chosen:
        seen = an_hour()
        put(_grown(seen), title=f"{LIVE}: memory")
        if (growth := seen["growth_mb_per_hour"]) > GROWTH_MB:
            wrong.append(f"memory grows by {growth:.1f} MB an hour")
    for line in wrong:
        say(line)
    raise SystemExit(bool(wrong))


def say(line: str) -> None:
    sys.stderr.write(line + "\n")


if __name__ == "__main__":
    main()
