"""A port listened to, and judged: ``sniffer.examine`` is what the command ``doctor`` calls."""

from __future__ import annotations

import contextlib
import os
import selectors
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol, runtime_checkable

from sniffer.decoding.names import protocols_named
from sniffer.decoding.pipeline import AUTO
from sniffer.decoding.understanding import understand, usual_bauds
from sniffer.doctor.adapter import about_echo
from sniffer.doctor.records import Level, Listened, Trial
from sniffer.doctor.verdicts import diagnose, worst
from sniffer.ground.limits import BAUDS, FALLBACK_BAUD, whole
from sniffer.ground.model import NS, Chunk, Clock, InputError
from sniffer.ports import Port, PortLostError, PortOptions, open_port
from sniffer.ports.listing import port_at

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from sniffer.decoding.understanding import Understanding
    from sniffer.doctor.records import Observation

TRIAL_S: Final = 1.0
"""How long another baud is listened at."""

TRIAL_BYTES: Final = 1000
"""Bytes that are enough to tell whether it is the right one, though it begins within a frame."""


@runtime_checkable
class Tunable(Port, Protocol):
    """A port whose baud can be changed while it stays open: RTS and DTR stay as they are."""

    def set_baud(self, baud: int) -> None:
        """Listen at another baud; what has come and was not read is thrown away."""


@dataclass(frozen=True, slots=True)
class Examined:
    """What listening to a port has shown: what was heard, what it is, and the verdicts."""

    heard: Listened
    found: Understanding
    verdicts: tuple[Observation, ...]

    @property
    def level(self) -> Level:
        """How bad the worst verdict is: with ``BAD`` it is not fit to be recorded from."""
        return worst(self.verdicts)

    def summary(self) -> dict[str, Any]:
        """Return what it comes to, as one JSON object; each verdict is another (``as_dict``)."""
        return {
            "type": "summary",
            "level": self.level.name.lower(),
            "port": self.heard.path,
            "protocol": self.found.protocol,
            "baud": self.heard.baud,
            "seconds": round(self.heard.seconds, 3),
            "bytes": self.heard.size,
        }


def _silent(message: str) -> None:
    """Tell nobody."""


def examine(
    port: str,
    protocol: str = AUTO,
    *,
    baud: int | None = None,
    seconds: float = 5.0,
    modem: Literal["low", "keep"] = "low",
    shared: bool = False,
    tell: Callable[[str], None] = _silent,
) -> Examined:
    """Open a port, listen, let go of it, and judge whether it is fit to be recorded from.

    Nothing is written to it.

    Args:
        port: its name or address.
        protocol: what is spoken there, or ``"auto"``.
        baud: bits per second; where None the protocol's own, and others are tried if it is not
            right.
        seconds: how long each baud is listened at, but those that are only tried.
        modem: what becomes of RTS and DTR, which the system raises: put low, or kept.
        shared: open a port that another program has open, too.
        tell: takes a line about what is done meanwhile.

    Raises:
        InputError: the port cannot be opened; the message says what to do.
        SnifferError: a number that cannot be.
    """
    how = _how(protocol, baud, modem, shared=shared)
    info = port_at(port)
    with contextlib.closing(open_port(port, how)) as opened:
        about = Listened(
            path=port,
            chunks=(),
            seconds=seconds,
            baud=how.baud,
            protocol=protocol,
            marks_errors=opened.marks_errors,
            latency_ns=opened.latency_ns,
            facts=opened.facts(),
            info=info,
            has_line=_has_line(port),
            counts_errors=opened.counts_errors,
        )
        heard = hear(opened, about, baud_is_named=baud is not None, tell=tell)
    return judged(heard)


def judged(heard: Listened) -> Examined:
    """Return the verdicts on what was heard."""
    found = understand(heard.chunks, heard.protocol, heard.line_baud)
    return Examined(heard, found, tuple(diagnose(heard)))


def prepare(
    port: str,
    protocol: str = AUTO,
    *,
    baud: int | None = None,
    modem: Literal["low", "keep"] = "low",
    shared: bool = False,
) -> Observation:
    """Open a port and let go of it, so that it echoes nothing when it is opened again.

    The kernel keeps the settings until the adapter is unplugged.

    Raises:
        InputError: the port cannot be opened, or is none of this machine.
    """
    with contextlib.closing(open_port(port, _how(protocol, baud, modem, shared=shared))) as opened:
        verdict = about_echo(opened.facts())
    if verdict is None:
        raise InputError(f"{port} is no port of this machine: its echo is not ours to switch off")
    return verdict


