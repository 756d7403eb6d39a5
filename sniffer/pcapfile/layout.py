"""The numbers of pcapng and of serial captures in it, for those who write, read and dissect them.

Sources: draft-ietf-opsawg-pcapng (blocks, options), draft-ietf-opsawg-pcap (the older format),
www.tcpdump.org/linktypes.html (link types), and for LINKTYPE_RTAC_SERIAL its dissector,
``epan/dissectors/packet-rtacser.c`` of Wireshark.
"""

from __future__ import annotations

import enum
import struct
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import NS, MarkKind

if TYPE_CHECKING:
    from collections.abc import Mapping

RTAC_SERIAL: Final = 250
"""Link type of serial lines: a head of 12 bytes, then what was on the line."""

USER_FIRST, USER_LAST = 147, 162
"""Link types that everybody may use for what he likes."""

USB_LINUX, USB_LINUX_MMAPPED = 189, 220
"""Link types of USB as Linux records it (usbmon), with a head of 48 and of 64 bytes."""

USB_WINDOWS: Final = 249
"""Link type of USB as Windows records it (USBPcap)."""

USB_LINKS: Final = frozenset({USB_LINUX, USB_LINUX_MMAPPED, USB_WINDOWS})

SECTION: Final = 0x0A0D0D0A
INTERFACE: Final = 1
PACKET: Final = 2  # obsolete, and still written by old captures
SIMPLE: Final = 3
ENHANCED: Final = 6
BYTE_ORDER: Final = 0x1A2B3C4D

PCAP_MAGICS: Final[Mapping[bytes, tuple[str, int]]] = MappingProxyType(
    {
        b"\xd4\xc3\xb2\xa1": ("<", 1000),
        b"\xa1\xb2\xc3\xd4": (">", 1000),
        b"\x4d\x3c\xb2\xa1": ("<", 1),
        b"\xa1\xb2\x3c\x4d": (">", 1),
    }
)
"""Order of bytes, and how many ns the fraction of a time counts, by the first bytes of a pcap."""

PCAPNG_MAGIC: Final = SECTION.to_bytes(4, "little")
"""A pcapng, if the order of its bytes follows at 8: a servo bus may say that, too."""

BYTE_ORDERS: Final[Mapping[bytes, str]] = MappingProxyType(
    {BYTE_ORDER.to_bytes(4, "little"): "<", BYTE_ORDER.to_bytes(4, "big"): ">"}
)
"""What a section says of the order of its bytes."""

END_OF_OPTIONS: Final = 0
COMMENT: Final = 1
USER_APPLICATION: Final = 4  # of a section
IF_NAME, IF_DESCRIPTION, IF_SPEED, IF_TSRESOL, IF_TSOFFSET = 2, 3, 8, 9, 14
EPB_FLAGS: Final = 2

FACTS: Final = 0x8053
"""Option of a section and of an interface: facts as JSON, of this tool alone. Codes with the
highest bit set are for local use: other programs pass over them."""

CHUNK_ENDS: Final = 0x8043
"""Option of a packet, of this tool alone: where the chunks end that its bytes came in
(``chunkends.py``)."""

INBOUND, OUTBOUND = 1, 2
"""``epb_flags``, the lowest two bits: to the controller, to the servos."""


class RtacEvent(enum.IntEnum):
    """What an RTAC head says has happened."""

    STATUS_CHANGE = 0
    TX_START = 1
    RX_START = 2
    TX_END = 3
    RX_END = 4
    DATA_LOST = 5
    COMPLETE = 6
    FRAMING_ERROR = 7
    PARITY_ERROR = 8
    BREAK = 9
    OVERFLOW = 10


EVENTS: Final[Mapping[MarkKind, RtacEvent]] = MappingProxyType(
    {
        MarkKind.FRAMING: RtacEvent.FRAMING_ERROR,
        MarkKind.PARITY: RtacEvent.PARITY_ERROR,
        MarkKind.BREAK: RtacEvent.BREAK,
        MarkKind.OVERRUN: RtacEvent.OVERFLOW,
        MarkKind.LOST: RtacEvent.DATA_LOST,
        MarkKind.SKIPPED: RtacEvent.DATA_LOST,
        MarkKind.ENDED: RtacEvent.COMPLETE,
    }
)
"""What a tap tells, as events."""

MARKS: Final[Mapping[RtacEvent, MarkKind]] = MappingProxyType(
    {
        RtacEvent.FRAMING_ERROR: MarkKind.FRAMING,
        RtacEvent.PARITY_ERROR: MarkKind.PARITY,
        RtacEvent.BREAK: MarkKind.BREAK,
        RtacEvent.OVERFLOW: MarkKind.OVERRUN,
    }
)
"""What events of any writer tell of the line."""

PROTOCOLS: Final[Mapping[str, int]] = MappingProxyType(
    {"mightyzap": 1, "lss": 2, "rs30x": 3, "wck": 4}
)
"""Protocols by their number in the footer; 0 is any other."""

RATE: Final = ", rate "
"""In an interface's description, before how its rate is known, where nobody stated it."""

NO_TIMES: Final = ", no times"
"""In an interface's description, where its times are only counted from the bytes."""

WITHIN: Final = ", stamps within "
"""In an interface's description, before how late its stamps may be, in ms."""

HEAD: Final = struct.Struct(">IIBBH")
"""RTAC head: seconds and microseconds, event, control lines, footer."""

_OURS: Final = 0x5


class RtacFooter(NamedTuple):
    """The footer of an RTAC head as this tool writes it, ``0x5bbp``: bus and protocol."""

    bus: int
    protocol: int

    @classmethod
    def of(cls, number: int) -> RtacFooter | None:
        """Return what a footer says, None where another program wrote it."""
        return cls(number >> 4 & 0xFF, number & 0xF) if number >> 12 == _OURS else None

    @property
    def number(self) -> int:
        """The footer's 16 bits."""
        return _OURS << 12 | (self.bus & 0xFF) << 4 | self.protocol


def rtac(t_ns: int, event: RtacEvent, footer: RtacFooter, data: bytes = b"") -> bytes:
    """Return a packet of an RTAC line; ``t_ns`` is when its first byte began."""
    seconds, fraction = divmod(max(t_ns, 0), NS)
    return HEAD.pack(seconds & 0xFFFFFFFF, fraction // 1000, event, 0, footer.number) + data
