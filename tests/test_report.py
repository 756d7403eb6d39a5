"""``sniffer report``: one page that says what was wrong, and shows the bytes."""

from __future__ import annotations

import base64
import hashlib
import html
import re
from html.parser import HTMLParser
from typing import TYPE_CHECKING, Final

import pytest

from sniffer import __version__
from sniffer.ground.model import Chunk, Clock
from sniffer.jobs.report import FORMS
from sniffer.jobs.report import report as write
from sniffer.mcapfile.sink import McapSink
from sniffer.simulation.buses import simulate
from sniffer.simulation.faults import FLIP, Fault
from sniffer.simulation.render import candump, frame_reads
from tests.commands import forbidden, log, sniffer, talk, within
from tests.golden import CAPTURES, captures
from tests.lists import each_in_turn
from tests.recordings import keep
from tests.recordings import talk as simulated

if TYPE_CHECKING:
    from pathlib import Path

    Capsys = pytest.CaptureFixture[str]

DAMAGED: Final = [path for path in captures() if "damaged" in path.name]
EACH_DAMAGED = each_in_turn(2, "capture", DAMAGED, ids=lambda p: str(p.name))
EACH = each_in_turn(4, "capture", captures(), ids=lambda p: str(p.name))

EVIL: Final = "<img/src=x/onerror=alert(1)>"