def _how(
    protocol: str, baud: int | None, modem: Literal["low", "keep"], *, shared: bool
) -> PortOptions:
    """Return how a port is opened; the baud is the protocol's own where none is named."""
    if baud is None:
        baud = FALLBACK_BAUD if protocol == AUTO else protocols_named(protocol)[0].baud
    return PortOptions(whole("baud", baud, *BAUDS), modem, shared=shared)


def _has_line(name: str) -> bool:
    """Tell whether a UART keeps the baud that is asked for."""
    if "://" in name:
        return name.lower().startswith("rfc2217://")
    return not os.path.realpath(name).startswith("/dev/pts/")


def hear(
    port: Port,
    about: Listened,
    *,
    baud_is_named: bool,
    tell: Callable[[str], None] = _silent,
) -> Listened:
    """Listen at the baud of ``about``; if it may be wrong, at others, too.

    If nobody has named a baud and one of the others is right, that one is listened at to the end.
    """
    heard = _listen(port, about, tell)
    found = understand(heard.chunks, heard.protocol, heard.line_baud)
    if not heard.has_line:
        if not baud_is_named and found.protocol is not None:
            heard = replace(heard, baud=protocols_named(found.protocol)[0].baud)
        return heard
    silent = not heard.size and not heard.line_errors
    if found.good or silent or heard.gone_s is not None or not isinstance(port, Tunable):
        return heard
    trials = _trials(port, heard, tell)
    best = max(trials, key=lambda t: t.found.share, default=None)
    if not baud_is_named and best is not None and best.found.good:
        port.set_baud(best.baud)
        return _listen(port, replace(about, baud=best.baud), tell)
    return replace(heard, trials=tuple(trials))


def _listen(
    port: Port, about: Listened, tell: Callable[[str], None], enough: int | None = None
) -> Listened:
    """Listen for ``about.seconds``, or until there are ``enough`` bytes."""
    if enough is None:
        tell(f"listening to {about.path} for {about.seconds:g} s at {about.baud} baud")
    before = port.counters()
    chunks: list[Chunk] = []
    began = time.monotonic_ns()
    until = began + int(about.seconds * NS)
    gone_s = None
    size = 0
    try:
        for t_ns, raw in _reads(port, until):
            data, marks = port.unmark(raw)
            chunks.append(Chunk(data, t_ns, Clock.READ, marks=marks))
            size += len(data)
            if enough is not None and size >= enough:
                break
    except PortLostError:
        gone_s = (time.monotonic_ns() - began) / NS
    after = None if gone_s is not None else port.counters()
    return replace(
        about,
        chunks=chunks,
        seconds=(time.monotonic_ns() - began) / NS,
        risen=after.since(before) if before is not None and after is not None else None,
        gone_s=gone_s,
    )


def _reads(port: Port, until: int) -> Iterator[tuple[int, bytes]]:
    """Yield each read and its time, as soon as it can be had."""
    with selectors.DefaultSelector() as selector:
        if port.pollable:
            selector.register(port.fileno(), selectors.EVENT_READ)
        while (now := time.monotonic_ns()) < until:
            if port.pollable and not selector.select((until - now) / NS):
                return
            raw = port.read()
            if raw:
                yield time.monotonic_ns(), raw


def _trials(port: Tunable, heard: Listened, tell: Callable[[str], None]) -> list[Trial]:
    """Listen at the other usual bauds until one is right."""
    bauds = usual_bauds(heard.protocol, heard.baud)
    tell(f"{heard.baud} baud are not understood: trying {', '.join(map(str, bauds))}")
    out: list[Trial] = []
    for baud in bauds:
        try:
            port.set_baud(baud)
        except InputError:  # the adapter cannot do it, so nobody speaks to it that way
            continue
        tried = _listen(port, replace(heard, baud=baud, seconds=TRIAL_S), tell, TRIAL_BYTES)
        if tried.gone_s is not None:
            break
        out.append(Trial(baud, understand(tried.chunks, heard.protocol, baud)))
        if out[-1].found.good:
            break
    return out
