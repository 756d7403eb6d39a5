"""``sniffer.discover``: what bytes that no table names may be; what ``sniffer discover`` calls."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sniffer.ground.model import InputError
from sniffer.ground.wording import plain
from sniffer.jobs.through import hear_part
from sniffer.sources.several import name_of
from sniffer.statistics.bytewise import Bytewise
from sniffer.statistics.guesses import guesses, model_of
from sniffer.statistics.stub import stub

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.options import Options
    from sniffer.decoding.summary import Summary
    from sniffer.ground.registers import RegisterMap
    from sniffer.jobs.session import Ending, Patience
    from sniffer.jobs.telling import Teller
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection
    from sniffer.statistics.guesses import FieldGuess


@dataclass(frozen=True, slots=True)
class Discovered:
    """What was found on each bus, by its name, and how the reading ended.

    ``tables`` are those by which the servos are read, by bus and servo. ``summary`` has the totals
    of all of the capture, and what was asked for where that is not all.
    """

    source: str
    found: dict[str, list[FieldGuess]]
    tables: dict[tuple[str, int], RegisterMap]
    ending: Ending
    summary: Summary

    def stub(self, model: str) -> str:
        """Return a register table with what was found, of the model that most of it is of.

        Raises:
            InputError: nothing was found.
        """
        by_table: dict[str, list[FieldGuess]] = {}
        bases: dict[str, RegisterMap] = {}
        for bus, each in self.found.items():
            for guess in each:
                base = self.tables[bus, guess.servo_id]
                bases[base.model] = base
                by_table.setdefault(base.model, []).append(guess)
        if not by_table:
            raise InputError("a table names every byte that was read or written: there is no stub")
        name = max(by_table, key=lambda base: len(by_table[base]))
        source = plain(Path(self.source).name).replace('"', "'").replace("\\", "/")
        return stub(bases[name], by_table[name], model, source)


def discover(
    source: str | Path | Sequence[str | Path],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    window: Window | None = None,
    selection: Selection | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Discovered:
    """Say of the bytes that no register table names what they do, and what they go with.

    Arguments as of ``sniffer.stats``. Of a selection the bytes of its frames are followed; what
    they go with is looked for among all values.

    Raises:
        InputError: the input cannot be read, its frames carry no addresses, or the selected ones
            read and write nothing.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    sink = Bytewise()
    done = hear_part(
        source,
        sink,
        options,
        input_format=input_format,
        window=window,
        selection=selection,
        patience=patience,
        tell=tell,
    )
    lanes = {name: lane for name, lane in sink.lanes.items() if lane.has_addresses}
    if not lanes:
        spoken = ", ".join(dict.fromkeys(lane.protocol.name for lane in sink.lanes.values()))
        raise InputError(
            f"frames of {spoken} carry no addresses here: there is nothing to discover"
        )
    if selection is not None and not any(lane.spans for lane in lanes.values()):
        raise InputError(f"{selection.text}: no byte of a register is in the frames it selects")
    found = {name: guesses(lane) for name, lane in lanes.items()}
    tables = {
        (name, guess.servo_id): model_of(lanes[name], guess.servo_id)
        for name, each in found.items()
        for guess in each
    }
    return Discovered(name_of(source), found, tables, done.ending, done.summary)
