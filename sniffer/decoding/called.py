"""What people call servos: told or recorded as a value, and laid over ids where a person reads.

Records hold ids, as the wire does, and so do the sentences that are made of them: what programs
read does not depend on who named what. A name is laid over an id when something is shown.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.limits import IDS, OF_BUS, number_in
from sniffer.ground.model import Anomaly, InputError
from sniffer.ground.wording import Sentence, and_, nearly
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

Named = int | tuple[str, int]
"""A servo that has a name: its id on whatever bus, or bus and id."""

NAME: Final = "name."
"""Facts ``name.3``, or ``name.<bus>.3`` where a bus was said: what people call a servo."""

SERVO_NAME: Final = "servo_name"
"""Key, or column, of a servo's name in what programs read; there only where names are known."""

NAME_MOST: Final = 32
"""Signs of a name: more are cut off in a legend."""

_ONE: Final = re.compile(r"\b(servo )(\d{1,3})\b")
_IDS: Final = r"\d{1,3}\b(?:-\d{1,3}\b)?"
_SEVERAL: Final = re.compile(rf"\b(servos )({_IDS}(?:, {_IDS})*(?: and {_IDS}(?! more| other))?)")
"""How sentences say who is meant: ``servo 3``, ``servos 1, 2 and 6-10``."""


class ServoNames:
    """What servos are called; without any, every text stays as it is.

    A name that was said of a bus is that of no other bus, and wins over one of all buses.
    """

    def __init__(self, told: Mapping[Named, str] | None = None) -> None:
        self._told = dict(told or {})

    def __bool__(self) -> bool:
        return bool(self._told)

    def of(self, bus: str, servo: int) -> str | None:
        """Return what a servo is called, None where it has no name.

        ``bus`` may be what one protocol of two says on it: ``arm.lss``.
        """
        if not self._told:
            return None
        name = self._told.get((bus, servo))
        if name is None and "." in bus:
            wire, _, part = bus.rpartition(".")
            name = self._told.get((wire, servo)) if part in PROTOCOLS else None
        return self._told.get(servo) if name is None else name

    @property
    def known(self) -> list[str]:
        """All names, each once."""
        return list(dict.fromkeys(self._told.values()))

    def on_bus(self, bus: str) -> dict[int, str]:
        """Return the names of a bus by id."""
        ids = sorted({who if isinstance(who, int) else who[1] for who in self._told})
        named = ((servo, self.of(bus, servo)) for servo in ids)
        return {servo: name for servo, name in named if name is not None}

    def ids(self, bus: str, name: str) -> list[int]:
        """Return the ids of the servos of a bus that are called so, or are ``arm:3`` there."""
        if (one := self._of_bus(name)) is not None:
            return [one[1]] if one[0] == bus else []
        return [servo for servo, known in self.on_bus(bus).items() if known == name]

    def _of_bus(self, text: str) -> tuple[str, int] | None:
        """Return bus and id where ``arm:3`` was written, and no servo is called so."""
        one = None if text in self._told.values() else named_in(text, OF_BUS)
        return one if isinstance(one, tuple) else None

    def label(self, bus: str, servo: int) -> str:
        """Return a servo's id with its name, for a cell of a table: ``3 left_knee``."""
        name = self.of(bus, servo)
        return str(servo) if name is None else f"{servo} {name}"

    def servo(self, bus: str, servo: int) -> str:
        """Return a servo in words: ``servo 3 left_knee``."""
        return f"servo {self.label(bus, servo)}"

    def legend(self, bus: str, servo: int) -> str:
        """Return a servo's name first, where long texts are cut: ``left_knee (3)``."""
        name = self.of(bus, servo)
        return f"servo {servo}" if name is None else f"{name} ({servo})"

    def beside(self, bus: str, row: Mapping[str, Any]) -> dict[str, Any]:
        """Return a record with ``servo_name`` behind its ``servo_id``, where that has a name."""
        servo = row["servo_id"]
        name = None if servo is None else self.of(bus, servo)
        if name is None:
            return dict(row)
        out: dict[str, Any] = {}
        for key, value in row.items():
            out |= {key: value, SERVO_NAME: name} if key == "servo_id" else {key: value}
        return out

    def sentence(self, bus: str, text: str) -> str:
        """Return a sentence about a bus with the names of the servos that it speaks of."""
        if not self._told:
            return text

        def named(match: re.Match[str]) -> str:
            return match[1] + re.sub(_IDS, lambda ids: self._each(bus, ids[0]), match[2])

        return _SEVERAL.sub(named, _ONE.sub(named, text))

    def _each(self, bus: str, ids: str) -> str:
        """Return ``3`` or ``6-10`` with names; a range with a name in it is told one by one."""
        first, _, last = ids.partition("-")
        every = range(int(first), int(last or first) + 1)
        if last and not any(self.of(bus, servo) for servo in every):
            return ids
        return ", ".join(self.label(bus, servo) for servo in every)

    def on(self, bus: str, anomaly: Anomaly) -> Anomaly:
        """Return an anomaly of a bus whose sentences have the names of servos."""
        if not self._told:
            return anomaly
        detail, remedy = (self.sentence(bus, t) for t in (anomaly.detail, anomaly.remedy))
        return anomaly._replace(detail=detail, remedy=remedy)

    def having(self, name: str) -> list[tuple[Named, list[str]]]:
        """Return the servos of a name as they were told, with the buses that call theirs otherwise.

        The name may be a bus and an id: ``arm:3``.

        Raises:
            InputError: none is called so; it says which name is near.
        """
        if (why := self.nobody(name)) is not None:
            if not self._told:
                why = "{name} is no servo id: write ids as 3,5 or 3-6 (no names are known)"
            raise InputError(Sentence(f"{{servos}}: {why}", name=repr(name[:40])))
        if (one := self._of_bus(name)) is not None:
            return [(one, [])]
        return [(who, self._others(who)) for who, known in self._told.items() if known == name]

    def nobody(self, name: str) -> str | None:
        """Return in a sentence that no servo is called so; None: one is, or ``arm:3`` is meant."""
        if name in self._told.values() or self._of_bus(name) is not None:
            return None
        known = f": one of {', '.join(self.known)}" if self._told else ": no names are known"
        return f"no servo is called {name[:40]!r}{nearly(name, self.known) or known}"

    def _others(self, who: Named) -> list[str]:
        """Return the buses on which a servo that was named on all has another name."""
        return [w[0] for w in self._told if isinstance(w, tuple) and w[1] == who]

    def astray(self, buses: Iterable[str], recorded: Mapping[Named, str]) -> str | None:
        """Return a sentence on names that were told of buses which are not there; None: none was.

        Those that a recording has may be of buses that somebody left out of it.
        """
        known = list(buses)
        said = [who[0] for who in self._told if isinstance(who, tuple) and who not in recorded]
        lost = [bus for bus in dict.fromkeys(said) if bus not in known]
        if not lost:
            return None
        near = nearly(lost[0], known) or f": one of {', '.join(known)}"
        return f"names were told of {and_(lost)}, but no bus is called so{near}"


