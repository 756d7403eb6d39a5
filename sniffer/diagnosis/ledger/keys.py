"""Requests by number: one for a servo and a command, one for those that are alike."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import I64

_STEPS: Final = tuple(
    np.uint64(step) for step in (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)
)
"""Odd numbers of 64 bits, by which keys are spread over the slots. Source: primes of xxHash."""

SLOTS: Final = 1 << 16
"""Two of fifty keys fall on one slot in one bus of fifty."""


def slots(first: I64, second: I64, *third: I64) -> I64:
    """Return one of ``SLOTS`` for each row of up to three columns: equal rows have the same."""
    key = first.view(np.uint64) * _STEPS[0] ^ second.view(np.uint64) * _STEPS[1]
    for column in third:
        key ^= column.view(np.uint64) * _STEPS[2]
    spread: I64 = (key >> np.uint64(48) ^ (key >> np.uint64(20) & np.uint64(0xFFFF))).astype(
        np.int64
    )
    return spread


def pair_key(servo_id: I64, op: I64) -> I64:
    """Return one number for a servo and a command, of which its last 32 bits."""
    return (servo_id + 1) << 32 | op & 0xFFFFFFFF


def pair_of(key: int) -> tuple[int, int]:
    """Return the servo and the command of a ``pair_key``; a command may be negative."""
    op = key & 0xFFFFFFFF
    return (key >> 32) - 1, op - (1 << 32) if op >> 31 else op


def request_key(servo_id: I64, op: I64, address: I64) -> I64:
    """Return one number for requests that are alike: a servo, a command and an address."""
    key: I64 = pair_key(servo_id, op) << 16 | np.maximum(address, 0) & 0xFFFF
    return key


def requested_of(key: int) -> int:
    """Return the servo of a ``request_key``."""
    return pair_of(key >> 16)[0]
