"""``sniffer replay --as controller``: what a recording asked is asked again."""

from __future__ import annotations

import os
import threading
import time
from typing import TYPE_CHECKING, Any, Final

import pytest

import sniffer
from sniffer.decoding.rows import FrameRow
from sniffer.ground.model import NS
from sniffer.jobs.playback import PlayedRole
from sniffer.playback import controller
from sniffer.playback.exchanges import PlayedReply, RecordedExchange, RequestKey
from sniffer.protocols import PROTOCOLS
from sniffer.selection.places import Window
from sniffer.simulation.play.outlet import FrameWriter
from tests.commands import log, talk, within
from tests.lists import each_in_turn
from tests.playbacks import CLEAN, playing
from tests.streams.mightyzap import packet as zap
from tests.test_playback_line import MS, Noted, Wall

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sniffer.jobs.playback import PlayedBack

Capsys = pytest.CaptureFixture[str]
CONTROLLER: Final = PlayedRole.CONTROLLER
BEGINNING: Final = Window(0, 0.25)


@pytest.fixture(autouse=True)
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for answers as long as a busy machine may need."""
    monkeypatch.setattr(controller, "PATIENCE_NS", 30 * NS)


def frames_in(source: Path, name: str) -> list[str]:
    return [row.hex for row in sniffer.decode(source, name) if isinstance(row, FrameRow)]


def both(name: str, output: Path, *, source: Path | None = None) -> PlayedBack:
    """Let the controller of a capture ask its own servos; return what became of it."""
    path = source or CLEAN[name]
    window = None if source else BEGINNING
    with playing(path, name, ports={"tap": False}) as servos:
        more = {"to": (servos.names["bus"],), "window": window, "outputs": [output]}
        with playing(path, name, CONTROLLER, **more) as asker:
            return asker.wait()


@each_in_turn(2, "name", PROTOCOLS)
def test_what_it_says_and_hears_is_what_was_recorded(name: str, tmp_path: Path) -> None:
    output = tmp_path / "talk.mcap"
    done = both(name, output)
    heard, recorded = frames_in(output, name), frames_in(CLEAN[name], name)
    assert len(heard) > 20
    assert heard == recorded[: len(heard)]
    assert done.as_recorded
    assert done.hearing is not None
    (line,) = done.hearing.lines()
    asked, _, answered, *_, then = line.replace(",", "").replace(";", "").split()
    assert answered == then
    assert int(asked) >= int(answered) > 0


def spoken(answers: dict[bytes, bytes], source: Path) -> tuple[PlayedBack, list[tuple[int, bytes]]]:
    """Let a controller ask somebody who has these answers; return when it asked what."""
    master, slave = os.openpty()
    os.set_blocking(master, False)
    import tty

    tty.setraw(slave)
    asked: list[tuple[int, bytes]] = []
    over = threading.Event()

    def answer() -> None:
        data = b""
        while not over.is_set():
            try:
                data += os.read(master, 4096)
            except BlockingIOError:
                time.sleep(0.0005)
                continue
            if len(data) > 4 and len(data) >= 5 + data[4]:  # whole: it may come in pieces
                asked.append((time.monotonic_ns(), data))
                os.write(master, answers.get(data, b""))
                data = b""

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        with playing(source, "mightyzap", CONTROLLER, to=(os.ttyname(slave),)) as it:
            return it.wait(), asked
    finally:
        over.set()
        thread.join()
        os.close(master)
        os.close(slave)


ONE, TWO = zap(1, 0xF1), zap(2, 0xF1)
ANSWERS: Final = {ONE: zap(1, 0), TWO: zap(2, 0)}


def of_two(folder: Path, count: int = 6, gap_ms: int = 30) -> Path:
    """Write a log of two servos that are pinged in turn, and answer after some milliseconds."""
    path, lines, ms = folder / "two.log", [], 0
    for nth in range(count):
        request = (ONE, TWO)[nth % 2]
        for at, data in ((ms, request), (ms + 4, ANSWERS[request])):
            lines.append(f"(1700000000.{at:03d}000) bus0 #{data.hex().upper()}\n")
        ms += gap_ms
    path.write_text("".join(lines))
    return path


class Servo(Noted):
    """A port at whose other end a servo answers every request after a while."""

    def __init__(self, wall: Wall, answer: bytes, delays_ns: Sequence[int]) -> None:
        super().__init__(wall)
        self._answer = answer
        self._delays = list(delays_ns)
        self._due: list[int] = []

    def write(self, data: bytes) -> int:
        if self._delays:
            self._due.append(self._wall.now_ns + self._delays.pop(0))
        return super().write(data)

    def read(self) -> bytes:
        said = b"".join(self._answer for due in self._due if due <= self._wall.now_ns)
        self._due = [due for due in self._due if due > self._wall.now_ns]
        return said


def asked_at(at_ms: Sequence[int], delays_ms: Sequence[int]) -> list[int]:
    """Return when requests of these times are said, in ms; answers come after ``delays_ms``."""
    wall: Any = Wall(())
    wall.step_ns = MS
    port = Servo(wall, zap(1, 0), [ms * MS for ms in delays_ms])
    key, reply = RequestKey(1, 0, -1, 0), PlayedReply(2 * MS, zap(1, 0))
    recorded = [RecordedExchange(ONE, key, "echo", True, at * MS, at * MS, [reply]) for at in at_ms]
    outlet = FrameWriter(port, lambda frame, offset: None)
    mightyzap = PROTOCOLS["mightyzap"]
    player = controller.ControllerPlayer(
        outlet, mightyzap, MS, bus="bus0", stop=wall, heard=lambda chunks: None, now=wall.now
    )
    player.play(recorded)
    return [t // MS for t, _ in port.written]


def test_requests_keep_the_times_that_they_had() -> None:
    assert asked_at([100, 110, 150, 151], [2, 2, 1, 1]) == [0, 10, 50, 51]


def test_an_answer_that_comes_late_is_waited_for_and_caught_up_with_in_the_pauses() -> None:
    at, delays = [*range(0, 200, 20)], [2, 25, *[2] * 8]
    late = [is_at - was_at for is_at, was_at in zip(asked_at(at, delays), at, strict=True)]
    assert late == [0, 0, 5, 3, 2, 0, 0, 0, 0, 0]


def test_servos_that_are_always_slower_are_asked_as_slowly_and_nothing_piles_up() -> None:
    assert asked_at([0, 10, 20, 30], [15, 15, 15, 2]) == [0, 15, 30, 45]
    stalled = asked_at([*range(0, 400, 20)], [2, 99, 99, 99, *[2] * 16])
    assert max(t - 20 * nth for nth, t in enumerate(stalled)) > 200
    assert stalled[-1] - 20 * 19 > 60  # 100 ms are caught up with, what is beyond is not


def test_a_servo_that_does_not_answer_is_told_with_how_often_it_did(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(controller, "PATIENCE_NS", NS)
    done, asked = spoken({ONE: zap(1, 0)}, of_two(tmp_path, 3))
    assert [data for _, data in asked] == [ONE, TWO, ONE]
    assert done.hearing is not None
    assert done.hearing.lines() == [
        "3 requests, 2 answered; in the recording 3",
        "echo of servo 2: 0 of 1 answered, in the recording 1",
    ]
    assert not done.as_recorded


def test_an_adapter_that_gives_back_what_is_sent_is_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(controller, "PATIENCE_NS", NS)
    echo = {ONE: ONE, TWO: TWO + zap(2, 0)}
    done, asked = spoken(echo, of_two(tmp_path, 2))
    assert len(asked) == 2
    assert done.hearing is not None
    assert done.hearing.lines()[0] == "2 requests, 1 answered; in the recording 2"


def test_the_status_says_whether_all_was_answered(
    tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(controller, "PATIENCE_NS", 0)
    source = tmp_path / "x.log"
    source.write_text(log(talk(1)))
    master, slave = os.openpty()
    try:
        ran = within(capsys, "replay", source, "--to", os.ttyname(slave), "--as", "controller")
    finally:
        os.close(master)
        os.close(slave)
    assert ran.status == 1
    assert "sniffer: 3 requests, 0 answered; in the recording 3\n" in ran.err
    assert "sniffer: load_data of servo 2: 0 of 1 answered, in the recording 1\n" in ran.err
