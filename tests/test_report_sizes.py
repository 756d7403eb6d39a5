"""A page on very much is of bounded size, and says what it leaves out."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from sniffer.mcapfile.sink import McapSink
from sniffer.reports.markup import sentence, text
from sniffer.simulation.buses import simulate
from sniffer.simulation.render import candump, frame_reads
from tests.lists import each_in_turn
from tests.recordings import talk as simulated
from tests.test_report import DAMAGED, Reader, page_of

if TYPE_CHECKING:
    from pathlib import Path

    from tests.test_report import Capsys


def test_a_bus_with_very_many_servos_has_a_page_of_bounded_size(
    tmp_path: Path, capsys: Capsys
) -> None:
    capture = tmp_path / "many.log"
    frames = simulate(
        "lss", seed=1, servo_ids=range(1, 120), rate_hz=4, start_ns=10**18, duration_s=2.0
    )
    capture.write_text(candump(frame_reads(frames)), encoding="ascii")
    page = page_of(capsys, capture, tmp_path)
    assert len(page.encode()) < 3_000_000
    told = Reader(page).text
    assert "servo 119" in told
    assert re.search(r"and \d+ further servos: figures above, no curves", told)


def test_very_many_buses_and_facts_have_a_page_of_bounded_size(
    tmp_path: Path, capsys: Capsys
) -> None:
    capture = tmp_path / "many.mcap"
    part = simulated("mightyzap", 0.3)
    facts = {f"fact {k}": "x y " * 2_000 for k in range(300)}
    sink = McapSink(capture, facts)
    for k in range(30):
        sink.raw(f"bus{k}", [replace(chunk, bus=f"bus{k}") for chunk in part])
    sink.close()
    page = page_of(capsys, capture, tmp_path, "--protocol", "mightyzap")
    assert len(page.encode()) < 3_000_000
    told = Reader(page).text
    assert "and 14 further buses: without curves" in told
    assert re.search(r"and \d+ more facts", told)
    assert "bus29" in told


def test_an_arrow_is_one_sign_that_no_end_of_a_line_breaks() -> None:
    assert text("servo 4 heats up -> servo 4 reports it") == "servo 4 heats up → servo 4 reports it"
    assert text("a->b <- c") == "a-&gt;b &lt;- c"


def test_what_stands_between_backticks_is_code_and_still_no_markup() -> None:
    told = sentence("`sniffer decode x` draws `<script>`, a lone ` stays")
    assert told == (
        "<code>sniffer decode x</code> draws <code>&lt;script&gt;</code>, a lone ` stays"
    )


@each_in_turn(4, "capture", DAMAGED, ids=lambda path: path.stem)
def test_one_byte_is_drawn_once_of_an_incident(
    capture: Path, tmp_path: Path, capsys: Capsys
) -> None:
    page = page_of(capsys, capture, tmp_path)
    for incident in page.split('<article id="incident-')[1:]:
        drawn = re.findall(r"<b>([^<]*)</b> byte (\d+): ", incident.split("</article>")[0])
        assert drawn
        assert len(drawn) == len(set(drawn))
