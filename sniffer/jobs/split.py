"""``sniffer.split``: a capture as several that lie side by side, by time or by bus."""

from __future__ import annotations

import functools
import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from sniffer.decoding.parting import Splitter
from sniffer.decoding.pipeline import Options
from sniffer.decoding.spans import PieceRow
from sniffer.ground.files import called, files_of, numbered, paths_of
from sniffer.ground.model import SnifferError
from sniffer.ground.wording import and_, in_file_name
from sniffer.jobs.anonymous import anonymous
from sniffer.jobs.asked import Extract
from sniffer.jobs.convert import convert_opened
from sniffer.jobs.cut import found
from sniffer.jobs.order import merged
from sniffer.jobs.outputs import check_outputs
from sniffer.jobs.session import Ending, undecided_of
from sniffer.jobs.telling import Teller
from sniffer.sources.several import inputs_of, joined, name_of, open_capture

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from sniffer.jobs.convert import Converted
    from sniffer.jobs.cut import CutPart
    from sniffer.jobs.session import Patience
    from sniffer.selection.places import Window
    from sniffer.sources import Source

MOST: Final = 1000
"""So many pieces at most: nobody looks at more files."""


@dataclass(frozen=True, slots=True)
class SplitPiece:
    """A piece that was written: its files, and how that went."""

    files: tuple[Path, ...]
    done: Converted


def split(
    source: str | Path | Sequence[str | Path],
    outputs: str | Path | Sequence[str | Path],
    every_ns: int | None,
    window: Window | None = None,
    options: Options | None = None,
    *,
    buses: Sequence[str] = (),
    input_format: str = "auto",
    anonymise: bool = False,
    overwrite: bool = False,
    patience: Patience | None = None,
    tell: Teller | None = None,
) -> list[SplitPiece]:
    """Split a capture into pieces, each of which says what the whole says there, as ``cut`` does.

    No byte is in two of them. Those by time are called ``-0001`` and on, by how often ``every_ns``
    has passed since the begin of the capture, or of the window; where nothing was said there is no
    piece. Those by bus are called after it.

    Args:
        source: as for ``cut``.
        outputs: how the files are called, but for what tells the pieces apart.
        every_ns: how long a piece is; None: a piece a bus.
        window: which part of the capture; all of it without.
        options: as for ``cut``.
        buses: as for ``cut``.
        input_format: as for ``cut``.
        anonymise: as for ``cut``.
        overwrite: as for ``cut``.
        patience: takes interruptions while it is written; what is left is not begun then.
        tell: as for ``cut``.

    Raises:
        InputError: as ``cut``.
        OutputError: a file is there already, before any is written; or one cannot be written: those
            before it are whole.
        SnifferError: there would be more than 1000 pieces, they have no length, or as ``cut``.
    """
    outputs = paths_of(outputs)
    if every_ns is not None and every_ns < 1:
        raise SnifferError(f"every_ns {every_ns}: a piece has 1 ns at least")
    options = options or Options()
    options.check()
    tell = tell or Teller(lambda line: None, quiet=True)
    inputs = inputs_of(source)
    with (
        undecided_of(name_of(inputs), leads=True),
        open_capture(inputs, input_format, again=True, wiring=options.wired) as opened,
    ):
        options = options.with_facts(opened.facts(), opened.tables)
        pieces = _pieces(opened, joined(inputs), every_ns, window, options, tell, buses)
        if len(pieces) > MOST:
            raise SnifferError(f"that makes {len(pieces)} pieces, {MOST} at most: make them longer")
        row_of_files = _names([*pieces], outputs, is_anonymous=anonymise)
        every = [f for files in row_of_files for path in files for f in files_of(path)]
        check_outputs(every, [*map(str, inputs)], force=overwrite)
        row = None
        if every_ns is not None and not anonymise:  # who looks for serial numbers reads it twice
            row = _row(opened, [*pieces.values()], tell)
        done, names = [], dict[str, str]()
        for nth, (files, piece) in enumerate(zip(row_of_files, pieces.values(), strict=True)):
            once = None if row is None else row.piece(nth)
            derived, own = piece.of(opened, joined(inputs), tell, once)
            if anonymise:
                derived, own = anonymous(derived, own, tell, names)
            converted = convert_opened(
                derived,
                inputs,
                files,
                own,
                overwrite=overwrite,
                patience=patience,
                tell=tell,
            )
            done.append(SplitPiece(tuple(files), converted))
            if converted.ending == Ending.INTERRUPTED:
                break
        if every_ns is not None and (left := _of_another([*pieces], outputs)):
            tell.warn(
                f"behind these stands what is not of this split: {and_([p.name for p in left])}"
            )
        return done


def _of_another(pieces: Sequence[int | str], outputs: Sequence[Path]) -> list[Path]:
    """Return files that stand in the row of the pieces, behind the last one."""
    last = max((piece for piece in pieces if isinstance(piece, int)), default=-1)
    left: list[Path] = []
    for output in outputs:
        row = (numbered(output, n) for n in itertools.count(last + 2))
        left += itertools.takewhile(lambda path: path.exists(), row)
    return left


def _row(opened: Source, pieces: Sequence[CutPart], tell: Teller) -> PieceRow:
    """Return pieces that follow each other, read in one go."""
    heard = merged(opened, opened, pieces[0].whole, tell.quieter())
    return PieceRow(heard, [piece.spans for piece in pieces], pieces[0].byte_ns)


def _names(
    pieces: Sequence[int | str], outputs: Sequence[Path], *, is_anonymous: bool
) -> list[list[Path]]:
    """Return the files of each piece: after the number of a time, from 0, or the name of a bus."""
    names: list[Callable[[Path], Path]] = []
    taken: set[str] = set()
    for nth, piece in enumerate(pieces):
        if isinstance(piece, int):
            names.append(functools.partial(numbered, number=piece + 1))
            continue
        # as the buses in it are called
        name = f"bus{nth}" if is_anonymous else in_file_name(piece)
        while name in taken:
            name += "_"
        taken.add(name)
        names.append(functools.partial(called, apart=name))
    return [[name(path) for path in outputs] for name in names]


def _pieces(
    opened: Source,
    source: str,
    every_ns: int | None,
    window: Window | None,
    options: Options,
    tell: Teller,
    buses: Sequence[str],
) -> dict[int | str, CutPart]:
    """Return the pieces of a capture by the number of a time, or by the name of a bus."""
    asked = (Extract.of(None, window) or Extract()).sought_in(opened, options)
    if every_ns is None:
        whole = found(opened, source, options, asked, tell, buses)
        return {bus: replace(whole, spans={bus: span}) for bus, span in whole.spans.items()}
    splitter = Splitter(every_ns)
    whole = found(opened, source, options, asked, tell, buses, splitter)
    return {
        number: replace(whole, spans=spans, ends=splitter.ends_of(number))
        for number, spans in splitter.pieces(whole.spans).items()
    }
