"""Whether a port runs at the baud rate that was asked for.

Drivers differ in what they report: some the rate that the chip makes (CP210x, PL2303), some the one
that was asked for, whatever the chip makes of it (8250), and most fall back to a rate of their own
where they cannot do it at all (FTDI to 9600, 8250 to the one before).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from sniffer.ground.model import InputError
from sniffer.ports.base import shown

if TYPE_CHECKING:
    from sniffer.ports.kernel import Divider, LineSettings
    from sniffer.ports.listing import PortInfo

BAUD_OFF: Final = 0.02
"""How far a baud rate may be off: sampled in mid-bit, the last bit of ten is wrong at 5 %, and the
sender has its own error (Silicon Labs' and FTDI's data sheets advise 2 to 3 %)."""

PLAIN_UARTS: Final = ("8250", "16450", "16550", "16550A")
"""Those that divide one clock by a whole number. Others of the family have fractions of it, or
change the clock."""

PLAIN_DRIVERS: Final = ("serial", "serial8250")
"""The 8250 driver on PCI, PnP and the ports of old: its relatives for systems on a chip (such as
dw-apb-uart) report a 16550A, too, and divide otherwise."""

_CUSTOM_BAUD: Final = 38400
"""What setserial's flags put another rate in the place of."""


def divides(info: PortInfo) -> bool:
    """Tell whether it is a UART that divides its clock by a whole number."""
    return info.chip in PLAIN_UARTS and info.driver in PLAIN_DRIVERS


def true_baud(reported: int, divider: Divider) -> int:
    """Return the rate at which a UART runs when its driver reports one.

    As the driver reckons (uart_get_divisor): the divisor is the whole number that is nearest.
    """
    if divider.multiplies and reported > divider.base:
        return reported  # by other means than the divisor
    asked = reported
    if divider.at_38400 is not None and reported == _CUSTOM_BAUD:
        asked = divider.at_38400
    return round(divider.base / max(1, (2 * divider.base + asked) // (2 * asked)))


def refuse_other(name: str, baud: int, got: LineSettings, divider: Divider | None = None) -> int:
    """Return the rate at which the port runs; refuse one that is not what was asked for.

    Args:
        name: the port's name, for the message.
        baud: what was asked for.
        got: what the driver reports.
        divider: how the UART makes its rate, if it is one that divides.

    Raises:
        InputError: it is more than ``BAUD_OFF`` off, or not 8N1.
    """
    if not got.is_8n1:
        raise InputError(f"{shown(name)}: the adapter cannot do 8N1; use another one")
    if abs(got.ispeed - baud) > BAUD_OFF * baud:
        raise InputError(
            f"{shown(name)}: the adapter cannot do {baud} baud, and its driver has set "
            f"{got.ispeed} instead; use another adapter or baud rate"
        )
    true = got.ispeed if divider is None else true_baud(got.ispeed, divider)
    if divider is not None and abs(true - baud) > BAUD_OFF * baud:
        raise InputError(
            f"{shown(name)}: this UART cannot do {baud} baud: it divides {divider.base} by a whole "
            f"number, and would run at {true}; use another adapter or baud rate"
        )
    return true
