"""What was read is in the file before any of it is decoded."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from typing import TYPE_CHECKING

from sniffer.ground.model import DamagedInputError
from sniffer.mcapfile.source import chunks
from tests.commands import environment
from tests.terminals import LINUX_ONLY, PATIENCE_S, Terminal

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

pytestmark = LINUX_ONLY

STUCK = """
import sys, time
from sniffer.decoding.pipeline import Pipeline
def stuck(self, bus, chunks):
    print("decoding", flush=True)
    while True:
        time.sleep(1)
Pipeline.decode = stuck
from sniffer.cli import run
sys.exit(run(sys.argv[1:]))
"""


def test_a_recorder_killed_in_a_decoding_that_never_ends_has_recorded_what_it_read(
    tmp_path: Path,
) -> None:
    said = bytes.fromhex("ffffff0104f28c027affffff010400ff07f4") * 20
    path = tmp_path / "stuck.mcap"
    with Terminal() as line:
        arguments = ["record", f"{line.path}=mightyzap", "--quiet", "-o", str(path)]
        with subprocess.Popen(
            [sys.executable, "-c", STUCK, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment(),
        ) as process:
            line.wait_for_tap()
            line.say(said)
            assert process.stdout is not None
            assert process.stdout.readline() == b"decoding\n"
            process.kill()
            process.wait(PATIENCE_S)
    assert b"".join(recorded(path)) == said


def recorded(path: Path) -> Iterator[bytes]:
    """Yield what a file that breaks off has."""
    with contextlib.suppress(DamagedInputError):
        for chunk in chunks(path):
            yield chunk.data
