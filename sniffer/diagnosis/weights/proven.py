"""Weights of what frames themselves prove: whoever else could have torn them is acquitted."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.causes import CAUSES
from sniffer.diagnosis.weights import controller, line, tap, wire
from sniffer.diagnosis.weights.table import Weight, for_

TAP_NOT_RAW, MALFORMED = "tap-not-raw", "malformed-command"

TRANSLATED = "bytes-translated"
SENT_SO, SUMS_WRONG, HEAD_WRONG = "sent-translated", "sums-wrong", "head-wrong"
TEXT, BROKEN_OFF = "text-sent", "requests-broken-off"
ALL_ASKED = "all-asked-at-once"
"""The proofs: of a program behind the tap, and of the controller's."""

WRONG_BAUD, READ_TWICE = "wrong-baud", "bits-read-twice"
"""The proof of a rate: what holds at another one is chance, and says nothing of anybody."""

SEARCH, TRIED = "rate-search", "rates-tried"
"""The proof that what is torn was said at other rates, and why."""

MIXED, OTHER = "mixed-protocols", "other-protocol"
"""The proof that nobody speaks the protocol: what holds of it is chance, and tells of nobody."""

_TORN: Final = tuple(
    dict.fromkeys(
        w.finding
        for w in (*tap.WEIGHTS, *wire.WEIGHTS)
        if w.cause in ("tap-loss", "wrong-baud") and w.weight > 0
    )
)
"""What follows where frames of all senders are torn alike."""

_UNHEARD: Final = tuple(
    w.finding for w in (*tap.WEIGHTS, *wire.WEIGHTS) if w.cause == "wrong-baud" and w.weight > 0
)
"""What follows where no frame holds."""

_WEIGHED: Final = (*tap.WEIGHTS, *line.WEIGHTS, *wire.WEIGHTS, *controller.WEIGHTS)

_OF_RATES: Final = frozenset(w.finding for w in _WEIGHED if w.cause == "wrong-baud")

_LATE: Final = (
    *dict.fromkeys(
        w.finding
        for w in _WEIGHED
        if w.cause == "signal-integrity" and w.weight > 0 and w.finding not in _OF_RATES
    ),
    *("loop-jitters", "loop-stalls"),
)
"""What a weak signal does to some bytes, which a wrong rate does to all; where hardly a frame holds,
those that do tell of no loop."""

_APART: Final = ("port-lost", "port-back", "not-decoded")
"""What tears frames by itself."""

_BEFORE: Final = ("line-error", "line-break", "bytes-lost")
"""What the UART or its driver finds."""

_KNOWN: Final = frozenset(w.finding for w in _WEIGHED if w.cause == MALFORMED)

_OF_MIXED: Final = frozenset(w.finding for w in _WEIGHED if w.cause == MIXED)

_SUSPECTS: Final = (
    *("wrong-baud", "bus-noise", "signal-integrity", "turnaround", "line-stuck"),
    *("mixed-protocols", "bad-cable", "clock-drift", "duplicate-id", "chatty-device"),
    *("two-masters", "impatient-controller", "retry-storm", "servo-refuses"),
    *("tap-loss", "tap-one-way", "echo"),
)
"""Causes that are concluded from torn frames, or from frames that are missing."""

_BY_CHANCE: Final = tuple(
    dict.fromkeys(w.finding for w in _WEIGHED if w.cause in _SUSPECTS and w.weight > 0)
)
"""What is found where frames of another protocol hold as those of this one now and then."""

_OF_FRAMES: Final = (
    *("brownout", "servo-reset-loop", "torque-off", "stall", "overheat", "overload"),
    *("servo-refuses", "clock-drift", "duplicate-id", "id-changed", "chatty-device"),
    *("goal-out-of-range", "position-jump"),
)
"""Causes that are concluded from what whole frames say."""