class Reader(HTMLParser):
    """What a page is made of: its elements with their attributes, and its text."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self._inside: list[str] = []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        self._inside.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while self._inside and self._inside.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if not {"script", "style"} & set(self._inside):
            self.text += data + " "


def page_of(capsys: Capsys, capture: Path, folder: Path, *options: str) -> str:
    path = folder / "report.html"
    ran = within(capsys, "report", capture, "-o", path, "--force", *options)
    assert ran.status == 0, ran.err
    return path.read_text(encoding="utf-8")


def recorded(path: Path, facts: dict[str, str]) -> None:
    """Write a recording that says so of itself."""
    sink = McapSink(path, facts)
    sink.raw("bus0", simulated("mightyzap", 1.0))
    sink.close()


@EACH_DAMAGED
def test_the_verdict_of_a_report_comes_first_and_is_that_of_the_diagnosis(
    capture: Path, tmp_path: Path, capsys: Capsys
) -> None:
    content = write(capture, tmp_path / "r.html").content
    worst = content.worst
    assert worst is not None
    page = Reader((tmp_path / "r.html").read_text(encoding="utf-8"))
    sections = [a["id"] for name, a in page.elements if name == "section"]
    assert sections[0] == "verdict"
    head = page.text.partition("Causes that were weighed")[0]
    assert worst.next in head
    diagnosed = within(capsys, "diagnose", capture).out
    assert " ".join(worst.next.split()) in " ".join(diagnosed.split())
    order = [(i.severity, i.number) for i in content.incidents]
    assert [s for s, _ in order] == sorted((s for s, _ in order), reverse=True)
    for incident in content.incidents:
        assert f"incident-{incident.number}" in [a.get("id") for _, a in page.elements]


def test_what_was_told_once_is_one_time(tmp_path: Path, capsys: Capsys) -> None:
    within(capsys, "report", str(CAPTURES / "lss_damaged.log"), "-o", str(tmp_path / "x.html"))
    assert "· 1 time " in Reader((tmp_path / "x.html").read_text()).text


@EACH_DAMAGED
def test_every_place_of_an_incident_that_is_shown_has_its_bytes_as_they_are_in_the_capture(
    capture: Path, tmp_path: Path
) -> None:
    content = write(capture, tmp_path / "r.html").content
    lines = capture.read_text(encoding="ascii").splitlines()
    stream = b"".join(bytes.fromhex(line.rpartition("#")[2]) for line in lines)
    shown = [e for some in content.exhibits.values() for e in some]
    assert shown
    page = re.sub(r"<[^>]*>", " ", (tmp_path / "r.html").read_text(encoding="utf-8"))
    squeezed = re.sub(r"\s", "", page)
    for exhibit in shown:
        assert exhibit.pieces, exhibit.place
        first, length = exhibit.place[:2]
        for piece in (*exhibit.before, *exhibit.behind):
            assert stream[piece.offset : piece.offset + len(piece.raw)] == piece.raw
            is_before = piece in exhibit.before
            assert (piece.offset + len(piece.raw) <= first) is is_before
            assert (piece.offset >= first + length) is not is_before
        for piece in exhibit.pieces:
            assert stream[piece.offset : piece.offset + len(piece.raw)] == piece.raw
            assert piece.offset < exhibit.place.offset + exhibit.place.length
            assert f"atbyte{piece.offset}" in squeezed


def test_a_frame_whose_checksum_is_wrong_is_drawn_field_by_field(
    tmp_path: Path, capsys: Capsys
) -> None:
    capture = tmp_path / "flips.log"
    frames = simulate(
        "mightyzap", seed=2, duration_s=4.0, start_ns=10**18, faults=[Fault(FLIP, 0.05)]
    )
    capture.write_text(candump(frame_reads(frames)), encoding="ascii")
    page = page_of(capsys, capture, tmp_path)
    wrong = re.findall(
        r'class="box wrong"[^>]*><span class="name">✗ checksum</span>.*?</div>', page
    )
    assert wrong
    for box in wrong:
        sent, expected = re.findall(r">(?:should be )?([0-9A-F]{2})<", box)
        assert sent != expected


@EACH
def test_a_page_fetches_nothing_and_may_not(capture: Path, tmp_path: Path, capsys: Capsys) -> None:
    page = page_of(capsys, capture, tmp_path)
    read = Reader(page)
    names = {name for name, _ in read.elements}
    assert not names & {"link", "img", "iframe", "object", "embed", "base", "form", "video", "use"}
    for name, attributes in read.elements:
        assert not {"src", "srcset", "action", "background", "xlink:href"} & set(attributes), name
        assert (attributes.get("href") or "#").startswith("#")
        assert not [key for key in attributes if key.startswith("on")]
    assert not re.search(r"https?:|@import|url\(|//[a-z]+\.", page)
    policy = next(a["content"] for n, a in read.elements if "http-equiv" in a) or ""
    assert policy.startswith("default-src 'none';")
    script = page.partition("<script>")[2].partition("</script>")[0]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in policy


@EACH
def test_a_page_is_well_formed(capture: Path, tmp_path: Path, capsys: Capsys) -> None:
    page = page_of(capsys, capture, tmp_path)
    open_: list[str] = []
    for mark in re.finditer(r"<(/?)([a-z][a-z0-9]*)([^>]*?)(/?)>", _without_raw(page)):
        closing, name, _, itself = mark.groups()
        if name in ("meta", "br") or itself:
            continue
        if closing:
            assert open_.pop() == name, mark.start()
        else:
            open_.append(name)
    assert not open_
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    for target in re.findall(r'href="#([^"]+)"', page):
        assert target in ids


def _without_raw(page: str) -> str:
    return re.sub(r"<(script|style)>.*?</\1>", r"<\1></\1>", page, flags=re.DOTALL)


def test_what_a_capture_says_does_not_become_markup(tmp_path: Path, capsys: Capsys) -> None:
    capture = tmp_path / "<b>name.mcap"
    keep(capture, [simulated("mightyzap", 1.0, bus=EVIL)])
    page = page_of(capsys, capture, tmp_path)
    assert EVIL not in page
    assert html.escape(EVIL) in page
    assert "<b>name" not in page
    assert not [name for name, _ in Reader(page).elements if name == "img"]


def test_what_a_recording_says_of_itself_does_not_become_markup(
    tmp_path: Path, capsys: Capsys
) -> None:
    capture = tmp_path / "x.mcap"
    facts = {"note": f"{EVIL}</style></script>", "\x1b[2J": "a\u202eb\nc\x00"}
    recorded(capture, facts)
    page = page_of(capsys, capture, tmp_path)
    assert EVIL not in page
    assert page.count("</style>") == page.count("</script>") == 1
    assert not set(page) & {"\x1b", "\x00", "\u202e"}
    text = within(capsys, "report", capture).out
    assert not set(text) & {"\x1b", "\x00", "\u202e"}
    assert not re.search(r"(?<!\\)<", text)


def test_what_a_capture_says_does_not_become_markdown(tmp_path: Path, capsys: Capsys) -> None:
    capture = tmp_path / "x.mcap"
    bus = "`*[a](b)|<script>"
    keep(capture, [simulated("mightyzap", 1.0, bus=bus)])
    text = within(capsys, "report", capture).out
    outside = re.sub(r"^```text$.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    assert bus not in outside
    assert r"\`\*\[a\](b)\|\<script>" in outside
    for line in outside.splitlines():
        assert not re.search(r"(?<!\\)<", line), line


def test_a_report_without_an_output_is_printed_as_markdown(capsys: Capsys) -> None:
    ran = within(capsys, "report", CAPTURES / "mightyzap_damaged.log")
    assert ran.status == 0
    assert ran.content
    assert ran.out.startswith("# ")
    titles = re.findall(r"^## (.*)$", ran.out, re.MULTILINE)
    assert titles[-6:] == [
        "The servos",
        "Over time",
        "Response times",
        "All anomalies",
        "Where the bytes are",
        "How it was recorded",
    ]
    assert ran.out.count("```") % 2 == 0


@pytest.mark.parametrize("form", FORMS)
def test_a_report_says_what_made_it_and_how_the_capture_was_recorded(
    form: str, tmp_path: Path
) -> None:
    capture = tmp_path / "x.mcap"
    recorded(capture, {"port.bus0": "/dev/ttyUSB7"})
    write(capture, tmp_path / f"r{form}")
    text = (tmp_path / f"r{form}").read_text(encoding="utf-8")
    for told in (f"servo-sniffer {__version__}", "/dev/ttyUSB7", "stamped by the recorder"):
        assert told in text


def test_a_sound_capture_has_no_incident_and_says_on_what_it_was_judged(
    tmp_path: Path, capsys: Capsys
) -> None:
    page = Reader(page_of(capsys, CAPTURES / "mightyzap_clean.log", tmp_path))
    assert "No incident" in page.text
    assert "1506 mightyzap frames of 3 servos" in page.text
    assert "Causes that were weighed" not in page.text


def test_without_a_clock_no_time_is_told(tmp_path: Path, capsys: Capsys) -> None:
    page = Reader(page_of(capsys, CAPTURES / "lss_clean.bin", tmp_path)).text
    assert "No response time is known" in page
    assert "how busy the line was is not known" in page
    assert "none in the input: times are counted from the bytes" in page


def test_response_times_are_told_only_as_far_as_the_stamps_carry_them(
    tmp_path: Path, capsys: Capsys
) -> None:
    page = Reader(page_of(capsys, CAPTURES / "mightyzap_clean.log", tmp_path)).text
    assert re.search(r"p99\s+<\d\.\d\d ms", page)
    frames = simulate("mightyzap", seed=1, duration_s=2.0, start_ns=10**18)
    exact = tmp_path / "exact.mcap"
    keep(exact, [[Chunk(f.wire, f.t_end_ns, Clock.SAMPLE) for f in frames if f.wire]])
    sharp = Reader(page_of(capsys, exact, tmp_path)).text
    low, high = re.findall(r"p99\s+(\d\.\d\d)-(\d\.\d\d) ms", sharp)[0]
    assert 0 < float(low) < float(high) < 2 * float(low)


def test_a_pipe_gives_the_report_that_its_file_gives(tmp_path: Path) -> None:
    capture = CAPTURES / "mightyzap_damaged.log"
    ran = sniffer("report", "-", data=capture.read_bytes())
    whole = sniffer("report", capture)
    assert ran.status == whole.status == 0

    def shared(text: str) -> list[str]:
        return [line for line in text.splitlines() if not re.match(r"(# |- (input|size):)", line)]

    assert shared(ran.out) == shared(whole.out)
    assert ran.out.startswith("# standard input\n")


@pytest.mark.parametrize("form", FORMS)
def test_an_input_that_breaks_off_is_reported_as_far_as_it_goes(
    form: str, tmp_path: Path, capsys: Capsys
) -> None:
    capture, path = tmp_path / "x.log", tmp_path / f"r{form}"
    capture.write_text(log(talk(40)) + "(1700000009.5) bus0 #GG\n" * 3, encoding="ascii")
    ran = within(capsys, "report", capture, "-o", path)
    assert ran.status == 3
    assert "The input broke off: " in re.sub(r"<[^>]*>", "", path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("form", FORMS)
def test_a_report_replaces_nothing_unless_it_is_told_to(
    form: str, tmp_path: Path, capsys: Capsys
) -> None:
    path = tmp_path / f"r{form}"
    path.write_text("dear to somebody", encoding="ascii")
    command = ("report", CAPTURES / "wck_manual.hex", "-o", path)
    ran = within(capsys, *command)
    assert ran.status == 2
    assert ran.complaint == f"{path} is there already: choose another name, or --force"
    assert path.read_text(encoding="ascii") == "dear to somebody"
    assert within(capsys, *command, "--force").status == 0
    assert path.read_text(encoding="utf-8") != "dear to somebody"


def test_an_output_that_cannot_be_is_refused_before_anything_is_decoded(
    tmp_path: Path, capsys: Capsys
) -> None:
    capture = CAPTURES / "wck_damaged.log"
    for name, why in (
        ("r.pdf", f"{tmp_path}/r.pdf: the suffix of a report is one of .html, .md"),
        ("no/r.html", f"{tmp_path}/no/r.html: there is no folder {tmp_path}/no: make it first"),
    ):
        ran = within(capsys, "report", capture, "-o", tmp_path / name)
        assert (ran.status, ran.err) == (2, f"sniffer: {why}\n")
    same = tmp_path / "x.md"
    same.write_bytes(capture.read_bytes())
    ran = within(capsys, "report", same, "-o", same, "--force", "--input-format", "candump")
    assert (ran.status, ran.complaint) == (2, f"{same} is the input: choose another output")
    assert same.read_bytes() == capture.read_bytes()
    assert [p.name for p in tmp_path.iterdir()] == ["x.md"]


def test_a_folder_that_may_not_be_written_is_told_before_anything_is_decoded(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "mine"
    folder.mkdir()
    folder.chmod(0o555)
    ran = forbidden(folder, "report", CAPTURES / "wck_damaged.log", "-o", folder / "r.html")
    assert (ran.status, ran.err) == (
        2,
        f"sniffer: {folder / 'r.html'}: no permission to write it\n",
    )


def test_a_capture_of_nothing_leaves_no_report(tmp_path: Path, capsys: Capsys) -> None:
    capture = tmp_path / "x.bin"
    capture.write_bytes(b"")
    ran = within(capsys, "report", capture, "-o", tmp_path / "r.html")
    assert ran.status == 2
    assert ran.complaint.endswith("is empty: nothing to decode")
    assert not (tmp_path / "r.html").exists()


def test_several_buses_are_told_apart(tmp_path: Path, capsys: Capsys) -> None:
    capture = tmp_path / "two.mcap"
    keep(
        capture,
        [simulated("mightyzap", 1.0), simulated("wck", 1.0, bus="leg")],
    )
    page = Reader(page_of(capsys, capture, tmp_path)).text
    assert "bus0 servo 1" in page
    assert "leg servo 1" in page
