"""A capture, or a part of it, decoded into one sink: for jobs that tell what they heard."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.jobs.convert import convert

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.decoding.options import Options
    from sniffer.decoding.sink import Sink
    from sniffer.jobs.session import Ending, Patience
    from sniffer.jobs.telling import Teller
    from sniffer.selection.places import Window


def hear_part(
    source: str | Path,
    sink: Sink,
    options: Options | None = None,
    *,
    input_format: str = "auto",
    window: Window | None = None,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> Ending:
    """Decode a capture into a sink; return how it ended. Arguments as of ``sniffer.diagnose``.

    Raises:
        InputError: the input cannot be read, its protocol cannot be told, or the window is empty.
        SnifferError: unknown protocol or model, or a number that cannot be.
    """
    return convert(
        source,
        (),
        options,
        input_format=input_format,
        sinks=[sink],
        window=window,
        patience=patience,
        tell=tell,
    ).ending
