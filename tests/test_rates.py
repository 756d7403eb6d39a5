"""The rate of a line that nobody stated: found by what holds, from bytes and line errors."""

from __future__ import annotations

import itertools
import os
import threading
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.decoding.rates import Rate, RateSearch, SearchStep
from sniffer.ground.model import NS, Chunk, Clock, InputError, Mark, MarkKind
from sniffer.jobs.compare import compare
from sniffer.jobs.files import Files, Flight
from sniffer.jobs.record import Shown, record
from sniffer.jobs.telling import Teller
from sniffer.mcapfile.source import chunks
from sniffer.ports.tty import TtyPort
from sniffer.protocols import PROTOCOLS
from sniffer.tap import listen
from sniffer.tap.recorder import Wishes
from sniffer.tap.stops import Stops
from sniffer.tap.tap import PortSpec
from tests.commands import frames_of, talk, within
from tests.recorder import Collected, assert_true_to_itself, codes, facts, frames_recorded, so_far
from tests.terminals import LINUX_ONLY, say_until

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from sniffer.jobs.record import Recorded
    from sniffer.ports import PortOptions

TALK: Final = talk(40)
START_NS: Final = 1_700_000_000 * NS
BITS: Final = 10


def misheard(data: bytes, spoken: int, heard: int) -> tuple[bytes, list[int]]:
    """Return what a UART reads of bytes that are spoken at another rate, back to back.

    And which of them had no stop bit. It samples each bit in its middle, and looks for a start bit
    anew behind the stop bit.
    """
    levels: list[int] = []
    for byte in data:
        levels += [0, *(byte >> k & 1 for k in range(8)), 1]
    step = spoken / heard
    out, bad = bytearray(), list[int]()
    at = 0.0
    while True:
        while int(at) < len(levels) and levels[int(at)]:
            at = int(at) + 1.0
        places = [int(at + (k + 0.5) * step) for k in range(BITS)]
        if places[-1] >= len(levels):
            return bytes(out), bad
        bits = [levels[place] for place in places]
        if not bits[9]:
            bad.append(len(out))
        out.append(sum(bit << k for k, bit in enumerate(bits[1:9])))
        at += (BITS - 0.5) * step


def heard_at(data: bytes, spoken: int, rate: int, *, marks: bool, t_ns: int = START_NS) -> Chunk:
    told, bad = (data, []) if rate == spoken else misheard(data, spoken, rate)
    found = tuple(Mark(MarkKind.FRAMING, at, 1) for at in bad) if marks else ()
    return Chunk(told, t_ns, Clock.READ, marks=found)


def tuned(baud: int, t_ns: int) -> Chunk:
    return Chunk(b"", t_ns, Clock.READ, marks=(Mark(MarkKind.TUNED, 0, count=baud),))


def searched(
    search: RateSearch, said: Sequence[bytes], spoken: int, *, marks: bool = True, most: int = 9000
) -> list[int]:
    """Let a search listen to what is said again and again; return the rates that it listened at."""
    rates = [search.baud]
    for nth, data in enumerate(itertools.islice(itertools.cycle(said), most)):
        t_ns = START_NS + nth * NS // 100
        verdict = search.hear([heard_at(data, spoken, rates[-1], marks=marks, t_ns=t_ns)])
        verdict = search.idle(t_ns) if verdict is SearchStep.LISTEN else verdict
        if verdict is SearchStep.FOUND:
            return rates
        if verdict is SearchStep.TRY:
            rates.append(search.baud)
            assert search.hear([tuned(search.baud, t_ns)]) is SearchStep.LISTEN
    raise AssertionError(f"it is not found: {rates}")


def pieces(data: bytes, size: int = 23) -> list[bytes]:
    return [data[at : at + size] for at in range(0, len(data), size)]


# --- the search itself ---------------------------------------------------------------------------


