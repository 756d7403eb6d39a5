"""Numbers that stand in columns, with their names.

Columns hold plain integers, and are compared with the constants: an ``IntEnum``'s member would make
numpy widen a column of bytes to 64 bits, and take seven times as long. Who has one number and wants
its name takes the enumeration.
"""

from __future__ import annotations

import enum
from typing import Final


class Kind(enum.IntEnum):
    """``Frames.kind``: who speaks."""

    REQUEST = 0
    RESPONSE = 1


class Reply(enum.IntEnum):
    """``Frames.reply``: is this request answered?"""

    NEVER = 0
    OPTIONAL = 1  # nobody can say
    IF_ALL = 2  # only where the servo answers every command (a mode it can be put in)
    IF_READ = 3  # unless the servo answers nothing
    MUST = 4
    MANY = 5  # every servo on the bus may answer, one after the other


class Outcome(enum.IntEnum):
    """``Transactions.outcome``: what became of a request, or of an answer nobody asked for."""

    OK = 0
    NO_RESPONSE = 1
    NOT_EXPECTED = 2
    MISMATCHED = 3
    UNSOLICITED = 4
    DAMAGED = 5


class Role(enum.IntEnum):
    """Of a register: what its value is to a servo."""

    COMMANDED = 0
    MEASURED = 1
    CONFIG = 2


class Provenance(enum.IntEnum):
    """``Samples.provenance``: where a scale comes from."""

    ASSUMED = 0
    PROFILE = 1
    OBSERVED = 2


def _names(kind: type[enum.IntEnum]) -> tuple[str, ...]:
    return tuple(member.name.lower() for member in kind)


KINDS: Final = _names(Kind)
OUTCOMES: Final = _names(Outcome)
ROLES: Final = _names(Role)
PROVENANCES: Final = _names(Provenance)
"""The names that outputs write, by number."""

REQUEST: Final = Kind.REQUEST.value
RESPONSE: Final = Kind.RESPONSE.value
NEVER: Final = Reply.NEVER.value
OPTIONAL: Final = Reply.OPTIONAL.value
IF_ALL: Final = Reply.IF_ALL.value
IF_READ: Final = Reply.IF_READ.value
MUST: Final = Reply.MUST.value
MANY: Final = Reply.MANY.value
OK: Final = Outcome.OK.value
NO_RESPONSE: Final = Outcome.NO_RESPONSE.value
NOT_EXPECTED: Final = Outcome.NOT_EXPECTED.value
MISMATCHED: Final = Outcome.MISMATCHED.value
UNSOLICITED: Final = Outcome.UNSOLICITED.value
DAMAGED: Final = Outcome.DAMAGED.value
COMMANDED: Final = Role.COMMANDED.value
MEASURED: Final = Role.MEASURED.value
CONFIG: Final = Role.CONFIG.value
ASSUMED: Final = Provenance.ASSUMED.value
PROFILE: Final = Provenance.PROFILE.value
OBSERVED: Final = Provenance.OBSERVED.value

ON_ITS_OWN: Final = -2
"""``Frames.token`` of an answer that a servo sends of its own accord, once what it was asked for is
done: it answers no request that is open, and is no second answer either."""

# Samples.part: how much of the register the packet carried
WHOLE: Final = 0
PARTS: Final = ("", "low byte", "high byte", "part")
