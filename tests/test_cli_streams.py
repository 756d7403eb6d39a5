"""Readers that go away, writers that are slow, Ctrl-C: what was decoded is kept."""

from __future__ import annotations

import gzip
import signal
import subprocess
import sys
import time
from typing import TYPE_CHECKING

import pyarrow.parquet as pq
import pytest

from sniffer.cli.signals import patient
from sniffer.cli.streams import say
from sniffer.decoding.pipeline import Options
from sniffer.ground.model import Chunk, OutputError
from sniffer.jobs.session import Ending, run_source
from sniffer.jobs.telling import Teller
from sniffer.sources import open_source
from tests.commands import (
    COMMAND,
    Ran,
    conserved,
    environment,
    sniffer,
    talk,
    within,
)

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol

Capsys = pytest.CaptureFixture[str]


# --- pipes -------------------------------------------------------------------------------------


def head(path: Path, *arguments: str) -> Ran:
    """Run a command as in ``... | head -1``."""
    command = [*COMMAND, "decode", str(path), *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment()
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        first = process.stdout.readline()
        process.stdout.close()
        err = process.stderr.read()
    return Ran(process.returncode, first.decode(), err.decode())


@pytest.fixture
def large(tmp_path: Path) -> Path:
    path = tmp_path / "large.bin"
    path.write_bytes(talk(1000))
    return path


@pytest.mark.parametrize("form", ["text", "jsonl"])
def test_a_reader_that_goes_away_ends_the_decoding_quietly(form: str, large: Path) -> None:
    ran = head(large, "--format", form)
    assert ran.status == 0
    assert ran.out.startswith("time" if form == "text" else '{"type":"frame"')
    assert ran.content


def test_a_reader_that_goes_away_does_not_stop_the_file(large: Path, tmp_path: Path) -> None:
    out = tmp_path / "whole.jsonl"
    ran = head(large, "-o", str(out))
    assert (ran.status, ran.content) == (0, True)
    assert conserved(out.read_text()) == large.read_bytes()


def test_standard_input_is_decoded_like_a_file(good: Path) -> None:
    piped = sniffer("decode", "-", "--format", "jsonl", data=good.read_bytes())
    assert (piped.status, piped.content) == (0, True)
    assert piped.out == sniffer("decode", good, "--format", "jsonl").out


# --- Ctrl-C ------------------------------------------------------------------------------------


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.skipif(sys.platform == "win32", reason="sends SIGINT to a child")
def test_ctrl_c_and_a_polite_kill_keep_what_was_decoded(
    number: signal.Signals, tmp_path: Path
) -> None:
    out = tmp_path / "x.parquet"
    data = talk(5000)
    with subprocess.Popen(
        [*COMMAND, "decode", "-", "--summary", "-o", str(out)],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment(),
    ) as process:  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write(data)
        process.stdin.flush()
        said = process.stderr.readline()  # the protocol is found: decoding has begun
        time.sleep(0.3)  # and it waits for more
        process.send_signal(number)
        printed = process.stdout.read().decode()
        said += process.stderr.read()
    ran = Ran(process.returncode, printed, said.decode())
    assert ran.status == 130
    assert ran.complaint == "interrupted: what was decoded is kept"
    frames = pq.read_table(out.with_suffix(".frames.parquet"))
    assert frames["length"].to_pylist()[:2] == [18, 9]
    decoded = sum(frames["length"].to_pylist())
    assert 0 < decoded <= len(data)
    assert f" = {decoded} in {len(frames)} frames" in ran.out


class Interrupting:
    """A sink whose user loses patience while it is written."""

    def __init__(self) -> None:
        self.closed = False

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        signal.raise_signal(signal.SIGINT)

    def close(self) -> None:
        self.closed = True


class Keeping(Interrupting):
    """A sink that keeps the batches."""

    def __init__(self) -> None:
        super().__init__()
        self.data = b""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        self.data += batch.data


def test_ctrl_c_never_parts_two_outputs(good: Path, capsys: Capsys) -> None:
    first, second, last = Keeping(), Interrupting(), Keeping()
    data = good.read_bytes()
    groups = ([Chunk(data)] for _ in range(10))
    with patient() as patience:
        _, ending = run_source(
            open_source(good),
            Options("mightyzap"),
            [first, second, last],
            name="x",
            tell=Teller(say),
            patience=patience,
            groups=groups,
        )
    assert ending == Ending.INTERRUPTED
    assert first.data == last.data == data
    assert first.closed
    assert second.closed
    assert last.closed
    assert capsys.readouterr().err == "sniffer: interrupted: what was decoded is kept\n"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_before_anything_was_read_is_told_in_one_line(
    good: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> object:
        raise KeyboardInterrupt

    monkeypatch.setattr("sniffer.jobs.convert.open_capture", interrupted)
    ran = within(capsys, "decode", good)
    assert (ran.status, ran.out) == (130, "")
    assert ran.complaint == "interrupted"


class Failing(Keeping):
    """A sink whose disk fills up at the very end; closed twice, it would not forgive."""

    def close(self) -> None:
        assert not self.closed
        super().close()
        raise OutputError("full")


def test_every_output_is_closed_once_even_if_closing_one_fails(good: Path) -> None:
    sinks = [Keeping(), Failing(), Keeping()]
    with pytest.raises(OutputError, match="full"):
        run_source(open_source(good), Options("mightyzap"), sinks, name="x", tell=Teller(say))
    assert all(sink.closed for sink in sinks)
    assert sinks[0].data == sinks[2].data == good.read_bytes()


def test_a_recording_is_read_from_a_pipe_and_from_a_packed_file(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.mcap"
    (tmp_path / "talk.bin").write_bytes(talk(50))
    assert sniffer("decode", tmp_path / "talk.bin", "--summary", "-o", path).status == 0
    packed = tmp_path / "run.mcap.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    spool = tmp_path / "spool"
    spool.mkdir()
    whole, piped, unpacked = (
        sniffer("decode", name, "--format", "jsonl", data=data, env={"TMPDIR": str(spool)})
        for name, data in ((path, None), ("-", path.read_bytes()), (packed, None))
    )
    assert (piped.status, piped.out) == (0, whole.out)
    assert (unpacked.status, unpacked.out) == (0, whole.out)
    assert list(spool.iterdir()) == [], "nothing is left behind"
    cut = sniffer("decode", "-", "--summary", data=path.read_bytes()[:1500])
    assert cut.status == 3
    assert "standard input: " in cut.err
    assert str(spool) not in cut.err
