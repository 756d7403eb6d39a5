"""``make demo``: decode the sample captures, record and plot them; no hardware needed."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console

from sniffer.cli.naming import worded
from sniffer.cli.streams import say
from sniffer.ground.model import SnifferError
from sniffer.jobs.demo import record_damaged, summaries
from sniffer.sinks.report import print_summary

OUT = Path("demo-out")


def demo() -> None:
    """Run the demo."""
    from sniffer.viewers import viewer

    console = Console(highlight=False)
    for summary in summaries():
        console.print()
        print_summary(summary, console)
    OUT.mkdir(exist_ok=True)
    recording, plots = OUT / "demo.mcap", OUT / "demo.rrd"
    record_damaged([recording, plots])
    console.print()
    console.print(f"wrote {recording} (the recording) and {plots} (its plots)", soft_wrap=True)
    try:
        viewer.need_display(str(recording))
    except SnifferError:
        console.print(
            f"there is no display here. On a machine with one: .venv/bin/sniffer view {recording}\n"
            f"in a browser of this machine: .venv/bin/sniffer view {recording} --web",
            soft_wrap=True,
        )
    else:
        viewer.show(plots, web=False, say=say)


if __name__ == "__main__":
    try:
        demo()
    except SnifferError as error:
        say(worded(error))
        sys.exit(2)
