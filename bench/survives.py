"""A recorder that is killed at a random moment: what is left, and what can be done with it.

Lines under full load are said on ptys, and for every write it is known when it began. The recorder
is killed with SIGKILL; every byte that was written a tenth of a second before must be in its file.
``python -m bench.survives --times 50``.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import io
import random
import re
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mcap.reader import make_reader

from bench.lines import NAMES, Line, ticks, traffic
from sniffer.cli import run as run_command
from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import Chunk, DamagedInputError
from sniffer.mcapfile.source import groups, session
from sniffer.messages import OFFSET

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

ALLOWED_NS: Final = 100_000_000
"""What a killed recorder may lose."""

BAUD: Final = 921600
LONGEST_S: Final = 2.5
"""The last moment at which one is killed."""

SAID_S: Final = 60.0
"""What there is to be said: on a busy machine one may be killed later, but in full flight."""

AT_ONCE: Final = 4
WAIT_S: Final = 180.0

SHOWN: Final = re.compile(r"^[\d:.]+ +(?:[^ <>]+ +)*[<>] ", re.MULTILINE)
"""The line of a frame, as replay prints it: time, bus where there is room, servo, direction."""


@dataclass(frozen=True, slots=True)
class Kind:
    """How the recorder is called."""

    protocol: str
    auto: bool = False
    options: tuple[str, ...] = ()


KINDS: Final = (
    *(Kind(name) for name in NAMES),
    Kind("mightyzap", auto=True),
    Kind("wck", options=("--durable",)),
    Kind("rs30x", options=("--rotate", "400ms")),
    Kind("lss", auto=True, options=("--durable", "--rotate", "1MB")),
)


@dataclass(frozen=True, slots=True)
class Left:
    """What a killed recorder left behind.

    ``lost_ns`` is how long before the kill the writing of the first byte that is missing began,
    ``held_up_ns`` how long the machine kept the writer from running at the worst.
    """

    kind: Kind
    files: tuple[Path, ...]
    said: bytes
    kept: bytes
    ran_s: float
    lost_ns: int
    held_up_ns: int

    def __str__(self) -> str:
        """Say it in a line."""
        what = " ".join((self.kind.protocol, *self.kind.options))
        files = "" if len(self.files) == 1 else f", {len(self.files)} files"
        return (
            f"{what}: killed after {self.ran_s:.2f} s, {len(self.kept)} bytes{files}, the first "
            f"lost one came {self.lost_ns / 1e6:.0f} ms before; the machine held the writer up for "
            f"{self.held_up_ns / 1e6:.0f} ms at worst"
        )


@functools.cache
def said(protocol: str) -> bytes:
    """Return what is said on a line."""
    return traffic(protocol, BAUD, SAID_S, 1)


class Victim:
    """A recorder of one line."""

    def __init__(self, folder: Path, kind: Kind, after_s: float) -> None:
        self.kind = kind
        self.after_s = after_s
        self.line = Line(said(kind.protocol), BAUD)
        self.written: list[tuple[int, int]] = []
        """For each write when it began, and the bytes by then."""
        self.killed_ns = 0
        self.held_up_ns = 0
        self._folder = folder
        folder.mkdir()
        spoken = "" if kind.auto else f"={kind.protocol}"
        port = f"b0={self.line.port.name}{spoken}@{BAUD}"
        command = [sys.executable, "-m", "sniffer", "record", port, "--quiet", *kind.options]
        self._errors = (folder / "errors.txt").open("wb")
        self._process = subprocess.Popen(
            [*command, "-o", str(folder / "run.mcap")],
            stdin=subprocess.DEVNULL,
            stderr=self._errors,
        )

    @property
    def files(self) -> tuple[Path, ...]:
        """What there is of its recording."""
        return tuple(sorted(self._folder.glob("run*.mcap")))

    def listens(self) -> bool:
        """Tell whether its file is begun; the ports are opened before.

        Raises:
            RuntimeError: it has ended.
        """
        if self._process.poll() is not None:
            raise RuntimeError((self._folder / "errors.txt").read_text(encoding="utf-8"))
        return bool(self.files)

    def kill(self) -> None:
        """Kill it, once."""
        if not self.killed_ns:
            self.killed_ns = time.monotonic_ns()
            self._process.kill()

    def say(
        self, elapsed_s: float, late_s: float, ready: Callable[[Victim], bool] = lambda v: True
    ) -> None:
        """Go on speaking, or kill it when its time has come."""
        if self.killed_ns:
            return
        self.held_up_ns = max(self.held_up_ns, int(late_s * 1e9))
        if elapsed_s >= self.after_s and ready(self):
            self.kill()
            return
        before, began = self.line.done, time.monotonic_ns()
        if self.line.say(elapsed_s):
            self.written.append((began, before))

    def left(self) -> Left:
        """Return what it left, when it is dead."""
        self._process.kill()
        self._process.wait(WAIT_S)
        self._errors.close()
        self.line.port.close()
        kept = joined(self.files)
        said = self.line.data[: self.line.done]
        # the last write that began before the first byte that is lost
        first = next((t for t, before in reversed(self.written) if before <= len(kept)), 0)
        lost = 0 if len(kept) == len(said) else self.killed_ns - first
        return Left(self.kind, self.files, said, kept, self.after_s, lost, self.held_up_ns)


def whole_chunks(path: Path) -> list[Chunk]:
    """Return the chunks of the one bus in a file that may be cut off."""
    out: list[Chunk] = []
    with contextlib.suppress(DamagedInputError):
        for group in groups(path):
            out += group
    return out


def raw(path: Path) -> bytes:
    """Return their bytes."""
    return b"".join(chunk.data for chunk in whole_chunks(path))


def joined(files: Iterable[Path]) -> bytes:
    """Return the bytes of files that follow on each other.

    Raises:
        RuntimeError: bytes are missing between them, or two files tell differently.
    """
    out = b""
    for path in files:
        data, begin = raw(path), int(session(path).get(f"{OFFSET}.b0", "0"))
        if begin > len(out) or out[begin:] != data[: len(out) - begin]:
            raise RuntimeError(f"{path} does not go on where the file before it ends")
        out += data[len(out) - begin :]
    return out


def kill(
    folder: Path,
    kinds: Sequence[Kind],
    seed: int,
    ready: Callable[[Victim], bool] = lambda victim: True,
    wait_s: float = WAIT_S,
) -> list[Left]:
    """Run recorders side by side and kill each at a moment of its own, but not before ``ready``."""
    rng = random.Random(seed)
    moments = [rng.uniform(0.05, LONGEST_S) for _ in kinds]
    victims: list[Victim] = []
    try:
        pairs = zip(kinds, moments, strict=True)
        for n, (kind, after_s) in enumerate(pairs):
            victims.append(Victim(folder / f"{seed}-{n}", kind, after_s))
        deadline = time.monotonic() + wait_s
        while not all(victim.listens() for victim in victims):
            if time.monotonic() > deadline:
                raise RuntimeError("a recorder does not begin")
            time.sleep(0.01)
        for elapsed, late in ticks(SAID_S):
            for victim in victims:
                victim.say(elapsed, late, ready)
            if all(victim.killed_ns for victim in victims):
                break
        while not all(victim.killed_ns or ready(victim) for victim in victims):
            if time.monotonic() > deadline:
                raise RuntimeError("a recorder records nothing")
            time.sleep(0.05)
        for victim in victims:
            victim.kill()
    finally:
        out = [victim.left() for victim in victims]
    return out


def command(*arguments: object) -> tuple[int, str, str]:
    """Run a command of the program; return its status, and what it said."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = run_command([str(argument) for argument in arguments])
    return status, out.getvalue(), err.getvalue()


