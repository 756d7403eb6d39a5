"""Whether a declaration has the form of the family, told to its author when the protocol is made.

What is amiss here would otherwise be told later, and by something else. Each mistake ends in one
sentence that names the declaration and says what to write.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NoReturn

import construct as c

from sniffer.ground.codes import IF_ALL, IF_READ, MANY, MUST, NEVER, OPTIONAL
from sniffer.ground.model import DeclarationError
from sniffer.ground.plan import asked_by, plan_of
from sniffer.ground.wire import Packet
from sniffer.protocols.packets.declare import ANY, Command
from sniffer.protocols.packets.fields import bare, field_named, flag_bits, numbers, unnamed
from sniffer.protocols.packets.told import ToldAnswers
from sniffer.protocols.packets.walk import Shape, shape_of

if TYPE_CHECKING:
    from sniffer.ground.plan import Plan
    from sniffer.protocols.packets.declare import PacketFamily

BY_HAND: Final = "docs/plugins.md, 'By hand', has the way for what does not fit"

MICROSECOND: Final = 1000
"""No servo answers within less."""


def check_form(family: PacketFamily) -> None:
    """Check the names by which the packet's and the answer's fields are known.

    Raises:
        DeclarationError: one is missing; it says what to write.
    """
    _check_numbers(family)
    _check_packet(family)
    for code, command in family.commands.items():
        _check_command(family, code, command)
    _check_answers(family)
    _check_errors(family)


def _check_errors(family: PacketFamily) -> None:
    """Check that an error has one name, whatever command it answers."""
    told = [{**flag_bits(error), **numbers(error)} for error in errors_of(family)]
    if any(names != told[0] for names in told):
        _refuse(
            family,
            "commands name the bits of their answers' error differently: one grammar for all, "
            "ERROR = FlagsEnum(...), in each feedback that has it",
        )


def errors_of(family: PacketFamily) -> list[Any]:
    """Return the fields that are the error of an answer: the family's, and those of commands."""
    own = (command.feedback for command in family.commands.values())
    fields = (field_named(g, "error") for g in (family.feedback, *own) if g is not None)
    return [field for field in fields if field is not None]


def _check_numbers(family: PacketFamily) -> None:
    if family.baud not in family.bauds:
        _refuse(family, f"baud {family.baud} is none of bauds: name it there, too")
    if not family.models:
        _refuse(family, 'models needs a table: models=(RegisterMap.from_toml("my.toml"),)')
    if family.window_ns < MICROSECOND:
        _refuse(
            family,
            f"window_ns={family.window_ns} is in nanoseconds: 5 ms are 5_000_000",
        )
    for what in ("silent", "anyone"):
        ids = getattr(family, what)
        if isinstance(ids, int):
            _refuse(family, f"{what} are ids, however many: {what}=({ids},)")
        for servo_id in ids:
            if not 0 <= servo_id <= 255:
                _refuse(family, f"{what} are ids from 0 to 255, and {servo_id} is none")


def _check_packet(family: PacketFamily) -> None:
    packet = bare(family.packet)
    own = {sub.name: bare(sub) for sub in getattr(packet, "subcons", ())}
    if isinstance(packet, Packet):
        if not [*packet.seals()]:
            _refuse(family, 'packet needs a check, as "checksum" / Seal(Byte, XOR8, "length", ...)')
        sums = [seal.checksum for _, seal in packet.seals()]
    else:
        if not isinstance(own.get("body"), c.RawCopy):
            _refuse(
                family,
                'packet needs "body" / RawCopy(Struct(...)) of what the checksum covers; or write '
                'Packet(...), with a "checksum" / Seal(Byte, XOR8, "length", ...) wherever it is; '
                f"packets that have none: {BY_HAND}",
            )
        checksum = own.get("checksum")
        if not isinstance(checksum, c.Checksum):
            _refuse(
                family,
                'packet needs "checksum" / Checksum(...) behind its body; one that stands '
                "elsewhere is a Seal in a Packet(...)",
            )
        sums = [checksum.hashfunc]
    for one in sums:
        if not hasattr(one, "good") or not hasattr(one, "formula"):
            _refuse(
                family,
                "the checksum needs a form for columns, too: take one of sniffer.ground.checksums, "
                "make one as they are made, by Checksum(...), or Crc16(...) or Crc8(...) of "
                "sniffer.ground.crc",
            )
    names = ["code"] if family.sole_id is not None else ["servo_id", "code"]
    for name in names:
        con = field_named(family.packet, name)
        if not isinstance(con, c.FormatField) or con.length != 1:
            more = ", or sole_id=0 where packets name no servo: all is shown under that id"
            _refuse(
                family,
                f"packet needs a field of one byte that is named {name}"
                + (more if name == "servo_id" else f"; without one, {BY_HAND}"),
            )
    if family.sole_id is not None and field_named(family.packet, "servo_id") is not None:
        _refuse(family, "packet names a servo_id: leave out sole_id")


