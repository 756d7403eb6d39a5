"""``sniffer.merge``: several captures as one, by time."""

from __future__ import annotations

import contextlib
import heapq
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer.decoding.called import NAME, names_in, overlaid
from sniffer.decoding.options import SINCE, Options
from sniffer.decoding.pacing import ASSUMED
from sniffer.ground.files import paths_of
from sniffer.ground.limits import GROUP_CHUNKS
from sniffer.ground.model import Chunk, Direction, SnifferError
from sniffer.ground.wording import Sentence
from sniffer.jobs.anonymous import anonymous
from sniffer.jobs.clocks import (
    Input,
    Wires,
    align_taps,
    named,
    put_on_one_clock,
    times_of,
    wires_of,
)
from sniffer.jobs.convert import Converted, convert_opened
from sniffer.jobs.derived import Derived
from sniffer.jobs.telling import Teller
from sniffer.messages import ANCHOR, OFFSET
from sniffer.sources import open_source
from sniffer.sources.several import inputs_of, refuse_twice

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from sniffer.decoding.called import Named
    from sniffer.jobs.session import Patience
    from sniffer.merging.merger import Merger
    from sniffer.protocols.base import BusProtocol

MERGED: Final = "merged"
"""Facts of a merged capture: ``merged.1.source``, ``merged.1.shift_ns`` and so on."""

_OF_A_BUS: Final = ("baud", "latency_ns", "protocol", "plugin", "port", "pair", SINCE)
"""Facts that belong to a bus and get its new name."""

_SAID_ANEW: Final = frozenset((*_OF_A_BUS, OFFSET, "rate", NAME.removesuffix(".")))
"""Facts that are not handed on as they are, though all captures may agree on them."""


