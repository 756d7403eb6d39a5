"""Running a source through the pipeline for a command: what to do when something breaks off."""

from __future__ import annotations

import datetime
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import click

from sniffer import __version__
from sniffer.detect import Detection
from sniffer.model import Batch, Chunk, DamagedInputError, InputError, OutputError
from sniffer.pipeline import Options, Pipeline
from sniffer.protocols.base import BusProtocol
from sniffer.sinks import open_sink
from sniffer.sinks.base import Sink
from sniffer.sources import Source


class Standard:
    """The sink on standard output: when its reader goes away, it falls silent.

    The pipe's end is nobody's fault; decoding goes on if there are other outputs.
    """

    def __init__(self, sink: Sink, *, alone: bool) -> None:
        self._sink = sink
        self._alone = alone
        self._open = True

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Pass chunks on."""
        self._sink.raw(bus, chunks)

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Pass a batch on while somebody listens."""
        if self._open:
            try:
                self._sink.write(bus, protocol, batch)
                sys.stdout.flush()
            except BrokenPipeError:
                self._closed()

    def close(self) -> None:
        """End the output while somebody listens."""
        if self._open:
            try:
                self._sink.close()
            except BrokenPipeError:
                self._closed()

    def _closed(self) -> None:
        self._open = False
        devnull = os.open(os.devnull, os.O_WRONLY)
        os.dup2(devnull, sys.stdout.fileno())
        os.close(devnull)
        if self._alone:
            raise _NobodyListensError


class _NobodyListensError(Exception):
    """The only output was a pipe, and it is closed."""


def say(message: str) -> None:
    """Talk to the user: one line on standard error."""
    click.echo(f"sniffer: {message}", err=True)


def session_facts(source: str, options: Options) -> Mapping[str, str]:
    """Return the facts of a recording that are known before its first byte."""
    facts = {
        "tool": f"servo-sniffer {__version__}",
        "source": source,
        "protocol": options.protocol,
        "written": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }
    if options.baud is not None:
        facts["baud"] = str(options.baud)
    for servo, model in options.models.items():
        facts["model" if servo is None else f"model.{servo}"] = model
    return facts


def open_outputs(paths: Sequence[Path], facts: Mapping[str, str], source: str) -> list[Sink]:
    """Open the outputs; none may be the input itself, and none is named twice."""
    out: list[Sink] = []
    for path in paths:
        if source != "-" and path.exists() and path.samefile(source):
            raise OutputError(f"{path} is the input: choose another output")
    if len({p.resolve() for p in paths}) < len(paths):
        raise OutputError("an output is named twice")
    for path in paths:
        out.append(open_sink(path, facts))
    return out


def run_source(
    source: Source | Iterable[Sequence[Chunk]],
    options: Options,
    sinks: Sequence[Sink],
    *,
    name: str,
    quiet: bool = False,
) -> tuple[Pipeline, int]:
    """Decode everything into the sinks; return the pipeline and the exit status.

    Damage further in, or an interruption, keeps what was decoded: the sinks are finished first.
    """

    def found(bus: str, detection: Detection) -> None:
        if not quiet:
            say(f"{bus}: {detection}")

    pipeline = Pipeline(options, sinks, on_detection=found)
    status = 0
    try:
        try:
            for group in source:
                pipeline.feed(group)
        except DamagedInputError as error:
            pipeline.close()
            usable = getattr(source, "format", "") == "mcap" and pipeline.summary.buses
            say(str(error) + (": read as far as it goes" if usable else ""))
            status = 0 if usable else 3
        except KeyboardInterrupt:
            pipeline.close()
            say("interrupted: what was decoded is kept")
            status = 130
        else:
            pipeline.close()
        if not pipeline.summary.buses and not status:
            raise InputError(f"{name} is empty: nothing to decode")
    except _NobodyListensError:
        pass
    finally:
        try:
            pipeline.finish()
        except _NobodyListensError:
            status = status or 0
    return pipeline, status
