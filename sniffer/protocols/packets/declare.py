"""What a member of the packet family declares.

A packet is header, id, length, code, parameters and checksum, in one form both ways. What a field
of a command's parameters means is told by its name:

- ``address``, ``length``, ``option``: whole numbers of one byte or, the low byte first, of two;
- ``data``: the bytes up to the end, ``GreedyBytes``, or ``Bytes(this.length)`` where they are
  counted; in an answer ``AllBut(n)``, too;
- ``targets``: servos one after the other, each with ``servo_id``, and with ``address``, ``length``
  and ``data`` of its own where they are not all alike.

So a command with a ``length`` and without ``data`` reads, one with ``address`` and ``data`` writes.
Other names are fields without a meaning to anybody but the reader.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Protocol

import construct as c

from sniffer.ground.codes import IF_READ, NEVER
from sniffer.ground.model import DeclarationError
from sniffer.ground.registers import numbered
from sniffer.ground.wire import ByCode
from sniffer.protocols.packets.fields import bare, field_named, named, parsed

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sniffer.ground.model import I64, U8
    from sniffer.ground.registers import RegisterMap


LISTED: Final = 1 << 24
"""Token of a request that lists whom it reads, and of those that it lists and that answer with as
many bytes as it says: no length is as great."""


KEY: Final = 1 << 48
"""In a token: the command's code is part of it, from bit 40 on, and where the answer names it the
address, from bit 16 on."""

CODE_AT, ADDRESS_AT = 40, 16

ANY: Final = -1
"""Of ``answer``: as many data bytes as what is asked for has. No request says how many."""


@dataclass(frozen=True, slots=True)
class Command:
    """One command: the grammar of its parameters, who answers, and what it changes.

    - ``reply``, ``to_all``: whether one servo answers, and whether anybody does where all are
      meant: NEVER, OPTIONAL, IF_ALL, IF_READ, MUST or MANY.
    - ``each``: how far each servo that a request lists owes it an answer, in the same words.
    - ``effect`` joins STAGED (its values wait for another command), RELEASES (it is that one) and
      RESETS (the servo goes back to its defaults).
    - ``new_id``: (bits, id), the id that the servo has afterwards where one of these bits of
      ``option`` is set; bits 0: always.

    Its answer:

    - ``answer``: how many data bytes it has, where no ``length`` asks for them. ANY: as many as the
      register, which the request does not say; that wants ``answer_code`` or ``answer_header``.
      With a reply of NEVER the servo says it of its own accord.
    - ``feedback``: the grammar of its own behind the code; that wants one of the two as well.
    - ``repeats``: it is the same packet once more; that wants ``echoes``.
    - ``together``: one packet answers for all targets, each with error, id, data and, but for the
      last, a checksum.
    - ``later``: {"status": (2, 3)}, what a field of its feedback says in a further answer, which
      the servo sends of its own accord once it has done what was asked.

    Where the bytes stand in the table:

    - ``at``, where packets name no address: that of the parameters or, with ``answer``, of the
      answer; of ``targets`` each servo's bytes stand there.
    - ``answer_at``: that of the answer, where ``at`` is that of the parameters.
    - ``stride``, ``space``: an address that packets name is multiplied by the first (it counts
      registers) and added to the second (several spaces that all begin at 0).
    """

    name: str
    params: Any
    reply: int
    effect: int = 0
    new_id: tuple[int, int] | None = None
    to_all: int = NEVER
    each: int = IF_READ
    answer: int = 0
    together: bool = False
    at: int = -1
    answer_at: int = -1
    stride: int = 1
    space: int = 0
    repeats: bool = False
    feedback: Any = None
    later: Mapping[str, tuple[int, ...]] = field(default_factory=dict)

    @property
    def on_its_own(self) -> bool:
        """Whether its answer is one that nobody asks for: a motor sends it over and over."""
        return self.reply == NEVER == self.to_all and self.answer != 0


class Stuffing(Protocol):
    """How bytes that look like a header are kept out of the parameters."""

    def find(self, data: U8) -> I64:
        """Return the offsets, in order, at which stuffed bytes begin."""
        ...

    def plain(self, params: bytes) -> bytes:
        """Return the parameters as they were meant."""
        ...


@dataclass(frozen=True, kw_only=True)
class PacketFamily:
    """A protocol of the family.

    ``packet`` is the grammar of all packets, a Struct of header, ``body`` and ``checksum``, or a
    ``Packet`` whose checks stand where they like. It names ``servo_id``, a length, ``code``, and
    the parameters, which it may call as the manual does. Without an id all is shown under
    ``sole_id``. Without a length all packets are as long; with ``Bytes(BY_CODE)`` in a ``Packet``
    they are as long as their command's parameters. ``most``: the greatest length that is believed.

    ``feedback`` is the grammar of a response: ``error`` (FlagsEnum or Enum) and ``data``. What
    tells a response is one of these:

    - ``feedback`` begins with a constant: that code is a response, all others are commands.
    - ``answer_code``, as ``lambda code: code + 0x40``: the code of the answer to each command, None
      where nothing tells one. ``feedback`` is then that of the parameters only, and a command may
      have its own. One that names ``address`` or ``length`` fits no other request.
    - ``answer_header``: answers are the same packets with that header and, unless ``answer_code``
      says otherwise, the code of their request.
    - ``echoes``: an answer has the code of its request, and as many bytes as ``answer`` says, which
      its request has not. All of these bytes are ``data``.
    - None of them: the error stands in the place of the code. Codes from ``certain`` on are
      commands. Any other is one where it fits as one (``begins``: where it begins as one), unless
      the request before it awaits just that many bytes; the same bytes once more are the same
      request. ``doubt``: a response with data that fits as a command, too, is marked (UNUSUAL), and
      states no values.

    Ids: all servos obey ``silent`` ones and none answers; each answers ``anyone`` under its own.
    Errors: ``refusals`` are the bits that say that it was not done; ``alerts`` are bits, by name,
    that are no error beside an Enum of those; ``reports`` say what names of the manual mean that
    anomalies have others for. Time: an answer takes ``window_ns`` at most, and
    nothing crosses a silence longer than ``tail_ns``. While others are asked, it comes within
    ``reach`` bytes, or those of the longest packet. ``words`` are what the manual calls a code that
    asks, what stands in its place in an answer, and a response: by default ("instruction", "error",
    "status") where the error stands there, ("instruction", "instruction", "status") where a
    constant does, and ("command", "command", "answer") where the code of the request does, or
    what follows from that.
    """

    name: str
    title: str
    bauds: tuple[int, ...]
    baud: int
    packet: Any
    commands: Mapping[int, Command]
    feedback: Any
    models: tuple[RegisterMap, ...]
    window_ns: int
    tail_ns: int = 100_000_000
    certain: int = 256
    begins: bool = False
    doubt: bool = False
    echoes: bool = False
    answer_code: Callable[[int], int | None] | None = None
    answer_header: bytes = b""
    sole_id: int | None = None
    reach: int = 256
    most: int = 255
    silent: tuple[int, ...] = ()
    anyone: tuple[int, ...] = ()
    refusals: int = 0
    alerts: Mapping[int, str] = field(default_factory=dict)
    reports: Mapping[str, str] = field(default_factory=dict)
    words: tuple[str, str, str] | None = None
    stuffing: Stuffing | None = None

    def __post_init__(self) -> None:
        """Number the registers of all models through.

        Raises:
            DeclarationError: a request could be taken for its answer.
        """
        object.__setattr__(self, "models", numbered(self.models))
        object.__setattr__(self, "packet", self._sized(self.packet, answers=False))
        for command in self.commands.values() if self.echoes else ():
            count = max(command.answer, 0)
            if count and parsed(command.params, bytes(count)) is not None:
                raise DeclarationError(
                    f"{self.name}: {command.name} may have {command.answer} parameters, as its "
                    "answer has: with echoes=True their count must tell request from answer"
                )

    @property
    def everyone(self) -> tuple[int, ...]:
        """The ids that address all servos."""
        return tuple(sorted((*self.anyone, *self.silent)))

    @functools.cached_property
    def answers(self) -> int | None:
        """The one code of all responses, None where the error stands in its place."""
        if self.answer_code is not None or self.answer_header:
            return None
        first = bare(self.feedback.subcons[0])
        return first.value[0] if isinstance(first, c.Const) else None

    @functools.cached_property
    def terms(self) -> tuple[str, str, str]:
        """What a code that asks is called, what stands in its place in an answer, a response."""
        if self.words is not None:
            return self.words
        if self.echoes or self.answer_code is not None or self.answer_header:
            return "command", "command", "answer"
        return "instruction", "error" if self.answers is None else "instruction", "status"

    @functools.cached_property
    def asked_by(self) -> dict[int, int]:
        """Code of an answer -> that of its command, where the one follows from the other."""
        if self.answer_code is None:
            return {code: code for code in self.commands} if self.answer_header else {}
        told = {k: self.answer_code(k) for k in self.commands}
        return {answer: code for code, answer in told.items() if answer is not None}

    @functools.cached_property
    def tells_more(self) -> bool:
        """Whether an answer is more than a constant code, an error and data, in that order."""
        if self.answers is None:
            return self.answer_code is not None or bool(self.answer_header)
        names = [name for name, _ in named(self.feedback)]
        rest = [name for name in names if name != bare(self.feedback).subcons[0].name]
        return (
            rest != ["error", "data"]
            or bare(field_named(self.feedback, "data")) is not c.GreedyBytes
        )

    def feedback_of(self, code: int) -> Any:
        """Return the grammar of what the answer to a command has for parameters."""
        if self.answers is not None:  # the constant in front is the code
            return c.Struct(*self.feedback.subcons[1:])
        command = self.commands.get(code)
        own = None if command is None else command.feedback
        return self.feedback if own is None else own

    @functools.cached_property
    def answering(self) -> Any:
        """The grammar of an answer where it has a header of its own."""
        header, *rest = self.packet.subcons
        own = c.Renamed(c.Const(self.answer_header), header.name)
        return self._sized(type(bare(self.packet))(own, *rest), answers=True)

    def _sized(self, packet: Any, *, answers: bool) -> Any:
        """Return the grammar of packets with the sizes of commands, or of answers, by their codes.

        Raises:
            DeclarationError: one has no size of its own.
        """
        fields = getattr(bare(packet), "subcons", ())
        if not any(isinstance(getattr(bare(f), "length", None), ByCode) for f in fields):
            return packet
        sizes = {} if answers else {code: self._size_of(k) for code, k in self._asking()}
        if answers or not self.answer_header:
            sizes |= {code: self._size_of(k, back=True) for code, k in self._answering()}
        own = [
            c.Renamed(c.Bytes(ByCode(sizes)), f.name)
            if isinstance(getattr(bare(f), "length", None), ByCode)
            else f
            for f in fields
        ]
        return type(bare(packet))(*own)

    def _asking(self) -> list[tuple[int, Command]]:
        return [(k, v) for k, v in self.commands.items() if isinstance(v, Command)]

    def _answering(self) -> list[tuple[int, Command]]:
        asked = [(code, self.commands[k]) for code, k in self.asked_by.items()]
        return [
            (code, k) for code, k in asked if k.on_its_own or (k.reply, k.to_all) != (NEVER, NEVER)
        ]

    def _size_of(self, command: Command, *, back: bool = False) -> int:
        """Return how many bytes the parameters of a command, or of its answer, have."""
        grammar = (command.feedback or self.feedback) if back else command.params
        takes = [f for f in grammar.subcons if bare(f) is not c.Terminated]
        counted = max(command.answer, 0) if back else 0
        if counted:  # the data are as many as the command says, whatever stands beside them
            takes = [f for f in takes if f.name != "data"]
        try:
            beside: int = sum(f.sizeof() for f in takes)  # of a Check it is 0
            return counted + beside
        except c.SizeofError:
            what = "its answer: say answer=, or a feedback" if back else "it: say parameters"
            raise DeclarationError(
                f"{self.name}: command {command.name}: BY_CODE wants one size of {what} without "
                "bytes of any number"
            ) from None

    def is_answer(self, raw: bytes) -> bool:
        """Tell whether a packet has the header of answers."""
        return bool(self.answer_header) and raw.startswith(self.answer_header)

    def packet_of(self, raw: bytes) -> Any:
        """Return the grammar of a packet, by its header."""
        return self.answering if self.is_answer(raw) else self.packet

    def body_of(self, raw: bytes) -> Any:
        """Return the fields of a packet."""
        fields = self.packet_of(raw).parse(raw)
        return fields.body.value if "body" in fields else fields

    @functools.cached_property
    def tail(self) -> str:
        """What the packet's grammar calls the parameters."""
        found = [name for name, con in named(self.packet) if isinstance(con, c.Bytes)]
        return found[-1]

    def plain(self, params: bytes, servo_id: int, code: int) -> bytes:
        """Return the parameters of a packet as they were meant.

        What answers for several servos is read by place: no stuffing is taken out of it.
        """
        together = any(command.together for command in self.commands.values())
        joint = together and code == self.answers and servo_id in self.silent
        return params if self.stuffing is None or joint else self.stuffing.plain(params)

    def effective(self, effect: str) -> int:
        """Return the address of the register with that effect, -1 where there is none.

        A model that does not name it is taken to have it where its siblings do.

        Raises:
            DeclarationError: the models do not agree on it.
        """
        found = {r.address for m in self.models for r in m.registers if r.effect == effect}
        if len(found) > 1:
            where = ", ".join(f"0x{address:02X}" for address in sorted(found))
            raise DeclarationError(
                f"{self.name}: models differ in where the {effect} stands: {where}"
            )
        return found.pop() if found else -1
