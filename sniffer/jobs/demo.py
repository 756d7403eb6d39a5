"""The sample captures decoded, and the damaged ones recorded as the buses of one robot."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer import __version__
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import Chunk, SnifferError
from sniffer.messages import TOOL
from sniffer.protocols import PROTOCOLS
from sniffer.sinks import open_sink
from sniffer.sources import open_source

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.decoding.summary import Summary

CAPTURES: Final = Path("sample_captures")

STORY: Final = CAPTURES / "mightyzap_damaged.log"
"""The capture that is told at length: a supply that sags, noise, and two servos with one id."""


def captures() -> list[Path]:
    """Return the sample captures, protocol by protocol.

    Raises:
        SnifferError: they are not here.
    """
    found = sorted(p for p in CAPTURES.glob("*_*") if p.suffix != ".md")
    if not found:
        raise SnifferError(f"no {CAPTURES}/ here: run the demo in the folder of the project")
    return found


def summaries() -> Iterator[Summary]:
    """Decode every capture and yield its totals."""
    for path in captures():
        pipeline = Pipeline(Options(protocol=path.name.split("_")[0]), [])
        for group in _as_bus(path, path.name):
            pipeline.feed(group)
        pipeline.close()
        yield pipeline.summary


def record_damaged(outputs: list[Path]) -> None:
    """Write the damaged captures as the four buses of one recording."""
    session = {"tool": f"{TOOL} {__version__}", "source": str(CAPTURES)}
    options = Options(protocols={name: name for name in PROTOCOLS.built_in})
    pipeline = Pipeline(options, [open_sink(path, session) for path in outputs])
    for name in PROTOCOLS.built_in:
        for path in captures():
            if path.name.startswith(f"{name}_damaged"):
                for group in _as_bus(path, name):
                    pipeline.feed(group)
    pipeline.close()
    pipeline.finish()


def _as_bus(path: Path, bus: str) -> Iterator[list[Chunk]]:
    """Yield a capture's groups under another bus name."""
    for group in open_source(path):
        yield [replace(chunk, bus=bus) for chunk in group]
