"""wCK talk, labelled: manual 1.07, A-1 commands and responses, A-6 table."""

from __future__ import annotations

from typing import Final

from sniffer.protocols.wck.controller import TYPES
from sniffer.protocols.wck.grammar import OPS
from sniffer.testing import Exchange, Label, Talk
from tests.streams.wck import command, rbc
from tests.talks import due, of_vectors

SET: Final = 0xE0
ANY: Final = b"\0\0"
"""Bytes 3 and 4 of a read, which may be anything."""


def move(who: int, goal: int, torque: int = 0, reply: bytes = b"\x05\x50") -> Exchange:
    """Move a module; it answers with load and position."""
    labels = {"torque_level": torque, "goal_position": goal, "load": reply[0], "position": reply[1]}
    return Exchange("position_move", command(torque << 5 | who, goal), (reply,), labels)


def together(torque: int, *goals: int) -> Exchange:
    """Move modules 0 and on, as many as there are goals."""
    labels: dict[Label, int] = {}
    for who, goal in enumerate(goals):
        labels |= {(who, "torque_level"): torque, (who, "goal_position"): goal}
    raw = command(torque << 5 | 31, len(goals), bytes(goals))
    return Exchange("sync_position_move", raw, (), labels)


def status(who: int, reply: bytes) -> Exchange:
    """Read load and position."""
    labels = {"load": reply[0], "position": reply[1]}
    return Exchange("status_read", command(0xA0 | who, 0), (reply,), labels)


def put(name: str, code: int, rest: bytes, who: int = 3, **labels: int) -> Exchange:
    """Set something; the reply repeats it."""
    return Exchange(name, command(SET | who, code, rest), (rest,), labels)


def get(name: str, code: int, reply: bytes, who: int = 3, **labels: int) -> Exchange:
    """Read something."""
    return Exchange(name, command(SET | who, code, ANY), (reply,), labels)


def motion(*words: bytes) -> Exchange:
    """Write a self-running motion; the reply is how many words it has, twice."""
    n = len(words)
    raw = command(SET | 3, 0x96, bytes([n]) + b"".join(words))
    return Exchange("motion_data_write", raw, (bytes([n, n]),), {"motion_count": n})


def move_10bit(who: int, goal: int, position: int) -> Exchange:
    """Move a module by ten bits, drawn as the manual draws them: L7 in bits 7 to 1."""
    words = [bytes([raw >> 7, (raw & 127) << 1]) for raw in (goal, position)]
    raw = command(SET | 7, 0xC8, bytes([who, 2]) + words[0])
    labels = {"torque_10bit": 2, "goal_position_10bit": goal, "position_10bit": position}
    return Exchange("position_move_10bit", raw, (words[1],), labels)


def read_10bit(who: int, position: int, *, text_sum: bool = False) -> Exchange:
    """Read a position of ten bits; the checksum is that of note 5, or that of the section."""
    raw = command(SET | 7, 0xC9, bytes([who, who]), text_sum=text_sum)
    answer = bytes([position >> 7, (position & 127) << 1])
    return Exchange("position_read_10bit", raw, (answer,), {"position_10bit": position})


def controller(kind: int, asked: bytes, answer: bytes | None) -> Exchange:
    """Speak to RoboBuilder's controller on the same line."""
    answers = None if answer is None else (rbc(kind, answer),)
    return Exchange(f"rbc_{TYPES.get(kind, f'{kind:02x}')}", rbc(kind, asked), answers, {})


