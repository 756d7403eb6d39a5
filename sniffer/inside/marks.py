"""Marks that somebody set, with a note each, in a file beside the capture."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.files import writing
from sniffer.ground.model import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.inside.index import CaptureIndex

SUFFIX: Final = ".marks.jsonl"
"""Of the file beside a capture."""


class NotedMark(NamedTuple):
    """A place in a capture: ``offset`` counts bytes of its bus."""

    t_ns: int
    bus: str
    offset: int
    note: str


def marks_file(capture: Path) -> Path:
    """Return where the marks of a capture are kept."""
    return capture.with_name(capture.name + SUFFIX)


def read_marks(path: Path) -> list[NotedMark]:
    """Return the marks of a file, none where there is no such file.

    Raises:
        InputError: it is no file of marks.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: the marks cannot be read ({error})") from None
    out = []
    for number, line in enumerate(text.splitlines(), 1):
        try:
            told = json.loads(line)
            out.append(
                NotedMark(
                    int(told["t_ns"]), str(told["bus"]), int(told["offset"]), str(told["note"])
                )
            )
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path}, line {number}: this is no mark") from None
    return out


def write_marks(path: Path, marks: list[NotedMark]) -> None:
    """Write marks in the order of time; no file is left where there are none.

    Raises:
        OutputError: it cannot be written.
    """
    with writing(path):
        if not marks:
            path.unlink(missing_ok=True)
            return
        fresh = path.with_name(path.name + ".new")
        lines = (json.dumps(mark._asdict(), ensure_ascii=False) for mark in sorted(marks))
        fresh.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        fresh.replace(path)


def mark_at(index: CaptureIndex, line: int, note: str) -> NotedMark:
    """Return a mark at a line."""
    one = index.lines[line]
    return NotedMark(int(one["t"]), index.buses[int(one["bus"])], int(one["at"]), note)
