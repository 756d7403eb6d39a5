"""Talk of servos that read and write by address and answer with status packets: what is alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from sniffer.ground.checksums import COMPLEMENT_SUM
from sniffer.testing import Exchange
from tests.talks import blocks, halves, stated

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sniffer.testing import Label

PING, READ, WRITE, REG, ACTION, RESET = range(1, 7)
REBOOT, SYNC_READ, SYNC_WRITE, BULK_READ = 8, 0x82, 0x83, 0x92
ALL: Final = 254
NAMES: Final = {
    PING: "ping",
    READ: "read",
    WRITE: "write",
    REG: "reg_write",
    ACTION: "action",
    SYNC_WRITE: "sync_write",
}
"""What all of them call alike."""


def packet(who: int, code: int, params: bytes = b"") -> bytes:
    """Put a packet of DYNAMIXEL 1.0 together, which is Feetech's, too; a status has no other."""
    body = bytes([who, len(params) + 2, code]) + params
    return b"\xff\xff" + body + bytes([COMPLEMENT_SUM(body)])


def flags(*names: str) -> Callable[[int], tuple[str, ...]]:
    """Return what names the bits of an error that are set; a bit without a name is empty."""
    return lambda status: tuple(n for bit, n in enumerate(names) if n and status >> bit & 1)


@dataclass(frozen=True)
class ByAddress:
    """What is said in one of these protocols.

    ``names`` are its instructions, ``errors`` the names of an error, ``refusals`` its bits that say
    that nothing was done, ``width`` the bytes of an address and of a length. ``alike``: nothing in
    a packet tells its direction.
    """

    model: str
    names: Mapping[int, str]
    errors: Callable[[int], tuple[str, ...]]
    refusals: int = 0
    packet: Callable[[int, int, bytes], bytes] = packet
    status: Callable[[int, int, bytes], bytes] = packet
    width: int = 1
    alike: bool = True

    def say(self, who: int, code: int, params: bytes = b"") -> bytes:
        """Put an instruction together."""
        return self.packet(who, code, params)

    def number(self, value: int) -> bytes:
        """Return an address or a length as it stands in a packet."""
        return value.to_bytes(self.width, "little")

    def read(
        self, who: int, address: int, data: bytes, status: int = 0, by: int | None = None
    ) -> Exchange:
        """Read registers."""
        labels = {} if self._is_instruction(status, data) else stated(self.model, address, data)
        request = self.say(who, READ, self.number(address) + self.number(len(data)))
        answer = self.status(who if by is None else by, status, data)
        return Exchange("read", request, (answer,), labels, self.errors(status), due=True)

    def table(self) -> list[Exchange]:
        """Read all registers of the model, whole and in halves."""
        whole = [(at, bytes(k * 7 % 251 for k in range(n))) for at, n in blocks(self.model)]
        parts = [(at, bytes(k * 5 % 251 for k in range(n))) for at, n in halves(self.model)]
        return [self.read(1, at, data) for at, data in whole + parts]

    def like_packets(self, address: int, header: bytes) -> list[Exchange]:
        """Read what looks like the next packet, whole or in part, wherever in the data."""
        asked = self.packet(1, PING, b"")
        behind = b"\x01" + header + b"\x01\x02", b"\x01\x02\x03" + header
        return [self.read(1, address, data) for data in (header + b"\x01\x02", *behind, asked)]

    def read_failed(self, who: int, address: int, length: int, status: int) -> Exchange:
        """Read registers; an error without any data answers."""
        request = self.say(who, READ, self.number(address) + self.number(length))
        return Exchange("read", request, (self.status(who, status, b""),), {}, self.errors(status))

    def write(
        self,
        who: int,
        address: int,
        data: bytes,
        status: int = 0,
        by: int | None = None,
        code: int = WRITE,
    ) -> Exchange:
        """Write registers, at once or with an action; what is refused does not become true."""
        labels = {} if status & self.refusals else stated(self.model, address, data)
        answer = self.status(who if by is None else by, status, b"")
        request = self.say(who, code, self.number(address) + data)
        return Exchange(self.names[code], request, (answer,), labels, self.errors(status))

    def told(self, who: int, address: int, data: bytes, code: int = WRITE) -> Exchange:
        """Write registers; nobody answers."""
        request = self.say(who, code, self.number(address) + data)
        return Exchange(self.names[code], request, (), stated(self.model, address, data))

    def plain(
        self, who: int, code: int, by: int | None = None, status: int = 0, params: bytes = b""
    ) -> Exchange:
        """Say an instruction about no register."""
        answer = self.status(who if by is None else by, status, b"")
        request = self.say(who, code, params)
        errors = self.errors(status)
        return Exchange(self.names[code], request, (answer,), {}, errors, due=code == PING)

    def unanswered(self, who: int, code: int, params: bytes = b"") -> Exchange:
        """Say an instruction about no register that the servo need not answer; it does not."""
        return Exchange(self.names[code], self.say(who, code, params), (), {})

    def to_all(self, code: int, params: bytes = b"") -> Exchange:
        """Say an instruction about no register to all; nobody answers."""
        return self.unanswered(ALL, code, params)

    def sync_write(self, address: int, *targets: tuple[int, bytes]) -> Exchange:
        """Write the same registers of several servos; nobody answers."""
        labels: dict[Label, int] = {}
        for servo, data in targets:
            labels |= stated(self.model, address, data, servo)
        rest = b"".join(bytes([servo]) + data for servo, data in targets)
        params = self.number(address) + self.number(len(targets[0][1])) + rest
        return Exchange(self.names[SYNC_WRITE], self.say(ALL, SYNC_WRITE, params), (), labels)

    def sync_read(self, address: int, *targets: tuple[int, int, bytes]) -> Exchange:
        """Read the same registers of several servos, each by its id, error and data, in turn."""
        head = self.number(address) + self.number(len(targets[0][2]))
        params = head + bytes(servo for servo, _, _ in targets)
        each = [(servo, address, status, data) for servo, status, data in targets]
        return self.several(SYNC_READ, params, *each)

    def several(self, code: int, params: bytes, *told: tuple[int, int, int, bytes]) -> Exchange:
        """Ask several servos: each answers by its id, what was asked for, its error and data."""
        labels: dict[Label, int] = {}
        for servo, address, _, data in told:
            labels |= stated(self.model, address, data, servo)
        answers = tuple(self.status(servo, status, data) for servo, _, status, data in told)
        errors = tuple(name for _, _, status, _ in told for name in self.errors(status))
        return Exchange(self.names[code], self.say(ALL, code, params), answers, labels, errors)

    def odd(self, code: int, params: bytes, who: int = 1) -> Exchange:
        """Say an instruction with too few or too many parameters."""
        return Exchange(self.names[code], self.say(who, code, params), None)

    def _is_instruction(self, code: int, data: bytes) -> bool:
        """Tell whether a status packet would do as an instruction: then no values are read."""
        fits = {READ: len(data) == 2, WRITE: len(data) > 1, REG: len(data) > 1}
        return self.alike and fits.get(code, code in self.names and not data)
