"""``make demo``: decode the sample captures, record and plot them; no hardware needed."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import click
from rich.console import Console

from sniffer import __version__
from sniffer.cli.streams import say
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, SnifferError
from sniffer.messages import TOOL
from sniffer.protocols import PROTOCOLS
from sniffer.sinks import open_sink
from sniffer.sinks.report import print_summary
from sniffer.sources import open_source

CAPTURES = Path("sample_captures")
OUT = Path("demo-out")


def captures() -> list[Path]:
    """Return the sample captures, protocol by protocol.

    Raises:
        SnifferError: they are not here.
    """
    found = sorted(p for p in CAPTURES.glob("*_*") if p.suffix != ".md")
    if not found:
        raise SnifferError(f"no {CAPTURES}/ here: run the demo in the folder of the project")
    return found


def as_bus(path: Path, bus: str) -> Iterator[list[Chunk]]:
    """Yield a capture's groups under another bus name."""
    for group in open_source(path):
        yield [replace(chunk, bus=bus) for chunk in group]


def show_summaries(console: Console) -> None:
    """Decode every capture and print its summary."""
    for path in captures():
        pipeline = Pipeline(Options(protocol=path.name.split("_")[0]), [])
        for group in as_bus(path, path.name):
            pipeline.feed(group)
        pipeline.close()
        console.print()
        print_summary(pipeline.summary, console)


def record(outputs: list[Path]) -> None:
    """Write the damaged captures as the four buses of one recording."""
    session = {"tool": f"{TOOL} {__version__}", "source": str(CAPTURES)}
    options = Options(protocols={name: name for name in PROTOCOLS.built_in})
    pipeline = Pipeline(options, [open_sink(path, session) for path in outputs])
    for name in PROTOCOLS.built_in:
        for path in captures():
            if path.name.startswith(f"{name}_damaged"):
                for group in as_bus(path, name):
                    pipeline.feed(group)
    pipeline.close()
    pipeline.finish()


def demo() -> None:
    """Run the demo."""
    from sniffer.viewers import viewer

    console = Console(highlight=False)
    show_summaries(console)
    OUT.mkdir(exist_ok=True)
    recording, plots = OUT / "demo.mcap", OUT / "demo.rrd"
    record([recording, plots])
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
        click.echo(f"sniffer: {error}", err=True)
        sys.exit(2)
