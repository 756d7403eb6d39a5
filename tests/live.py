"""Traffic for a recording that is shown while it is made, and the processes that show it."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import time
import warnings
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.pipeline import Options
from sniffer.ground.model import Chunk, Clock
from sniffer.viewers import viewer
from tests.streams.mightyzap import packet
from tests.viewer import connected

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sniffer.viewers.companion.parent import LiveView

LOAD: Final = 0xF2
POSITION, VOLTAGE = 0x8C, 0x92
START_NS: Final = 1_795_000_000_000_000_000
OPTIONS: Final = Options(protocol="mightyzap", baud=1_000_000)
MS: Final = 1_000_000


def asked(servo: int, address: int, reply: bytes) -> bytes:
    return packet(servo, LOAD, bytes([address, len(reply)])) + packet(servo, 0, reply)


def talk(ms: int, servos: Sequence[int] = (1, 2), first_ms: int = 0) -> list[Chunk]:
    """A millisecond a chunk: one servo asked for its position, and now and then for its voltage."""
    out = []
    for k in range(first_ms, first_ms + ms):
        servo = servos[k % len(servos)]
        data = asked(servo, POSITION, (1000 + k % 2000).to_bytes(2, "little"))
        if k % 50 < len(servos):
            data += asked(servo, VOLTAGE, b"\x78")
        out.append(Chunk(data, START_NS + k * MS, Clock.READ))
    return out


def busy(ms: int) -> list[Chunk]:
    """What 1 Mbit/s brings in a millisecond, time and again."""
    data = b"".join(asked(1 + k % 3, POSITION, (k % 4096).to_bytes(2, "little")) for k in range(99))
    starts = range(0, len(data) - 92, 92)
    at = [starts[k % len(starts)] for k in range(ms)]  # a read is an object of its own, each time
    return [Chunk(data[a : a + 92], START_NS + k * MS, Clock.READ) for k, a in enumerate(at)]


def until(is_so: Callable[[], Any], seconds: float = 180.0) -> None:
    deadline = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def until_it_has(live: LiveView, is_so: Callable[[], Any]) -> None:
    """Wait as a recorder does on silent buses."""

    def look() -> Any:
        live.keep_up()
        return is_so()

    until(look)


class Said(list[str]):
    """What the people at the recorder were told."""

    def __call__(self, line: str) -> None:
        assert "\n" not in line
        self.append(line)


def group(leader: int) -> dict[int, list[str]]:
    """Return the processes of a group with their command lines; the dead are not counted."""
    out = {}
    for place in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            stat = (place / "stat").read_text().rpartition(")")[2].split()
            if int(stat[2]) == leader and stat[0] != "Z":
                out[int(place.name)] = (place / "cmdline").read_text().split("\0")
    return out


def viewer_of(live: LiveView) -> tuple[int, str]:
    """Return process id and address of the viewer that a view has started, once it answers."""
    found: list[tuple[int, str]] = []

    def is_there() -> bool:
        for pid, arguments in group(live.pid).items():
            if pid != live.pid and "--port" in arguments:
                port = int(arguments[arguments.index("--port") + 1])
                if viewer.listens("127.0.0.1", port):
                    found.append((pid, f"rerun+http://127.0.0.1:{port}/proxy"))
        return bool(found)

    until(is_there)
    return found[0]


def looks(live: LiveView) -> int:
    """Return the process id of the viewer once it shows something."""
    pid, address = viewer_of(live)
    client = connected(address)
    until_it_has(live, lambda: client.get_state().recordings)
    return pid


def fed(live: LiveView, chunks: Sequence[Chunk], step: int = 50, bus: str = "bus0") -> None:
    """Feed chunks as the recorder does, in steps, but without waiting between them."""
    for at in range(0, len(chunks), step):
        live.raw(bus, chunks[at : at + step])
        live.keep_up()


@contextlib.contextmanager
def saver(path: Path) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Run a viewer that draws nothing: it writes down what it is sent."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    arguments = ("--save", str(path), "--port", str(port), "--bind", "127.0.0.1")
    with subprocess.Popen(
        [viewer.executable(), *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "CI": "1"},
    ) as process:
        try:
            until(lambda: viewer.listens("127.0.0.1", port))
            yield process, f"http://127.0.0.1:{port}"
        finally:
            process.send_signal(signal.SIGCONT)
            size = -1
            while size != (size := path.stat().st_size if path.exists() else 0):
                time.sleep(0.3)  # until it has written down what it has taken
            process.send_signal(signal.SIGINT)


def saved(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Return the rows of a .rrd by entity: time and value."""
    rows: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)  # a saver that is stopped writes no footer
        reader = RrdReader(str(path))
    for chunk in reader.stream():
        batch = chunk.to_record_batch()
        if not chunk.is_static:
            times = batch.column("time").cast("int64").to_pylist()
            *_, name = (n for n in batch.schema.names if ":" in n)
            rows[chunk.entity_path] += zip(
                times, (v[0] for v in batch.column(name).to_pylist()), strict=True
            )
    return rows


def decoded(chunks: Sequence[Chunk], servo: int = 1) -> list[tuple[int, float]]:
    """Return the positions of a servo."""
    decoder = Decoder("mightyzap", baud=1_000_000)
    out: list[tuple[int, float]] = []
    for batch in (decoder.feed(*chunks), decoder.close()):
        s = batch.samples
        names = [register.name for register in decoder.protocol.registers]
        number = names.index("present_position")
        mine = (s.servo_id == servo) & (s.register == number)
        out += zip(s.t_ns[mine].tolist(), s.value[mine].tolist(), strict=True)
    return out
