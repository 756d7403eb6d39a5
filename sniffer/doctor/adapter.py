"""Verdicts on the adapter: what it is, who else has it, what its lines and its timer do."""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Final

from sniffer.doctor.records import Level, Listened, Observation
from sniffer.ground.wording import Sentence

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.ports.listing import PortInfo

TIMER_MS: Final = 2
"""An adapter whose timer is no longer than this is as quick as USB can be: 1 ms is a full-speed
frame, and some chips take nothing below 2."""

RULE: Final = 'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'
"""What udev does with every FTDI adapter that is plugged in, if this stands in a rules file."""

RULES_FILE: Final = "/etc/udev/rules.d/60-servo-tap.rules"

_PREPARE: Final = (
    "before the bus is connected the next time, run `sniffer doctor --prepare`, or let "
    "docs/60-servo-tap.rules do it at each plugging"
)


def about_adapter(heard: Listened) -> Iterator[Observation]:
    """Is it the right one, ours alone, quick, and silent itself?"""
    yield _port(heard)
    yield _access(heard)
    if (echo := about_echo(heard.facts)) is not None:
        yield echo
    yield _modem(heard)
    yield _latency(heard)


def _port(heard: Listened) -> Observation:
    info = heard.info
    if info is None:
        text = "no serial hardware of this machine"
        if not heard.has_line:
            text += ", but a program or a connection behind it"
        return Observation(Level.NOTE, "port", text, numbers={"device": heard.path})
    words = [
        info.chip or ("adapter of an unknown chip" if info.usb else "UART on board"),
        *([f"({info.driver})"] if info.driver else []),
        *([info.device] if info.device else []),
    ]
    numbers = {"device": info.path, "stable": info.stable or None, "chip": info.chip or None}
    if info.stable and heard.path == info.path:
        advice = f"{info.path} may be another adapter after the next plugging; this name stays:"
        return Observation(Level.NOTE, "port", " ".join(words), advice, (info.stable,), numbers)
    return Observation(Level.OK, "port", " ".join(words), numbers=numbers)


def _access(heard: Listened) -> Observation:
    also = heard.facts.get("also_open_in", "not known")
    locked = heard.facts.get("locked") == "yes"
    numbers = {"locked": locked, "also_open_in": None if also in ("none", "not known") else also}
    if numbers["also_open_in"]:
        text = f"also open in {also}: each byte goes to one reader only, the other misses it"
        return Observation(Level.BAD, "access", text, "end the other program", numbers=numbers)
    lock = "locked for others" if locked else "not locked: another program may read along"
    if also == "none":
        return Observation(Level.OK, "access", f"open here alone, {lock}", numbers=numbers)
    text = f"open and {lock}; whether others have it open is not to be seen from here"
    advice = "" if locked else "if bytes are missing, look with `sudo fuser -v` who reads them"
    return Observation(Level.OK if locked else Level.NOTE, "access", text, advice, numbers=numbers)


def about_echo(facts: Mapping[str, str]) -> Observation | None:
    """Return whether opening the port can have sent anything; None where it does not say.

    A port that nobody has set up sends back what it hears until the first call after opening.
    """
    echo = facts.get("echo_at_open")
    if echo is None:
        return None
    told = facts.get("sent_since_plugged", "")
    sent = int(told) if told.isdecimal() else None
    numbers = {"echo_at_open": echo, "sent_since_plugged": sent}
    so_far = f"the port has sent {sent} bytes in all since it was plugged in"
    if echo == "off":
        text = "it was off when the port was opened: nothing was sent back"
        return Observation(
            Level.OK, "echo", text + (f"; {so_far}" if sent else ""), numbers=numbers
        )
    text = "it was on when the port was opened, and switched off at once: it stays so until the "
    text += "port is unplugged"
    if sent == 0:
        return Observation(
            Level.NOTE, "echo", f"{text}; nothing was sent back", _PREPARE, (), numbers
        )
    text += f"; {so_far}" if sent else ""
    advice = f"what the bus said in that moment was sent back to it: leave TX open. {_PREPARE}"
    return Observation(Level.WARN, "echo", text, advice, numbers=numbers)


def _modem(heard: Listened) -> Observation:
    opened = heard.facts.get("modem_after_open")
    after = heard.facts.get("modem_after_lowering")
    numbers = {"after_open": opened, "after_lowering": after}
    if opened is None:
        text = "what RTS and DTR do is not known here"
        advice = "an adapter that sends while RTS is up must be connected with RX and ground only"
        return Observation(Level.NOTE, "modem", text, advice, numbers=numbers)
    raised = [line for line in ("RTS", "DTR") if line in opened.split()]
    if not raised:
        text = "no such lines" if opened == "none" else "RTS and DTR are low"
        return Observation(Level.OK, "modem", text, numbers=numbers)
    told = " and ".join(raised)
    verb = "was" if len(raised) == 1 else "were"
    still = [line for line in raised if line in (after or "").split()]
    if heard.facts.get("modem") == "keep":
        said = "{told} {verb} raised by opening the port, and stay so ({modem:keep})"
        text = Sentence(said, told=told, verb=verb)
        level = Level.WARN if "RTS" in raised else Level.NOTE
        advice = Sentence(
            "if the adapter sends while RTS is up, it now holds the bus: use {modem:low}"
        )
        return Observation(level, "modem", text, advice, numbers=numbers)
    if still:
        text = f"{' and '.join(still)} cannot be lowered"
        advice = (
            "if the adapter sends while RTS is up, it holds the bus: connect RX and ground only"
        )
        return Observation(Level.BAD, "modem", text, advice, numbers=numbers)
    text = f"{told} {verb} raised by opening the port, and lowered at once"
    advice = (
        "an adapter that sends while RTS is up has held the bus for that moment: connect RX and "
        "ground only"
    )
    return Observation(Level.NOTE, "modem", text, advice, numbers=numbers)


def _latency(heard: Listened) -> Observation:
    info = heard.info
    told = heard.facts.get("latency_timer_ms", "")
    timer = int(told) if told.isdecimal() else info.latency_ms if info else None
    before = info.latency_ms if info else None
    ms = None if heard.latency_ns is None else heard.latency_ns / 1e6
    numbers = {"latency_ms": ms, "timer_ms": timer, "timer_before_ms": before}
    if timer is not None and timer > TIMER_MS:
        text = f"the adapter's timer is {timer} ms: frames that are closer come as one"
        advice = f"the first line lowers it now, the second one, in {RULES_FILE}, at each plugging:"
        return Observation(Level.WARN, "latency", text, advice, _commands(heard, info), numbers)
    if timer is not None:
        text = f"the adapter's timer is {timer} ms"
        if before is not None and before > TIMER_MS:
            text += f"; it was {before} ms before the port was opened for low latency"
        return Observation(Level.OK, "latency", text, numbers=numbers)
    if ms is None:
        text = "how long this adapter holds bytes back is not known; it has no timer to set"
        return Observation(Level.NOTE, "latency", text, numbers=numbers)
    text = f"bytes are held back for {ms:.1f} ms at most"
    level = Level.OK if ms <= TIMER_MS + 1 else Level.NOTE
    return Observation(level, "latency", text, numbers=numbers)


def _commands(heard: Listened, info: PortInfo | None) -> tuple[str, ...]:
    name = PurePosixPath(info.path if info else heard.path).name
    timer = f"/sys/bus/usb-serial/devices/{name}/latency_timer"
    return (f"echo 1 | sudo tee {timer}", RULE)
