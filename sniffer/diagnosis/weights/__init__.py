"""What each finding counts for and against each cause, and why: the table of the weighing."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.causes import CAUSES
from sniffer.diagnosis.weights import (
    controller,
    device,
    driver,
    identity,
    line,
    missing,
    outage,
    proven,
    tap,
    wire,
)
from sniffer.diagnosis.weights.table import KEY, Weight

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence


_AREAS: Final = (
    *tap.WEIGHTS,
    *line.WEIGHTS,
    *driver.WEIGHTS,
    *wire.WEIGHTS,
    *device.WEIGHTS,
    *identity.WEIGHTS,
    *controller.WEIGHTS,
    *missing.WEIGHTS,
    *outage.WEIGHTS,
    *proven.WEIGHTS,
)
"""All lines of all areas; none stands in two."""

NOISE, INTERFERENCE = "bus-noise", "emi-load"


def _as_of_noise(lines: Sequence[Weight]) -> Iterator[Weight]:
    """Yield what tells noise from others for interference, too: they differ in when they come."""
    own = {w.finding for w in lines if w.cause == INTERFERENCE}
    for w in lines:
        if w.cause == NOISE and w.finding not in own:
            yield w._replace(cause=INTERFERENCE)


EVERYWHERE, UNDECIDED = "damage-everywhere", "damage-undecided"

ONE_WAY: Final = 0.6
"""How much it counts that chance may have hit answers only, or requests only, so few they are."""


def _as_everywhere(lines: Sequence[Weight]) -> Iterator[Weight]:
    """Yield what damage of everybody counts for damage of which nothing tells whom it spares."""
    for w in lines:
        if w.finding == EVERYWHERE:
            weight = ONE_WAY * w.weight
            reason = "nobody is known to be spared" if w.is_key else w.reason
            yield Weight(w.cause, UNDECIDED, weight, reason, weight >= KEY)


_OF_NOISE: Final = (*_AREAS, *_as_of_noise(_AREAS))

LINES: Final = (*_OF_NOISE, *_as_everywhere(_OF_NOISE))
"""The same, and what interference has as noise has it, and what few torn frames count."""


def _by_cause() -> Mapping[str, Mapping[str, Weight]]:
    out: dict[str, dict[str, Weight]] = {slug: {} for slug in CAUSES}
    for weight in LINES:
        out[weight.cause][weight.finding] = weight
    return MappingProxyType({slug: MappingProxyType(rows) for slug, rows in out.items()})


WEIGHTS: Final = _by_cause()
"""Cause -> finding -> weight."""


def markdown() -> str:
    """Return the table as the page ``docs/weighing.md``."""
    lines = [
        "# The weighing",
        "",
        "What each finding (or anomaly) counts for a cause, about as the logarithm of how much",
        "likelier it makes it; a finding that was seen a few times only counts part of it. *Before* is",
        "what a cause has before anything is known. A cause is considered where a finding in **bold**",
        "is there. `sniffer diagnose FILE --why ID` shows this table filled in.",
        "",
    ]
    for slug, cause in CAUSES.items():
        lines += [
            f"## {slug}",
            "",
            "| counts | finding | because |",
            "|---|---|---|",
            f"| {cause.prior:+.1f} | before | {cause.title} |",
        ]
        for w in sorted(WEIGHTS[slug].values(), key=lambda w: -w.weight):
            name = f"**`{w.finding}`**" if w.is_key else f"`{w.finding}`"
            lines.append(f"| {w.weight:+.1f} | {name} | {w.reason} |")
        lines.append("")
    return "\n".join(lines).rstrip() + "\n"
