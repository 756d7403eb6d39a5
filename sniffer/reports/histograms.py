"""Response times of a servo as a histogram with bounds.

A stamp bounds a time from both sides, so there are two histograms: of what each response took at
least, and of what it took at most. The true one lies between. Where stamps are exact they are one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.decoding.durations import BINS_SHOWN, FIGURES
from sniffer.ground.amounts import number
from sniffer.ground.wording import counted
from sniffer.reports import svg
from sniffer.reports.curves import Ink, keys
from sniffer.reports.markup import Markup, tag

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.durations import Quantiles
    from sniffer.ground.model import I64

MS: Final = 1e6

STEPS: Final = ((1,), (1, 2, 5), (1, 1.5, 2, 3, 5, 7))
"""What is labelled of each decade, from the coarsest on: the first with ``LABELS`` is taken."""

LABELS: Final = 3
"""So many labels at least tell where a time stands: with one alone nobody knows the scale."""


class TimeScale:
    """One logarithmic axis for the response times of all servos; ``first`` is its first bin."""

    def __init__(self, all_of_them: Sequence[Quantiles]) -> None:
        most = np.sum([q.histogram()[1] for q in all_of_them], axis=0)
        least = np.sum([q.histogram()[0] for q in all_of_them], axis=0)
        held = np.flatnonzero(most)
        low = np.flatnonzero(least)
        low = low[low > 0]  # what may have taken no time at all stands in the first column
        lowest = min(int(held[0]), int(low[0]) if len(low) else int(held[0]))
        # a bound may be far below the usual time: three octaves of such show what they are
        self.first = max(lowest - 2, int(held[0]) - 3 * BINS_SHOWN, 0)
        self.size = int(held[-1]) - self.first + 2

    def fitted(self, counts: I64) -> I64:
        """Return the columns of the axis; what is shorter than it stands in its first one."""
        out = counts[self.first : self.first + self.size].copy()
        out[0] += counts[: self.first].sum()
        return out

    def share(self, ns: float) -> float:
        """Return where a duration stands, in percent."""
        at = (np.log2(max(ns, 1)) * BINS_SHOWN - self.first) / self.size
        return round(100 * float(min(max(at, 0), 1)), 2)

    def ticks(self) -> list[tuple[float, str]]:
        """Return places in percent and labels in ms: round numbers, as few as tell the scale."""
        low, high = (2 ** ((self.first + k) / BINS_SHOWN) for k in (1, self.size))
        decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
        every = (
            [k * 10.0**d for d in decades for k in chosen if low <= k * 10.0**d <= high]
            for chosen in STEPS
        )
        step = svg.round_up((high - low) / (LABELS + 1))
        even = [k * step for k in range(int(np.ceil(low / step)), int(high / step) + 1)]
        told = next((some for some in every if len(some) >= LABELS), even)
        return [(0.0, "0 ms"), *((self.share(ns), number(ns / MS)) for ns in told)]


def histogram(title: str, times: Quantiles, scale: TimeScale) -> Markup:
    """Return the chart of one servo: both outlines, and p50, p99 and the longest as intervals."""
    least, most = (scale.fitted(counts) for counts in times.histogram())
    highest = int(max(least.max(), most.max()))
    inks = [
        Ink("area atmost", "", svg.outline(most, highest)),
        Ink("line atmost", "took at most", svg.outline(most, highest)),
        Ink("line atleast", "took at least", svg.outline(least, highest)),
    ]
    drawing = tag(
        "svg",
        *(tag("path", d=ink.path, cls=ink.style) for ink in inks),
        view_box=f"0 0 {scale.size} {svg.HEIGHT}",
        preserve_aspect_ratio="none",
        role="img",
        aria_label=f"response times of {title}",
    )
    rows = []
    for name, share in FIGURES.items():
        bounds = times.figure(share)
        if bounds is None:
            continue
        left, right = scale.share(bounds.low), scale.share(bounds.high)
        bar = tag("i", style=f"left:{left}%;width:{max(round(right - left, 2), 0.5)}%")
        rows.append(tag("div", tag("b", name), tag("span", bar), tag("em", f"{bounds.ms()} ms")))
    axis = [tag("span", told, style=f"left:{at}%") for at, told in scale.ticks()]
    return tag(
        "figure",
        tag("figcaption", tag("b", title), f" {counted(times.count, 'answer')} ", *keys(inks)),
        tag("div", tag("div", cls="levels"), drawing, cls="plot"),
        tag("div", *axis, cls="times"),
        tag("div", *rows, cls="intervals"),
        cls="track histogram",
    )
