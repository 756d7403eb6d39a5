"""Buses whose servos are at fault, simulated or said line by line, for the tests of diagnoses."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any

from sniffer.ground.model import NS, Chunk, Clock
from sniffer.simulation.buses import simulate
from sniffer.simulation.faults import read_fault
from sniffer.simulation.mightyzap_servo import packet
from tests.diagnosed import chunks_of, diagnosed, found

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from sniffer.diagnosis import Diagnosis, Finding
    from sniffer.ground.registers import RegisterMap

BEGAN_NS = 1_700_000_000 * NS


@functools.cache
def suffering(
    protocol: str,
    fault: str = "",
    seconds: float = 14.0,
    seed: int = 1,
    model: RegisterMap | None = None,
) -> Diagnosis:
    """Return the diagnosis of a simulated bus with faults (a word each), by an exact clock."""
    faults = [read_fault(word) for word in fault.split()]
    frames = simulate(protocol, seed=seed, faults=faults, duration_s=seconds, start_ns=BEGAN_NS)
    own: dict[str, Any] = (
        {} if model is None else {"tables": (model,), "models": {None: model.model}}
    )
    return diagnosed(chunks_of(frames), protocol, **own)


def finding(diagnosis: Diagnosis, code: str) -> Finding | None:
    """Return the first finding of a code."""
    return next((f for f in found(diagnosis) if f.code == code), None)


def heard(
    said: Iterable[tuple[float, bytes]], protocol: str, clock: Clock = Clock.SAMPLE
) -> Diagnosis:
    """Return the diagnosis of bytes that are said at seconds."""
    chunks = [Chunk(data, BEGAN_NS + round(t * NS), clock) for t, data in said]
    return diagnosed(chunks, protocol, baud=None if clock == Clock.NONE else 115200)


def lss(*told: tuple[float, str]) -> Diagnosis:
    """Return the diagnosis of LSS lines at seconds; several may stand at one moment."""
    lines = [(t, f"{line}\r".encode()) for t, text in told for line in text.split()]
    return heard(_apart(sorted(lines, key=lambda line: line[0])), "lss")


def _apart(lines: Iterable[tuple[float, bytes]]) -> Iterator[tuple[float, bytes]]:
    """Leave between lines of one moment what they take on the line, and a millisecond."""
    free = 0.0
    for t, data in lines:
        free = max(t, free + len(data) * 10 / 115200 + 0.001)
        yield free, data


def polled(
    place: Callable[[float], float],
    goal: Callable[[float], float | None],
    *,
    seconds: float = 12.0,
    every: float = 0.04,
    servo_id: int = 5,
    milliampere: Callable[[float], float] | None = None,
    also: Iterable[tuple[float, str]] = (),
) -> list[tuple[float, str]]:
    """Return an LSS joint that gets goals and is polled: degrees, by seconds."""
    out = [*also]
    told: float | None = None
    for k in range(round(seconds / every)):
        t = k * every
        now = goal(t)
        if now is not None and now != told:
            out.append((t, f"#{servo_id}D{round(now * 10)}"))
            told = now
        out.append((t + 0.002, f"#{servo_id}QD"))
        out.append((t + 0.004, f"*{servo_id}QD{round(place(t) * 10)}"))
        if milliampere is not None:
            out.append((t + 0.006, f"#{servo_id}QC"))
            out.append((t + 0.008, f"*{servo_id}QC{round(milliampere(t))}"))
    return out


def mightyzap_read(
    servo_id: int, t: float, address: int, data: bytes, error: int = 0
) -> list[tuple[float, bytes]]:
    """Return a Load Data and its feedback."""
    request = packet(servo_id, 0xF2, bytes((address, len(data))))
    return [(t, request), (t + 0.005, packet(servo_id, error, data))]


def mightyzap_write(servo_id: int, t: float, address: int, data: bytes) -> tuple[float, bytes]:
    """Return a Store Data, which nobody answers."""
    return t, packet(servo_id, 0xF3, bytes((address,)) + data)