def complaints(left: Left, allowed_ns: int = ALLOWED_NS) -> list[str]:
    """Return what is wrong with what a killed recorder left: nothing, one hopes."""
    wrong: list[str] = []
    if left.lost_ns > allowed_ns:
        wrong.append(f"{left.lost_ns / 1e6:.0f} ms are lost")
    if not left.said.startswith(left.kept):
        wrong.append("the bytes are not those that were said")
    for path in left.files:
        wrong += (f"{path.name}: {what}" for what in _reopened(path, left.kind.protocol))
    return wrong


def _reopened(path: Path, protocol: str) -> list[str]:
    """Open a file with every command that takes one."""
    wrong = []
    chunks = whole_chunks(path)
    data = b"".join(chunk.data for chunk in chunks)
    decoder = Decoder(protocol, baud=BAUD)
    frames = sum(len(b.frames) for b in (decoder.feed(*chunks), decoder.close()))
    plot, whole = path.with_suffix(".rrd"), path.with_name(f"whole-{path.name}")
    for what, *arguments in (
        ("view", path, "-o", plot, "--protocol", protocol),
        ("replay", path, "--speed", "0", "--protocol", protocol),
        ("recover", path, "-o", whole),
        ("view", whole, "-o", plot, "--force", "--protocol", protocol),
    ):
        status, out, err = command(what, *arguments)
        if status:
            wrong.append(f"{what} ends with status {status}: {err.strip()}")
        if what == "replay":
            shown = len(SHOWN.findall(out))
            if shown != frames:
                wrong.append(f"replay shows {shown} of {frames} frames")
        if what == "view" and not plot.stat().st_size:
            wrong.append("view writes nothing")
    if b"".join(chunk.data for group in groups(whole) for chunk in group) != data:
        wrong.append("recovered with other bytes")
    with whole.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        counted = sum(1 for _ in reader.iter_messages())
        if summary is None or summary.statistics is None:
            wrong.append("recovered without a summary")
        elif summary.statistics.message_count != counted:
            wrong.append("recovered with a summary that is wrong")
    return wrong


def survive(times: int, say: Callable[[str], object]) -> list[tuple[Left, list[str]]]:
    """Kill so many recorders; return what they left, and what is wrong with it."""
    out: list[tuple[Left, list[str]]] = []
    while len(out) < times:
        many = min(AT_ONCE, times - len(out))
        kinds = [KINDS[(len(out) + n) % len(KINDS)] for n in range(many)]
        with tempfile.TemporaryDirectory() as folder:
            for left in kill(Path(folder), kinds, len(out)):
                out.append((left, complaints(left)))
                say("; ".join((str(left), *out[-1][1])))
    return out


def main() -> None:
    """Kill as many as the arguments say."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--times", type=int, default=50)
    given = parser.parse_args()
    found = survive(given.times, lambda line: sys.stderr.write(line + "\n"))
    raise SystemExit(any(wrong for _, wrong in found))


if __name__ == "__main__":
    main()
