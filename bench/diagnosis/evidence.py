"""Which host can show which fault, and where the wire alone cannot tell two causes apart.

What is excused here is no miss; a wrong verdict there still is wrong.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bench.diagnosis.scenario import Truth

_NO_CLOCK: Final = "it is a matter of time, and the input has none"
_MERGED: Final = "it is shorter than the host holds bytes"

UNSHOWN: Final[Mapping[tuple[str, str], str]] = MappingProxyType(
    {
        **{
            ("raw", cause): _NO_CLOCK
            for cause in (
                "slow-servo",
                "controller-stall",
                "controller-jitter",
                "bus-saturated",
                "impatient-controller",
                "emi-load",
                "two-masters",
                "brownout",
                "stall",
                "tap-swapped",
            )
        },
        **{
            ("usb16", cause): _MERGED
            for cause in ("slow-servo", "controller-jitter", "impatient-controller")
        },
        ("usb16", "tap-swapped"): "the stream of one adapter names no wires",
        ("log", "line-stuck"): "a byte of 00 and a pause: the missing stop bit is not in the text",
        ("raw", "line-stuck"): "a byte of 00: neither the pause nor the stop bit is in the file",
    }
)
"""Why a host cannot show a cause."""

NO_CHECKSUM: Final[Mapping[tuple[str, str, str], str]] = MappingProxyType(
    {
        (host, "clock-drift", "wck"): "its answers have no checksum, and stop bits are not told of"
        for host in ("usb16", "log", "raw")
    }
)
"""Why a host cannot show a cause in a protocol."""

ALSO_RIGHT: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        # requests hold, nobody ever answers: rates, a cut wire, a dead supply look all the same
        "wrong-baud-controller": ("tap-one-way",),
        # a driver that lets go too early: edges to one, the switching of the direction to another
        "signal-integrity-last-byte": ("turnaround",),
        # it states no voltage: once away, whatever it lacked
        "servo-outage-wck": ("brownout",),
    }
)
"""By how a scenario's name begins, what is as right in the first place, if the truth is listed."""


FINDINGS: Final[Mapping[tuple[str, str], tuple[str, ...]]] = MappingProxyType(
    {
        ("bus-noise", ""): ("damage-everywhere", "strays-anywhere"),
        ("signal-integrity", "signal-integrity-last-byte"): ("last-byte-torn",),
        ("turnaround", "turnaround-first-byte"): ("first-byte-torn", "damage-in-answers"),
        ("turnaround", "turnaround-stray"): ("strays-at-turn",),
        ("clock-drift", "clock-drift"): ("damage-one-servo", "last-bits"),
        ("echo", ""): ("adapter-echo",),
        ("tap-loss", "tap-loss-told"): ("bytes-lost",),
        ("tap-swapped", ""): ("direction-mismatch",),
        ("tap-one-way", "tap-one-way-requests"): ("no-answer-heard",),
        ("tap-one-way", "tap-one-way-answers"): ("no-request-heard",),
        ("bad-cable", "bad-cable-falls-out"): ("away-for-a-while",),
    }
)
"""By cause and how a scenario's name begins: the findings that must be there, where its truth names
none."""

UNHEARD: Final = frozenset((host, code) for host in ("log", "raw") for code in ("bytes-lost",))
"""Findings that a host cannot hand on: the driver's own words are not in its format."""


def findings(truth: Truth, name: str, host: str) -> tuple[str, ...]:
    """Return the findings that must be there."""
    known = truth.findings or next(
        (
            codes
            for (cause, start), codes in FINDINGS.items()
            if cause == truth.cause and name.startswith(start)
        ),
        (),
    )
    return tuple(code for code in known if (host, code) not in UNHEARD)


def excuse(truth: Truth, host: str, protocol: str) -> str:
    """Return why a host cannot show a fault; nothing where it can."""
    known = UNSHOWN.get((host, truth.cause), "")
    return known or NO_CHECKSUM.get((host, truth.cause, protocol), "")


def accepted(truth: Truth, name: str) -> tuple[str, ...]:
    """Return the causes that are right in the first place."""
    also = next((more for start, more in ALSO_RIGHT.items() if name.startswith(start)), ())
    return (truth.cause, *also)
