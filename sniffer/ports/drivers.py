"""What each of Linux' serial drivers tells about errors of the line, and how.

A driver that tells nothing looks like a line without errors: its counters, where it answers for
them at all, stay at nought for ever. So what a driver is able to tell is written down here, from
the drivers' sources and from what they did with errors on demand (``rig/``), and what nobody knows
is None.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ports.listing import UARTS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.ports.listing import PortInfo


@dataclass(frozen=True, slots=True)
class Tells:
    """What is told of line errors: True, False, or None where it is not known.

    Args:
        marks: whether bytes with errors are marked in the stream.
        counts: whether the driver's counters rise with them, and with bytes that were lost.
        words: the same for people.
        counts_sent: whether the driver counts the bytes that it sends. Most answer for that, too,
            with a nought that never changes.
    """

    marks: bool | None
    counts: bool | None
    words: str
    counts_sent: bool = False


NO_LINE: Final = Tells(True, False, "none: a pseudo terminal has no line")
"""A program is at the other end: none being marked, there are none."""

UART: Final = Tells(True, True, "marked; counted", counts_sent=True)
"""A UART on board: its status register has the error of each byte (serial8250_rx_chars, pl011)."""

UNHEARD: Final = Tells(None, None, "unknown: nobody has tried what this driver tells")

DRIVERS: Final[Mapping[str, Tells]] = MappingProxyType(
    {
        # ftdi_process_packet: one status for the packet, put on each of its bytes, counted once;
        # ftdi_prepare_write_buffer counts what is sent
        "ftdi_sio": Tells(
            True, True, "marked, for each packet of the adapter; counted", counts_sent=True
        ),
        # cp210x_enable_event_mode; a chip that answers for its part number with one byte is a copy,
        # and is not asked for events. From outside it looks the same.
        "cp210x": Tells(
            None, None, "unknown: a genuine chip has them marked and counted, a copy tells nothing"
        ),
        # ch341_update_status reads modem lines only
        "ch341-uart": Tells(False, False, "unknown: this driver tells of none"),
        # pl2303_process_read_urb: the status comes by another way than the bytes, and is put on the
        # packet that is read next; there is no get_icount
        "pl2303": Tells(
            True, False, "marked, for a packet of the adapter or the next one; not counted"
        ),
        # acm_process_notification: if the device's firmware sends SERIAL_STATE, and most do not
        "cdc_acm": Tells(None, None, "unknown: counted if the device tells of them; breaks marked"),
    }
)
"""By the driver's name in sysfs."""


def tells(info: PortInfo) -> Tells:
    """Return what is told of line errors on a port of this machine."""
    if not info.usb and info.chip in UARTS.values():
        return UART
    return DRIVERS.get(info.driver, UNHEARD)
