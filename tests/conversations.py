"""Conversations written exchange by exchange, into which tests of the diagnosis build faults."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.model import NS, Chunk, Clock, Direction, Mark
from tests.diagnosed import diagnosed
from tests.streams import mightyzap, rs30x, wck

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sniffer.diagnosis import Diagnosis

T0: Final = 1_795_215_306 * NS
MS: Final = 1_000_000
BAUD: Final = 115200


class Tongue(NamedTuple):
    """How one protocol asks where a servo is, how it answers, and how it is sent somewhere.

    ``tells`` answers a goal, where the servo does so. Places are 0..1.
    """

    ask: Callable[[int], bytes]
    answer: Callable[[int, float], bytes]
    goal: Callable[[int, float], bytes]
    tells: Callable[[int, float], bytes] | None = None


def _u16(value: float) -> bytes:
    return round(value).to_bytes(2, "little")


def _i16(value: float) -> bytes:
    return round(value).to_bytes(2, "little", signed=True)


def _wck_state(servo: int, place: float) -> bytes:
    del servo
    return bytes([3, 1 + round(place * 253)])


TONGUES: Final[Mapping[str, Tongue]] = MappingProxyType(
    {
        "mightyzap": Tongue(
            lambda servo: mightyzap.packet(servo, 0xF2, b"\x8c\x02"),
            lambda servo, place: mightyzap.packet(servo, 0, _u16(place * 4095)),
            lambda servo, place: mightyzap.packet(servo, 0xF3, b"\x86" + _u16(place * 4095)),
        ),
        "lss": Tongue(
            lambda servo: b"#%dQD\r" % servo,
            lambda servo, place: b"*%dQD%d\r" % (servo, round(place * 1800 - 900)),
            lambda servo, place: b"#%dD%d\r" % (servo, round(place * 1800 - 900)),
        ),
        "rs30x": Tongue(
            lambda servo: rs30x.packet(servo, 0x0F, 0x2A, 2, 0),
            lambda servo, place: rs30x.returned(servo, 0x2A, _i16(place * 2400 - 1200)),
            lambda servo, place: rs30x.write(servo, 0x1E, _i16(place * 2400 - 1200)),
        ),
        "wck": Tongue(
            lambda servo: wck.command(5 << 5 | servo, 0),
            _wck_state,
            lambda servo, place: wck.command(1 << 5 | servo, 1 + round(place * 253)),
            _wck_state,
        ),
    }
)


class Conversation:
    """A controller and servos that answer what they are asked, on one line; a chunk a frame."""

    def __init__(self, protocol: str, baud: int = BAUD) -> None:
        self.protocol = protocol
        self.tongue = TONGUES[protocol]
        self.chunks: list[Chunk] = []
        self.now_ns = T0
        self.byte_ns = 10 * NS // baud
        self.baud = baud

    @property
    def now_s(self) -> float:
        return (self.now_ns - T0) / NS

    def say(
        self,
        data: bytes,
        side: Direction = Direction.UNKNOWN,
        marks: tuple[Mark, ...] = (),
    ) -> None:
        """Put bytes on the line."""
        self.now_ns += len(data) * self.byte_ns
        self.chunks.append(Chunk(data, self.now_ns, Clock.SAMPLE, direction=side, marks=marks))

    def rest(self, ms: float) -> None:
        self.now_ns += round(ms * MS)

    def until(self, s: float) -> None:
        """Say nothing until a time; it may be over."""
        self.now_ns = max(self.now_ns, T0 + round(s * NS))

    def read(self, servo: int, place: float) -> None:
        """Ask where a servo is, and hear it."""
        self.say(self.tongue.ask(servo), Direction.TX)
        self.rest(0.3)
        self.say(self.tongue.answer(servo, place), Direction.RX)
        self.rest(0.4)

    def ask_in_vain(self, servo: int, wait_ms: float = 25) -> None:
        """Ask a servo that does not answer."""
        self.say(self.tongue.ask(servo), Direction.TX)
        self.rest(wait_ms)

    def send(self, servo: int, place: float) -> None:
        """Send a servo somewhere."""
        self.say(self.tongue.goal(servo, place), Direction.TX)
        if self.tongue.tells is not None:
            self.rest(0.3)
            self.say(self.tongue.tells(servo, place), Direction.RX)
        self.rest(0.4)

    def write(self, request: bytes) -> None:
        """Say a request that nobody answers."""
        self.say(request, Direction.TX)
        self.rest(0.4)

    def diagnosed(self, chunks: Iterable[Chunk] | None = None) -> Diagnosis:
        """Return the diagnosis of what was said, or of what a tap made of it."""
        heard = self.chunks if chunks is None else list(chunks)
        return diagnosed(heard, self.protocol, baud=self.baud)


def swinging(servo: int, s: float) -> float:
    """Return where a servo is to be: it swings, each in its own time."""
    return 0.5 + 0.3 * math.sin(2 * math.pi * (0.3 + 0.05 * servo) * s)


Doing = Callable[[Conversation, int], None]


def robot(
    protocol: str,
    seconds: float = 8.0,
    *,
    servos: Sequence[int] = (1, 2, 3),
    rate_hz: float = 40,
    path: Callable[[int, float], float] = swinging,
    before: Doing | None = None,
    instead: Callable[[Conversation, int, int], bool] | None = None,
    behind: Doing | None = None,
    baud: int = BAUD,
    goals: bool = True,
) -> Conversation:
    """Return a control loop: goals and reads of all servos, cycle after cycle.

    ``before`` and ``behind`` do something more in a cycle, ``instead`` may do a read otherwise.
    """
    talk = Conversation(protocol, baud)
    for cycle in range(int(seconds * rate_hz)):
        talk.until(cycle / rate_hz)
        if before is not None:
            before(talk, cycle)
        for servo in servos:
            place = path(servo, talk.now_s)
            if goals:
                talk.send(servo, place)
            if instead is None or not instead(talk, cycle, servo):
                talk.read(servo, place)
        if behind is not None:
            behind(talk, cycle)
    return talk


def echoed(talk: Conversation) -> list[Chunk]:
    """Let the adapter hear what it sends."""
    out = []
    for chunk in talk.chunks:
        if chunk.direction == Direction.TX:
            note = (chunk.t_ns or 0) - len(chunk.data) * talk.byte_ns + 1
            out.append(replace(chunk, t_ns=note, direction=Direction.UNKNOWN))
        out.append(replace(chunk, direction=Direction.UNKNOWN))
    return out


def one_wire(talk: Conversation) -> list[Chunk]:
    """Return what is heard where nobody tells the wires apart."""
    return [replace(chunk, direction=Direction.UNKNOWN) for chunk in talk.chunks]


def through_usb(chunks: Iterable[Chunk], timer_ms: int = 16) -> list[Chunk]:
    """Return what a host delivers that fetches bytes every so many ms."""
    timer = timer_ms * MS
    out: dict[int, bytearray] = {}
    for chunk in chunks:
        assert chunk.t_ns is not None
        out.setdefault(-(-chunk.t_ns // timer) * timer, bytearray()).extend(chunk.data)
    return [Chunk(bytes(data), t, Clock.READ) for t, data in out.items()]


def without_clock(chunks: Iterable[Chunk]) -> list[Chunk]:
    """Return the bare bytes."""
    return [Chunk(b"".join(chunk.data for chunk in chunks))]
