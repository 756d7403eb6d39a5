"""Every anomaly code: what it means, what usually causes it, what to try.

The one place for codes. ``docs/anomalies.md`` is written from here (``make golden``)
and a test holds the two equal. A code never changes its meaning.
"""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.anomalies.alarms import ALARM_CODES
from sniffer.anomalies.tap import TAP_CODES
from sniffer.ground.model import Severity

if TYPE_CHECKING:
    from collections.abc import Mapping

NOTE, WARN, ERROR = Severity.NOTE, Severity.WARN, Severity.ERROR


class Code(NamedTuple):
    """One kind of anomaly."""

    code: str
    group: str
    severity: Severity
    means: str
    causes: str
    remedy: str


_CODES: Final = (
    Code(
        "bad-checksum",
        "checksum",
        ERROR,
        "A frame of plausible shape whose checksum does not hold.",
        "Electrical noise, a collision of two senders, a wrong termination, or a sender that computes the sum wrongly.",
        "Look whether it is always the same sender (its code) or always the same place on the cable (the line).",
    ),
    Code(
        "damaged-frame",
        "framing",
        ERROR,
        "A frame begins but contradicts itself: an impossible length or a character that cannot stand there.",
        "Lost or altered bytes, a wrong baud rate, or text of another protocol on the line.",
        "Check the baud rate; compare the bytes with the frame that was meant.",
    ),
    Code(
        "truncated-frame",
        "framing",
        ERROR,
        "A frame begins but the next one starts before it is complete.",
        "A sender interrupted by another one, bytes lost by the adapter, or an altered length byte.",
        "Look at who speaks next: a controller that does not wait for the reply cuts it.",
    ),
    Code(
        "idle-tail",
        "framing",
        WARN,
        "A frame begins and the line falls silent (or the capture ends) before it is complete.",
        "The sender lost power or was reset while sending; at the very end of a capture it is only the cut.",
        "Compare with the supply voltage at that moment; ignore it at the end of a capture.",
    ),
    Code(
        "noise",
        "framing",
        WARN,
        "Bytes that no frame claims.",
        "A floating line while nobody drives it, a false start bit at bus turnaround, a wrong baud rate, or another protocol.",
        "If it stands behind requests, look at the direction switching and the bias resistors; if it is everywhere, at the baud rate.",
    ),
    Code(
        "capture-start",
        "capture",
        NOTE,
        "The capture begins in the middle of a frame, or between a request and its answer.",
        "The tap was started, or the capture cut, while the bus was talking.",
        "Nothing to do.",
    ),
    Code(
        "no-answer-heard",
        "capture",
        WARN,
        "Several servos were asked, and not one answer was heard so far: unanswered requests are no longer reported one by one until there is one.",
        "The tap hears only the controller's wire; or no servo answers at all: no power, another baud rate, a broken cable.",
        "Tap the servos' wire too (`sniffer record --pair`), or where both meet; if the tap does hear both, look at power, cable and baud rate.",
    ),
    Code(
        "no-request-heard",
        "capture",
        WARN,
        "Answers were heard, and not one request so far: they are no longer reported as unasked until there is one.",
        "The tap hears only the servos' wire.",
        "Tap the controller's wire too (`sniffer record --pair`), or where both meet: many values cannot be told without the request.",
    ),
    Code(
        "no-response",
        "pairing",
        ERROR,
        "A servo did not answer a request it must answer.",
        "No servo of that id, no power, another baud rate, feedback switched off, or the request did not reach it whole.",
        "Ping the id; look for a checksum fault of that servo just before; check its return mode.",
    ),
    Code(
        "damaged-response",
        "pairing",
        WARN,
        "Torn bytes stand where the answer to a request should be.",
        "The servo did answer, but its reply was damaged on the line; two servos answering at once look the same.",
        "See the checksum or framing fault at these bytes.",
    ),
    Code(
        "late-response",
        "timing",
        WARN,
        "An answer came later than it is expected from the manual and from what clients wait.",
        "A large return delay register, a servo busy with a flash write, or an adapter that delays bytes.",
        "Read the return delay register; check the adapter's latency timer before blaming the servo.",
    ),
    Code(
        "unsolicited-response",
        "pairing",
        WARN,
        "An answer that no request asked for.",
        "The request was damaged or lost to the tap, or the answer came after the controller had gone on.",
        "Look at the bytes before it.",
    ),
    Code(
        "duplicate-response",
        "pairing",
        ERROR,
        "A second answer from the same id to one request; where answers have no header: bytes behind them that would be another one, time and again.",
        "Two servos share an id.",
        "Disconnect one of them and give it another id.",
    ),
    Code(
        "mismatched-response",
        "pairing",
        ERROR,
        "The answer does not fit the request: another id, another length or another register.",
        "Two servos answering at once, an answer to an earlier request, or a servo with other firmware.",
        "Compare request and answer byte by byte (`sniffer explain`).",
    ),
    Code(
        "ambiguous-response",
        "pairing",
        NOTE,
        "One answer, and two requests that it may belong to: it is taken for that to the later one.",
        "Several requests were under way and an answer is missing; what came back does not say which of them it answers (a mightyZAP feedback of the same length, a wCK reply).",
        "Do not trust this value's name. Ask for values of different lengths, or for one after the other.",
    ),
    Code(
        "echo-mismatch",
        "pairing",
        WARN,
        "An answer that should repeat the request does not.",
        "The servo took another value than it was told, or the bytes are not an answer at all.",
        "Read the setting back.",
    ),
    Code(
        "adapter-echo",
        "capture",
        NOTE,
        "Every request is heard twice, byte for byte: the second is marked `echo` and counts for nothing.",
        "An adapter that hears what it sends, a log of what was sent and of what was heard, or a program that sends everything twice.",
        "Nothing to do; a tap that only listens hears each request once.",
    ),
    Code(
        "malformed-body",
        "protocol",
        WARN,
        "The frame holds, but its body does not have the form its command asks for.",
        "A client that builds its frames wrongly.",
        "Compare the frame with the manual (`sniffer explain`); servos usually ignore or misread it.",
    ),
    Code(
        "unknown-command",
        "protocol",
        WARN,
        "The frame holds, but its command stands in no manual.",
        "Newer firmware, a vendor tool, or a byte sequence that holds by chance.",
        "See whether servos answer it.",
    ),
    Code(
        "unusual-form",
        "protocol",
        NOTE,
        "Legal, but not in the form the manual gives.",
        "A client library with its own reading of the manual.",
        "Nothing to do if the servos understand it.",
    ),
    Code(
        "doubtful-response",
        "protocol",
        NOTE,
        "An answer that could be a command as well: no values are taken from it.",
        "Its error byte is the number of a command, and as many bytes follow as that command has (DYNAMIXEL 1.0, Feetech); nothing else tells the two apart.",
        "Tap the two directions apart; or clear the error that the servo reports.",
    ),
    Code(
        "value-out-of-range",
        "protocol",
        WARN,
        "A register value outside the range the manual states.",
        "A conversion or sign error in the controller, or a model with another range.",
        "Check the units; name the model (`--model`) if the servo is another one.",
    ),
    Code(
        "model-evidence",
        "protocol",
        NOTE,
        "What is said on the wire fits another model than the one a servo is read as, or a position contradicts the scale it was read with.",
        "Another model than the default, or than the one that was named; a controller written for another model.",
        "Name the model: `--model ID=MODEL`, with the values that this note gives.",
    ),
    Code(
        "id-changed",
        "device",
        NOTE,
        "A servo was given another id.",
        "A configuration tool, or a client with a command mix-up.",
        "From here on the servo is shown under its new id.",
    ),
    Code(
        "baud-changed",
        "device",
        NOTE,
        "A servo was told another baud rate; it may take effect after a restart.",
        "A configuration tool.",
        "If the servo falls silent later, listen at the new rate.",
    ),
    Code(
        "device-recovered",
        "device",
        NOTE,
        "A servo no longer reports a fault that it reported before.",
        "The cause is gone, or the servo was restarted.",
        "Nothing to do.",
    ),
    Code(
        "direction-mismatch",
        "capture",
        WARN,
        "A frame came in on the wire of the other direction.",
        "The two taps are swapped, or an adapter echoes what is sent.",
        "Swap the taps' names, or switch the echo off.",
    ),
    Code(
        "clock-step",
        "capture",
        NOTE,
        "The time stamps of the input step back.",
        "Two recordings joined, or a clock that was set while recording.",
        "Do not trust times across the step.",
    ),
)

