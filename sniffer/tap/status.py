"""How a recording is going, for whoever shows it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class BusStatus:
    """One bus now.

    ``state`` is listening, silent (no byte for a second) or away (its port is unplugged).
    ``protocol`` is None until the bytes have told it. ``line_errors`` is None where neither the
    driver's marks nor its counters tell.
    """

    bus: str
    port: str
    baud: int
    protocol: str | None
    state: str
    bytes: int
    lost: int
    """Times that bytes were lost on the tap's side."""
    line_errors: int | None


@dataclass(frozen=True, slots=True)
class Status:
    """The recording now; ``file`` is the one being written, ``size`` its bytes so far.

    ``waiting`` is how many bytes were read from the ports and are not decoded yet, ``now_ns`` the
    time on the recording's clock (Unix, in ns).
    """

    elapsed_s: float
    now_ns: int
    file: str
    size: int
    waiting: int
    buses: tuple[BusStatus, ...]
