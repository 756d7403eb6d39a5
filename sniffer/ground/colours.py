"""The colours of servos, the same in every picture of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

Rgb = tuple[int, int, int]

PALETTE: Final[Sequence[Rgb]] = tuple(
    (code >> 16, code >> 8 & 255, code & 255)
    for code in (
        *(0x4C9BE8, 0xFF9F40, 0x58C472, 0xF0556B, 0xB48CF2, 0x3FD0D4, 0xF2D64B, 0xE87BC8),
        *(0xA6D854, 0xC49A6C, 0x9CCBFF, 0xFFA79C, 0x2FA58E, 0x7F6BFF, 0xB3A83B, 0xC75B8A),
        *(0x9CF0C5, 0xC8692E, 0xD9C6FF, 0x3E8F4A, 0x6E93B5, 0xD9A400, 0xFF4FA3, 0xD0D0D0),
    )
)
"""One colour a servo, told apart on a dark ground; servo 1 has the first."""

GREY: Final[Rgb] = (160, 170, 190)
"""What is no servo's: how much is said on a line."""


class Colours:
    """Gives each servo id a colour; the same id has the same colour in every recording.

    Only where two ids of one recording meet on a colour does the later one take the next free.
    """

    def __init__(self) -> None:
        self._slot: dict[int, int] = {}

    def of(self, servo_id: int) -> Rgb:
        """Return the servo's colour."""
        slot = self._slot.get(servo_id)
        if slot is None:
            taken = set(self._slot.values())
            first = (servo_id - 1) % len(PALETTE)
            slots = ((first + k) % len(PALETTE) for k in range(len(PALETTE)))
            slot = next((k for k in slots if k not in taken), first)
            self._slot[servo_id] = slot
        return PALETTE[slot]