def is_name(text: str) -> bool:
    """Tell whether a servo can be called so: in a legend, in a path, in a line of text."""
    return 0 < len(text) <= NAME_MOST and text == text.strip() and text.isprintable()


def named_in(text: str, mark: str) -> Named | None:
    """Return the servo that ``3`` or, with ``:`` as the mark, ``arm:3`` stands for; None: none."""
    bus, parted, servo = text.rpartition(mark)
    number = number_in(servo, 0, IDS - 1)
    if number is None or (parted and not bus):
        return None
    return (bus, number) if parted else number


def names_in(facts: Mapping[str, str]) -> dict[Named, str]:
    """Return what a recording calls its servos; what cannot be is left out."""
    told = {k.removeprefix(NAME): v for k, v in facts.items() if k.startswith(NAME)}
    found = ((named_in(who, "."), name) for who, name in told.items())
    return {who: name for who, name in found if who is not None and is_name(name)}


def name_facts(names: Mapping[Named, str]) -> dict[str, str]:
    """Return what a recording says of the names of its servos."""
    return {
        f"{NAME}{who}" if isinstance(who, int) else f"{NAME}{who[0]}.{who[1]}": name
        for who, name in names.items()
    }


def overlaid(recorded: Mapping[Named, str], told: Mapping[Named, str]) -> dict[Named, str]:
    """Return the names of a recording with those that are told now, which win."""

    def is_told(who: Named) -> bool:
        return who in told or (isinstance(who, tuple) and who[1] in told)

    return {**{who: name for who, name in recorded.items() if not is_told(who)}, **told}
