"""Scenarios of programs: captures that are not raw, and drivers with wrong checksums."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.diagnosis.ear import tapped
from bench.diagnosis.making import bench_of, plan, talked
from bench.diagnosis.scenario import Heard, Scenario, Truth
from bench.diagnosis.wires import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    Change = Callable[[bytes], bytes]


def _without(*values: int) -> Change:
    return lambda data: bytes(value for value in data if value not in values)


AS_TEXT: Final[tuple[Change, ...]] = (
    lambda data: data.decode("latin-1").encode(),
    lambda data: data.decode(errors="replace").encode(),
    lambda data: bytes(value & 0x7F for value in data),
    lambda data: data.replace(b"\xff", b"\xff\xff"),
)
"""What text files and telnet make of bytes of which some have an eighth bit."""

CONTROLS: Final[tuple[Change, ...]] = (
    lambda data: data.replace(b"\n", b"\r\n"),
    lambda data: data.replace(b"\r", b"\n"),
    _without(0x00),
    _without(0x0D),
    _without(0x11, 0x13),
    _without(0x03, 0x04, 0x1A, 0x1C),
)
"""What terminals and programs make of control characters; answers with a checksum show it."""

LINES: Final[tuple[Change, ...]] = (lambda data: data.replace(b"\r", b"\n"), _without(0x0D))
"""What they make of LSS, which is text."""

SEALS: Final[tuple[Callable[[bytes, int], int], ...]] = (
    lambda packet, right: right ^ 0xFF,
    lambda packet, right: right + 1,
    lambda packet, right: 0,
    lambda packet, right: sum(packet[:-1]),
    lambda packet, right: ~sum(packet[1:-1]),
)
"""What drivers write for a checksum."""


def scenarios(draw: int = 0) -> Iterator[Scenario]:
    """Yield all of these, drawn anew for each number."""
    for protocol in PROTOCOLS:
        yield not_raw(protocol, draw)
        if protocol != "lss":  # it has no checksum
            yield wrong_sums(protocol, draw)


def not_raw(protocol: str, draw: int) -> Scenario:
    """A program between the tap and the capture takes bytes for text, or for a terminal's."""
    it = plan("tap-not-raw", protocol, draw, seconds=(8, 14))
    known = {"lss": LINES, "wck": AS_TEXT}.get(protocol, (*AS_TEXT, *CONTROLS))
    change = it.rng.choice(known)

    def make(seed: int) -> list[Heard]:
        heard = tapped(talked(it, seed, bench_of(it, seed)))
        return _changed(heard, change)

    truth = Truth("tap-not-raw", (), 0.0, it.seconds, ("bytes-translated",))
    return Scenario(it.name, protocol, (truth,), it.baud, make)


def _changed(heard: Sequence[Heard], change: Change) -> list[Heard]:
    changed = (h._replace(wire=change(h.wire)) for h in heard)
    return [h for h in changed if h.wire]


def wrong_sums(protocol: str, draw: int) -> Scenario:
    """A controller computes every checksum wrongly, and nobody answers."""
    it = plan("malformed-command-sums", protocol, draw, seconds=(8, 14), retries=0)
    seal = it.rng.choice(SEALS)
    most = 0x7F if protocol == "wck" else 0xFF

    def make(seed: int) -> list[Heard]:
        heard = tapped(talked(it, seed, bench_of(it, seed)))
        return [
            h._replace(wire=h.wire[:-1] + bytes((seal(h.wire, h.wire[-1]) & most,)))
            for h in heard
            if h.tx
        ]

    truth = Truth("malformed-command", (), 0.0, it.seconds, ("sums-wrong",))
    return Scenario(it.name, protocol, (truth,), it.baud, make)
