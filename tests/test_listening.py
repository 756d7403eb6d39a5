"""The reader thread and the worker behind it: what they promise each other, and what stops them."""

from __future__ import annotations

import socket
import threading
import time
from typing import TYPE_CHECKING, Any, Final

import pytest
from serial.urlhandler import protocol_socket

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.model import DamagedInputError, MarkKind
from sniffer.jobs.files import Files, open_files
from sniffer.jobs.record import run_recording
from sniffer.jobs.telling import Teller
from sniffer.ports import Port, open_port
from sniffer.ports.remote import SerialPort
from sniffer.ports.tty import TtyPort
from sniffer.tap.events import Back, Event, Lost, Read
from sniffer.tap.listen import Tapping
from sniffer.tap.reader import Anchor, Listener
from sniffer.tap.recorder import Recorder as Worker
from sniffer.tap.recorder import Wishes
from sniffer.tap.stops import Stops
from sniffer.tap.tap import PortSpec, Tap
from tests.commands import talk
from tests.recorder import Collected, Patient, raw, say_slowly
from tests.recordings import messages
from tests.terminals import AT_115200, EVERY_BYTE, LINUX_ONLY, PATIENCE_S, Terminal, wait

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol

pytestmark = LINUX_ONLY

TALK: Final = talk(60)


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


class Listening:
    """A listener and what came of it so far. Use it with ``with``."""

    def __init__(self, *ports: Port) -> None:
        self.anchor = Anchor.take()
        self.listener = Listener(ports, [AT_115200] * len(ports), self.anchor)
        self.events: list[Event] = []

    def __enter__(self) -> Listening:
        self.listener.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.listener.stop()

    def take(self) -> list[Event]:
        self.events += self.listener.drain()
        return self.events

    def heard(self, port: int = 0) -> bytes:
        """Return the bytes of a port; none of the tests says what must be escaped."""
        return b"".join(e.data for e in self.take() if isinstance(e, Read) and e.port == port)

    def wait_for(self, data: bytes, port: int = 0) -> None:
        wait(lambda: self.heard(port).endswith(data), "it was not heard")

    def wait_past(self, t_ns: int) -> None:
        """Wait until it is said that all up to then is heard."""
        wait(lambda: self.listener.heard_ns > t_ns, "nobody says that all is heard")

    def wait_for_event(self, kind: type[Event]) -> Any:
        wait(lambda: any(isinstance(e, kind) for e in self.take()), f"no {kind.__name__}")
        return next(e for e in self.events if isinstance(e, kind))


# --- the reader ----------------------------------------------------------------------------------


def test_what_comes_after_it_was_said_that_all_is_there_has_a_later_stamp(line: Terminal) -> None:
    with Listening(open_port(line.path, AT_115200)) as it:
        speaker = threading.Thread(target=say_slowly, args=(line, b"abcdefgh" * 100, 8))
        speaker.start()
        promised = stamped = size = 0
        end = time.monotonic() + PATIENCE_S
        while size < 800:
            assert time.monotonic() < end, f"{size} of 800 bytes came"
            heard_ns = it.listener.heard_ns
            for event in it.listener.drain():
                assert isinstance(event, Read)
                assert event.t_ns >= promised
                assert event.t_ns >= stamped
                stamped = event.t_ns
                size += len(event.data)
            assert heard_ns >= promised
            promised = heard_ns
            time.sleep(0.0002)
        speaker.join()
        wait(lambda: it.listener.heard_ns > stamped, "silence is not told")
        assert it.listener.heard_ns <= it.anchor.now()


def test_a_port_is_read_again_when_it_is_back_by_its_name(tmp_path: Path) -> None:
    link = tmp_path / "adapter"
    with Terminal() as first, Terminal() as second:
        first.plug_in_at(link)
        with Listening(open_port(str(link), AT_115200)) as it:
            first.say(b"before")
            it.wait_for(b"before")
            link.unlink()
            first.hang_up()
            lost = it.wait_for_event(Lost)
            second.plug_in_at(link)
            back = it.wait_for_event(Back)
            assert lost.t_ns < back.t_ns <= it.anchor.now()
            second.say(b"after")
            it.wait_for(b"after")
            assert it.heard() == b"beforeafter"
            assert isinstance(back.opened, TtyPort)


