"""The screen of ``sniffer open``: keys and clicks, without a terminal."""

from __future__ import annotations

import asyncio
import contextlib
import json
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest
from textual.events import Key
from textual.widgets import Static

from sniffer.decoding.options import Options
from sniffer.inside.app import LookingGlass
from sniffer.inside.index import CaptureIndex
from sniffer.inside.reading import Reading
from sniffer.sources import open_source
from tests.commands import within
from tests.terminals import PATIENCE_S

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Callable


ROOT: Final = Path(__file__).parents[1]
DAMAGED: Final = ROOT / "sample_captures" / "mightyzap_damaged.log"
CLEAN: Final = ROOT / "sample_captures" / "mightyzap_clean.log"


class Glass:
    """The screen of a capture, and somebody who looks and types."""

    def __init__(self, app: LookingGlass, pilot: Any) -> None:
        self.app, self._pilot = app, pilot

    async def press(self, *keys: str) -> None:
        for key in keys:
            await self._pilot.press(key)
        await self.settled()

    async def ask(self, key: str, text: str) -> None:
        """Open a prompt with a key, and give it a text."""
        await self._pilot.press(key)
        self.app.prompt.value = text
        await self._pilot.press("enter")
        await self.settled()

    async def click(self, where: str, x: int, y: int) -> None:
        await self._pilot.click(where, offset=(x, y))
        await self.settled()

    async def resize(self, columns: int, lines: int) -> None:
        await self._pilot.resize_terminal(columns, lines)
        await self.settled()

    async def settled(self) -> None:
        app = self.app
        await self.until(
            lambda: (
                not (app.view.is_behind or app._wanted is not None or app._search or app._is_due)
                and self._is_shown()
            )
        )

    def _is_shown(self) -> bool:
        """Tell whether the fields are those under the cursor: it may not know that it moved."""
        line, detail = self.app.list.line, self.app.fields.detail
        if line < 0 or self.app.below.current != "detail":
            return True
        return detail is not None and detail.parts[0].line == line

    @property
    def is_read(self) -> bool:
        """Tell whether all is read, and the screen says so."""
        return self.app.reading.done and "reading" not in self.text(self.app.top)

    async def until(self, so: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE_S
        while True:
            await self._pilot.pause(0.01)
            if so():
                return
            assert time.monotonic() < end

    @property
    def rows(self) -> list[str]:
        return [self.app.list.render_line(y).text for y in range(self.app.list.size.height)]

    @property
    def current(self) -> str:
        return self.rows[self.app.list.cursor - self.app.list.scroll_offset.y]

    def text(self, widget: Static) -> str:
        return str(widget.content)

    @property
    def lit(self) -> tuple[int, int]:
        chosen = self.app.fields.chosen
        assert chosen is not None
        return chosen.offset, chosen.length


@contextlib.asynccontextmanager
async def looking(
    path: Path, marks: Path | None = None, growing: Path | None = None, start: str = ""
) -> AsyncIterator[Glass]:
    reading = Reading(open_source(path), Options(), CaptureIndex(), growing=growing)
    reading.start(first=True)
    app = LookingGlass(
        reading, name=path.name, marks=marks, follow=growing is not None, start=start
    )
    try:
        async with app.run_test(size=(80, 24)) as pilot:
            glass = Glass(app, pilot)
            await glass.until(lambda: app.view.count > 0 if growing else glass.is_read)
            await glass.settled()
            yield glass
    finally:
        reading.stop()
        reading.index.discard()


def look(path: Path, what: Callable[[Glass], Awaitable[None]], **more: Any) -> None:
    async def all_of_it() -> None:
        async with looking(path, **more) as glass:
            await what(glass)

    asyncio.run(all_of_it())


def test_keys_go_through_a_capture_and_take_it_apart(tmp_path: Path) -> None:
    capture = tmp_path / "run.log"
    capture.write_bytes(DAMAGED.read_bytes())
    kept = tmp_path / "run.log.marks.jsonl"

    async def steps(glass: Glass) -> None:
        app = glass.app
        assert glass.text(app.top).split("  ") == ["run.log", "mightyzap", "line 1 of 1478"]
        assert [r.split()[1:4] for r in glass.rows[:2]] == [["1", ">", "echo"], ["1", "<", "echo"]]
        await glass.press("tab", "down")  # the first field below the title: the header
        await glass.until(lambda: glass.lit == (0, 3))
        assert "FF FF FF 01 02 F1 0B" in glass.text(app.bytes.query_one(Static))
        await glass.press("n", "m", *"knee", "enter")
        assert glass.current.startswith("◆")
        assert glass.current.rstrip().endswith("no response")
        assert any(f.text.startswith("error no-response") for f in app.fields.detail.fields)  # type: ignore[union-attr]
        await glass.press("p")
        assert "nothing more is wrong before" in glass.text(app.status)
        await glass.press("t", "t", "down", "down")
        lines = app.index.lines
        assert float(glass.current.split()[0]) == int(lines["t"][82] - lines["t"][80]) // 1000 / 1e6
        await glass.ask("f", "servo=3")
        assert "of 411 of 1478  filter servo=3" in glass.text(app.top)
        assert {row.split()[1] for row in glass.rows if row.strip()} <= {"3", "> load_data"}
        await glass.ask("f", "servo=9")
        await glass.until(lambda: "f and an empty line show all" in glass.text(app.status))
        await glass.ask("f", "foo=3")
        assert "nothing is called 'foo'" in glass.text(app.status)
        await glass.ask("f", "sevro=3")
        assert "did you mean servo?" in glass.text(app.status)
        await glass.ask("f", "")
        await glass.ask("slash", "speed -202")
        assert "position 11.22" in glass.current
        await glass.press("b")
        assert app.board.display
        assert not app.fields.is_on_screen
        await glass.press("s")
        counted = partial(glass.text, app.figures.query_one(Static))
        await glass.until(lambda: "1448 frames, 30 gaps" in counted())
        await glass.ask("f", "servo=3 kind=request")
        await glass.until(lambda: "1448 frames" not in counted())
        (told,) = [row for row in counted().splitlines() if row.split()[0] == "3"][:1]
        assert told.split()[1:3] == [str(app.view.count), "0"], "as many requests, no answers"
        await glass.ask("f", "")
        await glass.press("escape", "apostrophe", "x")
        assert "of 871 of 1478" in glass.text(app.top)

    async def again(glass: Glass) -> None:
        await glass.press("apostrophe")
        assert "line 81 of" in glass.text(glass.app.top)
        await glass.until(lambda: glass.text(glass.app.status) == "◆ knee")
        await glass.press("m")
        assert not glass.current.startswith("◆")

    look(capture, steps, marks=capture)
    told = json.loads(kept.read_text(encoding="utf-8"))
    assert (told["bus"], told["offset"], told["note"]) == ("bus0", 1051, "knee")
    look(capture, again, marks=capture)
    assert not kept.exists()


def test_the_mouse_the_size_the_help_and_a_place_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "run.log.marks.jsonl").write_text("{}\n", encoding="utf-8")

    async def steps(glass: Glass) -> None:
        app = glass.app
        assert "line 1: this is no mark" in glass.text(app.status)
        await glass.click("#list", 20, 4)
        await glass.until(lambda: app.list.cursor == 4)
        await glass.click("#fields", 3, 1)
        await glass.until(lambda: glass.lit == (0, 3))
        await glass.ask("g", "over there")
        assert "is no place" in glass.text(app.status)
        await glass.ask("g", "@970")
        assert "voltage" not in glass.current
        await glass.resize(140, 40)
        assert "offset" in glass.text(app.head)
        assert "voltage 12 V" in glass.current
        await glass.resize(80, 24)
        await glass.until(lambda: app.fields.size.width > 30 and app.bytes.size.width > 30)
        await glass.resize(40, 12)
        assert len(glass.current) <= 40
        await glass.press("question_mark")
        await asyncio.sleep(0.2)  # what is shown below goes on
        assert len(app.screen_stack) == 2
        await glass.press("x")
        assert len(app.screen_stack) == 1
        assert not app.view.exchanges
        await glass.press("question_mark")
        for _ in range(3):  # typed faster than they are read
            app.screen.post_message(Key("x", "x"))
        await glass.until(lambda: len(app.screen_stack) == 1)
        await glass.press("t")

    look(CLEAN, steps, marks=tmp_path / "run.log")


