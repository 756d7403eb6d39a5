"""Words for people on the line: a program prints what it does on the port that the servos are on."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING, Final

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.evidence.placed import finding_of
from sniffer.diagnosis.ledger.damage import HELD

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.diagnosis.model import Finding
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final = (
    FindingCode(
        "text-sent",
        "Text for people stands between the frames: messages of a program, or of a board that starts.",
        "Pieces of no frame that touch each other are read as one. Most bytes of no frame are in pieces of letters, digits and signs alone that have words: a letter and three small ones or more, as no command has and noise hardly ever leaves, or, where frames are of bytes, five lines with a letter and their end; 24 bytes of them and more.",
        settle="Print one line more or less in the program: the bytes follow it.",
        remedy="Print messages on another port than that of the bus, or leave them out; let the servos start after the controller's boot messages.",
    ),
)

WORD: Final = re.compile(rb"[A-Za-z][a-z]{3,}")
"""Commands in letters (LSS) have words too, but in small letters hardly any client writes them: noise
makes a small letter of one, not of four in a row."""

PRINTED: Final = re.compile(rb"[A-Za-z][^\n]{3,}\n")
SEVERAL: Final = 5
"""Lines with a letter and their end, 'pos: 512', and how many of them are no damage where frames are
of bytes: that a piece of noise of that length is one has a chance of one in ten thousand."""

PLAIN: Final = bytes([9, 10, 13, *range(32, 127)])
"""What text is of."""

LEAST: Final = 24
"""Bytes of text: that so many bytes of noise are all plain has a chance of one in ten billion."""

MOST: Final = 0.5
"""Part of the bytes of no frame that text must be: else it tells of part of the damage alone."""

BLANK: Final = 1
"""Bytes between two pieces of one text: a blank, which some protocols read over between frames."""

SHOWN: Final = 48
"""Characters of a text that are shown."""


def text_sent(case: Case) -> Iterator[Finding]:
    """Text that stands where frames belong."""
    told = (d for d in case.damages if d.turn != HELD)
    kept = [(run, _joined(run)) for run in _runs(told)]
    plain = [(run, got) for run, got in kept if not got.translate(None, PLAIN)]
    worded = [(run, got) for run, got in plain if WORD.search(got)]
    printed = [(run, got) for run, got in plain if WORD.search(got) or PRINTED.search(got)]
    if len(printed) >= SEVERAL and _is_binary(case):
        worded = printed
    size = sum(len(got) for _, got in worded)
    # what is left of a text when an answer came into it has no word
    other = sum(len(got) for _, got in kept) - sum(len(got) for _, got in plain)
    if size < LEAST or size < MOST * (size + other):
        return
    lines = dict.fromkeys(_lines(got for _, got in worded))
    said = ", ".join(f"'{line}'" for line in list(lines)[:3])
    yield finding_of(
        [run[0] for run, _ in worded],
        "text-sent",
        None,
        f"{len(worded)} pieces that are no frame are text: {said}",
        "text, and no frame",
        strength=min(0.7 + size / 400, 1.0),
        brief=f"text between frames: '{next(iter(lines))}'",
    )


def _is_binary(case: Case) -> bool:
    """Tell whether requests are no text: torn lines of text look as printed ones."""
    requests = case.ledger.exchanges.kinds.requests
    return bool(requests) and all(request.translate(None, PLAIN) for request in requests)


def _runs(damages: Iterable[Damage]) -> Iterator[list[Damage]]:
    """Yield damaged places that touch each other together: a line's end may part them."""
    run: list[Damage] = []
    for d in damages:
        if run and d.at - run[-1].at - run[-1].length > BLANK:
            yield run
            run = []
        run.append(d)
    if run:
        yield run


def _joined(run: Sequence[Damage]) -> bytes:
    """Return the bytes of pieces that touch each other."""
    parts = [run[0].got]
    for before, d in pairwise(run):
        parts += [b" " * (d.at - before.at - before.length), d.got]
    return b"".join(parts)


def _lines(texts: Iterator[bytes]) -> Iterator[str]:
    """Yield the lines with words, shortened; numbers in them differ from time to time."""
    for got in texts:
        for line in got.splitlines():
            if WORD.search(line) or PRINTED.search(line + b"\n"):
                yield line.strip()[:SHOWN].decode("ascii")


RULES: Final[tuple[Rule, ...]] = (text_sent,)
"""The rules of this area."""
