"""``sniffer.scenario_like``: servos that are to answer as those of a recording did."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.decoding.pipeline import Options
from sniffer.ground.model import InputError
from sniffer.jobs.asked import only_bus
from sniffer.jobs.session import run_source, undecided_of
from sniffer.jobs.telling import Teller
from sniffer.simulation.buses import BUSES
from sniffer.simulation.faults import DROP, Fault
from sniffer.simulation.likeness import SeenSink
from sniffer.simulation.play.scenario import Scenario
from sniffer.simulation.provenance import known_registers
from sniffer.sources import open_source
from sniffer.sources.several import name_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path


def scenario_like(
    source: str | Path,
    options: Options | None = None,
    *,
    input_format: str = "auto",
    buses: Sequence[str] = (),
    tell: Teller | None = None,
) -> Scenario:
    """Return a bus whose servos answer a controller as those of a recording did.

    They have its ids, protocol, rate and models, its registers as they were known last, the delays
    of its answers, drawn anew, and leave as many requests without answer.

    Args:
        source: a path, or ``"-"`` for standard input.
        options: how it is decoded.
        input_format: ``"auto"`` or a name of ``sniffer.sources.SOURCES``.
        buses: which of its buses, if it has more than one.
        tell: takes what should be told.

    Raises:
        InputError: it cannot be read, its protocol cannot be told, it has no such bus, or nobody
            answers in it.
        SnifferError: its protocol has no simulator, or it has several buses and none is named.
    """
    options = options or Options()
    options.check()
    tell = tell or Teller(lambda line: None, quiet=True)
    sink = SeenSink()
    with (
        undecided_of(name_of(source)),
        open_source(source, input_format, again=True, wiring=options.wired) as opened,
    ):
        options = options.with_facts(opened.facts(), opened.tables)
        run_source(opened, options, [sink], name=str(source), tell=tell)
    seen = sink.buses[only_bus(str(source), list(sink.buses), buses)]
    name = seen.protocol.name
    every, known = seen.likenesses(), BUSES.get(name)
    like = {who: one for who, one in every.items() if known is None or who in known.ids}
    if not like:
        raise InputError(f"{source}: no servo answers in it: there is nobody to be like")
    if lost := [str(w) for w in every if w not in like and seen.spoke(w)]:
        tell.warn(f"left out, for no {name} servo can have such an id: {', '.join(lost)}")
    tell.talk(known_registers(like))
    models: dict[int | None, str] = {**options.models}
    models.update((who, model) for who, model in seen.models.items() if who in like)
    for who, model in list(models.items()):
        if known is not None and model not in known.tables:
            tell.warn(f"the model {model} has no simulator: {next(iter(known.tables))} stands in")
            del models[who]
    return Scenario(
        name,
        servos=tuple(like),
        baud=seen.baud,
        respond=True,
        faults=tuple(Fault(DROP, s.missing, who) for who, s in like.items() if s.missing),
        models={who: model for who, model in models.items() if who is None or who in like},
        like=like,
    )
