"""``make demo``: decode the sample captures, record, plot and diagnose; no hardware needed."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from sniffer.cli.streams import say
from sniffer.ground.model import SnifferError
from sniffer.ground.naming import worded
from sniffer.jobs.demo import STORY, record_damaged, summaries
from sniffer.jobs.report import report
from sniffer.sinks.consoles import unpadded

OUT = Path("demo-out")


def demo() -> None:
    """Run the demo."""
    from sniffer.viewers import viewer

    console = Console(highlight=False)
    console.print("The sample captures, decoded (all of one: sniffer decode FILE --summary):\n")
    _print_totals(console)
    OUT.mkdir(exist_ok=True)
    recording, plots, page = (OUT / f"demo.{suffix}" for suffix in ("mcap", "rrd", "html"))
    record_damaged([recording, plots])
    found = report(STORY, page, overwrite=True).content.incidents
    console.print(f"\nWhat is wrong in {STORY} (how it is known: sniffer diagnose):\n")
    story = Table.grid(padding=(0, 1))
    for incident in found:
        first = incident.causes[0]
        sure = f"{first.cause}, {first.percent} % sure. {incident.next}"
        story.add_row("-", f"{incident.story}\n{sure}")
    with unpadded(console):
        console.print(story)
    console.print(
        f"\nwrote {recording} (the damaged captures as one recording), {plots} (its plots) and "
        f"{page}\n(all of the story, with its bytes and curves: open it in a browser)",
        soft_wrap=True,
    )
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


def _print_totals(console: Console) -> None:
    """Print a line a capture."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("capture")
    table.add_column("protocol")
    for name in ("bytes", "in frames", "frames", "anomalies"):
        table.add_column(name, justify="right")
    for summary in summaries():
        for capture, totals in summary.buses.items():
            share = f"{100 * totals.bytes_in_frames / max(totals.bytes, 1):.2f} %"
            counts = totals.bytes, share, totals.kinds.total(), totals.severities.total()
            table.add_row(capture, totals.protocol, *map(str, counts))
    with unpadded(console):
        console.print(table)


if __name__ == "__main__":
    try:
        demo()
    except SnifferError as error:
        say(worded(error))
        sys.exit(2)