MOVES: Final = [
    *(move(who, 100, torque) for who in (0, 3, 30) for torque in (0, 4)),
    move(3, 254, 2, b"\x00\xfe"),
    together(1, 100),
    together(0, 100, 120),
    together(4, *range(60, 91)),
    *(status(who, b"\x05\x50") for who in (0, 3, 30)),
    status(3, b"\x00\x00"),
    Exchange("passive", command(0xC0 | 3, 0x10), (b"\x10\x50",), {"position": 0x50}),
    *(
        Exchange(
            "wheel",
            command(0xC0 | 3, way << 4 | 7),
            (bytes([turns, 0x50]),),
            {"wheel_direction": way, "wheel_speed": 7, "rotation_count": turns, "position": 0x50},
        )
        for way, turns in ((3, 9), (4, 255))
    ),
    Exchange("break", command(0xDF, 0x20), (b"\x03\x50",), {(3, "position"): 0x50}),
]
SETS: Final = [
    put("baud_rate_set", 0x08, b"\x07\x07", baud_rate=7),
    put("pd_gain_set", 0x09, b"\x14\x1e", p_gain=0x14, d_gain=0x1E),
    get("pd_gain_read", 0x0A, b"\x14\x1e", p_gain=0x14, d_gain=0x1E),
    put("i_gain_set", 0x15, b"\x02\x02", i_gain=2),
    get("i_gain_read", 0x16, b"\x02\x02", i_gain=2),
    put("runtime_pd_gain_set", 0x0B, b"\x14\x1e", runtime_p_gain=0x14, runtime_d_gain=0x1E),
    put("runtime_i_gain_set", 0x18, b"\x02\x02", runtime_i_gain=2),
    put("id_set", 0x0C, b"\x05\x05", servo_id=5),
    put("speed_set", 0x0D, b"\x0f\x14", speed=15, acceleration=20),
    get("speed_read", 0x0E, b"\x0f\x14", speed=15, acceleration=20),
    Exchange(
        "runtime_speed_set",
        command(SET | 3, 0x17, b"\x0f\x14"),
        (),
        {"runtime_speed": 15, "runtime_acceleration": 20},
    ),
    put("overload_set", 0x0F, b"\x21\x21", overload=0x21),
    get("overload_read", 0x10, b"\x21\x21", overload=0x21),
    put("boundary_set", 0x11, b"\x01\xfe", lower_boundary=1, upper_boundary=0xFE),
    get("boundary_read", 0x12, b"\x01\xfe", lower_boundary=1, upper_boundary=0xFE),
    put("io_write", 0x64, b"\x02\x02", digital_output=2),
    put("io_write", 0x64, b"\xff\xff", digital_output=3),
    get("io_read", 0x65, b"\x02\x40", digital_output=2, ad_input=0x40),
    get("io_read", 0x65, b"\xff\xff", digital_output=3, ad_input=0xFF),
    motion(b"\x10\x64"),
    motion(b"\x10\x64", b"\x80\x00"),
    motion(b"\x10\xff", b"\xa0\x00", b"\x20\x10", b"\x80\x00"),  # holds a status read of module 0
    motion(*[b"\x10\x64"] * 8),
    get("motion_data_read", 0x97, b"\x02\x02", motion_count=2),
    Exchange("rbc_direct_control_end", command(SET, 0xFB, b"\x01\x00"), (), {}),
    *(move_10bit(who, 520, 517) for who in (0, 31, 200)),
    *(read_10bit(who, 517) for who in (0, 31, 200)),
    read_10bit(31, 517, text_sum=True),
    Exchange("unknown_20", command(SET | 3, 0x20, b"\x01\x02"), (b"\x01\x02",), {}),
]
CONTROLLER: Final = [
    *(controller(kind, b"\x01", None) for kind in (*TYPES, 0x77) if kind != 0x12),
    controller(0x12, b"\x01", b"\x01\x02"),
    controller(0x12, b"", bytes(64)),
]

TALK: Final = Talk(
    [*due([*of_vectors("wck"), *MOVES, *SETS], "*"), *CONTROLLER],
    commands=[
        *(op.name for op in OPS if op.name != "unknown"),
        *(f"rbc_{name}" for name in TYPES.values()),
    ],
    # A controller's packet says nothing of its direction: the second of a type is the answer to the
    # first, so what is said twice, or where something stands between, is read otherwise. Clients
    # repeat theirs after half a second, which is a silence.
    ambiguous={
        "repeated: rbc_*": 2,
        "repeated twice: rbc_*": 2,
        "repeated, lost: rbc_*": 17,
        "asked twice: rbc_*": 15,
        "answered twice: rbc_*": 2,
        "answer late: rbc_*": 2,
        "a stray byte: rbc_*": 2,
        "request damaged: rbc_*": 8,
        "silence inside: rbc_*": 15,
        # either checksum of this command will do, and one leaves a byte out
        "request damaged: position_read_10bit": 3,
        # of a motion that holds a command, the command comes to light where the frame breaks
        "request damaged: motion_data_write": 3,
        "silence inside: motion_data_write": 9,
    },
    absent={
        "* one byte *": "the code of a command says its length",
        "an answer with no data": "a reply is two bytes",
        "a scene: staged, then released": "nothing is staged",
        "a reset that *": "there is no reset",
        "arranged: answer *o* another *": "a reply names neither its module nor its command",
        "arranged: two in flight": "replies come in the order of their commands",
    },
)
