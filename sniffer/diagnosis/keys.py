"""Requests by number: one for a servo and a command, one for those that are alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import I64


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
