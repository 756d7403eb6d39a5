"""``sniffer.convert``: a capture decoded into files; what ``sniffer decode`` and ``view`` call."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sniffer.decoding.pipeline import Options
from sniffer.ground.files import files_of
from sniffer.jobs.outputs import check_outputs, gone, open_outputs, session_facts
from sniffer.jobs.session import run_source
from sniffer.jobs.telling import Teller
from sniffer.sources import open_source

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.sink import Sink
    from sniffer.decoding.summary import Summary
    from sniffer.jobs.asked import Extract
    from sniffer.jobs.session import Ending, Patience
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection
    from sniffer.sources import Source


@dataclass(frozen=True, slots=True)
class Converted:
    """What became of a capture: its totals, how the decoding ended, outputs that are gone."""

    summary: Summary
    ending: Ending
    gone: tuple[Path, ...] = ()


def convert(
    source: str | Path | Sequence[str | Path],
    outputs: Sequence[Path],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    overwrite: bool = False,
    sinks: Sequence[Sink] = (),
    selection: Selection | None = None,
    window: Window | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Converted:
    """Decode a capture, a dump, a log or a recording into files.

    What goes wrong on the bus is part of the outputs. Where the input breaks off, or somebody
    interrupts, what could be read is written; ``ending`` says so.

    Args:
        source: a path, or ``"-"`` for standard input; of several, such as the files of a rotation,
            each is read behind the other, as one capture.
        outputs: the files; their suffixes say what (.jsonl .csv .parquet .mcap .rrd).
        options: how it is decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        overwrite: files that are there already are replaced.
        sinks: further outputs, open already.
        selection: which records are written; totals are counted of all.
        window: which part of the capture, all of it where None.
        patience: takes interruptions; KeyboardInterrupt is one without, too.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: the input cannot be read, or its protocol cannot be told.
        OutputError: a file cannot be written; the others are whole.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    options = options or Options()
    options.check()
    asked = None
    if selection is not None or window is not None:
        from sniffer.jobs.asked import Extract, refuse_part_of

        asked = Extract.of(selection, window)
        refuse_part_of(asked, [path.suffix.lower() for path in outputs])
    inputs = [source] if isinstance(source, str | Path) else [*source]
    again = asked is not None and asked.seeks
    if len(inputs) == 1:
        opened = open_source(inputs[0], input_format, again=again)
    else:
        from sniffer.sources.several import open_sources

        check_outputs([f for p in outputs for f in files_of(p)], [*map(str, inputs)], force=True)
        opened = open_sources(inputs, input_format)
    return convert_opened(
        opened,
        " ".join(map(str, inputs)),
        outputs,
        options,
        overwrite=overwrite,
        sinks=sinks,
        asked=asked,
        patience=patience,
        tell=tell or Teller(lambda line: None, quiet=True),
    )


def convert_opened(
    opened: Source,
    source: str,
    outputs: Sequence[Path],
    options: Options,
    *,
    overwrite: bool,
    sinks: Sequence[Sink] = (),
    asked: Extract | None = None,
    patience: Patience | None,
    tell: Teller,
) -> Converted:
    """Decode a source that is open already; else as ``convert``."""
    facts = opened.facts()
    options = options.with_facts(facts, opened.tables)
    if asked is not None:
        asked = asked.sought_in(opened, options)
    told = session_facts(source, options, facts)
    every = [*open_outputs(outputs, told, source, force=overwrite), *sinks]
    name = "standard input" if source == "-" else source
    summary, ending = run_source(
        opened, options, every, name=name, tell=tell, patience=patience, asked=asked
    )
    return Converted(summary, ending, gone(outputs, tell))