def test_a_file_that_grows_is_followed_and_can_be_held(tmp_path: Path) -> None:
    lines = DAMAGED.read_bytes().splitlines(keepends=True)
    capture = tmp_path / "growing.log"
    capture.write_bytes(b"".join(lines[:1000]))

    async def steps(glass: Glass) -> None:
        app = glass.app
        count = app.view.count
        with capture.open("ab") as file:
            file.write(b"".join(lines[1000:2000]))
        await glass.until(lambda: app.view.count > count)
        await glass.until(lambda: app.list.cursor == app.view.count - 1)
        await glass.press("space")
        held, known = app.view.count, len(app.index.lines)
        with capture.open("ab") as file:
            file.write(b"".join(lines[2000:3000]) + b"\x00\x01 nonsense\n")
        await glass.until(lambda: len(app.index.lines) > known and app.reading.done)
        await glass.until(lambda: "line 3001" in glass.text(app.status))
        assert app.view.count == held
        assert "PAUSED" in glass.text(app.top)
        await glass.press("space")
        assert app.view.count > held

    look(capture, steps, growing=capture)


@pytest.mark.parametrize("how", ["cut", "replaced"])
def test_a_followed_file_that_is_begun_anew_is_told(how: str, tmp_path: Path) -> None:
    """As by logrotate: what came was not shown until it was longer than what had been there."""
    lines = DAMAGED.read_bytes().splitlines(keepends=True)
    capture = tmp_path / "growing.log"
    capture.write_bytes(b"".join(lines[:1000]))

    async def steps(glass: Glass) -> None:
        count = glass.app.view.count
        if how == "replaced":
            capture.rename(tmp_path / "growing.log.1")
        capture.write_bytes(b"".join(lines[:100]))
        await glass.until(lambda: glass.app.reading.done)
        why = {"cut": "it was cut short and is written anew", "replaced": "another file has taken"}
        await glass.until(lambda: why[how] in glass.text(glass.app.status))
        assert glass.app.view.count >= count

    look(capture, steps, growing=capture)


