"""RESULTS.md by its sections: those of one program are written anew, all others stay."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Sequence

RESULTS: Final = Path(__file__).parent / "RESULTS.md"
NOTES: Final = Path(__file__).parent / "NOTES.md"

LIVE: Final = "## Live"
"""How the titles begin of what is measured on a recording that is being made."""


def sections(text: str) -> list[str]:
    """Return what stands before the first title of the second order, then each section."""
    out: list[list[str]] = [[]]
    for line in text.splitlines():
        if line.startswith("## "):
            out.append([])
        out[-1].append(line)
    return ["\n".join(lines).rstrip() + "\n" for lines in out]


def live() -> list[str]:
    """Return the sections about live recordings as they are."""
    if not RESULTS.exists():
        return []
    return [s for s in sections(RESULTS.read_text(encoding="utf-8")) if s.startswith(LIVE)]


def put(lines: Sequence[str], *, title: str) -> None:
    """Put a section in the place of the one whose title begins so, or behind the measurements."""
    text = RESULTS.read_text(encoding="utf-8")
    notes = sections(NOTES.read_text(encoding="utf-8"))[1:]
    new = "\n".join(lines).rstrip() + "\n"
    kept = [s for s in sections(text) if s.split("\n", 1)[0] not in _titles(notes)]
    found = [n for n, section in enumerate(kept) if section.startswith(title)]
    if found:
        kept[found[0]] = new
    else:
        kept.append(new)
    RESULTS.write_text("\n".join([*kept, *notes]), encoding="utf-8")


def _titles(parts: Sequence[str]) -> set[str]:
    return {part.split("\n", 1)[0] for part in parts}
