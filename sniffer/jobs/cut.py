"""``sniffer.cut``: a part of a capture, as files of its own."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from sniffer.decoding.detect import UndecidedError
from sniffer.decoding.options import SINCE
from sniffer.decoding.parting import Slicer
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.decoding.slicing import first_told_ns
from sniffer.decoding.spans import sliced
from sniffer.ground.files import paths_of
from sniffer.ground.limits import OFFSET_END, number_in
from sniffer.ground.model import DamagedInputError, InputError
from sniffer.ground.timing import byte_time_ns
from sniffer.ground.wording import Sentence, and_
from sniffer.jobs.anonymous import anonymous
from sniffer.jobs.asked import Extract, buses_of
from sniffer.jobs.convert import Converted, convert_opened
from sniffer.jobs.derived import Derived
from sniffer.jobs.order import merged
from sniffer.jobs.session import undecided_of
from sniffer.jobs.telling import Teller
from sniffer.messages import CUT, OFFSET
from sniffer.sources.several import inputs_of, joined, name_of, open_capture

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.partends import EndsSince
    from sniffer.decoding.sink import Part
    from sniffer.decoding.spans import Span
    from sniffer.ground.model import Chunk
    from sniffer.jobs.session import Patience
    from sniffer.selection.places import Window
    from sniffer.sources import Source


def cut(
    source: str | Path | Sequence[str | Path],
    outputs: str | Path | Sequence[str | Path],
    window: Window,
    options: Options | None = None,
    *,
    buses: Sequence[str] = (),
    input_format: str = "auto",
    anonymise: bool = False,
    overwrite: bool = False,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Converted:
    """Cut a part out of a capture; what is written is what the whole says there.

    It is cut between frames, so that no exchange is torn: it may begin and end a little outside of
    the window. A recording says what it was cut from, and where its first byte stood there.

    Args:
        source: a path, or ``"-"`` for standard input; several are one capture, read in the order
            of their times.
        outputs: the files, as for ``convert``.
        window: which part of it.
        options: how it is decoded: by that it is known where frames begin.
        buses: only these; all of them where none is named.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        anonymise: times count from zero; names, ports and serial numbers are left out, and from
            what it was cut.
        overwrite: files that are there already are replaced.
        patience: takes interruptions while it is written.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: the input cannot be read, its protocol cannot be told, the window is empty, or
            there is no such bus.
        OutputError: a file cannot be written; the others are whole.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    outputs = paths_of(outputs)
    options = options or Options()
    options.check()
    tell = tell or Teller(lambda line: None, quiet=True)
    inputs = inputs_of(source)
    with (
        undecided_of(name_of(inputs), leads=True),
        open_capture(inputs, input_format, again=True, wiring=options.wired) as opened,
    ):
        derived, options = part_of(opened, joined(inputs), window, options, tell, buses)
        if anonymise:
            derived, options = anonymous(derived, options, tell)
        return convert_opened(
            derived,
            inputs,
            outputs,
            options,
            overwrite=overwrite,
            patience=patience,
            tell=tell,
        )


def part_of(
    opened: Source,
    source: str,
    window: Window | None,
    options: Options,
    tell: Teller,
    buses: Sequence[str] = (),
) -> tuple[Derived, Options]:
    """Return a part of a source that can be read twice, as a source, and how it is decoded.

    Raises:
        InputError: its protocol cannot be told, nothing was said there, or there is no such bus.
    """
    options = options.with_facts(opened.facts(), opened.tables)
    asked = (Extract.of(None, window) or Extract()).sought_in(opened, options)
    return found(opened, source, options, asked, tell, buses).of(opened, source, tell)


