"""``sniffer replay --as controller``: what a recording asked is asked again."""

from __future__ import annotations

import os
import threading
import time
from typing import TYPE_CHECKING, Final

import pytest

import sniffer
from sniffer.decoding.rows import FrameRow
from sniffer.ground.model import NS
from sniffer.jobs.play_back import PlayedRole
from sniffer.protocols import PROTOCOLS
from sniffer.selection.places import Window
from tests.commands import log, talk, within
from tests.played import CLEAN, playing
from tests.streams.mightyzap import packet as zap

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.jobs.play_back import PlayedBack

Capsys = pytest.CaptureFixture[str]
CONTROLLER: Final = PlayedRole.CONTROLLER
BEGINNING: Final = Window(0, 0.25)


def frames_in(source: Path, name: str) -> list[str]:
    return [row.hex for row in sniffer.decode(source, name) if isinstance(row, FrameRow)]


def both(name: str, output: Path, *, source: Path | None = None) -> PlayedBack:
    """Let the controller of a capture ask its own servos; return what became of it."""
    path = source or CLEAN[name]
    window = None if source else BEGINNING
    with playing(path, name, ports={"tap": False}) as servos:
        more = {"to": (servos.names["bus"],), "window": window, "outputs": [output]}
        with playing(path, name, CONTROLLER, **more) as controller:
            return controller.wait()


@pytest.mark.parametrize("name", PROTOCOLS)
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
        while not over.is_set():
            try:
                data = os.read(master, 4096)
            except BlockingIOError:
                time.sleep(0.0005)
                continue
            asked.append((time.monotonic_ns(), data))
            os.write(master, answers.get(data, b""))

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


def of_two(folder: Path, gap_ms: int = 30) -> Path:
    """Write a log of two servos that are pinged in turn, and answer after a millisecond."""
    path, lines, ms = folder / "two.log", [], 0
    for nth in range(6):
        request = (ONE, TWO)[nth % 2]
        for at, data in ((ms, request), (ms + 4, ANSWERS[request])):
            lines.append(f"(1700000000.{at:03d}000) bus0 #{data.hex().upper()}\n")
        ms += gap_ms
    path.write_text("".join(lines))
    return path


def test_requests_keep_the_distance_that_they_had(tmp_path: Path) -> None:
    done, asked = spoken(ANSWERS, of_two(tmp_path))
    assert [data for _, data in asked] == [ONE, TWO] * 3
    assert asked[-1][0] - asked[0][0] > 5 * 30 * NS // 1000 - 25_000_000
    assert done.as_recorded


def test_a_servo_that_does_not_answer_is_told_with_how_often_it_did(tmp_path: Path) -> None:
    done, asked = spoken({ONE: zap(1, 0)}, of_two(tmp_path))
    assert [data for _, data in asked] == [ONE, TWO] * 3
    assert done.hearing is not None
    assert done.hearing.lines() == [
        "6 requests, 3 answered; in the recording 6",
        "echo of servo 2: 0 of 3 answered, in the recording 3",
    ]
    assert not done.as_recorded


def test_an_adapter_that_gives_back_what_is_sent_is_no_answer(tmp_path: Path) -> None:
    echo = {ONE: ONE, TWO: TWO + zap(2, 0)}
    done, asked = spoken(echo, of_two(tmp_path))
    assert len(asked) == 6
    assert done.hearing is not None
    assert done.hearing.lines()[0] == "6 requests, 3 answered; in the recording 6"


def test_the_status_says_whether_all_was_answered(tmp_path: Path, capsys: Capsys) -> None:
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