WEIGHTS: Final[tuple[Weight, ...]] = (
    *for_(
        TAP_NOT_RAW,
        (TRANSLATED, 9.0, "frames hold as soon as the exchange is undone"),
        *(
            (code, 0.1, "frames are torn by it")
            for code in _TORN
            if code not in {*_BEFORE, *_APART}
        ),
        *((code, -2.0, "bytes were torn before any program had them") for code in _BEFORE),
        (SENT_SO, 8.0, "a tap that hears the controller only has no answers"),
        (SUMS_WRONG, -5.0, "only the checksums are wrong"),
        (HEAD_WRONG, -9.0, "no byte is missing, and the wrong one is no line end"),
    ),
    *for_("impatient-controller", ("begins-hold", 2.5, "answers run into the next requests")),
    *for_("two-masters", ("begins-hold", 0.2, "the other one's request ends what began well")),
    *for_(
        MALFORMED,
        ("begins-hold", 3.5, "what begins well, and never ends so, was sent so"),
        ("kind-never-whole", 4.0, "what tears frames does not choose one kind: it was sent so"),
        (
            SUMS_WRONG,
            9.0,
            "packets are right but for their checksums, which follow another formula",
        ),
        (BROKEN_OFF, 8.0, "what is there is as it should be, and the rest was not sent"),
        (ALL_ASKED, 9.0, "a question to all has as many answers at once"),
        (TEXT, 9.0, "what is no frame is text: a program prints there"),
        (HEAD_WRONG, 12.0, "all is there, and one byte tells of another frame: it is sent so"),
        *((code, 0.1, "no frame holds") for code in _UNHEARD if code not in {*_KNOWN, *_BEFORE}),
        (SENT_SO, 9.5, "what is sent is not what is meant, and nobody answers"),
        (TRANSLATED, -7.0, "what is torn here was whole on the wire"),
    ),
    *for_(
        WRONG_BAUD,
        (READ_TWICE, 12.0, "every byte is read so, whoever sends it"),
        *((code, 0.1, "bytes with a bit that is read twice look so") for code in _LATE),
    ),
    *(
        weight
        for cause in CAUSES
        if cause not in (WRONG_BAUD, MIXED)
        for weight in for_(cause, (READ_TWICE, -12.0, "at the right rate none of it may be there"))
    ),
    *for_(
        SEARCH,
        (TRIED, 9.0, "what is no frame are requests at other rates"),
        *(
            (code, 0.1, "what is said at another rate looks so, or holds by chance")
            for code in _BY_CHANCE
        ),
    ),
    *for_(
        MIXED,
        (READ_TWICE, -3.0, "a conversation that says little may have bits alike"),
        (OTHER, 12.0, "nearly all that was said are frames of another protocol"),
        *(
            (code, 0.1, "what holds of a protocol that nobody speaks holds by chance")
            for code in _BY_CHANCE
            if code not in _OF_MIXED
        ),
    ),
    *(
        weight
        for cause in CAUSES
        if cause != MIXED
        for weight in for_(cause, (OTHER, -12.0, "nobody speaks the protocol that it would be of"))
    ),
    *(
        weight
        for cause in _OF_FRAMES
        for weight in for_(
            cause, ("nothing-holds", -5.0, "a frame that holds by chance says anything")
        )
    ),
    *(
        weight
        for cause in _SUSPECTS
        for weight in for_(
            cause,
            (TRANSLATED, -7.0, "what is torn here was whole on the wire"),
            (TRIED, -7.0, "what is no frame here are requests at other rates"),
            (SENT_SO, -7.0, "frames hold as soon as the exchange is undone"),
            (BROKEN_OFF, -6.0, "no byte is altered, and all that is missing are ends of requests"),
            (
                ALL_ASKED,
                -7.0,
                "only answers to questions to all are torn: they lie over each other",
            ),
            (TEXT, -7.0, "noise makes no words"),
            (SUMS_WRONG, -7.0, "packets are as they were sent: their checksums are computed so"),
            (
                HEAD_WRONG,
                -7.0,
                "one byte of the head is wrong, always, and everything else is right",
            ),
            ("kind-never-whole", -4.0, "requests of other kinds and all answers are whole"),
        )
    ),
)
"""One line each."""
