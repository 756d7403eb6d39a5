"""``sniffer doctor`` on pseudo terminals behind which a simulated bus talks."""

from __future__ import annotations

import itertools
import json
import os
import sys
import threading
import time
import tty
from contextlib import closing, contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click
import pytest

from sniffer.cli.doctor import doctor, lines
from sniffer.doctor import Listened, diagnose, judged
from sniffer.doctor.examine import hear
from sniffer.ground.model import NS, InputError
from sniffer.ports import PortOptions, open_port
from sniffer.simulation import simulate
from tests.commands import records
from tests.terminals import say_until
from tests.test_doctor import misheard, said, slow

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from sniffer.simulation import TrueFrame

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="pseudo terminals as Linux has them"
)
Capsys = pytest.CaptureFixture[str]


def whole(frame: TrueFrame, far: int) -> tuple[bytes, ...]:
    return (frame.wire,)


def in_halves(frame: TrueFrame, far: int) -> tuple[bytes, ...]:
    half = len(frame.wire) // 2
    return (frame.wire[:half], frame.wire[half:])


@contextmanager
def talking(name: str, say: Callable[[TrueFrame, int], tuple[bytes, ...]] = whole) -> Iterator[str]:
    """Let a simulated bus talk behind a pseudo terminal, in its own time; yield its name.

    ``say`` cuts frames into the pieces that are written; ``far`` is the end that they go to.
    """
    master, slave = os.openpty()
    tty.setraw(slave)
    stop = threading.Event()

    def talk() -> None:
        began = time.monotonic_ns()
        for frame in simulate(name, seed=1):
            if stop.wait(max(0, began + frame.t_end_ns - time.monotonic_ns()) / NS):
                return
            for piece in say(frame, master):
                say_until(master, piece, stop)

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        stop.set()
        thread.join()
        os.close(slave)
        os.close(master)


def examined(*arguments: str) -> int:
    status: int = doctor.main(list(arguments), standalone_mode=False)
    return status


def test_a_bus_that_talks_is_fit_to_be_recorded(capsys: Capsys) -> None:
    with talking("mightyzap", in_halves) as path:
        status = examined(path, "--duration", "3", "--format", "jsonl")
    out, err = capsys.readouterr()
    assert status == 0
    assert err == f"sniffer: listening to {path} for 3 s at 115200 baud\n"
    *verdicts, summary = records(out)
    by_topic: dict[str, dict[str, Any]] = {v["about"]: v for v in verdicts}
    assert {v["type"] for v in verdicts} == {"verdict"}
    assert by_topic["bytes"]["bytes"] == summary["bytes"] > 500
    assert by_topic["protocol"]["protocol"] == summary["protocol"] == "mightyzap"
    assert by_topic["protocol"]["share"] > 0.95
    assert by_topic["reads"]["pairs"] > 10
    assert (summary["type"], summary["port"], summary["baud"]) == ("summary", path, 57600)


def test_a_silent_port_is_bad_and_says_what_to_look_at(capsys: Capsys) -> None:
    master, slave = os.openpty()
    try:
        assert examined(f"{os.ttyname(slave)}=lss@115200", "--duration", "0.2") == 1
    finally:
        os.close(slave)
        os.close(master)
    out = capsys.readouterr().out
    assert "bad   bytes     no byte in 0.2 s" in out
    assert out.endswith("not fit to record from: bytes\n")


def test_a_port_that_goes_away_is_told() -> None:
    master, slave = os.openpty()
    path = os.ttyname(slave)
    with closing(open_port(path, PortOptions(115200))) as port:
        os.write(master, b"\x01\x02")
        os.close(master)
        found = hear(port, Listened(path, (), 5.0, 115200), baud_is_named=True)
    os.close(slave)
    assert found.gone_s is not None
    assert said("bytes", found).text.startswith("the port went away after ")


def test_a_missing_port_is_a_mistake() -> None:
    with pytest.raises(InputError, match="no such port"):
        examined("/dev/ttyNothing")


def test_the_baud_is_found_without_opening_the_port_again() -> None:
    from sniffer.ports import kernel, tty

    right = 57600
    garbage = itertools.cycle(misheard("mightyzap", 4 * right).chunks)

    def sampled(frame: TrueFrame, far: int) -> tuple[bytes, ...]:
        """Let come what a UART would read at the speed that the port is set to."""
        if kernel.settings(far).ispeed == right:
            return (frame.wire,)
        return (b"".join(next(garbage).data for _ in frame.wire),)

    class Tuned(tty.TtyPort):
        """A port whose baud can be changed while it is open."""

        def set_baud(self, baud: int) -> None:
            kernel.set_settings(self._fd, kernel.settings(self._fd).listening(baud))
            while self.read():
                pass

    with talking("mightyzap", sampled) as path:
        port = Tuned(path, PortOptions(115200))
        about = Listened(path, (), 0.5, 115200)
        lines_told: list[str] = []
        found = hear(port, about, baud_is_named=False, tell=lines_told.append)
        assert (found.baud, found.trials) == (right, ())
        port.set_baud(115200)
        told = hear(port, about, baud_is_named=True)
        port.close()
    assert said("baud", found).text == "57600 is right: frames hold"
    assert (told.baud, told.trials[0].baud) == (115200, right)
    assert said("baud", told).commands == (f"sniffer doctor {path}=mightyzap@57600",)
    assert [line for line in lines_told if line.startswith("115200 baud are not understood: ")]


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["/dev/x=modbus"], "no protocol 'modbus'"),
        (["/dev/x=wck@1"], "no baud rate"),
        (["/dev/x=wck", "--protocol", "lss"], "which one"),
        (["/dev/x=wck@9600", "--baud", "115200"], "which one"),
        (["/dev/x", "--duration", "0.01"], "range"),
        (["/dev/x", "--seconds", "0.01"], "range"),  # as it was called before
    ],
)
def test_mistakes_are_told_before_anything_is_opened(arguments: list[str], word: str) -> None:
    with pytest.raises(click.UsageError, match=word):
        examined(*arguments)


@pytest.mark.parametrize("width", [80, 140])
def test_verdicts_fit_the_terminal_and_commands_stay_whole(width: int) -> None:
    case = slow()
    verdicts = diagnose(case)
    text = [line.plain for line in lines(judged(case), width)]
    commands = [f"      {c}" for v in verdicts for c in v.commands]
    assert len(commands) == 3
    assert set(commands) <= set(text)
    assert all(len(line) <= width for line in text if line not in commands), text
    assert text[0] == "/dev/ttyUSB0: 2.0 s at 57600 baud"
    assert text[-2:] == [
        "fit to record from, with doubts about latency, reads, times",
        "      sniffer record /dev/ttyUSB0=mightyzap@57600",
    ]


def test_what_is_printed_is_plain_where_nobody_sees_colours(tmp_path: Path, capsys: Capsys) -> None:
    with talking("wck") as path:
        link = tmp_path / "bus"
        link.symlink_to(path)
        assert examined(str(link), "--duration", "3", "--protocol", "wck") == 0
    out = capsys.readouterr().out
    assert "\x1b" not in out
    assert out.splitlines()[-1].endswith(f"sniffer record {link}=wck@115200")


def test_numbers_can_be_written_as_json() -> None:
    for verdict in diagnose(replace(slow(), trials=())):
        assert json.loads(json.dumps(verdict.as_dict(), allow_nan=False))["about"] == verdict.about
