"""``sniffer.diff``: two runs compared by servo, and their plots one over the other."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

from sniffer.decoding.called import Named, ServoNames, overlaid
from sniffer.decoding.options import Options
from sniffer.diagnosis import Diagnosis
from sniffer.ground.model import InputError, OutputError
from sniffer.ground.needs import need_rerun
from sniffer.ground.wording import Sentence, and_, counted
from sniffer.jobs.aside import kept_aside
from sniffer.jobs.asked import Extract
from sniffer.jobs.derived import Derived
from sniffer.jobs.order import merged
from sniffer.jobs.outputs import check_outputs, gone
from sniffer.jobs.session import Ending, run_source, undecided_of
from sniffer.jobs.telling import Teller
from sniffer.reports.differing import RunDifference, differences
from sniffer.reports.runs import RunFigures
from sniffer.reports.significance import ALPHA
from sniffer.selection.places import SINCE
from sniffer.sources import open_source

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence
    from pathlib import Path

    from sniffer.decoding.sink import Sink
    from sniffer.decoding.summary import Summary
    from sniffer.ground.model import Chunk
    from sniffer.jobs.session import Patience
    from sniffer.selection.places import CapturePlace, Window
    from sniffer.selection.selection import Selection
    from sniffer.sinks.rerun.overlay import OverlaidSink
    from sniffer.sources import Source

A_B: Final = ("A", "B")
"""What the two runs are called."""


@dataclass(frozen=True, slots=True)
class Compared:
    """In what two runs differ, the surest first; ``tests`` is how much was compared.

    ``runs`` are the figures of both, ``ending`` the worse of how the two were read. ``asked`` is
    what of them was compared, as the summary of a decode has it; empty: all.
    """

    sources: tuple[str, str]
    runs: tuple[RunFigures, RunFigures]
    differences: tuple[RunDifference, ...]
    tests: int
    ending: Ending
    asked: Mapping[str, Any]
    gone: tuple[Path, ...] = ()
    parts: tuple[str, ...] = ()
    """Which part of each run was compared, where these are two."""
    names: ServoNames = field(default_factory=ServoNames)
    """What servos are called, by the buses of the first run."""
    unproven: tuple[RunDifference, ...] = ()
    """Values that lie apart, and are too few independent ones to be sure."""

    @property
    def equal(self) -> bool:
        """Whether they do not differ."""
        return not self.differences

    def lines(self) -> list[str]:
        """Return it for people."""
        out = []
        for name, source, run in zip(A_B, self.sources, self.runs, strict=True):
            expected, missing = sum(run.expected.values()), sum(run.missing.values())
            told = f", {counted(expected, 'answer')} expected, {missing} failed"
            if self.asked and not expected:  # a selection without exchanges says nothing of them
                frames = sum(run.frames.values())
                told = f", {counted(frames, 'frame')}" if frames else ""
            length = "no clock" if run.seconds is None else f"{run.seconds:.1f} s"
            out.append(f"{name}: {source}: {length}{told}")
        if self.parts:
            out.insert(
                0, "; ".join(f"{n}: {part}" for n, part in zip(A_B, self.parts, strict=True))
            )
        if self.asked:
            out.insert(0, f"of each what is selected: {'; '.join(self.asked.values())}")
        if self.equal:
            out.append(f"the same, as far as {self.tests} comparisons can tell")
        else:
            n = len(self.differences)
            told = f"{counted(n, 'difference')} ({self.tests} comparisons; {ALPHA:.0%} of pairs of"
            out.append(f"{told} equal runs would have one by chance)")
        for one in self.differences:
            out += one.lines(self.names)
        if self.unproven:
            out.append(
                f"{len(self.unproven)} not proven: all of one run lie beyond all of the other, but "
                "each follows its neighbour so closely that they count as very few"
            )
        for one in self.unproven:
            out += one.lines(self.names)
        return out

    def as_dict(self) -> dict[str, Any]:
        """Return it as ``schemas/diff.schema.json`` has it."""
        both = zip(A_B, self.sources, self.runs, strict=True)
        return {
            **({"selection": dict(self.asked)} if self.asked else {}),
            **({"parts": list(self.parts)} if self.parts else {}),
            **{
                name.lower(): {
                    "source": source,
                    "seconds": None if run.seconds is None else round(run.seconds, 6),
                    "frames": sum(run.frames.values()),
                    "expected": sum(run.expected.values()),
                    "missing": sum(run.missing.values()),
                }
                for name, source, run in both
            },
            "alpha": ALPHA,
            "correction": "Holm",
            "tests": self.tests,
            "differences": self._dicts(self.differences),
            **({"unproven": self._dicts(self.unproven)} if self.unproven else {}),
        }

    def _dicts(self, found: Sequence[RunDifference]) -> list[dict[str, Any]]:
        return [self.names.beside(d.bus, d.as_dict()) for d in found]


def diff(
    a: str | Path,
    b: str | Path,
    output: Path | None = None,
    options: Options | None = None,
    *,
    input_format: str = "auto",
    overwrite: bool = False,
    window: Window | None = None,
    window_b: Window | None = None,
    selection: Selection | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Compared:
    """Compare two runs: times, missing answers, errors, values, settings, commands, incidents.

    Buses are compared that have one name; where each run has one bus, or one of which something is
    selected, these.

    Args:
        a: the first run, a path.
        b: the second one.
        output: a .rrd in which both stand one over the other, each from its own beginning.
        options: how both are decoded.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``, of both.
        overwrite: a file that is there already is replaced.
        window: which part of each, in seconds of its own; all of it where None.
        window_b: which part of the second one, where that is another.
        selection: which records are compared; all of them where None.
        patience: takes interruptions.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: one cannot be read, or its protocol cannot be told, or they share no bus.
        OutputError: the file cannot be written.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    options = options or Options()
    options.check()
    tell = tell or Teller(lambda line: None, quiet=True)
    parts = Extract.of(selection, window), Extract.of(selection, window_b or window)
    if any(part is not None and part.is_dated for part in parts):
        raise InputError(
            "two runs have no date in common: write seconds of each, as in 10 or 10min"
        )
    overlay: OverlaidSink | None = None
    called: dict[Named, str] = {}
    if output is not None:
        if output.suffix.lower() != ".rrd":
            raise OutputError(f"{output}: plots of both end in .rrd")
        need_rerun()
        check_outputs([output], [str(a), str(b)], force=overwrite)
    two = [_Run(str(path), part, options, tell) for path, part in zip((a, b), parts, strict=True)]
    endings = []
    # of a few records no cause can be told, of a bus it can
    is_whole = selection is None or set(selection.columns) == {"bus"}
    told: dict[str, Any] = {}
    with contextlib.ExitStack() as stack:
        aside = stack.enter_context(kept_aside())
        if output is not None:
            from sniffer.sinks.rerun.overlay import OverlaidSink

            aside.take([output])
            overlay = OverlaidSink(output)
            stack.callback(overlay.close)
        for run in two:
            run.open(stack, input_format)
        latest = max(run.start_ns for run in two)
        for name, run in zip(A_B, two, strict=True):
            sinks: list[Sink] = [run.figures]
            if is_whole:
                diagnosis = Diagnosis()
                sinks.append(diagnosis)
            if overlay is not None:
                run.later_ns = latest - run.start_ns
                sinks.append(_Named(overlay, name, called))
            summary, ending = run.read(sinks, patience)
            endings.append(ending)
            if is_whole:
                run.figures.incidents = diagnosis.incidents()
            told |= {k: v for k, v in summary.narrowed.items() if k in ("where", "part")}
        if selection is not None and not any(run.figures.rows.total() for run in two):
            raise InputError(f"{selection.text}: neither run has any of it")
        first, second = runs = two[0].figures, two[1].figures
        of_b = _match(first, second, str(a), str(b))
    differ = window_b is not None and window_b != window
    if differ:
        told.pop("part", None)
    names_a, names_b = (run.options.names for run in two)
    if of_b is not None:  # the names of one bus are those of the bus that it is compared with
        (shown,) = first.frames
        on_b = two[1].options.called.on_bus(of_b)
        names_b = {(shown, servo): name for servo, name in on_b.items()}
    found = differences(first, second)
    lost = () if output is None else gone([output], tell)
    worst = Ending.worst(endings)
    texts = tuple("all of it" if run.part is None else str(run.part) for run in two)
    return Compared(
        (str(a), str(b)),
        runs,
        tuple(found.told),
        found.tests,
        worst,
        told,
        lost,
        texts if differ else (),
        ServoNames(overlaid(names_b, names_a)),
        tuple(found.unproven),
    )


