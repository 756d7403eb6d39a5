"""The dissector: its engine, with the tables of grammars, commands and registers put in.

It is made anew whenever it is installed or compared, so it is never behind what the decoder reads.
``python -m sniffer.wireshark.tables FILE`` writes it to be read or copied (``make wireshark``).
"""

from __future__ import annotations

import sys
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.checksums import COMPLEMENT_SUM, XOR7, XOR8
from sniffer.ground.codes import MANY, NEVER, REQUEST, RESPONSE
from sniffer.ground.model import RESETS
from sniffer.ground.registers import scale_limit, unseen_scale
from sniffer.pcapfile.layout import NO_TIMES, WITHIN
from sniffer.pcapfile.layout import PROTOCOLS as NUMBERS
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.lss import grammar as lss
from sniffer.protocols.mightyzap import PROTOCOL as MIGHTYZAP
from sniffer.protocols.packets.fields import field_named, flag_bits
from sniffer.protocols.packets.walk import shape_of
from sniffer.protocols.rs30x import grammar as rs30x
from sniffer.protocols.rs30x.block import PLAN, RETURN_PLAN
from sniffer.protocols.wck import block as wck_block
from sniffer.protocols.wck import controller, reading
from sniffer.protocols.wck import grammar as wck
from sniffer.wireshark.lua import lua

if TYPE_CHECKING:
    from collections.abc import Iterable

    from sniffer.ground.plan import Plan
    from sniffer.ground.registers import Register, RegisterMap
    from sniffer.protocols.base import BusProtocol
    from sniffer.protocols.packets.declare import Command

ENGINE: Final = ("1_values.lua", "2_protocols.lua", "3_packets.lua", "4_tree.lua")
"""The parts of the engine, in order: they become one file."""

HERE: Final = "-- @TABLES@"
"""The line of the engine in whose place the tables stand."""

_NOBODY: Final = (wck_block.SYNC, wck_block.BREAK, wck_block.TO_CONTROLLER)
"""Commands of wCK that name no servo."""

_FOLDS: Final = {id(COMPLEMENT_SUM): "sum", id(XOR8): "xor8", id(XOR7): "xor7"}


def dissector() -> str:
    """Return the whole dissector as Lua.

    Raises:
        TypeError: a protocol holds what the engine has no form for.
    """
    folder = resources.files("sniffer.wireshark").joinpath("engine")
    engine = "\n".join(folder.joinpath(part).read_text("utf-8") for part in ENGINE)
    specs = {number: _spec(PROTOCOLS[name]) for name, number in NUMBERS.items()}
    told = {"NO_TIMES": NO_TIMES, "WITHIN": WITHIN, "PROTOCOLS": specs}
    tables = "\n\n".join(f"local {name} = {lua(value)}" for name, value in told.items())
    head, _, rest = engine.partition(HERE)
    return (
        f"{head}-- Generated up to the next ruler (sniffer/wireshark/tables.py).\n\n{tables}{rest}"
    )


def _spec(protocol: BusProtocol) -> dict[str, Any]:
    """Return what the engine knows of a protocol: what all have, and its own."""
    own = {"mightyzap": _packets, "lss": _lss, "rs30x": _rs30x, "wck": _wck}[protocol.name]
    watches = {r.scale_by[0] for r in protocol.registers if r.scale_by is not None}
    models = [_model(m, watches) for m in protocol.models]
    numbers = {
        raw: i
        for i, m in enumerate(protocol.models, 1)
        if m.identity is not None
        for raw in m.identity.values
    }
    return {
        "name": protocol.name,
        "title": protocol.title,
        "reach": protocol.reach,
        "tail": protocol.tail_ns / 1e9,
        "ordered": protocol.ordered or None,
        "everyone": dict.fromkeys(protocol.everyone, True),
        "watches": sorted(watches) if watches or numbers else None,
        "numbers": numbers or None,
        "models": models,
        **own(),
    }


