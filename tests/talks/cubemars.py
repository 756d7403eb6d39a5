"""CubeMars talk, labelled: serial examples of the AK manual, and the table."""

from __future__ import annotations

from typing import Final

from sniffer.ground.crc import Crc16
from sniffer.testing import Exchange, Talk
from tests.talks import of_package, stated

PACKAGE: Final = "examples/protocols/cubemars"
MODEL: Final = f"{PACKAGE}/ak.toml"
CRC: Final = Crc16(0x1021)
GET, DETECT, TERMINAL, ROTOR, ORIGIN = 0x04, 0x0B, 0x14, 0x16, 0x5F
GOALS: Final = {  # command: name, and two goals
    0x05: ("set_duty", "00004E20", "FFFFB1E0"),
    0x06: ("set_current", "00001388", "FFFFEC78"),
    0x07: ("set_current_brake", "00001388", "FFFFEC78"),
    0x08: ("set_rpm", "000003E8", "FFFFFC18"),
    0x09: ("set_pos", "0ABA9500", "F5456B00"),
    0x0A: ("set_handbrake", "00001388", "FFFFEC78"),
    0x5B: ("set_pos_spd", "0002BF200000138800007530", "FFFD40E00000138800007530"),
    0x5C: ("set_pos_multi", "00000000", "FFFFF1F0"),
    0x5D: ("set_pos_single", "00000000", "00000E10"),
}
MEASURED: Final = bytes.fromhex(
    "012D011D0000007800000050FFFFFFFD000000730032FFFFFC1800F0" + "00" * 24 + "02FFFF4FB601"
) + bytes(14)
"""What is answered: temperatures, currents, duty, speed, voltage, fault, position, two voltages."""


def packet(code: int, params: bytes = b"") -> bytes:
    """Put a packet together; no packet names a motor."""
    body = bytes([code]) + params
    return bytes([2, len(body)]) + body + CRC(body).to_bytes(2, "big") + b"\3"


def goal(code: int, data: bytes) -> Exchange:
    """Give a goal; nobody answers."""
    return Exchange(GOALS[code][0], packet(code, data), (), stated(MODEL, code << 8, data), ())


def measured(data: bytes) -> Exchange:
    """Ask for all that is measured."""
    values = stated(MODEL, GET << 8, data)
    return Exchange("get_values", packet(GET), (packet(GET, data),), values, (), due=True)


def text(words: bytes) -> Exchange:
    """Send the terminal a line: what comes back is documented nowhere."""
    return Exchange("terminal_command", packet(TERMINAL, words), None, {})


def streams(what: int, position: bytes) -> Exchange:
    """Have the motor send its position over and over, unasked."""
    request, said = packet(DETECT, bytes([what])), packet(ROTOR, position)
    values = stated(MODEL, ROTOR << 8, position)
    return Exchange("set_detect", request, (), {}, (), later=(said, said), later_values=values)


def origin(kept: int) -> Exchange:
    """Take where it stands for the origin."""
    return Exchange("set_origin", packet(ORIGIN, bytes([kept])), (), {}, ())


def odd(name: str, code: int, params: bytes) -> Exchange:
    """Say a command with too few or too many parameters."""
    return Exchange(name, packet(code, params), None)


def _with(at: int, data: bytes) -> bytes:
    return MEASURED[:at] + data + MEASURED[at + len(data) :]


TALK: Final = Talk(
    [
        *of_package(PACKAGE),
        *(goal(code, bytes.fromhex(one)) for code, (_, *both) in GOALS.items() for one in both),
        *(measured(_with(0x34, bytes([fault]))) for fault in range(15)),
        measured(bytes(k * 7 % 251 for k in range(72))),
        # what looks like the next packet
        measured(_with(0, b"\2\1\4")),
        measured(_with(0x20, packet(GET))),
        measured(_with(0x47, b"\2")),
        *(text(words) for words in (b"encoder", b"exit", b"a", b"ab", b"x" * 95)),
        streams(4, b"\x00\x1a\xb6\x64"),
        streams(4, b"\xff\xff\xb1\xe0"),
        *(origin(kept) for kept in (0, 1)),
        Exchange("unknown_1f", packet(0x1F, b"\1"), None),
        *(
            odd(name, code, params)
            for code, (name, one, _) in GOALS.items()
            for params in (bytes.fromhex(one)[:-1], bytes.fromhex(one) + b"\1")
        ),
        odd("get_values", GET, b"\1"),
        *(odd("set_detect", DETECT, params) for params in (b"", b"\4\4")),
        *(odd("set_origin", ORIGIN, params) for params in (b"", b"\1\1")),
    ],
    absent={
        "get_values one byte less": "it has no parameters",
        "requests to two servos": "a line has one motor",
        "an answer under another id": "a line has one motor",
        "arranged: answer from another id": "a line has one motor",
        "arranged: two in flight": "a line has one motor",
        "arranged: answer to another command": "one command is answered",
        "an answer with no data": "one command is answered, with 72 bytes",
        "an answer with one byte of data": "one command is answered, with 72 bytes",
        "a frame that ends as the header begins": "each ends with 03",
        "a scene: staged, then released": "nothing is staged",
        "a reset that *": "there is none",
        "*, part": "no command is about half a number",
        "*, low byte": "no command is about half a number",
        "*, high byte": "no command is about half a number",
    },
    # A packet within the data of one that is torn is a packet.
    ambiguous={
        "answer cut: get_values": 4,
        "answer damaged: get_values": 4,
        "silence inside: get_values": 20,
    },
    harmless={"get_values: any id may answer": "a line has one motor"},
)