def test_an_address_that_does_not_answer_keeps_no_other_port_waiting(
    line: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    # who tries to connect gives up later than anything here is waited for
    monkeypatch.setattr(protocol_socket, "POLL_TIMEOUT", 2 * PATIENCE_S)
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen(0)
        server.settimeout(PATIENCE_S)
        host, number = server.getsockname()
        ports = [open_port(f"socket://{host}:{number}", AT_115200), open_port(line.path, AT_115200)]
        far, _ = server.accept()
        with socket.create_connection((host, number)), Listening(*ports) as it:
            far.close()  # and nobody will be let in any more: the server's queue is full
            it.wait_for_event(Lost)
            time.sleep(0.5)  # by now it is tried again
            for n in range(5):
                said_ns = it.anchor.now()
                line.say(b"hello%d" % n)
                it.wait_for(b"hello%d" % n, port=1)
                it.wait_past(said_ns)
            assert not any(isinstance(e, Back) for e in it.events)


def test_a_port_that_cannot_be_polled_has_a_thread_of_its_own(line: Terminal) -> None:
    port = SerialPort(line.path, AT_115200)
    assert not port.pollable
    with Listening(port) as it:
        line.say(EVERY_BYTE)
        it.wait_for(EVERY_BYTE)
        line.say(b"the last words")
        it.listener.stop()
        assert it.heard() == EVERY_BYTE + b"the last words"


def test_what_was_said_before_it_is_stopped_can_be_drained_and_the_port_is_let_go(
    line: Terminal,
) -> None:
    with Listening(open_port(line.path, AT_115200)) as it:
        for _ in range(300):  # it rests between two reads
            line.say(b"abcdefgh")
        time.sleep(0.01)  # the kernel's own way from one end to the other
        it.listener.stop()
        it.listener.stop()
        assert it.heard() == b"abcdefgh" * 300
        assert it.listener.died is None
    open_port(line.path, AT_115200).close()


class Crowded(TtyPort):
    """A port whose kernel moves up late what does not fit in a read, and is slow besides."""

    moved_up_at = 0.0

    def read(self) -> bytes:
        if time.monotonic() < self.moved_up_at:
            return b""
        data = super().read()
        if data and not self.moved_up_at:
            time.sleep(0.11)  # another program has the processor
            self.moved_up_at = time.monotonic() + 0.01
        return data


def test_what_did_not_fit_in_a_read_when_the_end_is_asked_for_is_heard(line: Terminal) -> None:
    port = Crowded(line.path, AT_115200)
    said = b"abcdefgh" * 900
    with Listening(port) as it:
        line.say(said)
        it.listener.stop()
        assert it.heard() == said
        assert it.listener.died is None


def test_a_listener_that_looks_for_a_port_ends_at_once(tmp_path: Path) -> None:
    link = tmp_path / "adapter"
    with Terminal() as line:
        line.plug_in_at(link)
        with Listening(open_port(str(link), AT_115200)) as it:
            link.unlink()
            line.hang_up()
            it.wait_for_event(Lost)
            before = threading.active_count()
            it.listener.stop()
            wait(lambda: threading.active_count() < before, "somebody still looks for it")


class Broken(TtyPort):
    """A port whose driver answers nonsense after some reads."""

    reads = 0

    def read(self) -> bytes:
        data = super().read()
        self.reads += bool(data)
        if self.reads > 3:
            raise ValueError("nonsense")
        return data


def test_a_reader_that_dies_says_so_and_leaves_a_whole_recording(
    tmp_path: Path, line: Terminal, capsys: pytest.CaptureFixture[str]
) -> None:
    port = Broken(line.path, AT_115200)
    spec = PortSpec("arm", line.path, "mightyzap")
    anchor = Anchor.take()
    listener = Listener([port], [AT_115200], anchor)
    options = Options(protocols={"arm": "mightyzap"}, latencies={"arm": 2_000_000})
    tapping = Tapping(listener, (Tap(spec, port),), anchor, options, {}, {})
    path = tmp_path / "run.mcap"
    file, sinks = open_files(Files(path), {})
    told: list[str] = []
    listener.start()
    speaker = threading.Thread(target=say_slowly, args=(line, TALK, 900), kwargs={"pause_s": 0.1})
    speaker.start()
    with pytest.raises(DamagedInputError, match="reading stopped by itself: ValueError"):
        run_recording(
            tapping, file, sinks, Stops(), tell=Teller(told.append), mode=None, wishes=Wishes()
        )
    speaker.join()
    assert any("bytes recorded, " in line for line in told)
    kept = raw(path)["arm"]  # whole, by the library's own reader
    assert len(kept) >= 900
    assert TALK.startswith(kept)
    assert messages(path)["/arm/frames"]


# --- the worker ----------------------------------------------------------------------------------


class Slow(Collected):
    """A sink that takes its time for what was decoded."""

    def __init__(self, pause_s: float) -> None:
        super().__init__()
        self._pause_s = pause_s

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        super().write(bus, protocol, batch)
        time.sleep(self._pause_s)


class Working:
    """A worker over a real listener and a pipeline without a file."""

    def __init__(self, line: Terminal, sink: Collected, stops: Stops, **options: Any) -> None:
        port = open_port(line.path, AT_115200)
        anchor = Anchor.take()
        self.listener = Listener([port], [AT_115200], anchor)
        self.wishes = Wishes()
        self.pipeline = Pipeline(Options(protocol="mightyzap"), [sink], live=True)
        self.taps = [Tap(PortSpec("bus0", line.path, "mightyzap"), port)]
        self.worker = Worker(
            *(self.listener, self.taps, anchor, self.pipeline, None, stops),
            wishes=self.wishes,
            **options,
        )

    def run(self) -> str:
        self.listener.start()
        ended = self.worker.run()
        self.pipeline.close()
        self.pipeline.finish()
        return ended


def test_bytes_that_nobody_has_time_to_decode_are_recorded_and_counted(line: Terminal) -> None:
    sink = Slow(0.15)
    it = Working(line, sink, Stops(idle_ns=300_000_000), backlog=100_000)
    said = TALK * 200  # 1 MB, and a batch of 64 KB takes 0.15 s
    speaker = threading.Thread(target=line.say, args=(said,))
    speaker.start()
    assert it.run().startswith("no byte for")
    speaker.join()
    assert sink.heard() == said
    assert it.worker.skipped > 100_000
    remarks = [r for b in sink.batches["bus0"] for r in b.remarks]
    kinds = {r.kind for r in remarks} - {MarkKind.HELD}  # a busy machine comes late
    assert kinds == {MarkKind.SKIPPED, MarkKind.ENDED}
    skipped = [r.count for r in remarks if r.kind == MarkKind.SKIPPED]
    assert sum(skipped) == it.worker.skipped
    assert "not-decoded" in sink.anomalies()
    decoded = sum(len(b.data) for b in sink.batches["bus0"])
    assert decoded + it.worker.skipped == len(said)
    for batch in sink.batches["bus0"]:  # what is decoded stands where it stood in the stream
        assert said[batch.base : batch.base + len(batch.data)] == batch.data
    assert it.worker.status().waiting == 0


def test_decoding_that_is_too_slow_keeps_no_condition_from_ending_the_recording() -> None:
    with Patient() as line:
        sink = Slow(0.1)
        it = Working(line, sink, Stops(duration_ns=600_000_000))
        it.wishes.hurry = True  # at the end the rest is only recorded
        over = threading.Event()

        def speak() -> None:
            while not over.wait(0.0005):
                if line.takes_more():
                    line.say(TALK[:900])

        speaker = threading.Thread(target=speak)
        speaker.start()
        assert it.run() == "0.6 s are over"
        over.set()
        speaker.join()
    assert it.worker.skipped > 0
    assert len(sink.heard()) == it.taps[0].bytes
    decoded = sum(len(b.data) for b in sink.batches["bus0"])
    assert decoded + it.worker.skipped == it.taps[0].bytes
