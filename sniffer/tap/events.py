"""What the reader tells of its ports: what came, what went wrong, what was changed."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from sniffer.ports import Counters, Port


class Read(NamedTuple):
    """Raw bytes of one read, at the time of its end.

    ``held_ns`` is how long they may have been there already because nobody looked; 0: not worth a
    word.
    """

    port: int
    t_ns: int
    data: bytes
    held_ns: int = 0


class Lost(NamedTuple):
    """The port went away."""

    port: int
    t_ns: int


class Back(NamedTuple):
    """The port was opened again, as another object."""

    port: int
    t_ns: int
    opened: Port


class Retuned(NamedTuple):
    """The port listens at another rate from here on; ``done``: unless it cannot."""

    port: int
    t_ns: int
    baud: int
    done: bool


class Counted(NamedTuple):
    """The driver's counters have risen."""

    port: int
    t_ns: int
    now: Counters
    before: Counters


Event = Read | Lost | Back | Retuned | Counted