_DEVICE: Final[Mapping[str, tuple[Severity, str, str, str]]] = MappingProxyType(
    {
        "input-voltage": (
            ERROR,
            "The servo reports a supply voltage outside its limits.",
            "A weak supply or thin wires under load; a limit register set too tight.",
            "Look at the voltage timeline at that moment.",
        ),
        "stroke-limit": (
            WARN,
            "The servo reports a goal outside its stroke limits.",
            "The controller asks for more than the limit registers allow.",
            "Read the limit registers; compare units and resolution.",
        ),
        "overheating": (
            ERROR,
            "The servo reports a temperature above its limit.",
            "Too much load for too long, or no air.",
            "Look at load and temperature together.",
        ),
        "range": (
            ERROR,
            "The servo refused an address outside its map.",
            "A register table of another model.",
            "Check the address and length of the request.",
        ),
        "checksum": (
            ERROR,
            "The servo refused a command whose checksum did not hold for it.",
            "The line is worse at the servo than at the tap.",
            "Check the cable between tap and servo.",
        ),
        "overload": (
            ERROR,
            "The servo reports a load it cannot hold.",
            "A blocked joint, a goal behind a stop, or a force limit set too low.",
            "Look at load, goal and position at that moment.",
        ),
        "instruction": (
            ERROR,
            "The servo refused a command it does not know, or an execution without staged data.",
            "Older firmware, or a command mix-up in the client.",
            "Compare with the manual of that model.",
        ),
        "temperature-limit": (
            ERROR,
            "The servo reports its temperature limit; the motor is off or braking.",
            "Too much load for too long.",
            "Let it cool down; look at load and temperature together.",
        ),
        "temperature-alarm": (
            WARN,
            "The servo reports that its temperature is close to the limit.",
            "Much load, or no air.",
            "Lower the load before the limit is reached.",
        ),
        "flash-write-error": (
            ERROR,
            "The servo reports that writing its flash memory failed.",
            "Power lost during the write, or a worn memory.",
            "Write again and read back.",
        ),
        "packet-not-processable": (
            ERROR,
            "The servo received a packet it cannot process.",
            "A wrong address, length or value.",
            "Compare the request with the manual (`sniffer explain`).",
        ),
        "nack": (
            ERROR,
            "The servo answered that it did not accept the packet.",
            "A wrong address, length or value.",
            "Compare the request with the manual (`sniffer explain`).",
        ),
        "outside-limits": (
            WARN,
            "The servo reports a position outside its limits.",
            "It was turned by hand or driven there before the limits were set.",
            "Move it back inside.",
        ),
        "stuck": (
            ERROR,
            "The servo reports that it cannot move at the speed asked for.",
            "A blocked joint or too much load.",
            "Look at current and position at that moment.",
        ),
        "blocked": (
            ERROR,
            "The servo reports that it cannot move at all.",
            "A blocked joint.",
            "Free the joint; look at the current.",
        ),
        "safe-mode": (
            ERROR,
            "The servo went into safe mode.",
            "Current, voltage or temperature beyond its limits.",
            "Ask for the cause (Q1) and restart it.",
        ),
    }
)

