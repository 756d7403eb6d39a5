"""``sniffer.registers_held``: what registers held; what ``sniffer state FILE`` calls."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sniffer.decoding.called import SERVO_NAME
from sniffer.ground.codes import ROLES
from sniffer.jobs.through import hear_part
from sniffer.sources.several import name_of
from sniffer.statistics.held import HeldRegister, RegisterBook, StatedValue

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sniffer.decoding.called import ServoNames
    from sniffer.decoding.options import Options
    from sniffer.decoding.summary import Summary
    from sniffer.jobs.session import Ending, Patience
    from sniffer.jobs.telling import Teller
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection


@dataclass(frozen=True, slots=True)
class HeldRegisters:
    """What was said of each register of each servo, and how the reading ended.

    ``began_ns`` is when the capture began, of each bus with a clock. ``summary`` has the totals of
    all of the capture, and what was asked for where that is not all.
    """

    source: str
    registers: list[HeldRegister]
    began_ns: dict[str, int]
    ending: Ending
    summary: Summary

    def as_dicts(self) -> list[dict[str, Any]]:
        """Return a record a register, as ``schemas/state.schema.json`` has it."""
        return [_as_dict(self.source, held, self.summary.names) for held in self.registers]


def registers_held(
    source: str | Path | Sequence[str | Path],
    options: Options | None = None,
    *,
    input_format: str = "auto",
    window: Window | None = None,
    selection: Selection | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> HeldRegisters:
    """Say what each register of each servo held: what was first and last read or written of it.

    Arguments as of ``sniffer.stats``; of a part, what was said in it.

    Raises:
        InputError: the input cannot be read, its protocol cannot be told, or the window is empty.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    book = RegisterBook()
    done = hear_part(
        source,
        book,
        options,
        input_format=input_format,
        window=window,
        selection=selection,
        patience=patience,
        tell=tell,
    )
    began_ns = dict.fromkeys(sorted(book.clocked), done.summary.began_ns or 0)
    return HeldRegisters(name_of(source), book.held(), began_ns, done.ending, done.summary)


def _as_dict(source: str, held: HeldRegister, names: ServoNames) -> dict[str, Any]:
    r = held.register
    name = names.of(held.bus, held.servo_id)
    return {
        "source": source,
        "bus": held.bus,
        "protocol": held.protocol.name,
        "servo_id": held.servo_id,
        **({SERVO_NAME: name} if name is not None else {}),
        "register": r.name,
        "address": r.address if r.address >= 0 else None,
        "role": ROLES[r.role],
        "unit": r.unit,
        "count": held.count,
        "reads": held.reads,
        "writes": held.writes,
        "changes": held.changes,
        "first": _said(held, held.first),
        "last": _said(held, held.last),
    }


def _said(held: HeldRegister, said: StatedValue) -> dict[str, Any]:
    return {
        "raw": said.raw,
        "value": None if math.isnan(said.value) else round(said.value, 9),
        "named": held.register.names(said.raw),
        "t_ns": said.t_ns,
        "offset": said.offset,
        "by": "write" if said.is_written else "read",
    }
