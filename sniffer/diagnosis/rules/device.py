"""What servos do: follow or not, sag, heat, restart, complain."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "voltage-sag",
        "device",
        "The supply voltage that a servo measures falls far below what it usually is.",
        "A bucket of a quarter second with a voltage more than a tenth below the servo's median.",
    ),
)

SAG: Final = 0.10
"""Part of the usual voltage; a servo's own load moves it by some hundredths."""


def voltage_sag(case: Case) -> Iterator[Finding]:
    """Servos whose supply falls."""
    for servo in case.measured_by("voltage"):
        v = case.series(servo, "voltage")
        if v is None or len(v) < 4:
            continue
        usual = float(np.median(v.mean))
        low = np.flatnonzero(v.low < (1 - SAG) * usual)
        if not len(low):
            continue
        least = float(v.low[low].min())
        yield Finding(
            "voltage-sag",
            servo,
            int(v.t_first[low[0]]),
            int(v.t[low[-1]]),
            len(low),
            f"servo {servo} measures {v.told(least)} at least, usually {v.told(usual)}",
            tuple(
                Place(int(v.at[r]), 1, int(v.t_first[r]), f"voltage {v.told(v.low[r])}")
                for r in low[:3]
            ),
            brief=f"supply of servo {servo} sags to {v.told(least)}",
        )


RULES: Final[tuple[Rule, ...]] = (voltage_sag,)
"""The rules of this area."""
