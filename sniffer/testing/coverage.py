"""What a talk has to reach, and whether it does: a law only tells of what it was shown."""

from __future__ import annotations

import re
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.ground.codes import IF_ALL, IF_READ, MUST, PARTS, REQUEST, WHOLE
from sniffer.ground.model import MALFORMED, RELEASES, RESETS, STAGED, UNKNOWN
from sniffer.protocols.packets.fields import number_in
from sniffer.protocols.reports import error_number
from sniffer.testing.facts import header_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from sniffer.ground.registers import RegisterMap
    from sniffer.protocols.base import BusProtocol
    from sniffer.protocols.packets import PacketFamily
    from sniffer.testing.case import TalkCase
    from sniffer.testing.facts import Fact, Known
    from sniffer.testing.talk import Talk

STATUS_BITS: Final = 15
"""A status is a 16-bit number with a sign."""

LOW, HIGH, PART = 1, 2, 3


class Goal(NamedTuple):
    """Something a talk should show, and whether it does."""

    name: str
    is_met: bool


def commands_of(protocol: BusProtocol, talk: Talk) -> list[str]:
    """Return the names of all commands: as declared by the protocol, else by the talk.

    What a servo only says of its own accord is no request that a talk could show.
    """
    family = getattr(protocol, "family", None)
    declared = getattr(protocol, "commands", getattr(family, "commands", None))
    names: Iterable[str] = talk.commands
    if declared is not None and not talk.commands:
        table = declared.values() if hasattr(declared, "values") else declared
        names = (getattr(c, "name", c) for c in table if not getattr(c, "on_its_own", False))
    return list(dict.fromkeys([*names, *(() if names else (e.name for e in talk.exchanges))]))


def table_of(protocol: BusProtocol, talk: Talk) -> RegisterMap:
    """Return the register table by which the talk's values are labelled."""
    return next((m for m in protocol.models if m.model == talk.model), protocol.models[0])


def goals(
    protocol: BusProtocol,
    talk: Talk,
    known: Sequence[Known],
    scenes: Sequence[Sequence[Fact]],
    cases: Sequence[TalkCase],
    arrangements: Iterable[str],
) -> list[Goal]:
    """Return everything that is asked of a talk, met or not."""
    names = commands_of(protocol, talk)
    out = [
        *_commands(names, known),
        *_replies(names, known, {e.name for s in talk.scenes for e in s if e.answers == ()}),
        *_later(protocol, known),
        *_addressing(protocol, known),
        *_statuses(protocol, known),
        *_sizes(protocol, known),
        *_headers(known),
        *_directions(protocol, known),
        *_memory(known, scenes),
        *_registers(table_of(protocol, talk), known, scenes),
    ]
    seen = {c.arrangement for c in cases}
    return out + [Goal(f"arranged: {name}", name in seen) for name in arrangements]


def lacking(talk: Talk, asked: Sequence[Goal]) -> list[str]:
    """Return what a talk lacks without saying why, and what it says to lack without need."""
    missing = [g.name for g in asked if not g.is_met]
    out = [
        f"not shown: {name}"
        for name in missing
        if not any(fnmatchcase(name, pattern) for pattern in talk.absent)
    ]
    out += [
        f"said to be absent, and it is not: {pattern}"
        for pattern in talk.absent
        if not any(fnmatchcase(name, pattern) for name in missing)
    ]
    return out


def _commands(names: Sequence[str], known: Sequence[Known]) -> Iterator[Goal]:
    for name in names:
        mine = [k for k in known if k.exchange.name == name]
        good = [k for k in mine if not k.request.flags & (MALFORMED | UNKNOWN)]
        right = {len(k.exchange.request) for k in good}
        lengths = {len(k.exchange.request) for k in mine}
        yield Goal(f"{name} well-formed", bool(good))
        yield Goal(f"{name} one byte less", any(n - 1 in lengths for n in right))
        yield Goal(f"{name} one byte more", any(n + 1 in lengths for n in right))
        yield Goal(f"{name} with its values", any(k.exchange.values is not None for k in good))
    yield Goal("an unknown command", any(k.request.flags & UNKNOWN for k in known))


