"""What entities and states are called in a viewer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.registers import Register

ALL: Final = -1
"""The servo id of frames that name none; for protocols that say so, it means all servos."""


def entity_path(bus: str, servo: int, name: str, called: str | None) -> str:
    """Return where a servo's values stand: under its id, and what it is called."""
    import rerun as rr

    who = "all" if servo == ALL else str(servo) if called is None else f"{servo} {called}"
    who = who.replace(" ", "_")  # in a path the viewer shows a blank with a backslash
    return rr.new_entity_path([bus, "servo", who, *name.split("/")])


def named(register: Register, raw: int) -> str:
    """Return the name of a register's value."""
    return words(register.names(raw), raw)


def words(names: str | Sequence[str] | None, raw: int = 0) -> str:
    """Return a state's name as people read it."""
    if names == "unknown":
        return f"unknown ({raw})"
    if isinstance(names, str):
        return names.replace("_", " ")
    return ", ".join(names or ()).replace("_", " ") or "none"
