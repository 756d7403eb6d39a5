"""Weights of the causes that are the line's."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import Weight, for_

_TORN: Final = (
    ("bad-checksum", 0.3, "frames fail their checksum"),
    ("damaged-frame", 0.3, "frames contradict themselves"),
    ("truncated-frame", 0.3, "frames are cut"),
    ("idle-tail", 0.3, "frames are cut by silence"),
    ("noise", 0.3, "bytes that are no frame"),
    ("line-error", 0.3, "the UART saw bytes without a stop bit"),
    ("damaged-response", 0.3, "answers are torn"),
    ("no-response", 0.2, "a torn request is not answered"),
    ("mismatched-response", 0.2, "a torn answer may hold by chance"),
    ("unsolicited-response", 0.2, "the request before it was torn"),
    ("late-response", 0.1, "the answer to a torn request may be taken for a late one"),
    ("ambiguous-response", 0.1, "an answer is missing"),
    ("unknown-command", 0.1, "a torn frame may hold by chance"),
    ("malformed-body", 0.1, "a torn frame may hold by chance"),
    ("value-out-of-range", 0.1, "a torn frame may hold by chance"),
    ("device-checksum", 0.2, "servos refuse torn requests"),
    ("away-for-a-while", 0.1, "torn requests in a row are not answered"),
)
"""What torn frames bring with them, whatever tears them."""

WEIGHTS: Final[tuple[Weight, ...]] = (
    *for_(
        "bus-noise",
        ("damage-everywhere", 4.0, "all senders are hit alike"),
        ("strays-anywhere", 2.5, "the line is disturbed while nobody speaks"),
        ("damage-in-answers", 1.5, "answers are hit"),
        ("damage-in-requests", 1.5, "requests are hit"),
        ("damage-one-servo", -3.0, "only one servo is hit"),
        ("same-bit", -3.0, "noise does not choose a bit"),
        ("one-way-bits", -2.5, "noise goes both ways"),
        ("late-edges", -3.0, "noise does not look at the bit before"),
        ("first-byte-torn", -2.5, "noise does not choose a byte"),
        ("last-byte-torn", -2.5, "noise does not choose a byte"),
        ("strays-at-turn", -2.0, "noise comes at any time"),
        *_TORN,
    ),
    *for_(
        "signal-integrity",
        ("same-bit", 4.0, "the same bit falls again and again"),
        ("late-edges", 4.0, "edges come too late to be read"),
        ("one-way-bits", 3.0, "bits fall in one direction"),
        ("damage-everywhere", 1.0, "all senders are hit"),
        ("damage-in-answers", 1.0, "all servos' answers are hit"),
        ("damage-in-requests", 1.0, "the controller's requests are hit"),
        ("damage-one-servo", 0.5, "one sender's signal is weak"),
        ("last-byte-torn", 0.5, "the last byte has no time to settle"),
        ("first-byte-torn", 0.5, "the first edges are late"),
        ("strays-at-turn", 0.1, "a slow edge may look like a start"),
        ("last-bits", -2.5, "only one servo's last bits are hit"),
        ("strays-anywhere", 0.3, "a slow edge may look like a start"),
        *_TORN,
    ),
    *for_(
        "turnaround",
        ("strays-at-turn", 4.0, "stray bytes stand where the direction changes"),
        ("first-byte-torn", 4.0, "the first byte of answers is hit, no other"),
        ("last-byte-torn", 4.0, "the driver lets go before the last byte is over"),
        ("damage-in-answers", 1.0, "answers are hit"),
        ("damage-in-requests", 0.5, "requests are hit"),
        ("damage-everywhere", 0.5, "frames are torn"),
        ("damage-one-servo", 0.3, "one servo's answers come early or late"),
        ("strays-anywhere", 0.2, "some of the bytes stand elsewhere"),
        ("one-way-bits", 0.1, "what holds the line holds it at one level"),
        ("same-bit", 0.1, "what is let go is the same bit each time"),
        ("late-edges", 0.1, "what is held is read as before"),
        *_TORN,
    ),
    *for_(
        "clock-drift",
        ("last-bits", 4.0, "its bytes are misread at their end"),
        ("damage-one-servo", 2.0, "only its answers are hit"),
        ("late-edges", 0.3, "its bits are read too early"),
        ("one-way-bits", 0.1, "its stop bits are read for bits"),
        ("same-bit", 0.5, "it is always the last bits"),
        *_TORN,
    ),
    *for_(
        "bad-cable",
        ("damage-one-servo", 2.5, "only these servos' answers are hit"),
        ("last-bits", -2.0, "a contact does not look at the bits"),
        *_TORN,
    ),
)
"""One line each."""