def _replies(names: Sequence[str], known: Sequence[Known], unanswered: set[str]) -> Iterator[Goal]:
    """What silence means is told by silence only: of answers no two classes of reply differ.

    It is asked of a talk that says of any exchange what silence means there.
    """
    for name in names if any(k.exchange.due for k in known) else ():
        mine = [k for k in known if k.exchange.name == name and k.answers]
        replies = {k.request.reply for k in mine}
        if replies & {MUST, IF_READ}:
            yield Goal(f"{name} due", any(k.exchange.due for k in mine))
        if IF_ALL in replies:
            yield Goal(f"{name} unanswered, without fault", name in unanswered)


def _later(protocol: BusProtocol, known: Sequence[Known]) -> Iterator[Goal]:
    family: PacketFamily | None = getattr(protocol, "family", None)
    if family is None:
        return
    for command in family.commands.values():
        said = [raw for k in known if k.exchange.name == command.name for raw in k.exchange.later]
        for name, values in command.later.items():
            told = {_later_says(family, raw, name) for raw in said}
            for value in values:
                yield Goal(f"{command.name} done later, {name} {value}", value in told)


def _later_says(family: PacketFamily, raw: bytes, name: str) -> int:
    """Return what a field of the feedback says in a packet that comes once something is done."""
    body = family.body_of(raw)
    servo_id = body.get("servo_id", family.sole_id)
    params = family.plain(bytes(body[family.tail]), servo_id, body.code)
    return number_in(family.feedback_of(family.asked_by[body.code]), name, params)


def _addressing(protocol: BusProtocol, known: Sequence[Known]) -> Iterator[Goal]:
    asked = {k.servo_id for k in known}
    ones = asked - {*protocol.everyone, -1}
    yield Goal("a request to one servo", bool(ones))
    yield Goal("requests to two servos", len(ones) > 1)
    for servo in protocol.everyone:
        yield Goal(f"a request to id {servo}" if servo >= 0 else "a request to all", servo in asked)
    others = any(a.servo_id != k.servo_id for k in known for a in k.answers)
    yield Goal("an answer under another id", others)


def _statuses(protocol: BusProtocol, known: Sequence[Known]) -> Iterator[Goal]:
    labelled = [k for k in known if k.exchange.errors is not None]
    told = {a.status for k in labelled for a in k.answers}
    bits, numbers = status_bits(protocol), status_numbers(protocol)
    for bit, name in bits.items():
        yield Goal(f"status bit {bit} ({name})", 1 << bit in told)
    for number, name in numbers.items():
        yield Goal(f"status {number} ({name})", number in told)
    named = [*(1 << bit for bit in bits), *numbers]
    if protocol.refused(np.array(named, np.int16)).any():
        no = [
            k
            for k in known
            if k.exchange.values == {}
            and k.request.parts
            and any(protocol.refused(np.array([a.status], np.int16))[0] for a in k.answers)
        ]
        yield Goal("a write that is refused", bool(no))


def _sizes(protocol: BusProtocol, known: Sequence[Known]) -> Iterator[Goal]:
    lengths = {a.data_length for k in known for a in k.answers}
    for n, words in ((0, "no data"), (1, "one byte of data")):
        yield Goal(f"an answer with {words}", n in lengths)
    frames = {len(raw) for k in known for raw in (k.exchange.request, *k.exchange.replies)}
    yield Goal("a frame as long as any may be", protocol.longest in frames)


def status_bits(protocol: BusProtocol) -> dict[int, str]:
    """Return the bits of a status that mean something each, by number."""
    number = error_number(protocol)
    bits = {bit: 1 << bit for bit in range(STATUS_BITS) if not number >> bit & 1}
    return _named(protocol, bits)


def status_numbers(protocol: BusProtocol) -> dict[int, str]:
    """Return what the bits of a status that are one number may say, by that number."""
    number = error_number(protocol)
    return _named(protocol, {n: n for n in range(1, number + 1) if not n & ~number})


def _named(protocol: BusProtocol, of: Mapping[int, int]) -> dict[int, str]:
    """Return the names of statuses that have one; a bare number is none."""
    names = {key: protocol.status_names(status) for key, status in of.items()}
    return {k: n[0] for k, n in names.items() if n and not re.fullmatch(r"(bit|error)_?\d+", n[0])}


def headers(known: Sequence[Known]) -> tuple[bytes, bytes]:
    """Return what all requests, and what all answers that stand alone, begin with."""
    answers = [raw for k in known if k.stands_alone for raw in k.exchange.replies]
    return header_of(k.exchange.request for k in known), header_of(answers)


