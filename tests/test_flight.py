"""The flight recorder: a file each time something happens, with the time before and after it."""

from __future__ import annotations

import signal
import time
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.diagnosis.causes import CAUSES
from sniffer.ground.model import NS, Chunk, Clock, MarkKind
from sniffer.mcapfile.ring import MARGIN_NS, Ring
from sniffer.mcapfile.ringfile import RingFile
from sniffer.mcapfile.source import chunks
from tests.commands import Ran, sniffer, within
from tests.recorder import Recorder, assert_true_to_itself, codes, facts, heard, raw, so_far
from tests.recordings import messages
from tests.streams.mightyzap import packet
from tests.terminals import LINUX_ONLY, Terminal, wait
from tests.transcripts import ROOT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

pytestmark = LINUX_ONLY

ASKED: Final = packet(1, 0xF2, b"\x8c\x02")
ANSWER: Final = packet(1, 0, b"\xff\x07")
SOUND: Final = ASKED + ANSWER
SUPPLY: Final = packet(1, 0xF2, b"\x92\x01")
LOST: Final = packet(2, 0xF2, b"\x8c\x02")
"""A request that nobody answers."""


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


class Speaker:
    """Says things on a line and knows what it has said."""

    def __init__(self, line: Terminal) -> None:
        self._line = line
        self.said = b""

    def say(self, data: bytes) -> None:
        self._line.say(data)
        self.said += data

    def go_on(self, seconds: float, data: bytes = SOUND) -> None:
        """Say the same every 20 ms for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.say(data)
            time.sleep(0.02)

    def until(self, is_so: Callable[[], bool], data: bytes = SOUND) -> None:
        """Go on talking until something is so."""

        def look() -> bool:
            self.go_on(0.05, data)
            return is_so()

        wait(look, "it has not become so")


def flying(folder: Path, line: Terminal, *arguments: str, before: str = "1s") -> Recorder:
    told = ("{}=mightyzap@57600", "--ring", before, "-o", str(folder), *arguments)
    return Recorder(folder, *told, lines=[line])


def files(folder: Path) -> list[Path]:
    return sorted(folder.glob("incident-*.mcap"))


def is_finished(run: Recorder, count: int = 1) -> bool:
    """Tell whether so many files have been told to be whole."""
    return sum(line.endswith(" bytes") for line in run.said.splitlines()) >= count


def test_what_happens_is_written_with_the_time_before_and_after_it(
    tmp_path: Path, line: Terminal
) -> None:
    speaker = Speaker(line)
    told = ("--trigger", "no-response", "--post", "300ms")
    with flying(tmp_path, line, *told) as run:
        speaker.go_on(1.5)
        assert files(tmp_path) == []
        speaker.say(LOST + SOUND)
        speaker.until(lambda: is_finished(run))
        speaker.go_on(0.3)
        ran = run.stop()
    assert ran.status == 0
    (path,) = files(tmp_path)
    about = facts(path)
    assert (about["trigger"], about["trigger.bus"], about["trigger.servo_ids"]) == (
        "no-response",
        "bus0",
        "2",
    )
    assert about["trigger.what"] == "no-response on bus0: servo 2 did not answer load_data"
    assert f"{path} has 1." in ran.err
    assert f"{len(speaker.said)} bytes heard, " in ran.err, "most of them are in no file"
    kept = raw(path)["bus0"]
    assert LOST in kept
    begin = int(about["offset.bus0"])
    assert speaker.said[begin : begin + len(kept)] == kept
    assert begin > 0
    assert begin + len(kept) < len(speaker.said)
    stamps = [c.t_ns or 0 for c in chunks(path) if c.data]
    t_ns = int(about["trigger.t_ns"])
    assert stamps[0] <= t_ns - NS
    assert t_ns < stamps[-1] <= t_ns + 300_000_000
    assert codes(path).count("no-response") == 1
    assert_true_to_itself(path)


def test_where_nothing_happens_nothing_is_written(tmp_path: Path, line: Terminal) -> None:
    speaker = Speaker(line)
    with flying(tmp_path, line, "--trigger", "no-response") as run:
        speaker.go_on(0.3)
        ran = run.stop()
    assert "nothing happened that a file was to be written for" in ran.err
    assert {p.name for p in tmp_path.iterdir()} == {"stdout.txt", "stderr.txt"}


def test_a_rule_triggers_and_what_the_wire_said_of_it_is_in_the_file(
    tmp_path: Path, line: Terminal
) -> None:
    speaker = Speaker(line)
    told = ("--trigger", "1.voltage < 9", "--post", "200ms")
    with flying(tmp_path, line, *told) as run:
        speaker.go_on(0.3)
        speaker.say(SUPPLY + packet(1, 0, b"\x50"))  # 8 V
        speaker.until(lambda: is_finished(run))
        assert run.stop().status == 0
    (path,) = files(tmp_path)
    assert facts(path)["trigger.what"] == "alarm on bus0: 1.voltage < 9: servo 1 has 8 V"
    assert facts(path)["alarm.1"] == "1.voltage < 9"
    assert codes(path).count("alarm") == 1
    assert_true_to_itself(path)


def test_any_incident_triggers_where_any_is_asked_for(tmp_path: Path, line: Terminal) -> None:
    speaker = Speaker(line)
    with flying(tmp_path, line, "--trigger", "any", "--post", "50ms") as run:
        speaker.until(lambda: is_finished(run), LOST + SOUND)
        assert run.stop().status == 0
    assert {facts(path)["trigger"] for path in files(tmp_path)} == {"any"}
    what = facts(files(tmp_path)[0])["trigger.what"]
    assert any(f"{cause} on bus0" in what for cause in CAUSES), what


def test_what_goes_on_prolongs_the_file_to_a_bound_and_begins_no_other_one(
    tmp_path: Path, line: Terminal
) -> None:
    speaker = Speaker(line)
    told = ("--trigger", "no-response", "--post", "100ms")
    with flying(tmp_path, line, *told) as run:
        speaker.go_on(0.3)
        speaker.go_on(2.5, LOST + SOUND)
        wait(lambda: is_finished(run), "the file is not ended")
        speaker.go_on(1.0, LOST + SOUND)
        assert run.stop().status == 0
    (path,) = files(tmp_path)
    t_ns = int(facts(path)["trigger.t_ns"])
    last = max(c.t_ns or 0 for c in chunks(path) if c.data)
    assert t_ns + 600_000_000 < last <= t_ns + 10 * 100_000_000
    assert_true_to_itself(path)


def test_another_thing_while_a_file_is_written_is_noted_in_it(
    tmp_path: Path, line: Terminal
) -> None:
    speaker = Speaker(line)
    told = ("--trigger", "no-response", "--trigger", "voltage < 9", "--post", "4s")
    with flying(tmp_path, line, *told) as run:
        speaker.say(SOUND * 3 + LOST + SOUND)
        speaker.until(lambda: bool(files(tmp_path)))
        speaker.say(SUPPLY + packet(1, 0, b"\x50"))
        speaker.until(lambda: is_finished(run))
        assert run.stop().status == 0
    (path,) = files(tmp_path)
    assert codes(path).count("alarm") == 1
    last = max(c.t_ns or 0 for c in chunks(path) if c.data)
    (alarm,) = (a for a in messages(path)["/bus0/anomalies"] if a.code == "alarm")
    assert last > alarm.t_ns + 3 * NS
    assert b"servo_sniffer.trigger" in path.read_bytes()


def test_a_signal_has_a_file_written_and_two_have_numbers(tmp_path: Path, line: Terminal) -> None:
    speaker = Speaker(line)
    (tmp_path / "incident-0001.mcap").write_bytes(b"dear to somebody")
    with flying(tmp_path, line, "--trigger", "temperature > 200", "--post", "50ms") as run:
        speaker.go_on(0.2)
        for count in (1, 2):
            run.tell(signal.SIGHUP)
            speaker.until(lambda count=count: is_finished(run, count))  # type: ignore[misc]
        assert run.stop().status == 0
    assert [p.name for p in files(tmp_path)] == [f"incident-000{n}.mcap" for n in (1, 2, 3)]
    assert facts(files(tmp_path)[1])["trigger"] == "signal"
    for path in files(tmp_path)[1:]:
        assert_true_to_itself(path)


def test_the_recording_ends_in_the_midst_of_it_and_the_file_is_whole(
    tmp_path: Path, line: Terminal
) -> None:
    speaker = Speaker(line)
    with flying(tmp_path, line, "--trigger", "no-response", "--post", "1h") as run:
        speaker.say(SOUND * 3 + LOST + SOUND)
        speaker.until(lambda: bool(files(tmp_path)))
        speaker.say(LOST)
        assert run.stop().status == 0
    (path,) = files(tmp_path)
    assert raw(path)["bus0"] == speaker.said
    # the last one is not waited for; where the recorder comes late it is over by then
    assert codes(path).count("no-response") in (1, 2)
    assert [m.kind for c in chunks(path) for m in c.marks][-1] == MarkKind.ENDED
    assert_true_to_itself(path)


def test_the_oldest_files_go_where_few_are_to_be_kept(tmp_path: Path, line: Terminal) -> None:
    speaker = Speaker(line)
    told = ("--trigger", "no-response", "--post", "50ms", "--keep", "1")
    with flying(tmp_path, line, *told) as run:
        speaker.go_on(0.2)
        for count in (1, 2):
            run.tell(signal.SIGHUP)
            speaker.until(lambda count=count: is_finished(run, count))  # type: ignore[misc]
        run.stop()
    assert [p.name for p in files(tmp_path)] == ["incident-0002.mcap"]


def test_killed_it_leaves_its_ring_on_the_disk(tmp_path: Path, line: Terminal) -> None:
    speaker, ring = Speaker(line), tmp_path / "ring.mcap"
    told = ("--trigger", "no-response", "--ring-file", str(ring))
    with flying(tmp_path, line, *told, before="500ms") as run:
        speaker.go_on(0.5)
        wait(lambda: so_far(ring).get("bus0", b"") == speaker.said, "the ring is not on the disk")
        run.process.kill()
        run.process.wait()
    decoded = sniffer("decode", ring, "--quiet")
    assert decoded.status == 0, decoded.err
    whole = tmp_path / "whole.mcap"
    assert sniffer("recover", ring, "-o", whole).status == 0
    assert raw(whole)["bus0"] == speaker.said
    left = ring.read_bytes()
    with flying(tmp_path, line, *told) as run:
        run.wait_until(lambda: "did not end" in run.said, "it is not told")
        assert run.stop().status == 0
    assert (tmp_path / "incident-0001.mcap").read_bytes() == left
    with flying(tmp_path, line, *told) as run:
        speaker.go_on(0.1)
        ran = run.stop()
    assert "did not end" not in ran.err, "one that was ended on purpose is replaced"
    assert len(files(tmp_path)) == 1


@pytest.mark.parametrize("content", ["notes", "recording"])
def test_a_ring_replaces_no_file_that_is_no_ring(
    content: str, tmp_path: Path, line: Terminal
) -> None:
    kept = tmp_path / "ring.mcap"
    kept.write_text("dear to somebody")
    if content == "recording":
        kept.unlink()
        sniffer("convert", ROOT / "sample_captures" / "mightyzap_clean.log", kept)
    before = kept.read_bytes()
    told = ("--ring", "1s", "--trigger", "no-response", "--ring-file", kept)
    port = f"{line.path}=mightyzap@57600"
    ran = sniffer("record", port, *told, "-o", tmp_path, "--duration", "100ms")
    assert ran.status == 2
    assert ran.complaint == f"{kept} is there already: choose another name, or --force"
    assert kept.read_bytes() == before


def test_the_ring_on_the_disk_has_at_any_time_all_that_the_ring_has(tmp_path: Path) -> None:
    path = tmp_path / "ring.mcap"
    ring = Ring(2 * NS, 1 << 20)
    file = RingFile(path, {"baud": "57600"}, ring)
    said, sizes = b"", set()
    for second in range(40):
        t_ns = 1_700_000_000 * NS + second * NS
        some = [Chunk(bytes([second, k]), t_ns + k, Clock.READ) for k in range(5)]
        said += b"".join(c.data for c in some)
        file.add(ring.add("bus0", some), some)
        ring.trim(t_ns)
        file.flush(t_ns)
        kept = so_far(path)["bus0"]
        sizes.add(len(kept))
        assert said.endswith(kept)
        assert len(kept) >= ring.size
        assert min(c.t_ns or 0 for c in heard(path)) <= max(t_ns - 2 * NS, 1_700_000_000 * NS)
    assert max(sizes) <= 10 * (2 * (2 + MARGIN_NS // NS) + 4), "two rings and the one being copied"
    file.close()
    assert said.endswith(raw(path)["bus0"])
    assert [p.name for p in tmp_path.iterdir()] == ["ring.mcap"]


def test_a_ring_is_bounded_in_bytes_and_says_so(tmp_path: Path, line: Terminal) -> None:
    speaker = Speaker(line)
    with flying(tmp_path, line, "--trigger", "no-response", "--ring", "300B") as run:
        speaker.go_on(1.0)
        speaker.say(LOST + SOUND)
        speaker.until(lambda: bool(files(tmp_path)))
        ran = run.stop()
    assert ran.err.count("the ring is full with") == 1
    (path,) = files(tmp_path)
    assert int(facts(path)["offset.bus0"]) > 300
    assert_true_to_itself(path)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--ring", "60s"), "--ring goes with --trigger: say what a file is written for"),
        (("--trigger", "no-response"), "--trigger, --post and --ring-file go with --ring 60s"),
        (("--post", "3s"), "--trigger, --post and --ring-file go with --ring 60s"),
        (("--ring", "1", "--trigger", "noise"), "'1' is no size or time"),
        (("--ring", "9s", "--trigger", "nose"), "no code or cause 'nose': did you mean noise?"),
        (
            ("--ring", "9s", "--trigger", "temprature > 3"),
            "temprature > 3: mightyzap has no quantity 'temprature': did you mean temperature?",
        ),
        (
            ("--ring", "9s", "--trigger", "noise", "--rotate", "1MB"),
            "a flight recorder begins files by itself: --rotate is not for it",
        ),
        (
            ("--ring", "9s", "--trigger", "noise", "-o", "x.jsonl"),
            "a flight recorder writes recordings: -o x.mcap",
        ),
        (("--ring", "9s", "--trigger", "noise", "-o", "no/x.mcap"), "there is no folder no"),
        (
            ("--ring", "9s", "--trigger", "noise", "-o", "crashes"),
            "there is no folder crashes: make it first",
        ),
        (("--until", "no-respons"), "no code or cause 'no-respons': did you mean no-response?"),
        (("--until", "voltage <"), "'voltage <' is no rule"),
        (("--on", "nothing", "true"), "no code or cause 'nothing'"),
    ],
)
def test_a_mistake_about_what_is_waited_for_is_told_in_one_line(
    tmp_path: Path,
    line: Terminal,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    complaint: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = within(capsys, "record", line.path, "--protocol", "mightyzap", *arguments)
    assert ran.status == 2
    assert complaint in ran.complaint
    assert list(tmp_path.iterdir()) == []


def test_a_rule_ends_a_recording(tmp_path: Path, line: Terminal) -> None:
    with Recorder(tmp_path, "{}=mightyzap", "--until", "voltage<9 V", lines=[line]) as run:
        line.say(SOUND + SUPPLY + packet(1, 0, b"\x50") + SOUND)
        ran = run.ended()
    assert ran == Ran(0, "", ran.err)
    assert "sniffer: stopped: alarm on bus0: voltage < 9 V: servo 1 has 8 V" in ran.err
    assert codes(run.path).count("alarm") == 1
