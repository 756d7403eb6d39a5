"""What a source says, in the order in which it was said."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.decoding.pipeline import Options
    from sniffer.ground.model import Chunk
    from sniffer.jobs.telling import Teller
    from sniffer.sources import Source


def merged(
    source: Source, groups: Iterable[Sequence[Chunk]], options: Options, tell: Teller
) -> Iterable[Sequence[Chunk]]:
    """Return the groups of a source; lines of two taps that their host mixed are merged."""
    if not source.is_mixed:
        return groups
    from sniffer.merging.wires import in_order

    return in_order(groups, options, tell.talk)