def _headers(known: Sequence[Known]) -> Iterator[Goal]:
    header = headers(known)[0]
    if not header:
        return
    data, frames = [], []
    for k in known:
        raws = (k.exchange.request, *k.exchange.replies)
        for raw, fact in zip(raws, (k.request, *k.answers), strict=True):
            data.append(raw[fact.data_start : fact.data_start + fact.data_length])
            frames.append(raw)
    n = len(header)
    yield Goal("data that begin with the header", any(d.startswith(header) for d in data))
    yield Goal("data that hold the header", any(header in d[1:-1] for d in data))
    yield Goal("data that end with the header", any(d.endswith(header) for d in data))
    ends = any(f[-1:] == header[:1] for f in frames)
    yield Goal("a frame that ends as the header begins", ends)
    requests = {k.exchange.request for k in known}
    whole = any(r in d for d in data if len(d) > n for r in requests)
    yield Goal("data that hold a whole request", whole)


def _directions(protocol: BusProtocol, known: Sequence[Known]) -> Iterator[Goal]:
    """What looks alike both ways is told by its neighbours; these are the hard ones."""
    asking, answering = headers(known)
    names = sum(1 << bit for bit in status_bits(protocol))
    numbers = {0, *status_numbers(protocol)}
    alike = {
        k.request.op: k.exchange.name
        for k in known
        if 0 <= k.request.op < 256
        and k.request.op & ~names in numbers
        and k.request.kind == REQUEST
    }
    has_status = names or len(numbers) > 1
    if not (has_status and alike and asking and answering.startswith(asking)):
        return
    told = {a.status for k in known for a in k.answers}
    for code, name in sorted(alike.items()):
        yield Goal(f"a status like {name}", code in told)
    pairs = [(k.exchange.request, raw) for k in known for raw in k.exchange.replies]
    yield Goal("an answer as long as its request", any(len(q) == len(a) for q, a in pairs))
    yield Goal("an answer that reads as a command", any(k.reads_as_command for k in known))
    sizes = {(k.servo_id, len(raw)) for k in known for raw in k.exchange.replies}
    fits = any((k.servo_id, len(k.exchange.request)) in sizes for k in known)
    yield Goal("a request that would fit as an answer", fits)


def _memory(known: Sequence[Known], scenes: Sequence[Sequence[Fact]]) -> Iterator[Goal]:
    released = False
    for scene in scenes:
        flags = [f.flags for f in scene]
        staged = next((i for i, x in enumerate(flags) if x & STAGED), len(flags))
        released = released or any(x & RELEASES for x in flags[staged:])
    yield Goal("a scene: staged, then released", released)
    resets = [f for scene in scenes for f in scene if f.flags & RESETS]
    resets += [k.request for k in known if k.request.flags & RESETS]
    yield Goal("a reset that gives a new id", any(f.alt_id >= 0 for f in resets))
    yield Goal("a reset that keeps the id", any(f.alt_id < 0 for f in resets))


def _registers(
    table: RegisterMap, known: Sequence[Known], scenes: Sequence[Sequence[Fact]]
) -> Iterator[Goal]:
    facts = [f for k in known for f in (k.request, *k.answers)] + [f for s in scenes for f in s]
    seen = {part for k in known for f in k.labelled for part in f.parts}
    written = [f for f in facts if f.kind == REQUEST and f.parts and f.address >= 0]
    addresses = [r.address for r in table.registers if r.address >= 0]
    for r in table.registers:
        if not r.width:
            continue
        yield Goal(f"{r.name} whole", (r.name, WHOLE) in seen)
        if r.address < 0:
            continue
        parts = {1: (), 2: (LOW, HIGH)}.get(r.width, (PART,))
        for part in parts:
            yield Goal(f"{r.name}, {PARTS[part]}", (r.name, part) in seen)
        if r.effect in ("servo_id", "feedback") and "w" in r.access:
            over = any((r.name, WHOLE) in f.parts for f in written)
            yield Goal(f"a write over {r.name}", over)
            if r.address > min(addresses):
                before = any(f.address + f.data_length == r.address for f in written)
                yield Goal(f"a write that ends before {r.name}", before)
            if r.address < max(addresses):
                behind = any(f.address == r.address + r.width for f in written)
                yield Goal(f"a write that begins behind {r.name}", behind)