@pytest.mark.parametrize("marks", [True, False])
@pytest.mark.parametrize("spoken", [57600, 115200, 9600, 400000])
def test_the_rate_is_found_from_bytes_and_line_errors(spoken: int, marks: bool) -> None:
    search = RateSearch((), 115200)
    rates = searched(search, pieces(TALK), spoken, marks=marks)
    assert (search.baud, search.is_found) == (spoken, True)
    assert rates[:-1] == search.tried
    assert len(rates) <= 16
    first = b"".join(c.data for c in search.heard())
    if spoken == 115200:
        assert (search.begin, TALK.startswith(first)) == (0, True)
    else:
        assert TALK.find(first[:60]) >= 0, "what was heard at the right rate is kept"
        assert first.startswith(b"\xff\xff\xff"), "from the first frame on"


@pytest.mark.parametrize("protocol", ["lss", "rs30x", "wck"])
def test_of_a_protocol_that_is_named_its_own_rates_are_tried(protocol: str) -> None:
    from tests.recorder import said_by

    p = PROTOCOLS[protocol]
    spoken = p.bauds[-1]
    search = RateSearch((p,), p.baud)
    rates = searched(search, pieces(said_by(protocol)), spoken)
    assert rates[-1] == spoken
    assert set(rates) <= set(p.bauds)


def test_errors_of_the_uart_make_it_leave_sooner() -> None:
    sizes = []
    for marks in (True, False):
        search, heard = RateSearch((), 115200), 0
        for data in itertools.cycle(pieces(TALK)):
            chunk = heard_at(data, 57600, 115200, marks=marks)
            heard += len(chunk.data)
            if search.hear([chunk]) is SearchStep.TRY:
                break
        sizes.append(heard)
    assert sizes[0] < sizes[1] <= 600


def test_a_bad_line_is_still_found_and_nothing_is_left_for_a_little_noise() -> None:
    spoilt = bytearray(TALK)
    for at in range(10, len(spoilt), 60):
        spoilt[at] ^= 0x40
    search = RateSearch((), 115200)
    searched(search, pieces(bytes(spoilt)), 57600, marks=False)
    assert search.baud == 57600


def test_a_rate_that_the_adapter_cannot_do_is_passed_over() -> None:
    search = RateSearch((), 115200)
    while search.hear([heard_at(TALK, 57600, 115200, marks=True)]) is not SearchStep.TRY:
        pass
    first = search.baud
    assert search.cannot(first) is SearchStep.TRY
    assert search.baud != first
    assert search.cannot(first) is SearchStep.LISTEN, "that was answered already"


def test_silence_and_what_comes_before_the_port_listens_anew_decide_nothing() -> None:
    search = RateSearch((), 115200)
    for _ in range(50):
        assert search.hear([Chunk(b"", START_NS, Clock.READ)]) is SearchStep.LISTEN
    while search.hear([heard_at(TALK[:200], 57600, 115200, marks=True)]) is not SearchStep.TRY:
        pass
    for _ in range(9):
        assert search.hear([heard_at(TALK, 57600, 115200, marks=True)]) is SearchStep.LISTEN


def test_what_was_heard_at_other_rates_is_left_out_and_the_rest_decoded_the_same() -> None:
    garbage, _ = misheard(TALK[:300], 57600, 115200)
    every = [Chunk(data, START_NS + k, Clock.READ) for k, data in enumerate(pieces(garbage))]
    right = [Chunk(data, START_NS + NS + k, Clock.READ) for k, data in enumerate(pieces(TALK))]
    told = Options(protocol="mightyzap").with_facts(
        {"baud.bus0": "57600", "rate_since.bus0": str(len(garbage)), "rate": "assumed"}
    )
    assert (told.bauds, told.begins) == ({"bus0": 57600}, {"bus0": len(garbage)})
    for size in (1, 7, 1000):
        kept = Collected()
        pipeline = Pipeline(told, [kept])
        both = [*every, *right]
        for at in range(0, len(both), size):
            pipeline.feed(both[at : at + size])
        pipeline.close()
        assert kept.heard() == garbage + TALK, "a recording has all of it"
        assert next(b.base for b in kept.batches["bus0"]) == len(garbage)
        assert b"".join(b.data for b in kept.batches["bus0"]) == TALK
        found = kept.anomalies()
        assert (found[0], found.count("rate-found")) == ("rate-found", 1)
        assert not set(found) & {"noise", "bad-checksum", "no-response"}