def planned(family: PacketFamily, *, answers: bool = False) -> Plan:
    """Return the plan of the packets, or of answers that have a header of their own.

    Raises:
        DeclarationError: there is none, it has no header, or a check cannot be where it is.
    """
    packet = family.answering if answers else family.packet
    try:
        plan = plan_of(packet)
    except TypeError as error:
        _refuse(family, f"packet: {error}")
    if not plan.header:
        _refuse(family, f'packet needs a header, "header" / Const(b"...") at its front; {BY_HAND}')
    if plan.size and not _is_bounded(plan, family.most):
        _refuse(
            family,
            f"most={family.most} is the greatest {plan.size}, and the packet takes more: write "
            f"Check(this.{plan.size} <= {family.most}) behind it, or another most",
        )
    if family.answer_header and not answers:
        first = bare(bare(family.packet).subcons[0])
        if not isinstance(first, c.Const) or first.value != plan.header:
            _refuse(
                family, 'answer_header wants "header" / Const(...) as the packet\'s first field'
            )
        if len(family.answer_header) != len(plan.header) or family.answer_header == plan.header:
            _refuse(
                family,
                f"answer_header is another header of {len(plan.header)} bytes, as that of packet "
                f"has, not {family.answer_header!r}",
            )
    for seal in plan.seals:
        apart = not seal.is_behind
        if (apart or seal.order == "big") and not hasattr(seal.checksum, "over"):
            why = "stands not right behind the fields it covers" if apart else "is high byte first"
            _refuse(
                family,
                f"{seal.name} {why}: its checksum needs over(block, spans), too, as those of "
                "sniffer.ground.checksums have",
            )
    return plan


def _is_bounded(plan: Plan, most: int) -> bool:
    """Tell whether no length above the greatest one passes the checks of the packet."""
    if most + 1 >= 256 ** plan.width[plan.size]:
        return True
    above = c.Container({plan.size: most + 1})
    alone = [check for check in plan.checks if asked_by(check) == {plan.size}]
    return any(not check(above) for check in alone)


def _check_command(family: PacketFamily, code: Any, command: Any) -> None:
    if not isinstance(code, int) or not 0 <= code <= 255 or not isinstance(command, Command):
        _refuse(family, f"commands are {{code: Command(...)}}, codes from 0 to 255: not {code!r}")
    replies = (NEVER, OPTIONAL, IF_ALL, IF_READ, MUST, MANY)
    if command.reply not in replies or command.to_all not in replies:
        _refuse(
            family,
            f"command {command.name}: its reply is one of NEVER, OPTIONAL, IF_ALL, IF_READ, MUST",
        )
    told = family.asked_by or family.echoes
    if command.answer_at >= 0 and not (told and command.answer):
        _refuse(
            family,
            f"command {command.name}: answer_at is where the data of its answer stand: say how "
            "many they are, answer=, and by echoes, answer_code or answer_header what tells it",
        )
    if command.answer == ANY and not family.asked_by:
        _refuse(
            family,
            f"command {command.name}: answer=ANY wants answer_code or answer_header, by which an "
            "answer tells what it answers",
        )
    if command.repeats and (not family.echoes or command.answer):
        _refuse(
            family,
            f"command {command.name}: repeats says that its answer is the same packet once more: "
            "that wants echoes=True, and no answer=",
        )
    if command.feedback is not None and not family.asked_by:
        _refuse(
            family,
            f"command {command.name} has a feedback of its own: that wants answer_code (or "
            "answer_header), by which an answer tells what it answers",
        )
    if command.later and not family.asked_by:
        _refuse(
            family,
            f"command {command.name}: later wants answer_code or answer_header, by which an answer "
            "tells what it answers",
        )
    for name in command.later:
        if not _is_short_number(field_named(family.feedback_of(code), name)):
            _refuse(
                family,
                f"command {command.name}: later names {name}, which is no number in its feedback: "
                "Byte or Int16ul, or an Enum of these",
            )


