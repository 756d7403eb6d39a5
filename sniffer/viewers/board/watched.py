"""A filter of the board: which servos and which anomalies are shown, by what is selected of them.

A servo is shown from the moment on at which something of it is selected: a request to it, an
answer, a value, an anomaly. What was before the filter is not looked through again.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

from sniffer.anomalies.found import Anomalies
from sniffer.decoding.called import ServoNames
from sniffer.decoding.narrowing import meant
from sniffer.ground.limits import IDS, number_in
from sniffer.ground.model import InputError
from sniffer.selection.selection import Selection
from sniffer.viewers.board.troubles import Troubles

if TYPE_CHECKING:
    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol

WORDS: Final = {"servo": "servos", "op": "ops", "kind": "kinds", "code": "codes", "bus": "buses"}
"""The words of a filter line, and the shorthand that each stands for."""

_WORD: Final = re.compile(r"([a-z]+)=([^\s'()=]+)")


def selection_in(text: str, names: ServoNames | None = None) -> Selection | None:
    """Read a filter line: words (``servo=3,5 code=no-response``) or an expression; None: empty.

    Servos may be told by their ``names``.

    Raises:
        InputError: it is neither.
    """
    words = [_WORD.fullmatch(word) for word in text.split()]
    if not words:
        return None
    told: dict[str, Any] = {}
    for word in words:
        if word is None or word[1] not in WORDS:
            return Selection.parse(text).named(names or ServoNames())
        said = [name for name in word[2].split(",") if name]
        who = [_who(name, names or ServoNames()) for name in said] if word[1] == "servo" else said
        told.setdefault(WORDS[word[1]], []).extend(who)
    return Selection.of(**told, names=names or ServoNames())


def _who(name: str, names: ServoNames) -> int | str:
    """Return an id, or a name where servos have names."""
    servo = number_in(name, 0, IDS - 1)
    if servo is None and not names:
        raise InputError(f"servo {name[:20]!r} is no id: write servo=3,5")
    return name if servo is None else servo


class Watched:
    """What a selection has shown of all buses since it was asked for."""

    def __init__(self, selection: Selection) -> None:
        self.selection = selection
        self.servos: set[tuple[str, int]] = set()
        """By the bus's name on the board, and id."""
        self.troubles = Troubles()

    def add(self, name: str, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take a batch; ``name`` is what the board calls the bus."""
        shown = self.selection.rows(bus, protocol, batch)
        found = shown("anomalies")
        ids = set(batch.frames.servo_id[meant(batch, shown)].tolist())
        ids.update(batch.values.servo_id[shown("samples")].tolist())
        if found.any():
            rows = found.nonzero()[0]
            ids.update(Anomalies.of(batch.anomalies).servo_id[rows].tolist())
            self.troubles.add(name, [batch.anomalies[i] for i in rows.tolist()])
        self.servos.update((name, servo) for servo in ids if servo >= 0)
