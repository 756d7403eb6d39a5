"""``sniffer.convert``: files made of a capture; ``convert``, ``decode`` and ``view`` call it."""

from __future__ import annotations

import contextlib
import functools
from typing import TYPE_CHECKING, NamedTuple

from sniffer.decoding.pipeline import Options
from sniffer.decoding.summary import Summary
from sniffer.ground.files import STDIN, TABLES, paths_of
from sniffer.ground.model import SnifferError
from sniffer.ground.wording import Sentence, and_
from sniffer.jobs.anonymous import anonymous
from sniffer.jobs.aside import kept_aside
from sniffer.jobs.copying import Copies, copy_source
from sniffer.jobs.derived import Derived
from sniffer.jobs.outputs import gone, open_all, session_facts, told_part
from sniffer.jobs.session import run_source, undecided_of
from sniffer.jobs.telling import Teller
from sniffer.sources.several import inputs_of, joined, name_of, open_capture

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from sniffer.decoding.sink import Sink
    from sniffer.jobs.asked import Extract
    from sniffer.jobs.outputs import Contents, Wide
    from sniffer.jobs.session import Ending, Patience
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection
    from sniffer.sinks.raw import RawFile
    from sniffer.sources import Source


class Converted(NamedTuple):
    """What became of a capture: its totals, how the decoding ended, outputs that are gone."""

    summary: Summary
    ending: Ending
    gone: tuple[Path, ...] = ()