@dataclass(slots=True)
class _Run:
    """One of the two: its times count from its first byte, and from ``later_ns`` in a picture."""

    path: str
    part: Extract | None
    options: Options
    tell: Teller
    figures: RunFigures = field(default_factory=RunFigures)
    start_ns: int = 0
    """Where its part begins."""
    later_ns: int = 0
    _source: Source | None = None

    def open(self, stack: contextlib.ExitStack, input_format: str) -> None:
        """Open it, and find where its part begins."""
        again = self.part is not None and self.part.seeks
        with undecided_of(self.path, leads=True):
            opened = stack.enter_context(
                open_source(self.path, input_format, again=again, wiring=self.options.wired)
            )
            self.options = self.options.with_facts(opened.facts(), opened.tables)
            self._source = Derived(opened, self._from_zero(opened), opened.facts(), is_mixed=False)
            if self.part is not None:
                found = self.part.sought_in(self._source, self.options)
                self.part = replace(found, start=_counted(found.start), stop=_counted(found.stop))
                self.start_ns = max(self.part.ends(0)(None).start or 0, 0)

    def read(self, sinks: Sequence[Sink], patience: Patience | None) -> tuple[Summary, Ending]:
        """Decode it."""
        assert self._source is not None
        with undecided_of(self.path, leads=True):
            return run_source(
                self._source,
                self.options,
                sinks,
                name=self.path,
                tell=self.tell,
                patience=patience,
                asked=self.part,
            )

    def _from_zero(self, opened: Source) -> Any:
        """Return what reads a source with times that count from its first byte."""

        def made(groups: Iterable[Sequence[Chunk]]) -> Iterator[list[Chunk]]:
            began: int | None = None
            for group in merged(opened, groups, self.options, self.tell):
                if began is None:
                    began = next((c.t_ns for c in group if c.t_ns is not None), None)
                by = self.later_ns - (began or 0)
                yield [c if c.t_ns is None else replace(c, t_ns=c.t_ns + by) for c in group]

        return made


