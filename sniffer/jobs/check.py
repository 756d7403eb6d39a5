"""``sniffer.check``: a capture held to rules; what ``sniffer check`` calls."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sniffer.decoding.options import Options
from sniffer.jobs.hearing import hear
from sniffer.jobs.telling import Teller
from sniffer.reports.judging import judge
from sniffer.reports.rules import read_rules
from sniffer.reports.subject import Subject
from sniffer.sources.several import name_of, open_capture

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.jobs.session import Ending, Patience
    from sniffer.reports.judging import Judged
    from sniffer.reports.rules import Rule
    from sniffer.selection.places import Window


@dataclass(frozen=True, slots=True)
class Checked:
    """The verdicts on a capture, in the order of the rules, and how the reading ended.

    ``damage`` says why the input was not read to its end; empty: it was.
    """

    verdicts: tuple[Judged, ...]
    ending: Ending
    damage: str = ""

    @property
    def holds(self) -> bool:
        """Whether all rules are kept."""
        return all(judged.holds for judged in self.verdicts)


def check(
    source: str | Path | Sequence[str | Path],
    rules: str | Path | Sequence[Rule],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    window: Window | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Checked:
    """Hold a capture to rules: no incident of a cause, answers in time, the supply above a limit.

    Args:
        source: a path, or ``"-"`` for standard input; several are one capture, read in the order
            of their times.
        rules: a file of rules (``docs/checking.md``), or rules that were read.
        options: how it is decoded; what a recording says of itself fills what is not said.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        window: which part of the capture; all of it where None.
        patience: takes interruptions; what was read until then is judged.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: the input cannot be read, or its protocol cannot be told.
        SnifferError: a rule cannot be understood; unknown protocol or model.
    """
    asked = read_rules(Path(rules)) if isinstance(rules, str | Path) else tuple(rules)
    options = options or Options()
    options.check()
    tell = tell or Teller(lambda line: None, quiet=True)
    with open_capture(source, input_format, again=True, wiring=options.wired) as opened:
        options = options.with_facts(opened.facts(), opened.tables)
        asked = tuple(rule.meant(options.called) for rule in asked)
        found = hear(
            opened, options, name=name_of(source), tell=tell, patience=patience, window=window
        )
    incidents = [i.named(found.summary.names) for i in found.diagnosis.incidents()]
    heard = Subject(found.summary, found.collector, incidents)
    return Checked(tuple(judge(asked, heard)), found.ending, found.damage)
