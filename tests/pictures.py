"""Pictures in the documentation: ``python -m tests.pictures report board open`` takes them anew."""

from __future__ import annotations

import asyncio
import contextlib
import io
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rich.console import Console
from rich.terminal_theme import TerminalTheme

from sniffer.decoding.options import Options
from sniffer.diagnosis import Diagnosis
from sniffer.diagnosis.tracking import Tracked
from sniffer.inside.app import LookingGlass
from sniffer.inside.index import CaptureIndex
from sniffer.inside.reading import Reading
from sniffer.jobs.convert import convert
from sniffer.jobs.report import report
from sniffer.protocols import PROTOCOLS
from sniffer.sources import open_source
from sniffer.viewers.board.controls import Controls
from tests.browser import Browser
from tests.commands import COMMAND
from tests.terminals import wait
from tests.transcripts import ROOT
from tests.viewer import headless
from tests.wires import shown_by, status_of, wire

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

CAPTURE: Final = "sample_captures/mightyzap_damaged.log"
PICTURE: Final = ROOT / "docs" / "images" / "report.png"

LESS: Final = """
  const drop = (which) => document.querySelectorAll(which).forEach((e) => e.remove());
  drop(".incident ~ .incident, .exhibit ~ .exhibit ~ .exhibit, .servo ~ .servo, footer");
  drop("#times, #anomalies, #bytes, #recorded, nav");
"""
"""Leaves of each kind of thing the first one: a page is longer than a picture may be."""


IMAGES: Final = ROOT / "docs" / "images"

BUSES: Final = (("arm", "mightyzap", 5), ("leg", "rs30x", 6), ("hand", "lss", 3))
"""Of the live board: name, protocol, servos."""

LIVE: Final = (
    ("arm", "mightyzap", ("--fault", "limp:2@8s", "--fault", "flip:1%")),
    ("leg", "rs30x", ("--fault", "brownout:1@10s+3s")),
)
"""Of the live plots: name, protocol, what goes wrong."""

LOOKED_AT: Final = 74
"""The line of the capture that its picture shows: a response."""

LIVE_S: Final = 24
"""How long it has gone on when the picture is taken, in seconds."""

DARK: Final = TerminalTheme(
    (30, 33, 39),
    (220, 223, 228),
    [
        (30, 33, 39), (224, 92, 92), (131, 196, 109), (229, 192, 98),
        (97, 161, 224), (190, 132, 209), (86, 182, 194), (220, 223, 228),
    ],
    [
        (92, 99, 112), (224, 92, 92), (131, 196, 109), (229, 192, 98),
        (97, 161, 224), (190, 132, 209), (86, 182, 194), (255, 255, 255),
    ],
)  # fmt: skip


def of_a_report() -> None:
    """Take the picture of a report."""
    with tempfile.TemporaryDirectory() as folder, Browser(Path(folder) / "profile") as browser:
        page = Path(folder) / "report.html"
        done = report(ROOT / CAPTURE, page)
        text = page.read_text(encoding="utf-8")
        page.write_text(text.replace(done.content.name, CAPTURE), encoding="utf-8")
        browser.open(page, width=1100)
        browser.eval(LESS)
        browser.picture(PICTURE, whole=True)


def of_the_board() -> None:
    """Take the picture of the live board, sorted by the following error."""
    wires = [wire(name, protocol, servos, 10.0) for name, protocol, servos in BUSES]
    board, diagnosis = shown_by(*wires), Diagnosis()
    for w in wires:
        for batch in w.batches:
            diagnosis.write(w.name, PROTOCOLS[w.protocol], batch)
    board.incidents = tuple(Tracked(one, one.cause) for one in diagnosis.incidents())
    board.controls = Controls(sort="error", cursor=("arm", 2))
    status = status_of(*(w.status() for w in wires), late_ns=4 * 10**9)
    console = Console(
        file=io.StringIO(), width=130, record=True, force_terminal=True, color_system="truecolor"
    )
    console.print(board.render(status, 130, 36), end="")
    title = "sniffer record arm=sim/arm=mightyzap leg=sim/leg=rs30x hand=sim/hand=lss -o run.mcap"
    console.save_svg(str(IMAGES / "board.svg"), title=title, theme=DARK, unique_id="board")


def of_plots() -> None:
    """Take the picture of a capture in Rerun."""
    with tempfile.TemporaryDirectory() as folder, headless(Path(folder)) as viewer:
        plots = Path(folder) / "plots.rrd"
        convert(ROOT / CAPTURE, [plots])
        viewer.show(plots)
        viewer.client.save_screenshot(str(IMAGES / "view.png"))


def of_live_plots() -> None:
    """Take the picture of two buses live in Rerun."""
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        viewer = stack.enter_context(headless(folder))
        ports = []
        for name, protocol, faults in LIVE:
            link = folder / name
            stack.enter_context(_running("simulate", protocol, "--link", str(link), *faults))
            wait(link.exists, f"{name} is not played")
            ports.append(f"{name}={link}={protocol}")
        out = ("-o", str(folder / "run.mcap"), "--quiet", "--rerun-connect", viewer.client.url)
        stack.enter_context(_running("record", *ports, *out))
        wait(lambda: bool(viewer.client.get_state().active_recording), "nothing is shown")
        time.sleep(LIVE_S)
        viewer.client.save_screenshot(str(IMAGES / "live.png"))


def of_the_looking_glass() -> None:
    """Take the picture of a capture on the terminal, a value of a frame chosen."""
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,  # it ends a moment later
        Browser(Path(folder) / "profile") as browser,
    ):
        drawn = Path(folder) / "open.svg"
        drawn.write_text(asyncio.run(_looked_at()), encoding="utf-8")
        browser.open(drawn, width=1240, height=782)
        browser.picture(IMAGES / "open.png", whole=True)


async def _looked_at() -> str:
    reading = Reading(open_source(ROOT / CAPTURE), Options(), CaptureIndex())
    reading.start()
    reading.wait()
    app = LookingGlass(reading, name=Path(CAPTURE).name)
    try:
        async with app.run_test(size=(100, 30)) as pilot:
            app.list.go(LOOKED_AT)
            await pilot.press("tab")
            while not app.fields.detail:
                await pilot.pause(0.05)
            await pilot.press("down")
            await pilot.pause(0.2)
            return app.export_screenshot()
    finally:
        reading.stop()
        reading.index.discard()


@contextlib.contextmanager
def _running(*arguments: str) -> Iterator[None]:
    with subprocess.Popen((*COMMAND, *arguments), stdout=subprocess.DEVNULL) as process:
        try:
            yield
        finally:
            process.terminate()


PICTURES: Final[Mapping[str, Callable[[], None]]] = {
    "report": of_a_report,
    "board": of_the_board,
    "view": of_plots,
    "live": of_live_plots,
    "open": of_the_looking_glass,
}


if __name__ == "__main__":
    for picture in sys.argv[1:] or PICTURES:
        PICTURES[picture]()