def _counted(place: CapturePlace | None) -> CapturePlace | None:
    """Return a place that was found as one that counts from the first byte."""
    if place is None or place.kind == SINCE:
        return place
    return replace(place, kind=SINCE)


class _Named:
    """A sink that gets the batches of a run under the run's name; it is closed elsewhere.

    ``told`` are the names of servos of all runs, by what their buses are called in the picture.
    """

    def __init__(self, sink: OverlaidSink, name: str, told: dict[Named, str]) -> None:
        self._sink = sink
        self._names = ServoNames()
        self._told = told
        self._name = name
        self._buses: list[str] = []

    def call(self, names: ServoNames) -> None:
        """Take what the servos of the run are called."""
        self._names = names

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: Any, batch: Any) -> None:
        """Hand a batch on."""
        if bus not in self._buses:
            self._buses.append(bus)
            shown = self._shown(bus)
            self._told |= {(shown, who): name for who, name in self._names.on_bus(bus).items()}
            self._sink.call(ServoNames(self._told))
        self._sink.write(self._shown(bus), protocol, batch)

    def _shown(self, bus: str) -> str:
        """Return the name under which a bus is shown."""
        return f"{self._name} {bus}" if self._buses.index(bus) else self._name

    def close(self) -> None:
        """Do nothing."""


def _match(a: RunFigures, b: RunFigures, name_a: str, name_b: str) -> str | None:
    """Give the only bus of each run, or the only one of which something is selected, one name.

    Return what that bus of the second run was called, None where several are compared.

    Raises:
        InputError: they have none in common.
    """
    asked = [[bus for bus, n in run.rows.items() if n] for run in (a, b)]
    if not a.frames.keys() & b.frames.keys() and all(len(buses) == 1 for buses in asked):
        for run, (bus,) in zip((a, b), asked, strict=True):
            run.keep(bus)
    if len(a.frames) == 1 and len(b.frames) == 1:
        called = next(iter(b.frames))
        b.rename(called, next(iter(a.frames)))
        return called
    if not a.frames.keys() & b.frames.keys():
        told = "{a} has {has_a}, {b} has {has_b}: no bus in common"
        told += "; name one of each: {buses:{x},{y}}"
        has_a, has_b = (and_(list(run.frames)) for run in (a, b))
        x, y = (next(iter(run.frames)) for run in (a, b))
        raise InputError(Sentence(told, a=name_a, b=name_b, has_a=has_a, has_b=has_b, x=x, y=y))
    return None