def test_a_rate_is_told_once_also_where_the_first_frame_begins_with_it() -> None:
    kept = Collected()
    pipeline = Pipeline(Options(protocol="mightyzap"), [kept], live=True)
    garbage = Chunk(bytes(40), START_NS, Clock.READ)
    pipeline.record("bus0", [garbage])
    pipeline.tune("bus0", Rate(57600, len(garbage.data), 1_000_000))
    pipeline.feed([tuned(57600, START_NS), Chunk(TALK, START_NS + NS, Clock.READ)])
    pipeline.close()
    assert kept.anomalies().count("rate-found") == 1


# --- in a recording ------------------------------------------------------------------------------


def exchanges(talk: bytes, least: int = 40) -> list[bytes]:
    """Cut talk between frames: a busy machine may make a pause of any length between two pieces."""
    out = [b""]
    for frame, _ in frames_of(talk):
        if len(out[-1]) >= least:
            out.append(b"")
        out[-1] += frame
    return out


class Wire:
    """A line spoken at one rate, and pseudo terminals that hear it at whatever they are set to."""

    def __init__(self, spoken: int) -> None:
        self.spoken = spoken
        self.rates: list[int] = []
        self._master, self._slave = os.openpty()
        self.path = os.ttyname(self._slave)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._talk)
        self.said = b""

    def __enter__(self) -> Wire:
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        os.close(self._master)
        os.close(self._slave)

    def open(self, name: str, options: PortOptions) -> TtyPort:
        wire = self

        class Line(TtyPort):
            """A port with a line behind it: what comes depends on the rate."""

            def retune(self, baud: int) -> None:
                if baud == 250000:
                    raise InputError("this adapter cannot do 250000 baud")
                super().retune(baud)
                wire.rates.append(baud)

        port = Line(name, options)
        port.is_virtual = False
        self.rates.append(options.baud)
        self._thread.start()
        return port

    def _talk(self) -> None:
        for data in itertools.cycle(exchanges(TALK)):
            if self._stop.wait(0.01):
                return
            rate = self.rates[-1]
            heard = data if rate == self.spoken else misheard(data, self.spoken, rate)[0]
            say_until(self._master, heard, self._stop)


@pytest.fixture
def wire(monkeypatch: pytest.MonkeyPatch) -> Iterator[Wire]:
    with Wire(57600) as made:
        monkeypatch.setattr(listen, "open_port", made.open)
        yield made


def recorded(
    wire: Wire, files: Files, spec: PortSpec | None = None, options: Options | None = None
) -> tuple[Recorded, list[str]]:
    said: list[str] = []
    told = record(
        [spec or PortSpec("arm", wire.path)],
        files,
        options,
        stops=Stops(frames=300, duration_ns=120 * NS),
        shown=Shown(),
        wishes=Wishes(),
        tell=Teller(said.append),
    )
    return told, said


