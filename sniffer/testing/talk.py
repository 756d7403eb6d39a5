"""What the author of a protocol brings: exchanges, each with what it truly says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from sniffer.ground.model import SnifferError

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

Label = str | tuple[int, str]
Labels = Mapping[str, int] | Mapping[tuple[int, str], int] | Mapping[Label, int]
"""Three of the same, since the keys of a mapping have one type."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """One request, what answers it, and what the two say: the truth, whatever a decoder thinks.

    Args:
        name: the command, as ``op_name`` has it.
        request: its bytes.
        answers: the bytes of each answer, in order; none where nobody answers. None: what a servo
            does with this request is documented nowhere, so no answer is right and none wrong.
        values: raw values by register, all that become true with this exchange: a name stands for
            the servo asked, ``(servo, name)`` for another one. None: not labelled.
        errors: what the answers report, as ``status_names`` has it. None: not labelled.
        later: what the servo says once more when the thing is done, unasked: frames that answer no
            request, whatever they stand behind.
        later_values: raw values that these state, as ``values``. None: not labelled.
        due: whether silence is a fault, whatever the servo was told before. Else it may be one.
        listed: the servos that the request lists, each of which owes an answer of its own, in the
            order in which they are to answer. None: those that the protocol finds in it.
    """

    name: str
    request: bytes
    answers: tuple[bytes, ...] | None = ()
    values: Labels | None = None
    errors: tuple[str, ...] | None = None
    later: tuple[bytes, ...] = ()
    later_values: Labels | None = None
    due: bool = False
    listed: tuple[int, ...] | None = None

    @property
    def owing(self) -> tuple[int, ...]:
        """Whose answers are missed one by one, in order; -1: nothing tells whose."""
        listed = self.listed or (-1,)
        told = len(self.replies) in (0, len(listed)) or self.is_joint
        return listed if told else (-1,) * len(listed)

    @property
    def is_joint(self) -> bool:
        """Whether one packet answers for all that are listed."""
        return len(self.replies) == 1 < len(self.listed or ())

    @property
    def replies(self) -> tuple[bytes, ...]:
        """The answers, none where nobody knows of any."""
        return self.answers or ()

    @property
    def data(self) -> bytes:
        """Request and answers, joined."""
        return self.request + b"".join(self.replies)

    @property
    def said(self) -> bytes:
        """All of it, with what comes once more when it is done."""
        return self.data + b"".join(self.later)

    @property
    def done(self) -> Exchange:
        """The exchange once the thing is done: what is said then is true, too."""
        values: dict[Label, int] | None = None
        if self.values is not None and self.later_values is not None:
            values = dict(pair for x in (self.values, self.later_values) for pair in x.items())
        return replace(self, values=values, errors=None)


@dataclass(frozen=True, slots=True)
class Talk:
    """All that is said to a protocol in its tests.

    Args:
        exchanges: each stands for itself; the kit arranges them.
        scenes: exchanges that only make sense in their order (staged, then released), played as
            they are. In a scene an exchange without answers is one that nobody expects answered.
        commands: the names of all commands, for a protocol that does not declare them.
        ambiguous: by ``"arrangement: command"`` (or a pattern of it) how many cases the wire leaves
            undecided, so that what is decoded need not be the label. More or less is an error.
        absent: what coverage asks for and this protocol cannot have, with the reason: the names
            of goals, or patterns of them (``*``, ``?``). What is there after all is an error.
        harmless: planted faults that change nothing in this protocol, with the reason.
        model: the register table by which ``values`` are labelled; the default one where empty.
    """

    exchanges: Sequence[Exchange]
    scenes: Sequence[Sequence[Exchange]] = ()
    commands: Sequence[str] = ()
    ambiguous: Mapping[str, int] = field(default_factory=dict)
    absent: Mapping[str, str] = field(default_factory=dict)
    harmless: Mapping[str, str] = field(default_factory=dict)
    model: str = ""


def talk_of(given: Talk | Iterable[Exchange]) -> Talk:
    """Return what was given as a talk.

    Raises:
        SnifferError: there is nothing in it, or something that is no exchange.
    """
    talk = given if isinstance(given, Talk) else Talk(tuple(given))
    every = [*talk.exchanges, *(e for scene in talk.scenes for e in scene)]
    if not talk.exchanges:
        raise SnifferError("a talk has at least one exchange")
    for e in every:
        if not isinstance(e, Exchange):
            raise SnifferError(f"a talk is made of exchanges, not of {e!r:.40}")
        if not e.request or not all((*e.replies, *e.later)):
            raise SnifferError(f"{e.name}: a request and each answer have at least one byte")
    return talk
