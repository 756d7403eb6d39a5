"""Whether a declaration has the form of the family, told to its author when the protocol is made.

What is amiss here would otherwise be told later, and by something else.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

import construct as c

from sniffer.protocols.packets.declare import bare, field_named
from sniffer.protocols.packets.walk import Shape, shape_of

if TYPE_CHECKING:
    from sniffer.protocols.packets.declare import PacketFamily


def check_form(family: PacketFamily) -> None:
    """Check the names by which the packet's and the answer's fields are known.

    Raises:
        TypeError: one is missing; it says what to write.
    """
    own = {sub.name: bare(sub) for sub in getattr(bare(family.packet), "subcons", ())}
    if not isinstance(own.get("body"), c.RawCopy):
        _refuse(family, 'packet needs "body" / RawCopy(Struct(...)) of what the checksum covers')
    checksum = own.get("checksum")
    if not isinstance(checksum, c.Checksum):
        _refuse(family, 'packet needs "checksum" / Checksum(...) behind its body')
    if not hasattr(checksum.hashfunc, "good"):
        _refuse(
            family,
            "the checksum needs a form for columns, too: take one of sniffer.ground.checksums, "
            "or write a class as its Sum",
        )
    for name in ("servo_id", "code"):
        if not isinstance(field_named(family.packet, name), c.FormatField):
            _refuse(family, f"packet needs a field of one byte that is named {name}")
    if field_named(family.feedback, "data") is None:
        _refuse(family, 'feedback needs "data" / GreedyBytes at its end')
    if not family.echoes and field_named(family.feedback, "error") is None:
        _refuse(
            family,
            "feedback needs a field named error, in the place of the code or, behind a constant "
            "code, as the first parameter",
        )


def shapes_of(family: PacketFamily) -> dict[int, Shape]:
    """Return the shapes of all commands, by code.

    Raises:
        TypeError: one has none; it says which, and what there are.
    """
    out = {}
    for code, command in family.commands.items():
        try:
            out[code] = shape_of(command.params)
        except TypeError as error:
            _refuse(family, f"command {command.name}: {error}")
    return out


def _refuse(family: PacketFamily, why: str) -> NoReturn:
    raise TypeError(f"{family.name}: {why}")
