"""Weights of the causes that are the tap's."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import for_

_LOST_HERE: Final = (
    ("bytes-lost", -1.5, "the tap's driver counted losses"),
    ("requests-torn-short", -2.5, "requests lack bytes: noise takes none away"),
    ("headless-frames", -2.0, "noise alters frames, and leaves their length"),
    ("requests-missing", -1.0, "noise takes no requests away"),
    ("order-lacks-bytes", -2.5, "noise alters requests, and leaves their length"),
    ("answered-though-torn", -3.0, "on the line the requests were whole"),
    ("goes-on-unanswered", -2.5, "the controller got the answers that are missing here"),
    ("pieces-complete", -3.5, "pieces of frames are as they were sent: noise alters them"),
    ("frames-spliced", -3.5, "what is left of frames is as it was sent, and lacks bytes"),
)
"""What speaks against a fault of line or servo: the tap lost what is missing."""

WEIGHTS: Final = (
    *(
        weight
        for cause in ("bus-noise", "signal-integrity", "bad-cable", "servo-reset-loop")
        for weight in for_(cause, *_LOST_HERE)
    ),
    *for_("two-masters", ("order-lacks-bytes", 0.1, "what two say at once is shorter than both")),
    *for_(
        "echo",
        ("adapter-echo", 4.0, "every request stands there twice, byte for byte, with one answer"),
        ("said-twice", 2.5, "every request stands there twice, and nobody needs to answer"),
        ("no-response", 0.4, "the first of two is unanswered until the echo is known"),
        ("ambiguous-response", 0.4, "two requests, one answer"),
        ("direction-mismatch", 0.4, "what is sent is heard on the servos' wire"),
        ("duplicate-response", 0.2, "the echo of a request may look like an answer"),
        ("unsolicited-response", 0.2, "the echo of a request may look like an answer"),
        ("echo-differs", 0.1, "what comes back is not always what was sent"),
        ("wires-swapped", -2.0, "all frames are on the other wire, not the requests alone"),
    ),
    *for_(
        "tap-loss",
        ("bytes-lost", 4.0, "the tap's driver counted losses"),
        ("port-lost", 3.0, "the port went away"),
        ("port-back", 0.5, "the port came back"),
        ("not-decoded", 0.5, "the recorder was too slow to decode"),
        ("goes-on-unanswered", 3.0, "the controller got the answers that are missing here"),
        ("requests-missing", 1.2, "requests are missing from the controller's order"),
        ("order-lacks-bytes", 3.0, "requests are missing, and less is torn than they have"),
        ("pieces-complete", 4.0, "pieces are as they were sent, but for bytes that are missing"),
        ("frames-spliced", 3.5, "frames are joined as they were sent, without what is between"),
        ("headless-frames", 2.5, "ends of frames stand without their beginnings"),
        (
            "request-swallowed",
            -2.5,
            "a tap does not choose the request behind an answer as long as it is",
        ),
        ("requests-torn-short", 3.0, "requests lack bytes, which only the tap can have lost"),
        ("answered-though-torn", 3.0, "servos answer requests that are torn here"),
        ("damage-everywhere", 0.3, "frames of all senders lack bytes"),
        ("damage-in-answers", 0.3, "answers lack bytes"),
        ("damage-in-requests", 0.3, "requests lack bytes"),
        ("strays-at-turn", 0.2, "what is left of a frame"),
        ("strays-anywhere", 0.2, "what is left of a frame"),
        *(
            (code, 0.1, "what is left of two frames is joined")
            for code in (
                "same-bit",
                "one-way-bits",
                "late-edges",
                "last-bits",
                "first-byte-torn",
                "last-byte-torn",
                "value-out-of-range",
                "doubtful-value",
                "echo-mismatch",
                "refuses-command",
                "echoes-differ",
                "goal-beyond-range",
                "odd-commands",
                "position-jumps",
                "request-over-answer",
                "requests-run-together",
                "answers-after-next",
                "answers-spoken-into",
                "answers-twice",
                "modifier-misused",
                "unusual-form",
                "same-bytes-torn",
            )
        ),
        *(
            (code, 0.2, "exchanges in a row are missing here")
            for code in (
                "away-again-and-again",
                "misses-now-and-then",
                "comes-and-goes",
                "lost-together",
                "speaks-unasked",
                "late-replies",
                "loop-jitters",
                "goal-jump",
                "joint-not-following",
                "joint-limp",
                "joint-stalled",
                "joint-limp-after-restart",
                "unrelated-periods",
                "rounds-cross",
            )
        ),
        ("damage-one-servo", 0.2, "answers lack bytes, by chance most of one servo"),
        ("no-response", 0.5, "answers are missing where the tap lost bytes"),
        ("damaged-response", 0.5, "answers lack bytes where the tap lost them"),
        ("truncated-frame", 0.6, "frames lack bytes"),
        ("damaged-frame", 0.5, "what is left of two frames is joined"),
        ("bad-checksum", 0.4, "what is left of two frames is joined"),
        ("idle-tail", 0.4, "frames lack bytes at their end"),
        ("noise", 0.4, "what is left of a frame is none"),
        ("mismatched-response", 0.4, "the answer to a request that is missing here"),
        ("unsolicited-response", 0.5, "the answer to a request that is missing here"),
        ("duplicate-response", 0.3, "the answer to a request that is missing here"),
        ("ambiguous-response", 0.3, "an answer is missing here"),
        ("late-response", 0.2, "the answer to a request that is missing here"),
        ("unknown-command", 0.2, "what is left of a frame may hold by chance"),
        ("malformed-body", 0.2, "what is left of a frame may hold by chance"),
        ("loop-stalls", 0.3, "what was said in the pause is missing here"),
        ("away-for-a-while", 0.2, "answers in a row are missing here"),
        ("hasty-request", -2.0, "the controller itself cuts answers"),
        ("request-in-answer", -2.0, "two senders at once"),
        ("line-error", -2.5, "bytes that are lost leave the others with their stop bits"),
        ("line-break", -1.5, "bytes that are lost leave the others with their stop bits"),
    ),
    *for_(
        "tap-swapped",
        ("wires-swapped", 4.0, "nearly all frames came in on the other wire than theirs"),
        ("direction-mismatch", 1.0, "frames came in on the other wire than theirs"),
        ("no-response", 0.2, "what causes what is looked for on the wrong wires"),
        ("unsolicited-response", 0.2, "what causes what is looked for on the wrong wires"),
        ("adapter-echo", -3.0, "what is sent is heard on the servos' wire"),
        *(
            (code, 0.1, "what was told whom is taken from the wrong wire")
            for code in ("joint-limp", "joint-not-following", "goals-without-torque")
        ),
    ),
    *for_(
        "tap-one-way",
        ("no-answer-heard", 0.5, "many requests to several servos, and not one answer"),
        ("nobody-answers", 2.2, "not one answer in the whole capture"),
        ("nobody-asks", 4.0, "answers, and not one request"),
        ("no-request-heard", 0.5, "answers, and not one request so far"),
        ("goes-on-unanswered", 1.5, "the controller does hear answers"),
        ("waits-in-vain", -3.0, "the controller hears no answer either"),
        ("no-response", 0.5, "the answers are on the wire that is not heard"),
        ("unsolicited-response", 0.5, "the requests are on the wire that is not heard"),
        ("late-response", 0.3, "the requests are on the wire that is not heard"),
        ("duplicate-response", 0.3, "the requests between are on the wire that is not heard"),
        ("mismatched-response", 0.3, "the requests are on the wire that is not heard"),
        ("ambiguous-response", 0.3, "the requests are on the wire that is not heard"),
        ("noise", 0.4, "answers without a header are nothing without their requests"),
        ("idle-tail", 0.2, "what is heard of one side breaks off"),
        ("truncated-frame", 0.2, "bare answers may look like the beginning of a frame"),
        ("damaged-frame", 0.2, "bare answers may look like a frame"),
        ("bad-checksum", 0.2, "bare answers may look like a frame"),
        *(
            (code, 0.1, "what has no header is a torn frame by its looks")
            for code in ("damage-everywhere", "damage-in-answers", "damage-in-requests")
        ),
    ),
    *for_(
        "two-masters",
        ("answered-though-torn", -5.0, "servos do not answer what ran together"),
        ("headless-frames", -2.0, "pieces stand alone, nobody spoke beside them"),
        ("frames-spliced", -1.5, "what runs together is altered where it does"),
        ("bytes-lost", -1.5, "the tap's driver counted losses"),
        ("adapter-echo", -2.0, "the adapter hears what it sends"),
        ("pieces-complete", 0.1, "the end of the second of two that run together is whole"),
    ),
    *(
        weight
        for cause in (
            "duplicate-id",
            "turnaround",
            "malformed-command",
            "clock-drift",
            "chatty-device",
        )
        for weight in for_(
            cause, ("pieces-complete", -2.5, "what is torn here was whole on the line")
        )
    ),
    *for_(
        "duplicate-id",
        (
            "bytes-lost",
            -2.0,
            "two answers in a row are those to two requests, of which one was lost",
        ),
        ("requests-missing", -1.5, "the request before a second answer may be missing here"),
    ),
    *for_("bus-noise", ("echo-differs", 2.5, "requests come back altered, too")),
    *for_("bad-cable", ("echo-differs", -2.0, "the controller's own requests are hit, too")),
    *for_(
        "wrong-baud",
        ("nobody-answers", 1.6, "nobody understands the controller, or nobody is there"),
        ("waits-in-vain", 1.8, "the controller waits for each answer, and none comes"),
        ("goes-on-unanswered", -4.0, "the controller does hear answers"),
    ),
)
"""One line each."""