def _model(model: RegisterMap, watches: Iterable[str]) -> dict[str, Any]:
    """Return a register table; what is as most are is left out."""
    return {
        "name": model.model,
        "registers": [_register(r, model, watches) for r in model.registers],
    }


def _register(r: Register, model: RegisterMap, watches: Iterable[str]) -> dict[str, Any]:
    told = model.identity
    by, scales = r.scale_by or (None, None)
    limits = {mode: scale_limit(r, mode) for mode in scales} if scales and r.range else None
    return {
        "name": r.name,
        "address": r.address if r.address >= 0 else None,
        "type": r.type,
        "width": r.width,
        "unit": r.unit or None,
        "scale": unseen_scale(r),
        "by": by,
        "scales": dict(scales) if scales else None,
        "limits": limits,
        "sign_bit": r.sign_bit,
        "special": dict(r.special) or None,
        "values": dict(r.values) or None,
        "bits": dict(r.bits) or None,
        "effect": r.effect or None,
        "selects": r.name in watches or None,
        "identifies": (told is not None and told.register == r.name) or None,
    }


def _framing(plan: Plan) -> dict[str, Any]:
    return {
        "header": plan.header,
        "sum_from": plan.sum_from,
        "fold": _FOLDS[id(plan.checksum)],
        "least": plan.tail_at + plan.sum_width,
    }


def _packets() -> dict[str, Any]:
    """Return a member of the packet family: the plan of its packet, a shape a command."""
    family, plan = MIGHTYZAP.family, MIGHTYZAP.plan
    return {
        "style": "packets",
        **_framing(plan),
        "size_at": plan.at["size"],
        "extra": plan.tail_at + int(plan.tail({"size": 0})) + plan.sum_width,
        "id_at": plan.at["servo_id"],
        "code_at": plan.at["code"],
        "status_at": plan.at["code"],
        "body_at": plan.tail_at,
        "answer": family.terms[2],
        "silent": dict.fromkeys(family.silent, True),
        "anyone": dict.fromkeys(family.anyone, True),
        "servo_id": family.effective("servo_id"),
        "status": {},
        "status_bits": flag_bits(field_named(family.feedback, "error")),
        "refusals": [1 << bit for bit in range(16) if family.refusals >> bit & 1],
        "commands": {code: _command(command) for code, command in family.commands.items()},
    }


def _command(command: Command) -> dict[str, Any]:
    shape = shape_of(command.params)
    at = {name: where for name, (where, _) in shape.at.items()}
    many = shape.data or shape.targets is not None
    return {
        "name": command.name,
        "reply": "never" if command.reply == NEVER else "many" if command.reply == MANY else None,
        "least": shape.least,
        "most": None if many else shape.most,
        "fixed": shape.fixed,
        "address": at.get("address"),
        "length": at.get("length"),
        "option": at.get("option"),
        "reads": shape.reads or None,
        "writes": shape.writes or None,
        "targets": (shape.targets is not None and shape.targets.data) or None,
        "new_id": list(command.new_id) if command.new_id else None,
        "resets": bool(command.effect & RESETS) or None,
    }


def _rs30x() -> dict[str, Any]:
    """Return RS30x: its two packets, what reply nibbles ask for, what flag bits command."""
    forms = {
        nibble: {
            1: form.address,
            2: form.length,
            "ack": nibble == rs30x.ASKS_ACK or None,
            "own": nibble == rs30x.ASKS_ADDRESS or None,
        }
        for nibble, form in rs30x.REPLIES.items()
    }
    commands = (
        (rs30x.FLASH_BIT, rs30x.FLASH_WRITE),
        (rs30x.REBOOT_BIT, rs30x.REBOOT),
        (rs30x.RESET_BIT, rs30x.FACTORY_RESET),
    )
    return {
        "style": "rs30x",
        **_framing(PLAN),
        "back": RETURN_PLAN.header,
        "ack": rs30x.ACK_BYTE,
        "nack": rs30x.NACK,
        "ack_token": rs30x.ACK_TOKEN,
        "long": rs30x.LONG,
        "all": rs30x.EVERYONE,
        "reset": rs30x.RESET_BIT,
        "command_address": rs30x.COMMAND_ADDRESS,
        "servo_id": rs30x.ID_REGISTER,
        "default_id": rs30x.DEFAULT_ID,
        "status_at": PLAN.at["flags"],
        "status": {rs30x.NACK: "nack"},
        "status_bits": dict(rs30x.STATUS),
        "refusals": [1 << bit for bit in range(16) if rs30x.REFUSALS >> bit & 1],
        "replies": forms,
        "flags": [[bit, rs30x.OPS[op]] for bit, op in commands],
    }


