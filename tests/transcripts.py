"""The transcripts in the documentation: found, run again, compared, written anew.

``python -m tests.transcripts`` (part of ``make golden``) rewrites those that are no longer true;
read the diff before committing it. What counts as a transcript:

- in a fenced ``console`` block each line ``$ ...`` that runs ``sniffer``, with what the terminal
  shows below it: both streams, 80 columns wide, no blanks at line ends. Pipes, several commands in
  a line and files written before work as in a shell: all commands of a page run in order, in one
  folder with the sample captures. A line ``...`` stands for lines left out, once a command;
- among them a line that ends in ``&``: it goes on until the page is done, and where the page shows
  what it prints, that is what comes first. ``wait %2`` waits for the second one of the page to end
  and shows the rest. A block that does either happens now: any number passes for any other;
- a fenced ``python`` block, and the ``text`` block right behind it if there is one: what it prints.

Commands that need hardware stand in ``sh`` blocks, which are not run. What a command that fails
prints is never written into a page: a failure that is meant stands there already, word by word, or
ends in ``; echo "status $?"``.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import DamagedInputError, InputError
from sniffer.mcapfile.source import chunks
from tests.background import OVER_S, Job, lines_of
from tests.commands import begin_anew, install

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from typing import Self

ROOT: Final = Path(__file__).parent.parent
_DOCS: Final = (
    "api",
    "recording",
    "simulating",
    "replaying",
    "diagnosing",
    "columns",
    "conformance",
    "reports",
    "checking",
    "asking",
    "editing",
    "fleet",
    "twitch",
    "numbers",
    "names",
    "with/foxglove",
    "with/matlab",
    "with/pandas",
    "with/plotjuggler",
    "with/ros2",
)
PAGES: Final = ("README.md", *(f"docs/{name}.md" for name in _DOCS))
LEFT_OUT: Final = "..."

_FENCE: Final = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_TOOL: Final = re.compile(r"(?:^|[|;&]\s*)([\w.-]+)")
_QUOTED: Final = re.compile(r"'[^']*'|\"[^\"]*\"")
_WAIT: Final = re.compile(r"wait %(\d+)")
_KILL: Final = re.compile(r"(?P<command>[^&]+) & sleep (?P<seconds>\d+); kill -(?P<signal>\d+) \$!")
_RECORDING: Final = re.compile(r"-o (\S+\.mcap)")
_NUMBER: Final = re.compile(r"<?\d[\d.:]*")
_ONE: Final = re.compile(r"\b1 (byte|frame|message|anomaly)\b")
_MANY: Final = {"anomaly": "anomalies"}
_BLANKS: Final = re.compile(r" +")


@dataclass(frozen=True, slots=True)
class Fence:
    """A fenced block of a page: its language, its text, and where the text stands."""

    language: str
    text: str
    start: int
    end: int


@dataclass(slots=True)
class Shown:
    """One thing to run, and what comes of it if the page says so (``told``; ``at``: where).

    ``live``: it happens now, so its numbers are others each time.
    """

    language: str
    source: str
    output: list[str]
    at: tuple[int, int]
    told: bool = True
    live: bool = False


def fences(text: str) -> list[Fence]:
    """Return the fenced blocks of a page."""
    return [Fence(m[1], m[2], m.start(2), m.end(2)) for m in _FENCE.finditer(text)]


def shown(text: str) -> list[Shown]:
    """Return what a page shows being run, in order."""
    out: list[Shown] = []
    blocks = fences(text)
    for i, fence in enumerate(blocks):
        if fence.language == "console":
            block = list(_commands(fence))
            live = any(one.source.endswith("&") or is_awaited(one) for one in block)
            for one in block:
                one.live = live
            out += block
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


def is_awaited(one: Shown) -> bool:
    """Tell whether a command line is one that waits for a command in the background."""
    return _WAIT.fullmatch(one.source) is not None


def is_run(one: Shown) -> bool:
    """Tell whether a transcript is run: Python always, of command lines those with ours."""
    if one.language == "python" or is_awaited(one):
        return True
    return "sniffer" in _TOOL.findall(one.source)


def missing_tools(one: Shown) -> list[str]:
    """Return the programs of a command line that this machine does not have."""
    if one.language != "console":
        return []
    line = _QUOTED.sub("", one.source)  # what is quoted names no tool
    ours = ("sniffer", "wait", "sleep", "kill")
    return [t for t in _TOOL.findall(line) if t not in ours and shutil.which(t) is None]


@dataclass(slots=True)
class Stage:
    """A folder with the sample captures, in which a page's transcripts are run one by one."""

    folder: Path
    names: dict[str, Any] = field(default_factory=lambda: {"__name__": "__page__"})
    jobs: list[Job] = field(default_factory=list)
    status: int = 0
    """How the last command that was run has ended; 0 if it goes on."""

    def __post_init__(self) -> None:
        shutil.copytree(ROOT / "sample_captures", self.folder / "sample_captures")
        command = self.folder / ".bin" / "sniffer"
        begun = self.folder / ".begun" / "sniffer"
        command.parent.mkdir()
        begun.parent.mkdir()
        begin_anew(begun)
        install(command)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for job in self.jobs:
            job.end()

    def run(self, one: Shown) -> list[str]:
        """Return the lines that come of it; ``status`` tells then whether it went well."""
        self.status = 0
        if one.language == "python":
            return self._python(one.source)
        if one.source.endswith("&"):
            job = self._start(one.source.removesuffix("&"))
            lines = job.first(len(one.output)) if one.output else []
            self.status = job.process.poll() or 0
            return lines
        if (awaited := _WAIT.fullmatch(one.source)) is not None:
            job = self.jobs[int(awaited[1]) - 1]
            lines = job.rest()
            self.status = job.process.returncode
            return lines
        if (killed := _KILL.fullmatch(one.source)) is not None:
            return self._killed(killed["command"], int(killed["seconds"]), int(killed["signal"]))
        return self._shell(one.source)

    def _killed(self, line: str, seconds: int, number: int) -> list[str]:
        """Run a recorder, and send it a signal when its file holds so many seconds."""
        found = _RECORDING.search(line)
        if found is None:
            raise ValueError(f"{line}: it writes no .mcap that tells how far it is")
        job = self._start(line)
        deadline = time.monotonic() + OVER_S
        while recorded_s(self.folder / found[1]) < seconds:
            if job.process.poll() is not None or time.monotonic() > deadline:
                self.status = job.process.poll() or 1
                break
            time.sleep(0.1)
        job.kill(number)
        return job.rest()

    def _start(self, line: str) -> Job:
        output = self.folder / ".bin" / f"job{len(self.jobs) + 1}"
        with output.open("wb") as file:
            process = subprocess.Popen(
                ["sh", "-c", line],
                cwd=self.folder,
                env=self._environment(".begun"),  # signals are for it, not for who calls it
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                process_group=0,
            )
        self.jobs.append(Job(process, output))
        return self.jobs[-1]

    def _shell(self, line: str) -> list[str]:
        done = subprocess.run(
            ["sh", "-c", line],
            cwd=self.folder,
            env=self._environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
            timeout=OVER_S,
        )
        self.status = done.returncode
        return lines_of(done.stdout.decode("utf-8"))

    def _environment(self, programs: str = ".bin") -> Mapping[str, str]:
        path = os.pathsep.join([str(self.folder / programs), os.environ["PATH"]])
        kept = {
            k: v for k, v in os.environ.items() if k not in ("FORCE_COLOR", "NO_COLOR", "LINES")
        }
        ours = {"PATH": path, "PYTHONPATH": str(ROOT), "COLUMNS": "80", "TERM": "dumb"}
        return kept | ours | {"PYTHONUTF8": "1"}

    def _python(self, code: str) -> list[str]:
        out = io.StringIO()
        with contextlib.chdir(self.folder), contextlib.redirect_stdout(out):
            exec(compile(code, "<python block>", "exec"), self.names)
        return lines_of(out.getvalue())


