"""The transcripts in the documentation: found, run again, compared, written anew.

``python -m tests.transcripts`` (part of ``make golden``) rewrites those that are no longer true;
read the diff before committing it. What counts as a transcript:

- in a fenced ``console`` block each line ``$ ...`` that runs ``sniffer``, with what the terminal
  shows below it: both streams, 80 columns wide, no blanks at line ends. Pipes, several commands in
  a line and files written before work as in a shell: all commands of a page run in order, in one
  folder with the sample captures. A line ``...`` stands for lines left out, once a command;
- a fenced ``python`` block, and the ``text`` block right behind it if there is one: what it prints.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

ROOT: Final = Path(__file__).parent.parent
PAGES: Final = ("README.md", "docs/api.md")
LEFT_OUT: Final = "..."

_FENCE: Final = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_TOOL: Final = re.compile(r"(?:^|[|;&]\s*)([\w.-]+)")


@dataclass(frozen=True, slots=True)
class Fence:
    """A fenced block of a page: its language, its text, and where the text stands."""

    language: str
    text: str
    start: int
    end: int


@dataclass(slots=True)
class Shown:
    """One thing to run, and what comes of it if the page says so (``told``; ``at``: where)."""

    language: str
    source: str
    output: list[str]
    at: tuple[int, int]
    told: bool = True


def fences(text: str) -> list[Fence]:
    """Return the fenced blocks of a page."""
    return [Fence(m[1], m[2], m.start(2), m.end(2)) for m in _FENCE.finditer(text)]


def shown(text: str) -> list[Shown]:
    """Return what a page shows being run, in order."""
    out: list[Shown] = []
    blocks = fences(text)
    for i, fence in enumerate(blocks):
        if fence.language == "console":
            out += _commands(fence)
        elif fence.language == "python":
            one = Shown("python", fence.text, [], (fence.end, fence.end), told=False)
            if i + 1 < len(blocks) and _is_right_behind(fence, blocks[i + 1], text):
                behind = blocks[i + 1]
                one.output, one.at = behind.text.splitlines(), (behind.start, behind.end)
                one.told = True
            out.append(one)
    return out


def _is_right_behind(fence: Fence, other: Fence, text: str) -> bool:
    between = text[fence.end : other.start].strip()
    return other.language == "text" and between.split() == ["```", "```text"]


def _commands(fence: Fence) -> Iterator[Shown]:
    at = fence.start
    current: Shown | None = None
    for line in fence.text.splitlines(keepends=True):
        begin, at = at, at + len(line)
        if line.startswith("$ "):
            if current is not None:
                yield current
            current = Shown("console", line[2:].strip(), [], (at, at))
        elif current is not None:
            current.output.append(line.rstrip("\n"))
            current.at = (current.at[0], at)
        else:
            raise ValueError(f"a console block begins with output, at character {begin}")
    if current is not None:
        yield current


def is_run(one: Shown) -> bool:
    """Tell whether a transcript is run: Python always, of command lines those with ours."""
    return one.language == "python" or "sniffer" in _TOOL.findall(one.source)


def missing_tools(one: Shown) -> list[str]:
    """Return the programs of a command line that this machine does not have."""
    if one.language != "console":
        return []
    words = shlex.split(one.source, posix=False)  # quoted text stays quoted, so it names no tool
    line = " ".join(w for w in words if w[:1] not in "'\"")
    return [t for t in _TOOL.findall(line) if t != "sniffer" and shutil.which(t) is None]


@dataclass(slots=True)
class Stage:
    """A folder with the sample captures, in which a page's transcripts are run one by one."""

    folder: Path
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__page__"})

    def __post_init__(self) -> None:
        shutil.copytree(ROOT / "sample_captures", self.folder / "sample_captures")
        command = self.folder / ".bin" / "sniffer"
        command.parent.mkdir()
        command.write_text(
            f'#!/bin/sh\nexec "{sys.executable}" -m sniffer "$@"\n', encoding="ascii"
        )
        command.chmod(0o755)

    def run(self, one: Shown) -> list[str]:
        """Return the lines that come of it."""
        return self._python(one.source) if one.language == "python" else self._shell(one.source)

    def _shell(self, line: str) -> list[str]:
        done = subprocess.run(
            ["sh", "-c", line],
            cwd=self.folder,
            env=self._environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
            timeout=120,
        )
        return _lines(done.stdout.decode("utf-8"))

    def _environment(self) -> Mapping[str, str]:
        path = os.pathsep.join([str(self.folder / ".bin"), os.environ["PATH"]])
        kept = {
            k: v for k, v in os.environ.items() if k not in ("FORCE_COLOR", "NO_COLOR", "LINES")
        }
        ours = {"PATH": path, "PYTHONPATH": str(ROOT), "COLUMNS": "80", "TERM": "dumb"}
        return kept | ours | {"PYTHONUTF8": "1"}

    def _python(self, code: str) -> list[str]:
        out = io.StringIO()
        with contextlib.chdir(self.folder), contextlib.redirect_stdout(out):
            exec(compile(code, "<python block>", "exec"), self.names)
        return _lines(out.getvalue())


def _lines(text: str) -> list[str]:
    """Return lines as a page has them: no blanks at their ends, none of them empty at the end."""
    return [line.rstrip() for line in text.rstrip().splitlines()]


def agrees(said: list[str], got: list[str]) -> bool:
    """Tell whether the output is what a page says, where ``...`` stands for lines left out."""
    if LEFT_OUT not in said:
        return said == got
    k = said.index(LEFT_OUT)
    head, tail = said[:k], said[k + 1 :]
    enough = len(head) + len(tail) <= len(got)
    return enough and got[:k] == head and got[len(got) - len(tail) :] == tail


def abridged(got: list[str], said: list[str]) -> list[str]:
    """Return the output with as many lines left out as ``said`` leaves out."""
    if LEFT_OUT not in said:
        return got
    k = said.index(LEFT_OUT)
    tail = len(said) - k - 1
    if k + tail >= len(got):
        return got
    return [*got[:k], LEFT_OUT, *got[len(got) - tail :]]


def renewed(text: str, folder: Path) -> str:
    """Return a page with all its transcripts as they are now."""
    stage = Stage(folder)
    out, done = [], 0
    for one in shown(text):
        if not is_run(one):
            continue
        if lacking := missing_tools(one):
            raise SystemExit(f"{one.source}: install {', '.join(lacking)} first")
        got = stage.run(one)
        if not one.told:
            continue
        start, end = one.at
        new = abridged(got, one.output)
        out += [text[done:start], "".join(f"{line}\n" for line in new)]
        done = end
    return "".join([*out, text[done:]])


def main() -> None:
    """Write the transcripts of all pages anew."""
    for page in PAGES:
        path = ROOT / page
        with tempfile.TemporaryDirectory(prefix="transcripts-") as folder:
            path.write_text(
                renewed(path.read_text(encoding="utf-8"), Path(folder)), encoding="utf-8"
            )


if __name__ == "__main__":
    main()