def test_it_begins_at_a_place_as_soon_as_that_was_read(tmp_path: Path) -> None:
    lines = DAMAGED.read_bytes().splitlines(keepends=True)
    capture = tmp_path / "growing.log"
    capture.write_bytes(b"".join(lines[:1000]))

    async def steps(glass: Glass) -> None:
        app = glass.app
        assert glass.text(app.status) == "looking for 7s …"
        with capture.open("ab") as file:
            file.write(b"".join(lines[1000:]))
        await glass.until(lambda: not app._start)
        times = app.index.lines["t"] - app.index.lines["t"][0]
        assert times[app.list.cursor - 1] < 7_000_000_000 <= times[app.list.cursor]
        assert "looking" not in glass.text(app.status)

    async def moved(glass: Glass) -> None:
        await glass.press("home")
        assert glass.app._start == ""

    async def nowhere(glass: Glass) -> None:
        await glass.until(lambda: not glass.app._start)
        assert "@anomaly:99999: " in glass.text(glass.app.status)
        assert "line 1 of" in glass.text(glass.app.top)

    look(capture, steps, growing=capture, start="7s")
    look(capture, moved, growing=capture, start="@anomaly:99999")
    look(DAMAGED, nowhere, start="@anomaly:99999")


def test_the_place_to_begin_at_is_said_as_elsewhere(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def look_inside(source: str, options: Options, *, start: str, **more: Any) -> None:
        asked.append(start)

    monkeypatch.setattr("sniffer.inside.session.look_inside", look_inside)
    assert within(capsys, "open", DAMAGED, "--from", "@first-error").status == 0
    assert within(capsys, "open", DAMAGED).status == 0
    assert asked == ["@first-error", ""]
    for what, why in (
        ((DAMAGED, "--from", "soon"), "'soon' is no place in a capture"),
        (("socket://localhost:1", "--from", "2"), "nothing of a port is there yet"),
    ):
        done = within(capsys, "open", *what)
        assert (done.status, why in done.complaint) == (2, True)