CATALOGUE: Final[Mapping[str, Code]] = MappingProxyType(
    {c.code: c for c in _CODES}
    | {name: Code(name, *told) for name, told in (ALARM_CODES | TAP_CODES).items()}
    | {f"device-{name}": Code(f"device-{name}", "device", *rest) for name, rest in _DEVICE.items()}
    | {
        "device-alarm": Code(
            "device-alarm",
            "device",
            WARN,
            "The servo reports a status bit that its manual reserves or does not name.",
            "Newer firmware, or a reply that holds by chance.",
            "Compare with the manual of that model.",
        )
    }
)
"""All codes by name."""


def markdown() -> str:
    """Return the catalogue as the page ``docs/anomalies.md``."""
    lines = [
        "# Anomalies",
        "",
        "What the listener reports, by group. Codes are stable: scripts may rely on them",
        "(`--fail-on`, the `code` key of the JSON lines, the `anomalies` topic of a recording).",
        "",
    ]
    for group in dict.fromkeys(c.group for c in CATALOGUE.values()):
        lines += [f"## {group}", ""]
        for c in CATALOGUE.values():
            if c.group == group:
                lines += [f"### `{c.code}` ({c.severity.name.lower()})", "", c.means, ""]
                lines += [f"- Usual causes: {c.causes}", f"- Try: {c.remedy}", ""]
    return "\n".join(lines).rstrip() + "\n"
