"""``sniffer.report``: a page on a capture; what ``sniffer report`` calls.

The capture is read twice: first to judge it, then to draw what is evidence.
"""

from __future__ import annotations

import contextlib
import datetime
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer import __version__
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.files import open_text, writing
from sniffer.ground.model import DamagedInputError, OutputError
from sniffer.jobs.hearing import hear
from sniffer.jobs.order import merged
from sniffer.jobs.outputs import check_outputs, gone
from sniffer.jobs.session import Ending
from sniffer.jobs.telling import Teller
from sniffer.messages import TOOL
from sniffer.reports.content import Content
from sniffer.reports.evidence import Exhibits
from sniffer.sources.several import inputs_of, name_of, open_capture

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.diagnosis import Incident
    from sniffer.jobs.hearing import HeardCapture
    from sniffer.jobs.session import Patience
    from sniffer.selection.places import Window
    from sniffer.sources import Source

HTML: Final = ".html"
MARKDOWN: Final = ".md"

FORMS: Final = (HTML, MARKDOWN)
"""Suffixes of reports."""


@dataclass(frozen=True, slots=True)
class Reported:
    """What a report tells, how the reading ended, and the file if somebody took it away since."""

    content: Content
    ending: Ending
    gone: tuple[Path, ...] = ()

    def as_text(self, form: str = MARKDOWN) -> str:
        """Return the report as Markdown (``.md``) or as a page (``.html``)."""
        if form == HTML:
            from sniffer.reports.page import page

            return page(self.content)
        from sniffer.reports.text import markdown

        return markdown(self.content)


def report(
    source: str | Path | Sequence[str | Path],
    output: str | Path | None = None,
    options: Options | None = None,
    *,
    input_format: str = "auto",
    overwrite: bool = False,
    window: Window | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Reported:
    """Tell what was wrong in a capture, with the bytes that show it: as a page, or as Markdown.

    Where the input breaks off, or somebody interrupts, it is on what could be read, and says so. A
    capture that speaks another protocol than was said has no report.

    Args:
        source: a path, or ``"-"`` for standard input; several are one capture, read in the order
            of their times.
        output: ``*.html`` or ``*.md``; no file is written where None.
        options: how it is decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        overwrite: a file that is there already is replaced.
        window: which part of the capture it is on; all of it where None.
        patience: takes interruptions.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: the input cannot be read, or its protocol cannot be told.
        OutputError: the report cannot be written.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    path = None if output is None else Path(output)
    inputs = inputs_of(source)
    if path is not None:
        _suffix_known(path)
        check_outputs([path], [*map(str, inputs)], force=overwrite, later=True)
    options = options or Options()
    options.check()
    tell = tell or Teller(lambda line: None, quiet=True)
    with open_capture(inputs, input_format, again=True, wiring=options.wired) as opened:
        options = options.with_facts(opened.facts(), opened.tables)
        hearing = hear(
            opened, options, name=name_of(inputs), tell=tell, patience=patience, window=window
        )
        notes = tuple(opened.notes)
        if (part := hearing.summary.narrowed.get("part")) is not None:
            notes = (f"a part of the capture, {part}", *notes)
        names = hearing.summary.names
        incidents = sorted((i.named(names) for i in hearing.diagnosis.incidents()), key=_rank)
        evidence = Exhibits(incidents)
        if not evidence.is_done:
            _draw(opened, hearing.options, evidence)
        content = _content(hearing, opened, inputs, notes, incidents, evidence)
        done = Reported(content, hearing.ending)
    if path is None or hearing.ending == Ending.MISTAKEN:
        return done
    told = done.as_text(path.suffix.lower())
    with writing(path), open_text(path) as file:
        file.write(told)
    return Reported(done.content, done.ending, gone([path], tell))


def _suffix_known(path: Path) -> None:
    if path.suffix.lower() not in FORMS:
        raise OutputError(f"{path}: the suffix of a report is one of {', '.join(FORMS)}")


def _rank(incident: Incident) -> tuple[int, float, int, int]:
    """Sort the worst first: by severity, then by how sure its cause is, then by time."""
    sure = incident.causes[0].confidence if incident.causes else 0.0
    return -incident.severity, -round(sure, 1), incident.first_ns, incident.number


def _draw(opened: Source, options: Options, evidence: Exhibits) -> None:
    """Read a capture again as far as there is evidence."""
    quiet = Teller(lambda line: None, quiet=True)
    pipeline = Pipeline(options, [evidence])
    with contextlib.suppress(DamagedInputError):
        for group in merged(opened, opened, options, quiet):
            pipeline.feed(group)
            if evidence.is_done:
                return
    pipeline.close()


def _content(
    hearing: HeardCapture,
    opened: Source,
    inputs: Sequence[str | Path],
    notes: tuple[str, ...],
    incidents: list[Incident],
    evidence: Exhibits,
) -> Content:
    now = datetime.datetime.now(datetime.UTC)
    rest = hearing.diagnosis.rest(incidents)
    is_part = "part" in hearing.summary.narrowed
    return Content(
        name=name_of(inputs),
        described=opened.label,
        size=opened.size,
        facts=opened.facts(),
        notes=notes,
        damage=hearing.damage,
        summary=hearing.summary,
        collector=hearing.collector,
        incidents=incidents,
        exhibits=evidence.exhibits(),
        judged=hearing.diagnosis.sentence(),
        rest=rest.of(inputs, is_part=is_part).named(hearing.summary.names),
        shared=hearing.diagnosis.shared(incidents),
        tool=f"{TOOL} {__version__}",
        made=f"{now:%Y-%m-%d}",
    )
