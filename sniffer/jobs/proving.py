"""Whether an input is anything, looked at before a file is replaced by what is made of it."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING

from sniffer.decoding.pipeline import Pipeline
from sniffer.ground.files import files_of, occupied
from sniffer.ground.model import DamagedInputError, InputError
from sniffer.jobs.order import merged
from sniffer.jobs.session import nothing_in
from sniffer.jobs.telling import Teller
from sniffer.sinks import BYTES
from sniffer.sources.several import name_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.options import Options
    from sniffer.sources import Source


def prove(
    opened: Source, inputs: Sequence[str | Path], outputs: Sequence[Path], options: Options
) -> None:
    """Refuse an input of which nothing can be decoded, where an output would be replaced by that.

    It is read as far as the first frames of a bus. What can be read once is not looked at, nor what
    becomes a file of the bytes alone, whoever's they are.

    Raises:
        InputError: there is nothing in it, or its protocol cannot be told.
    """
    made = [path for path in outputs if path.suffix.lower() not in BYTES]
    replaced = any(occupied(file) for path in made for file in files_of(path))
    if not replaced or not all(Path(one).is_file() for one in inputs):
        return
    pipeline = Pipeline(options.with_facts(opened.facts(), opened.tables), [])
    with contextlib.suppress(DamagedInputError):  # it comes again when it is read to be written
        for group in merged(opened, opened, options, Teller(lambda line: None, quiet=True)):
            pipeline.feed(group)
            if pipeline.summary.buses:
                return
    pipeline.close()
    if not pipeline.summary.buses:
        raise InputError(nothing_in(name_of(inputs), None, opened.notes))