@dataclass(frozen=True, slots=True)
class CutPart:
    """What is cut out of a capture: ``spans`` by bus, and the times that were asked for, in ns.

    ``byte_ns`` is how long a byte takes, by bus; ``whole`` is how the capture is decoded,
    ``options`` how the part is.
    """

    spans: Mapping[str, Span]
    ends: tuple[int | None, int | None]
    byte_ns: Mapping[str, int]
    whole: Options
    options: Options

    @classmethod
    def heard_by(cls, slicer: Slicer, pipeline: Pipeline, options: Options) -> CutPart:
        """Return what a slicer found in what a pipeline decoded."""
        spans = slicer.spans()
        byte_ns = {bus: byte_time_ns(pipeline.paces[bus].baud) for bus in spans}
        spoken = {bus: name for bus in spans if (name := pipeline.speaks(bus)) is not None}
        # what is left out of the whole, as it was heard at other rates, is not in a part of it
        own = replace(options, protocols={**spoken, **options.protocols}, begins={})
        return cls(spans, slicer.ends[:2], byte_ns, options, own)

    def of(
        self,
        opened: Source,
        source: str,
        tell: Teller,
        once: Iterator[list[Chunk]] | None = None,
    ) -> tuple[Derived, Options]:
        """Return it as a source, and how it is decoded; ``once``: its chunks, if they are read."""

        def made(groups: Iterable[Sequence[Chunk]]) -> Iterator[list[Chunk]]:
            if once is not None:
                return once
            return sliced(
                merged(opened, groups, self.whole, tell.quieter()), self.spans, self.byte_ns
            )

        facts = self.facts(opened.facts(), source)
        return Derived(opened, made, facts, is_mixed=False), self.options

    def facts(self, known: Mapping[str, str], source: str) -> dict[str, str]:
        """Return what the part says of itself, from what the whole says: ``cut.`` and so on."""
        first = known.get(f"{CUT}.source")
        told = {k: v for k, v in known.items() if k.partition(".")[0] != OFFSET}
        told |= {key: "0" for key in known if key.startswith(f"{SINCE}.")}
        told[f"{CUT}.source"] = source if first is None else first
        for name, end in zip(("from_ns", "to_ns"), self.ends, strict=True):
            told.pop(f"{CUT}.{name}", None)
            if end is not None:
                told[f"{CUT}.{name}"] = str(end)
        for bus, span in self.spans.items():
            key = f"{CUT}.{OFFSET}.{bus}"
            before = number_in(known.get(key, ""), 0, OFFSET_END) or 0
            before += number_in(known.get(f"{OFFSET}.{bus}", ""), 0, OFFSET_END) or 0
            told[key] = str(before + span.begin)
        return told


def found(
    opened: Source,
    source: str,
    options: Options,
    asked: Extract,
    tell: Teller,
    buses: Sequence[str],
    slicer: Slicer | None = None,
) -> CutPart:
    """Find where the part begins and ends on each bus; of some ``buses`` alone, if any are named.

    A ``slicer`` may find more than that.

    Raises:
        InputError: nothing was said there, or there is no such bus.
    """
    began: list[int | None] = []

    def ends(parts: Sequence[Part]) -> EndsSince:
        began[0] = first_told_ns(began[0], parts)
        return asked.ends(began[0])

    slicer = slicer or Slicer()
    slicer.find(ends)
    heard: dict[str, None] = {}

    def timed(groups: Iterable[Sequence[Chunk]]) -> Iterator[Sequence[Chunk]]:
        for group in groups:
            if group and not began:
                began.append(group[0].t_ns)
                asked.ends(group[0].t_ns)  # what cannot be is refused here: sinks do not raise it
            heard.update((chunk.bus, None) for chunk in group)
            yield [chunk for chunk in group if chunk.bus in buses] if buses else group

    pipeline = Pipeline(options, [slicer], on_detection=tell.found)
    undecided: UndecidedError | None = None
    with contextlib.suppress(DamagedInputError):  # it comes again when it is read to be written
        for group in timed(merged(opened, opened, options, tell)):
            pipeline.feed(group)
    try:
        pipeline.close()
    except UndecidedError as error:
        undecided = error
    wanted = buses_of(source, [*heard], buses) if heard else []
    part = CutPart.heard_by(slicer, pipeline, options)
    if part.spans and undecided is not None:
        lost = and_([bus for bus in wanted if pipeline.speaks(bus) is None])
        tell.warn(Sentence("{lost}: {error}; left out", lost=lost, error=undecided))
    if not part.spans:
        if undecided is not None:
            raise undecided
        length = pipeline.summary.seconds
        raise InputError(f"nothing was said {asked}: the capture has {length:.3f} s")
    return part