def recorded_s(path: Path) -> float:
    """Return how many seconds a recording holds, which may be being written."""
    times: list[int] = []
    with contextlib.suppress(DamagedInputError, InputError):  # it has no end yet, or no begin
        times += (chunk.t_ns for chunk in chunks(path) if chunk.t_ns is not None)
    return (times[-1] - times[0]) / 1e9 if times else 0.0


def agrees(said: list[str], got: list[str], *, live: bool = False) -> bool:
    """Tell whether the output is what a page says, where ``...`` stands for lines left out.

    ``live``: any number passes for any other, in columns of any width, and one byte for many.
    """
    if live:
        said, got = [_numberless(line) for line in said], [_numberless(line) for line in got]
    if LEFT_OUT not in said:
        return said == got
    k = said.index(LEFT_OUT)
    head, tail = said[:k], said[k + 1 :]
    enough = len(head) + len(tail) <= len(got)
    return enough and got[:k] == head and got[len(got) - len(tail) :] == tail


def _numberless(line: str) -> str:
    many = _ONE.sub(lambda m: "0 " + _MANY.get(m[1], f"{m[1]}s"), line)
    return _BLANKS.sub(" ", _NUMBER.sub("0", many))


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
    """Return a page with those of its transcripts rewritten that are no longer true.

    Raises:
        SystemExit: a command is not here, or fails in a way that the page does not show already.
    """
    out, done = [], 0
    with Stage(folder) as stage:
        for one in shown(text):
            if not is_run(one):
                continue
            if lacking := missing_tools(one):
                raise SystemExit(f"{one.source}: install {', '.join(lacking)} first")
            got = stage.run(one)
            true = not one.told or agrees(one.output, got, live=one.live)
            if stage.status and not (true and stage.status == 1):
                said = "\n".join(got)
                raise SystemExit(f"{one.source}\nends with status {stage.status}:\n{said}")
            if true:
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