@LINUX_ONLY
def test_a_recording_without_a_rate_finds_it_says_so_and_is_replayed_the_same(
    tmp_path: Path, wire: Wire, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mcap"
    told, said = recorded(wire, Files(path))
    assert "frames are decoded" in told.ended
    assert wire.rates[0] == 115200
    assert wire.rates[-1] == 57600
    assert 250000 not in wire.rates
    assert any(line.startswith("arm: no rate is stated: listening at 115200") for line in said)
    assert sum("arm: 57600 bit/s; nothing held at 115200" in line for line in said) == 1
    assert any(line.startswith("arm: mightyzap (sure: explains ") for line in said)
    about = facts(path)
    assert (about["baud.arm"], about["protocol.arm"]) == ("57600", "mightyzap")
    since = int(about["rate_since.arm"])
    assert since > 64
    marks = [m for c in chunks(path) for m in c.marks if m.kind == MarkKind.TUNED]
    assert [m.count for m in marks] == wire.rates[1:]
    frames = frames_recorded(path)["arm"]
    assert frames[0][0] == since
    assert_true_to_itself(path)
    assert codes(path, "arm").count("rate-found") == 1
    assert not {"noise", "bad-checksum", "truncated-frame"} & set(codes(path, "arm"))
    assert compare(path, Options(), say=lambda line: None).equal
    sliced = within(capsys, "replay", path, "--from", "0.01", "--to", "60", "--speed", "0")
    assert sliced.status == 0
    assert sliced.out.count("! no frame") <= 1, "the last one is cut"
    again = tmp_path / "again.mcap"
    assert within(capsys, "decode", path, "-o", again, "--quiet").status == 0
    assert frames_recorded(again)["arm"] == frames
    assert facts(again)["rate_since.arm"] == str(since)


@LINUX_ONLY
def test_a_rate_that_is_right_at_once_is_kept_from_the_first_byte_on(
    tmp_path: Path, wire: Wire
) -> None:
    wire.spoken = 115200
    path = tmp_path / "run.mcap"
    _, said = recorded(wire, Files(path), options=Options(latency_ns=2_000_000))
    assert wire.rates == [115200]
    assert "arm: 115200 bit/s" in said
    assert [facts(path)[f"{key}.arm"] for key in ("rate_since", "latency_ns")] == ["0", "2000000"]
    assert frames_recorded(path)["arm"][0][0] == 0
    assert "rate-found" not in codes(path, "arm")
    assert_true_to_itself(path)


@LINUX_ONLY
@pytest.mark.parametrize(
    ("spec", "options"),
    [
        (PortSpec("arm", "", "mightyzap", 115200), None),
        (PortSpec("arm", ""), Options(protocol="mightyzap", baud=115200)),
    ],
)
def test_a_rate_that_is_stated_is_never_left(
    tmp_path: Path, wire: Wire, spec: PortSpec, options: Options | None
) -> None:
    said: list[str] = []
    record(
        [PortSpec(spec.bus, wire.path, spec.protocol, spec.baud)],
        Files(tmp_path / "run.mcap"),
        options,
        stops=Stops(duration_ns=2 * NS),
        tell=Teller(said.append),
    )
    assert wire.rates == [115200]
    assert not any("no rate is stated" in line for line in said)


@LINUX_ONLY
def test_what_ends_before_the_rate_is_found_is_recorded_all_the_same(
    tmp_path: Path, wire: Wire
) -> None:
    wire.spoken = 31250  # no protocol has it
    path, said = tmp_path / "run.mcap", list[str]()
    record(
        [PortSpec("arm", wire.path)],
        Files(path),
        stops=Stops(duration_ns=3 * NS),
        tell=Teller(said.append),
    )
    assert len(wire.rates) > 2
    assert any("arm: its rate was not found; read as " in line for line in said)
    assert len(so_far(path)["arm"]) > 500


@LINUX_ONLY
def test_a_flight_recorder_s_file_from_before_the_rate_was_found_is_replayed_the_same(
    tmp_path: Path, wire: Wire
) -> None:
    wishes, said = Wishes(), list[str]()

    def tell(line: str) -> None:
        said.append(line)
        wishes.rotate |= "mightyzap (sure" in line

    flight = Flight(3600 * NS, None, ("any",), 200_000_000)
    record(
        [PortSpec("arm", wire.path)],
        Files(tmp_path / "x.mcap", flight=flight),
        stops=Stops(frames=600, duration_ns=120 * NS),
        wishes=wishes,
        tell=Teller(tell),
    )
    path = tmp_path / "x-0001.mcap"
    assert int(facts(path)["rate_since.arm"]) > int(facts(path)["offset.arm"]) == 0
    assert frames_recorded(path)["arm"]
    assert_true_to_itself(path)