def _is_short_number(con: Any) -> bool:
    """Tell whether columns read a field by itself."""
    inner = unnamed(con)
    return isinstance(inner, c.FormatField) and inner.fmtstr in (">B", "<H")


def _check_answers(family: PacketFamily) -> None:
    if family.answers in family.commands:
        name = family.commands[family.answers or 0].name
        _refuse(
            family,
            f"feedback has the code {family.answers:#04x}, which is also a command, {name}: an "
            "answer with the code of its request wants echoes=True or answer_code=",
        )
    if family.answer_code is not None or family.answer_header:
        _check_codes(family)
    elif not family.echoes and field_named(family.feedback, "error") is None:
        _refuse(
            family,
            "feedback needs a field named error, in the place of the code or, behind a constant "
            "code, as the first parameter; an answer with the code of its request wants "
            "echoes=True, one with that code and an offset answer_code=lambda code: code + 0x40",
        )
    elif field_named(family.feedback, "data") is None:
        _refuse(family, 'feedback needs "data" / GreedyBytes at its end')
    elif family.answers is None and not family.echoes:
        error = field_named(family.feedback, "error")
        rest = [sub.name for sub in bare(family.feedback).subcons if sub.name]
        if rest != ["error", "data"] or error.sizeof() != 1:
            _refuse(
                family,
                "where the error stands in the place of the code, feedback is "
                'Struct("error" / ... of one byte, "data" / GreedyBytes), and nothing else',
            )
    if family.tells_more and family.stuffing is not None:
        _refuse(family, f"stuffing goes with answers of code, error and data only; {BY_HAND}")
    if any(command.together for command in family.commands.values()):
        if family.tells_more:
            _refuse(family, f"together goes with answers of code, error and data only; {BY_HAND}")
        if isinstance(bare(family.packet), Packet):  # between two servos stands what ends a packet
            _refuse(family, f"together goes with a Checksum at the end, not with Seals; {BY_HAND}")


def _check_codes(family: PacketFamily) -> None:
    """Check that the code of an answer tells that it is one, and to what."""
    if family.echoes:
        _refuse(
            family,
            "echoes says that only the count tells an answer: leave out answer_code and "
            "answer_header, or echoes",
        )
    if isinstance(bare(bare(family.feedback).subcons[0]), c.Const):
        _refuse(
            family,
            "with answer_code or answer_header, feedback is what stands behind the code: leave the "
            "constant out",
        )
    answers: dict[int, str] = {}
    for code, command in family.commands.items():
        answer = family.answer_code(code) if family.answer_code is not None else code
        if answer is None:
            continue
        if not isinstance(answer, int) or not 0 <= answer <= 255:
            _refuse(family, f"answer_code({code:#04x}) is {answer!r}, and a code is from 0 to 255")
        if answer in family.commands and not family.answer_header:
            what = "its own: say echoes=True" if answer == code else "also a command"
            _refuse(
                family,
                f"answer_code gives {command.name} the code {answer:#04x}, which is {what}"
                + ("" if answer == code else f", {family.commands[answer].name}"),
            )
        if answer in answers:
            _refuse(
                family,
                f"answer_code gives {command.name} and {answers[answer]} the same code, "
                f"{answer:#04x}: write one that tells them apart",
            )
        answers[answer] = command.name
    if not answers:
        _refuse(family, "answer_code gives no command a code: write which answers which")


def told_of(family: PacketFamily) -> ToldAnswers | None:
    """Return what answers say, None where they say an error and data only.

    Raises:
        DeclarationError: a grammar of them has no form for columns.
    """
    if not family.tells_more:
        return None
    try:
        return ToldAnswers(family)
    except TypeError as error:
        _refuse(family, f"feedback: {error}")


def shapes_of(family: PacketFamily) -> dict[int, Shape]:
    """Return the shapes of all commands, by code.

    Raises:
        DeclarationError: one has none; it says which, and what there are.
    """
    out = {}
    for code, command in family.commands.items():
        try:
            out[code] = shape_of(command.params, command.at, command.stride, command.space)
        except TypeError as error:
            _refuse(family, f"command {command.name}: {error}")
    return out


def _refuse(family: PacketFamily, why: str) -> NoReturn:
    raise DeclarationError(f"{family.name}: {why}")
