"""A capture, or a part of it, decoded into one sink: for jobs that tell what they heard."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.jobs.convert import convert
from sniffer.jobs.session import undecided_of
from sniffer.sources.several import name_of

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sniffer.decoding.options import Options
    from sniffer.decoding.sink import Sink
    from sniffer.jobs.convert import Converted
    from sniffer.jobs.session import Patience
    from sniffer.jobs.telling import Teller
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection


def hear_part(
    source: str | Path | Sequence[str | Path],
    sink: Sink,
    options: Options | None = None,
    *,
    input_format: str = "auto",
    window: Window | None = None,
    selection: Selection | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Converted:
    """Decode a capture into a sink; return its totals, and how it ended.

    Arguments as of ``sniffer.stats``.

    Raises:
        InputError: the input cannot be read, its protocol cannot be told, or the window is empty.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    with undecided_of(name_of(source), leads=True):
        return convert(
            source,
            (),
            options,
            input_format=input_format,
            sinks=[sink],
            window=window,
            selection=selection,
            patience=patience,
            tell=tell,
        )