def convert(
    source: str | Path | Sequence[str | Path],
    outputs: str | Path | Sequence[str | Path],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    overwrite: bool = False,
    sinks: Sequence[Sink] = (),
    selection: Selection | None = None,
    window: Window | None = None,
    context: int = 0,
    wide: Wide | None = None,
    contents: Contents | None = None,
    anonymise: bool = False,
    jobs: int = 1,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Converted:
    """Make files of a capture, a dump, a log or a recording.

    What goes wrong on the bus is part of the outputs. Where the input breaks off, or somebody
    interrupts, what could be read is written; ``ending`` says so. For the bytes alone (.log .bin
    .hex) nothing is decoded: ``summary`` is empty then.

    Args:
        source: a path, or ``"-"`` for standard input; of several, such as the files of a rotation,
            each is read behind the other, as one capture.
        outputs: the files; their suffixes say what (.jsonl .csv .parquet .mcap .rrd .pcapng, and
            .log .bin .hex).
        options: how it is decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        overwrite: files that are there already are replaced.
        sinks: further outputs, open already.
        selection: which records are written, of bytes which frames; totals are counted of all.
        window: which part of the capture, all of it where None.
        context: how many frames and gaps of its bus are written before and behind each that is
            selected, in lines for people and in JSON lines.
        wide: tables have a column for each quantity of a servo; a row a register where None.
        contents: what recordings have beside the raw bytes; the usual where None.
        anonymise: times count from zero; names, ports and serial numbers are left out.
        jobs: how many processes decode; the result is the same.
        patience: takes interruptions; KeyboardInterrupt is one without, too.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: the input cannot be read, or its protocol cannot be told.
        OutputError: a file cannot be written; the others are whole.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    outputs = paths_of(outputs)
    options = options or Options()
    options.check()
    asked = None
    if jobs > 1:
        refuse_jobs(source, window, context)
    if selection is not None or window is not None:
        from sniffer.jobs.asked import Extract, refuse_part_of

        asked = Extract.of(selection, window, context)
        refuse_part_of(asked, [path.suffix.lower() for path in outputs])
    tell = tell or Teller(lambda line: None, quiet=True)
    if selection is not None and (why := selection.lacking_in("samples")):
        for path in (path for path in outputs if path.suffix.lower() in TABLES):
            tell.talk(f"{path} has no rows: {why}")
    inputs = inputs_of(source)
    again = anonymise or (asked is not None and asked.seeks)
    opened = open_capture(inputs, input_format, again=again, wiring=options.wired)
    if (part := told_part(opened.facts())) is not None:
        tell.talk(part)
    if anonymise:
        opened, options = anonymous(opened, options, tell)
    # of one file who calls this says which it is, if that is wanted
    with undecided_of(name_of(inputs), leads=True) if len(inputs) > 1 else contextlib.nullcontext():
        return convert_opened(
            opened,
            inputs,
            outputs,
            options,
            overwrite=overwrite,
            sinks=sinks,
            asked=asked,
            wide=wide,
            contents=contents,
            jobs=jobs,
            patience=patience,
            tell=tell,
        )


def convert_opened(
    opened: Source,
    inputs: Sequence[str | Path],
    outputs: Sequence[Path],
    options: Options,
    *,
    overwrite: bool,
    sinks: Sequence[Sink] = (),
    asked: Extract | None = None,
    wide: Wide | None = None,
    contents: Contents | None = None,
    jobs: int = 1,
    patience: Patience | None,
    tell: Teller,
) -> Converted:
    """Make files of a source that is open already; else as ``convert``.

    ``inputs`` are the files that it is read from: none of them is an output.
    """
    facts = opened.facts()
    options = options.with_facts(facts, opened.tables)
    if asked is not None:
        asked = asked.sought_in(opened, options)
    told = session_facts(opened.origin(joined(inputs)), options, facts)
    with kept_aside() as aside:
        decoded, raw = open_all(
            outputs,
            told,
            [*map(str, inputs)],
            force=overwrite,
            wide=wide,
            contents=contents,
            aside=aside,
        )
        name = name_of(inputs)
        every = [*decoded, *sinks]
        if raw and asked is not None and asked.selection is not None:
            every += _selected(raw, outputs, asked.selection, tell)
            raw = []
        copies = Copies(raw, Options().with_facts(facts).bauds)
        if raw and not every:
            ending = copy_source(opened, copies, name=name, tell=tell, patience=patience)
            return Converted(Summary(), ending, gone(outputs, tell, wide=wide is not None))
        heard = Derived(opened, copies.of, facts) if raw else opened
        run: Callable[..., tuple[Summary, Ending]] = run_source
        if jobs > 1 and raw:
            tell.talk("decoded by one process: the bytes themselves are written on the way")
        elif jobs > 1:
            from sniffer.jobs.parts import decode_in_parts

            files = [path for path in outputs if path.is_file()]
            folder = files[0].parent if files else None
            run = functools.partial(decode_in_parts, jobs=jobs, folder=folder)
        try:
            summary, ending = run(
                heard, options, every, name=name, tell=tell, patience=patience, asked=asked
            )
        finally:
            copies.finish(tell)
        if contents is not None and contents.joints is not None:
            from sniffer.mcapfile.sink import McapSink

            for sink in decoded:
                if isinstance(sink, McapSink):
                    for line in sink.remarks:
                        tell.talk(line)
        return Converted(summary, ending, gone(outputs, tell, wide=wide is not None))


def _selected(
    raw: Sequence[RawFile], outputs: Sequence[Path], selection: Selection, tell: Teller
) -> list[Sink]:
    """Return sinks that write the selected frames to files of bytes, and say what those lack."""
    from sniffer.sinks import BYTES
    from sniffer.sinks.selected import LEFT_OUT, UNFRAMED, SelectedBytes

    told = [LEFT_OUT]
    if UNFRAMED.issuperset(selection.tables):
        what = and_(list(selection.tables))
        told.append(f"has no bytes: {what} are no frames; `sniffer decode` shows theirs")
    for path in (path for path in outputs if path.suffix.lower() in BYTES):
        for words in told:
            tell.talk(f"{path} {words}")
    return [SelectedBytes(file) for file in raw]


def refuse_jobs(
    source: str | Path | Sequence[str | Path], window: Window | None, context: int = 0
) -> None:
    """Refuse several processes for what one reads as it comes, or only some of.

    Raises:
        SnifferError: it is standard input, a part of a capture, or one with lines around others.
    """
    if any(str(one) == STDIN for one in inputs_of(source)):
        raise SnifferError(Sentence("{jobs} needs a file: save standard input first"))
    if window is not None and window.is_part:
        raise SnifferError(Sentence("{jobs} decodes a whole capture: leave {start} and {stop} out"))
    if context:
        raise SnifferError(Sentence("{jobs} decodes piece by piece: leave {context} out"))