def _lss() -> dict[str, Any]:
    """Return LSS: the words with the registers that they state, by model."""
    identities = [m.identity for m in lss.MODELS]
    asked = {i.register for i in identities if i is not None}
    words = {
        sent: {
            "name": word.name,
            "query": word.is_query or None,
            "plain": len(set(word.selectors.values())) == 1 or None,
            "identifies": not asked.isdisjoint(word.asks) or None,
            "registers": _indices(word.registers),
            "answers": [{s: r + 1 for s, r in by.items()} for by in word.answers]
            if word.is_query
            else None,
        }
        for sent, word in lss.WORDS.items()
    }
    return {
        "style": "lss",
        "all": lss.BROADCAST,
        "button": lss.BUTTON_MODE,
        "words": words,
        "modifiers": {name: _indices(m.registers) for name, m in lss.MODIFIERS.items()},
        "text_words": list(lss.TEXT_WORDS),
        "names": [
            {"texts": dict.fromkeys(i.texts, True), "begins": list(i.begins)}
            if i is not None
            else {"texts": {}, "begins": []}
            for i in identities
        ],
    }


def _indices(registers: Iterable[int]) -> dict[int, int] | None:
    """Return the registers by model, both counted from 1; those that there are."""
    return {m: r + 1 for m, r in enumerate(registers, 1) if r >= 0} or None


def _wck() -> dict[str, Any]:
    """Return wCK: the commands in the order in which they are tried, and what their bytes say."""
    return {
        "style": "wck",
        "header": wck.HEADER,
        "controller": controller.HEADER,
        "types": {number: f"rbc_{name}" for number, name in controller.TYPES.items()},
        "ops": [_op(i, op) for i, op in enumerate(wck.OPS)],
    }


def _op(index: int, op: wck.Op) -> dict[str, Any]:
    sync = op.name == "sync_position_move"
    reads = reading.reads_of
    counted = {n: _reads(reads(index, REQUEST, n)) for n in range(1, wck_block.ID_BITS + 1)}
    return {
        "name": op.name,
        "firsts": _ranges(wck.FIRSTS[index]),
        "seconds": _ranges(wck.SECONDS[index]),
        "least": op.length + (1 if sync else 0),
        "most": None if op.tail else op.length,
        "reply": bool(op.reply) or None,
        "unknown": op.name == "unknown" or None,
        "nobody": index in _NOBODY or None,
        "id_at": wck_block.PARAMS + op.params.index("id") if "id" in op.params else None,
        "sum_from": wck_block.PARAMS if sync else wck_block.DATA1,
        "text_sum": op.name == "position_read_10bit" or None,
        "out": None if sync else _reads(reads(index, REQUEST)),
        "counted": counted if sync else None,
        "back": _reads(reads(index, RESPONSE)),
    }


def _reads(reads: Iterable[reading.ByteRead]) -> list[dict[str, Any]]:
    return [
        {
            "reg": read.register + 1,
            "at": read.at,
            "shift": read.shift or None,
            "mask": read.mask if read.mask != 0xFF else None,
            "servo": read.servo,
            "ten": read.is_ten_bits or None,
        }
        for read in reads
    ]


def _ranges(numbers: Iterable[int]) -> list[int]:
    """Return numbers as first, last, first, last ..."""
    out: list[int] = []
    for number in sorted(numbers):
        if out and out[-1] == number - 1:
            out[-1] = number
        else:
            out += [number, number]
    return out


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(dissector(), encoding="utf-8")
