"""Marks that somebody set, with a note each: in a file beside the capture, or in the recording.

While it is looked at, they stand beside; a recording takes them when that is over.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from sniffer.ground.files import writing
from sniffer.ground.model import InputError
from sniffer.messages import MAGIC

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
        with path.open(encoding="utf-8") as file:
            lines = list(file)  # a note may hold what ends a line elsewhere: U+2028
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: the marks cannot be read ({error})") from None
    out = []
    for number, line in enumerate(lines, 1):
        try:
            out.append(_mark(json.loads(line)))
        except (ValueError, KeyError, TypeError):
            raise InputError(f"{path}, line {number}: this is no mark") from None
    return out


def marks_of(capture: Path) -> list[NotedMark]:
    """Return the marks of a capture: those beside it, else those that a recording holds.

    Raises:
        InputError: what is beside it is no file of marks.
    """
    beside = marks_file(capture)
    if beside.exists() or not _is_recording(capture):
        return read_marks(beside)
    return marks_in(capture)


def marks_in(recording: Path) -> list[NotedMark]:
    """Return the marks that a recording holds."""
    from sniffer.mcapfile.noted import read_notes

    try:
        return [_mark(note) for note in read_notes(recording)]
    except (OSError, ValueError, KeyError, TypeError):
        return []  # another tool's: nobody marked it here


def into_recording(capture: Path) -> None:
    """Put the marks beside a recording into it; those of other captures stay where they are.

    Raises:
        OutputError: the recording has no end, or cannot be written: they stay beside it.
    """
    beside = marks_file(capture)
    if not beside.exists() or not _is_recording(capture):
        return
    from sniffer.mcapfile.noted import write_notes

    write_notes(capture, [mark._asdict() for mark in read_marks(beside)])
    beside.unlink()


def _mark(told: Any) -> NotedMark:
    return NotedMark(int(told["t_ns"]), str(told["bus"]), int(told["offset"]), str(told["note"]))


def _is_recording(capture: Path) -> bool:
    try:
        with capture.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def write_marks(path: Path, marks: list[NotedMark]) -> None:
    """Write marks; where there are none, no file is left but beside a recording, which has some.

    Raises:
        OutputError: it cannot be written.
    """
    with writing(path):
        capture = path.with_name(path.name.removesuffix(SUFFIX))
        if not marks and not (_is_recording(capture) and marks_in(capture)):
            path.unlink(missing_ok=True)
            return
        fresh = path.with_name(path.name + ".new")
        lines = (json.dumps(mark._asdict(), ensure_ascii=False) for mark in marks)
        fresh.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        fresh.replace(path)


def mark_at(index: CaptureIndex, line: int, note: str) -> NotedMark:
    """Return a mark at a line."""
    one = index.lines[line]
    return NotedMark(int(one["t"]), index.buses[int(one["bus"])], int(one["at"]), note)
