"""Values in whole thousandths of their unit: sums of whole numbers are the same in any order."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

if TYPE_CHECKING:
    from sniffer.ground.model import F64, I64

MILLI: Final = 1000

MOST: Final = 1 << 52
"""Thousandths beyond which nothing is measured, of any unit: thousands of them add up in 63 bits.
A torn answer in text may state any number of digits."""


def in_milli(value: F64 | I64, most: int = MOST) -> I64:
    """Return values in thousandths, those beyond ``most`` as that."""
    return np.clip(np.rint(value * float(MILLI)), -most, most).astype(np.int64)