def merge(
    sources: str | Path | Iterable[str | Path],
    outputs: str | Path | Sequence[str | Path],
    options: Options | None = None,
    *,
    offsets: Mapping[str, int] | None = None,
    align: bool = False,
    pair: bool = False,
    together: bool = False,
    input_format: str = "auto",
    anonymise: bool = False,
    overwrite: bool = False,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Converted:
    """Make one capture of several, in the order of time.

    A bus keeps its name; where several captures have a bus of one name, each is called after its
    file. The files of one recording (``rotate_bytes``, ``rotate_ns``) are one bus again, as are
    those that are one capture ``together``.

    Args:
        sources: paths.
        outputs: the files, as for ``convert``.
        options: how it is decoded.
        offsets: what is added to the times of a source, in ns, by its path.
        align: find that from the traffic that two taps of one bus both heard, or of two wires from
            who answers what; the first one's clock counts.
        pair: of two sources the first heard the controller's wire, the second the servos': they
            become one bus, in the order of cause and effect.
        together: the sources are one capture, such as a log in pieces: buses of one name are one.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``, of all.
        anonymise: times count from zero; names, ports and serial numbers are left out, and of what
            it was made.
        overwrite: files that are there already are replaced.
        patience: takes interruptions while it is written.
        tell: takes what should be told; nothing is told without.

    Raises:
        InputError: an input cannot be read or has no times, or no traffic tells the clocks.
        OutputError: a file cannot be written; the others are whole.
        SnifferError: unknown protocol or model, or arguments that do not fit.
    """
    outputs = paths_of(outputs)
    options = options or Options()
    options.check()
    tell = tell or Teller(lambda line: None, quiet=True)
    sources = inputs_of(sources)
    if not sources:
        raise SnifferError("merge takes captures, one or more: there is none")
    if pair and len(sources) != 2:
        raise SnifferError(Sentence("{pair} is about two captures, one of each wire"))
    if pair and together:
        raise SnifferError(
            Sentence("{pair} is about two wires, {together} about one after another")
        )
    refuse_twice(sources)
    with contextlib.ExitStack() as stack:
        inputs = []
        for path in sources:
            opened = stack.enter_context(
                open_source(path, input_format, again=True, wiring=options.wired)
            )
            own = options.with_facts(opened.facts(), opened.tables)
            inputs.append(Input(str(path), opened, own, opened.facts(), times_of(opened), {}))
        for path, shift in (offsets or {}).items():
            named(inputs, path).shift_ns = shift
        given = {named(inputs, path).path for path in offsets or {}}
        if align and not pair:
            align_taps(inputs, given, tell)
        _name(inputs, pair=pair, together=together)
        wires = _wires(inputs, options, tell, align=align and not given) if pair else None
        spoken, called = _protocols(inputs, options), overlaid(_called(inputs), options.names)
        facts, both = _facts(inputs), replace(options, protocols=spoken, names=called)

        def made(groups: Iterable[Sequence[Chunk]]) -> Iterator[list[Chunk]]:
            del groups  # the first one is read with the others
            stream = heapq.merge(*(one.chunks(tell) for one in inputs), key=lambda e: e[0])
            paired = None if wires is None else wires.merger(next(iter(inputs[0].names.values())))
            yield from _grouped((chunk for _, chunk in stream), paired)

        derived = Derived(
            inputs[0].source,
            made,
            facts,
            is_mixed=False,
            origin=" + ".join(one.path for one in inputs),
            tables=lambda: [table for one in inputs for table in one.source.tables()],
        )
        if anonymise:
            derived, both = anonymous(derived, both, tell)
        return convert_opened(
            derived,
            [one.path for one in inputs],
            outputs,
            both,
            overwrite=overwrite,
            patience=patience,
            tell=tell,
        )


def _name(inputs: Sequence[Input], *, pair: bool, together: bool) -> None:
    """Name the buses: apart, but for the two wires of one bus, and the files of one capture."""
    taken: dict[str, Input] = {}
    clashes = {
        bus
        for nth, one in enumerate(inputs)
        for other in inputs[:nth]
        for bus in one.buses.keys() & other.buses.keys()
        if not (together or _continues(one, other, bus) or _continues(other, one, bus))
    }
    for nth, one in enumerate(inputs):
        if pair:
            if len(one.buses) > 1:
                raise SnifferError(f"{one.path} has several buses: a pair is two taps of one")
            one.names = dict.fromkeys(one.buses, next(iter(inputs[0].buses)))
            one.wire = Direction.RX if nth else Direction.TX
            continue
        for bus in one.buses:
            name = bus
            if bus in clashes:
                stem = Path(one.path).name.partition(".")[0] or f"bus{nth}"
                name = stem if len(one.buses) == 1 else f"{stem}-{bus}"
            while name in taken and not (bus not in clashes and name == bus):
                name += "_"
            taken[name] = one
            one.names[bus] = name


def _continues(later: Input, earlier: Input, bus: str) -> bool:
    """Tell whether a file goes on where another one of its recording ended."""
    is_next = later.facts.get(f"{OFFSET}.{bus}", "0") != "0"
    if any(later.facts.get(key) != earlier.facts.get(key) for key in ANCHOR):
        return False  # of another recorder, which had begun anew
    return is_next and later.buses[bus][0] >= earlier.buses[bus][0]


def _facts(inputs: Sequence[Input]) -> dict[str, str]:
    """Return what the merged capture says of itself."""
    out: dict[str, str] = {}
    for nth, one in enumerate(inputs, 1):
        out[f"{MERGED}.{nth}.source"] = one.path
        out[f"{MERGED}.{nth}.shift_ns"] = str(one.shift_ns)
        for key, value in one.facts.items():
            what, _, rest = key.partition(".")
            bus = max((b for b in one.names if f"{rest}.".startswith(f"{b}.")), key=len, default="")
            if what not in _OF_A_BUS or not bus:
                continue
            if what == "baud" and one.facts.get("rate") == ASSUMED:
                continue
            name = f"{what}.{one.names[bus]}{rest.removeprefix(bus)}"
            out.setdefault(name, "0" if what == SINCE else value)
    shared = set.intersection(*(set(one.facts.items()) for one in inputs))
    out |= {k: v for k, v in shared if k.partition(".")[0] not in _SAID_ANEW}
    return out


def _protocols(inputs: Sequence[Input], options: Options) -> dict[str, str | BusProtocol]:
    """Return what each bus was said to speak."""
    told: dict[str, str | BusProtocol] = {}
    for one in inputs:
        for bus, name in one.options.protocols.items():
            if bus in one.names:
                told.setdefault(one.names[bus], name)
    return {**told, **options.protocols}


def _called(inputs: Sequence[Input]) -> dict[Named, str]:
    """Return what servos are called; who has one id in two captures need not be one servo."""
    told = [names_in(one.facts) for one in inputs]
    everywhere: list[dict[Named, str]] = [
        {who: name for who, name in names.items() if isinstance(who, int)} for names in told
    ]
    agree = all(names == everywhere[0] for names in everywhere)
    out: dict[Named, str] = everywhere[0] if agree else {}
    for one, names in zip(inputs, told, strict=True):
        for who, name in names.items():
            if isinstance(who, tuple) and who[0] in one.names:
                out[one.names[who[0]], who[1]] = name
            elif isinstance(who, int) and not agree:
                for bus in one.names.values():
                    out.setdefault((bus, who), name)
    return out


def _wires(inputs: Sequence[Input], options: Options, tell: Teller, *, align: bool) -> Wires:
    """Return what is spoken on two wires; their clocks are aligned, or looked at."""
    asks, says = inputs
    wires = wires_of(asks, says, options)
    put_on_one_clock(asks, says, wires, tell, align=align)
    bus = next(iter(asks.names.values()))
    lag = wires.latency_ns / 1e6
    tell.talk(f"{bus}: two wires, put in order by cause and effect, times ± {lag:g} ms")
    return wires


def _grouped(stream: Iterable[Chunk], paired: Merger | None) -> Iterator[list[Chunk]]:
    """Yield chunks in groups; of two wires, put in order."""
    group: list[Chunk] = []
    for chunk in stream:
        group.append(chunk)
        if len(group) >= GROUP_CHUNKS:
            yield group if paired is None else paired.feed(group)
            group = []
    if paired is not None:
        group = [*paired.feed(group), *paired.close()]
    if group:
        yield group
