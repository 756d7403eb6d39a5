"""Weights of the causes that are the line's as a whole: rates, protocols, controllers, motors."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import Weight, for_

_ALONE: Final = (
    *("bus-noise", "signal-integrity", "bad-cable", "tap-loss", "turnaround"),
    *("duplicate-id", "clock-drift", "impatient-controller", "line-stuck", "chatty-device"),
)
"""Causes that have one controller, which does not speak into its own requests."""

WEIGHTS: Final[tuple[Weight, ...]] = (
    *(
        weight
        for cause in _ALONE
        for weight in for_(
            cause, ("requests-overlaid", -4.0, "two requests at once make just these bytes")
        )
    ),
    *for_(
        "bus-noise",
        ("requests-spoken-into", -2.5, "what is torn is torn for as long as a frame"),
    ),
    *for_(
        "duplicate-id",
        ("requests-spoken-into", 0.8, "the second answer runs into the next request"),
    ),
    *(
        weight
        for cause in (
            "signal-integrity",
            "line-stuck",
            "turnaround",
            "clock-drift",
            "tap-loss",
            "chatty-device",
            "impatient-controller",
            "mixed-protocols",
            "wrong-baud",
        )
        for weight in for_(
            cause,
            ("requests-spoken-into", 0.1, "what is garbled for long looks like a second sender"),
        )
    ),
    *for_(
        "mixed-protocols",
        ("two-protocols", 5.0, "two protocols hold on one line"),
        ("unknown-packets", 8.0, "packets state their lengths, and none is of this protocol"),
        ("nothing-holds", 2.0, "another protocol that nobody here knows holds in nothing, too"),
        ("line-babbles", 0.2, "what another protocol says holds in nothing"),
        ("odd-commands", 0.2, "frames of another protocol hold by chance"),
        ("foreign-frames", 6.0, "another protocol holds in what this one does not claim"),
        ("spoken-between", 5.0, "for a while something else is spoken, and nothing is torn else"),
        ("noise", 0.6, "frames of another protocol"),
        ("truncated-frame", 0.3, "frames of another protocol begin like one"),
        ("damaged-frame", 0.4, "frames of another protocol begin like one"),
        ("bad-checksum", 0.4, "frames of another protocol begin like one"),
        ("damage-in-requests", 0.4, "frames of another protocol"),
        ("damage-everywhere", 0.4, "frames of another protocol"),
        ("strays-anywhere", 0.4, "frames of another protocol"),
        ("strays-at-turn", 0.3, "frames of another protocol"),
        ("damaged-response", 0.2, "frames of another protocol"),
        ("unsolicited-response", 0.2, "frames of another protocol"),
        ("unknown-command", 0.2, "frames of another protocol hold by chance"),
        ("malformed-body", 0.2, "frames of another protocol hold by chance"),
        ("idle-tail", 0.2, "frames of another protocol"),
        ("loop-jitters", 0.1, "another controller speaks in between"),
    ),
    *for_(
        "wrong-baud",
        ("nothing-holds", 5.0, "the same conversation all the time, and no frame"),
        ("bits-of-another-rate", 3.0, "the line is slower than the receiver"),
        ("unknown-packets", -9.0, "at a wrong rate no packet is as long as it says"),
        ("begins-hold", -9.0, "at a wrong rate no frame begins as it should"),
        ("foreign-frames", -6.0, "another protocol holds at this rate"),
        ("damage-behind-steps", -5.0, "a rate is wrong whatever moves"),
        ("line-babbles", 0.2, "a line that is much slower, or faster"),
        ("held-low", 0.2, "a line that is much slower"),
        ("noise", 0.6, "nothing holds"),
        ("bad-checksum", 0.4, "nothing holds"),
        ("damaged-frame", 0.4, "nothing holds"),
        ("truncated-frame", 0.4, "nothing holds"),
        ("idle-tail", 0.3, "nothing holds"),
        ("line-error", 0.8, "stop bits are not where they should be"),
        ("line-break", 0.4, "the line is low for longer than a byte"),
        ("damage-everywhere", 0.5, "nothing holds"),
        ("damage-in-requests", 0.5, "nothing holds"),
        ("strays-anywhere", 0.4, "nothing holds"),
        ("unsolicited-response", 0.3, "what holds by chance"),
        ("no-request-heard", 0.3, "what holds by chance"),
        ("no-answer-heard", 0.3, "what holds by chance"),
        ("no-response", 0.3, "what holds by chance"),
        ("unknown-command", 0.3, "what holds by chance"),
        ("malformed-body", 0.3, "what holds by chance"),
        ("value-out-of-range", 0.3, "what holds by chance"),
        ("damaged-response", 0.3, "what holds by chance"),
    ),
    *(
        weight
        for cause in ("bus-noise", "signal-integrity", "line-stuck")
        for weight in for_(cause, ("nothing-holds", -5.0, "noise lets a frame by now and then"))
    ),
    *for_(
        "two-masters",
        ("interleaved-requests", 6.5, "the same requests come in two rhythms"),
        ("unrelated-periods", 5.5, "requests come in two rhythms that do not belong together"),
        ("requests-run-together", 6.0, "one controller does not speak into its own requests"),
        ("requests-overlaid", 7.0, "two requests at once make just these bytes"),
        ("streams-apart", 3.0, "two loops keep two times"),
        ("rounds-cross", 5.5, "requests of one round stand anywhere between those of another"),
        (
            "rhythms-meet",
            7.0,
            "two clocks drift through each other, and frames are torn as they meet",
        ),
        ("requests-spoken-into", 2.0, "somebody speaks into requests, and servos do not"),
        ("torn-when-none-due", 0.1, "another one asks when no answer is due"),
        ("gives-up-early", -2.0, "another one's requests come after any time"),
        ("damage-in-answers", 0.3, "answers are spoken into"),
        ("last-byte-torn", 0.1, "another request begins within the last byte"),
        ("one-way-bits", 0.1, "who pulls low wins"),
        ("answers-twice", 0.1, "two ask, and two answers come"),
        ("duplicate-response", 0.2, "two ask, and two answers come"),
        ("loop-stalls", 0.3, "each waits for answers that were spoken into"),
        ("voltage-sag", 0.1, "what holds by chance says anything"),
        ("held-low", 0.1, "pieces of what ran together"),
        ("device-stroke-limit", 0.1, "what holds by chance says anything"),
        ("device-input-voltage", 0.1, "what holds by chance says anything"),
        ("device-instruction", 0.1, "what holds by chance says anything"),
        ("device-recovered", 0.1, "what holds by chance says anything"),
        ("hasty-request", 0.8, "one asks while the other waits for its answer"),
        ("request-in-answer", 0.8, "one asks into the other's answer"),
        ("several-answer-twice", 2.5, "two ask, and two answers come, of whomever"),
        ("damage-in-requests", 0.8, "requests run into each other"),
        ("damage-everywhere", 0.6, "requests run into each other"),
        ("bad-checksum", 0.5, "requests and answers run into each other"),
        ("damaged-frame", 0.5, "requests and answers run into each other"),
        ("truncated-frame", 0.5, "requests and answers run into each other"),
        ("damaged-response", 0.5, "a request runs into the answer"),
        ("no-response", 0.5, "a request that was torn is not answered"),
        ("mismatched-response", 0.4, "the answer is to the other's request"),
        ("unsolicited-response", 0.4, "the answer is to the other's request"),
        ("ambiguous-response", 0.3, "the answer is to the other's request"),
        ("late-response", 0.3, "the answer is to the other's request"),
        ("noise", 0.5, "requests run into each other"),
        ("idle-tail", 0.3, "requests run into each other"),
        ("line-error", 0.5, "bits of two requests make no bytes"),
        ("line-break", 0.3, "bits of two requests make no bytes"),
        ("strays-anywhere", 0.3, "what is left of requests"),
        ("strays-at-turn", 0.3, "what is left of requests"),
        ("loop-jitters", 0.6, "each one's requests come at any time of the other's cycle"),
        ("comes-and-goes", 0.3, "answers are hit now and then"),
        ("first-byte-torn", 0.2, "requests and answers run into each other"),
        ("last-bits", 0.2, "requests and answers run into each other"),
        ("malformed-body", 0.2, "what two requests make may hold by chance"),
        ("unknown-command", 0.2, "what two requests make may hold by chance"),
        ("value-out-of-range", 0.3, "what two requests make may hold by chance"),
        ("doubtful-value", 0.3, "what two answers make may hold by chance"),
        ("device-overload", 0.1, "two programs pull at one joint"),
        ("line-babbles", -4.0, "nothing gets by for long, and nobody speaks"),
        ("strays-alone", -2.5, "who speaks says more than a byte"),
        ("late-edges", -1.5, "two who speak at once do not look at the bit before"),
        ("request-swallowed", 0.4, "a request that ran into the other's is swallowed"),
        ("requests-torn-short", 0.1, "two requests at once are fewer bytes than both"),
        ("refuses-command", 0.1, "the answer is to the other's request"),
        ("echoes-differ", 0.2, "the answer is to the other's request"),
        ("echo-mismatch", 0.1, "the answer is to the other's request"),
        ("away-for-a-while", 0.1, "requests in a row ran into the other's"),
        *(
            (code, 0.1, "requests ran into the other's, and are not answered")
            for code in (
                "misses-now-and-then",
                "others-away-too",
                "torn-when-away",
                "outages-anytime",
            )
        ),
        ("damage-while-moving", 0.1, "two speak more where more is to do"),
        ("damage-behind-steps", -3.0, "two clocks do not wait for goals to jump"),
        ("device-checksum", 0.1, "a servo refuses what ran together"),
        ("goal-jump", 0.4, "two programs state goals"),
        ("joint-not-following", 0.3, "two programs state goals"),
        ("position-jumps", 0.3, "the answer to the other's question is taken for a position"),
    ),
)
"""One line each."""
