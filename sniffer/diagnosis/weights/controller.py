"""Weights of the causes that are the controller's."""

from __future__ import annotations

from typing import Final

from sniffer.diagnosis.weights.table import for_

_SPEAKS_INTO: Final = (
    ("request-swallowed", -3.0, "the request that was due stands in the torn answer"),
    ("hasty-request", -3.0, "the controller does not wait for the answers that are missing"),
    ("torn-behind-unanswered", -4.0, "answers are torn where the one before is still to come"),
)
_MIXED: Final = ("answers-spoken-into", -2.5, "what is torn is torn for as long as a frame")
"""What speaks against a fault of the line: the controller tears the answers."""

WEIGHTS: Final = (
    *(
        weight
        for cause in (
            "bus-noise",
            "signal-integrity",
            "turnaround",
            "duplicate-id",
            "clock-drift",
            "two-masters",
        )
        for weight in for_(
            cause,
            ("same-bytes-torn", -8.0, "the same bytes, and never whole: they were sent so"),
            ("command-under-answer", -6.0, "answers lie over commands, and nothing else is torn"),
        )
    ),
    *(
        weight
        for cause in ("bus-noise", "bad-cable", "signal-integrity", "clock-drift")
        for weight in for_(cause, _MIXED)
    ),
    *(
        weight
        for cause in (
            "turnaround",
            "line-stuck",
            "duplicate-id",
            "chatty-device",
            "two-masters",
            "mixed-protocols",
        )
        for weight in for_(
            cause, ("answers-spoken-into", 0.1, "what alters many bytes looks like a second sender")
        )
    ),
    *(
        weight
        for cause in (
            "bus-noise",
            "signal-integrity",
            "bad-cable",
            "turnaround",
            "clock-drift",
            "servo-reset-loop",
        )
        for weight in for_(cause, *_SPEAKS_INTO)
    ),
    *(
        weight
        for cause in ("brownout", "bad-cable", "clock-drift")
        for weight in for_(
            cause,
            ("start-takes-long", -3.0, "it is away because it was told to start anew"),
            (
                "started-when-missing",
                0.2,
                "an answer is missing, and the controller starts it anew",
            ),
        )
    ),
    *for_("retry-storm", ("start-takes-long", -2.0, "it asks until the servo has started")),
    *for_("slow-servo", ("torn-behind-unanswered", -3.0, "others are as late, and torn for it")),
    *for_(
        "duplicate-id",
        ("request-swallowed", -5.0, "what stands there is a request: the one that is missing"),
        ("torn-behind-unanswered", -4.0, "the other answer is that to the request before"),
        ("hasty-request", -3.0, "the controller does not wait for the answers that are missing"),
    ),
    *for_(
        "impatient-controller",
        ("hasty-request", 4.0, "it does not wait as long as sound answers take"),
        ("streams-apart", -2.0, "two loops keep two times"),
        ("rounds-cross", -2.0, "one loop keeps its order"),
        ("torn-when-none-due", -4.0, "behind an answer nobody speaks into its requests"),
        ("requests-run-together", -4.0, "it does not speak into its own requests"),
        ("request-in-answer", 3.5, "its requests run into answers"),
        ("command-under-answer", 6.0, "it says the next command while the answer comes"),
        ("request-over-answer", 3.5, "its requests begin while answers are on the line"),
        ("request-swallowed", 3.5, "its requests are lost in answers"),
        ("answers-spoken-into", 2.5, "answers begin well, and somebody speaks into them"),
        ("answers-after-next", 3.0, "answers come when it has asked something else"),
        ("gives-up-early", 3.0, "it gives up after a time that answers exceed"),
        ("torn-behind-unanswered", 5.0, "answers that come late lie over the next ones"),
        ("late-response", 0.5, "answers are late for it"),
        ("damaged-response", 0.5, "answers are cut by requests"),
        ("no-response", 0.5, "answers are lost among requests"),
        ("no-answer-heard", 0.2, "all answers lie under requests"),
        ("mismatched-response", 0.4, "an answer is taken for that to the next request"),
        ("unsolicited-response", 0.4, "an answer comes when it is not asked for any more"),
        ("duplicate-response", 0.2, "an answer comes behind that to the repeated request"),
        ("ambiguous-response", 0.3, "two requests, one answer"),
        ("bad-checksum", 0.4, "two senders at once"),
        ("damaged-frame", 0.4, "two senders at once"),
        ("truncated-frame", 0.5, "a request cuts an answer"),
        ("idle-tail", 0.2, "two senders at once"),
        ("noise", 0.3, "two senders at once"),
        ("line-error", 0.3, "two senders at once"),
        ("unknown-command", 0.2, "a torn frame may hold by chance"),
        ("goes-on-unanswered", -2.0, "it waits as long as behind sound answers"),
        ("damage-everywhere", 0.3, "answers of all servos are torn"),
        ("damage-in-answers", 1.0, "answers are torn, and requests are not"),
        ("damage-in-requests", 0.2, "what is torn may look like a request"),
        ("strays-at-turn", 0.2, "what is left of a request behind an answer"),
        ("strays-anywhere", 0.2, "what is left of a request behind an answer"),
        *(
            (code, 0.1, "bits of two senders at once")
            for code in (
                "same-bit",
                "one-way-bits",
                "late-edges",
                "last-bits",
                "first-byte-torn",
                "last-byte-torn",
                "line-break",
                "malformed-body",
                "value-out-of-range",
                "doubtful-value",
                "speaks-unasked",
                "headless-frames",
            )
        ),
        *(
            (code, 0.3, "answers are lost among requests")
            for code in (
                "away-for-a-while",
                "away-again-and-again",
                "away-without-a-tear",
                "misses-now-and-then",
                "comes-and-goes",
                "late-replies",
                "joint-not-following",
                "torque-survives",
                "supply-steady",
                "outages-anytime",
                "outages-evenly",
                "lost-together",
                "others-away-too",
            )
        ),
        ("pieces-complete", 0.1, "the end of a request stands behind the answer it was said into"),
        (
            "requests-torn-short",
            0.1,
            "the end of a request stands behind the answer it was said into",
        ),
        ("answers-twice", 0.2, "an answer and the piece of a request behind it"),
        ("answers-mixed", 0.2, "a request over an answer begins like one"),
        ("damage-one-servo", 0.3, "answers of one servo are torn: it is the slowest"),
        ("coarse-stamps", -0.5, "the stamps cannot tell what came first"),
        ("answers-always-torn", -1.5, "what it speaks into now and then comes in time"),
    ),
    *for_(
        "duplicate-id",
        ("answers-after-next", -2.0, "who does not wait has his next request torn by the answer"),
    ),
    *for_(
        "controller-stall",
        ("loop-stalls", 3.5, "its loop stops, and nothing was missing"),
        ("waits-alike", 3.5, "it waits as long each time, and nothing was missing on this wire"),
        ("tap-was-late", -1.0, "the tap itself was late"),
        ("clock-stepped", -2.0, "the clock of the input was set"),
        ("goal-jump", 0.2, "behind a stop the goals are far from where it left"),
        ("device-overload", 0.3, "behind a stop the servo is to hasten"),
        ("device-recovered", 0.1, "behind a stop the servo is to hasten"),
    ),
    *for_(
        "controller-jitter",
        ("loop-jitters", 4.0, "its cycles differ much"),
        ("loop-stalls", -0.5, "single stalls, the other cycles keep their time"),
        ("tap-was-late", -0.5, "the tap itself was late"),
        ("clock-stepped", -2.0, "the clock of the input was set"),
        ("coarse-stamps", -0.5, "the stamps cannot tell small differences"),
    ),
    *for_(
        "controller-slows",
        ("loop-slows", 4.0, "it says less and less, and rests longer and longer"),
        ("clock-stepped", -2.0, "the clock of the input was set"),
        ("tap-was-late", -0.5, "the tap itself was late"),
    ),
    *for_(
        "bus-saturated",
        ("bus-full", 3.5, "bytes are on the line nearly all the time"),
        ("clock-stepped", -2.0, "the clock of the input was set"),
    ),
    *(
        weight
        for cause in ("brownout", "overheat", "overload")
        for weight in for_(
            cause, ("limit-set-beyond", -7.0, "what it complains of came with a limit, and alone")
        )
    ),
    *for_(
        "limit-misplaced",
        ("limit-set-beyond", 6.0, "it complains since a limit was written"),
        ("device-input-voltage", 0.3, "that limit is of its supply"),
        ("voltage-sag", 0.3, "its supply is below that limit"),
        ("supply-stays-low", -3.0, "its supply is far below what it was, whatever the limit"),
        ("device-overheating", 0.3, "that limit is of its temperature"),
        ("device-temperature-alarm", 0.3, "that limit is of its temperature"),
        ("device-temperature-limit", 0.3, "that limit is of its temperature"),
        ("temperature-high", 0.3, "its temperature is beyond that limit"),
        ("temperature-rising", -3.0, "its temperature rises, whatever the limit"),
        ("joint-limp-after-alarm", 0.3, "it switches its motor off for that"),
        ("device-safe-mode", 0.2, "it protects itself for that"),
        ("complaints-together", 0.1, "several were told so"),
        ("device-recovered", 0.1, "it was written back"),
    ),
    *for_(
        "joints-mixed-up",
        ("joints-exchanged", 5.0, "two do what the other one is told"),
        ("joint-mirrored", 4.5, "it goes the opposite way"),
        *(
            (code, 0.3, "its goals are another's")
            for code in ("joint-not-following", "joint-limp", "joint-stalled", "load-high")
        ),
    ),
    *for_(
        "goal-out-of-range",
        ("goal-beyond-range", 3.0, "goals outside the manual's range"),
        ("goal-beyond-limits", 3.0, "goals outside the limits in the servo"),
        ("device-stroke-limit", 2.0, "the servo complains of its limits"),
        ("goal-jump", 0.5, "the way out of range is a jump"),
        ("goals-in-turns", 0.5, "the way out of range is a jump, and back"),
        ("value-out-of-range", 0.8, "a number outside the manual's range"),
        ("device-outside-limits", 0.5, "it stands outside its limits"),
        *(
            (code, 0.4, "it cannot go there")
            for code in (
                "joint-limp",
                "joint-not-following",
                "joint-stalled",
                "stuck-before-alarm",
                "device-overload",
                "load-high",
                "load-high-and-still",
                "refuses-command",
            )
        ),
        ("device-recovered", 0.1, "the complaint ends with the next goal"),
        ("device-packet-not-processable", 0.3, "the servo refuses such a goal"),
        ("device-nack", 0.3, "the servo refuses such a goal"),
    ),
    *for_(
        "position-jump",
        ("goal-jump", 3.5, "one step far beyond all others"),
        ("goals-in-turns", 4.5, "two programs state its goals in turns"),
        ("goal-beyond-range", -0.5, "goals out of range are a fault of their own"),
        ("device-overload", 0.3, "the servo is to hasten to a goal far away"),
        ("device-recovered", 0.1, "the servo has come to its goal"),
        ("load-high", 0.2, "the servo hastens to a goal far away"),
        ("joint-not-following", 0.2, "the goal is back before the servo gets there"),
    ),
    *for_(
        "read-only-write",
        ("writes-read-only", 3.0, "a register that can only be read is written"),
        ("writes-unnamed", 2.0, "an address that the table does not name is written"),
        ("device-range", 0.8, "the servo refuses the address"),
        ("device-packet-not-processable", 0.6, "the servo refuses the packet"),
        ("device-nack", 0.6, "the servo refuses the packet"),
        ("refuses-command", 0.4, "the servo refuses the packet"),
        ("no-response", 0.2, "the servo ignores it"),
        ("value-out-of-range", 0.2, "what is written fits no range"),
    ),
    *for_(
        "partial-write",
        ("writes-part", 3.0, "half a register is written"),
        ("joint-limp", 0.5, "half a goal moves nothing"),
        ("joint-not-following", 0.5, "half a goal moves nothing"),
        ("goal-jump", 0.3, "half a goal is another goal"),
        ("doubtful-value", 0.1, "half a goal is another goal"),
        ("position-jumps", 0.2, "a joint goes where half a goal sends it"),
        ("device-range", 0.4, "the servo refuses the length"),
        ("device-packet-not-processable", 0.4, "the servo refuses the packet"),
        ("refuses-command", 0.4, "the servo refuses the packet"),
        ("no-response", 0.2, "the servo ignores it"),
    ),
    *for_(
        "malformed-command",
        ("odd-commands", 3.0, "requests that hold, and are not as the manual has them"),
        ("items-misread", 4.5, "values are read as ids: items are not as long as the command says"),
        ("value-out-of-range", 0.3, "what is misread is any number"),
        ("joint-limp", 0.3, "a goal that is misread moves nothing"),
        ("joint-not-following", 0.3, "a goal that is misread moves nothing"),
        ("joint-stalled", 0.3, "a goal that is misread moves nothing"),
        ("goals-in-turns", 0.3, "goals and what is misread come in turns"),
        ("goal-jump", 0.3, "what is misread is another goal"),
        ("malformed-body", 1.0, "frames whose body their command cannot have"),
        ("unknown-command", 1.0, "commands that stand in no manual"),
        ("modifier-misused", 3.0, "a modifier that the command does not have"),
        ("gain-read-sets-id", 3.0, "the command is not the one that was meant"),
        ("id-changed", 0.3, "servos are given an id that nobody meant"),
        ("unusual-form", 0.3, "not in the manual's form"),
        ("device-instruction", 1.0, "the servo does not know the command"),
        ("device-range", 0.3, "the servo refuses the address"),
        ("device-packet-not-processable", 0.8, "the servo refuses the packet"),
        ("device-nack", 0.8, "the servo refuses the packet"),
        ("no-response", 0.3, "servos do not answer it"),
        ("misses-now-and-then", 0.5, "servos do not answer it"),
        ("comes-and-goes", 0.3, "servos do not answer it"),
        ("away-for-a-while", 0.2, "servos do not answer it"),
        *(
            (code, 0.2, "servos do not answer it, and all else")
            for code in (
                "one-question-unanswered",
                "away-without-a-tear",
                "away-again-and-again",
                "away-alike",
                "outages-evenly",
                "outages-anytime",
                "supply-steady",
                "torque-survives",
            )
        ),
        ("refuses-command", 0.5, "servos refuse it"),
        ("same-bytes-torn", 3.5, "the same bytes that are no frame, time and again"),
        ("damaged-frame", 0.4, "it is no frame at all"),
        ("truncated-frame", 0.4, "it is no frame at all"),
        ("bad-checksum", 0.4, "it is no frame at all"),
        ("noise", 0.3, "it is no frame at all"),
        ("damage-in-requests", 0.5, "it is no frame at all"),
        *(
            (code, 0.3, "the same bytes are torn in the same way")
            for code in (
                "late-edges",
                "one-way-bits",
                "same-bit",
                "strays-anywhere",
                "strays-at-turn",
                "answers-twice",
            )
        ),
        ("damage-everywhere", -1.5, "torn frames may hold by chance"),
        ("damage-one-servo", -1.0, "torn frames may hold by chance"),
        ("request-in-answer", -2.0, "requests run into answers"),
    ),
    *for_(
        "nv-wear",
        ("memory-written-often", 3.5, "settings are written in a loop"),
        ("device-flash-write-error", 1.0, "a write of the memory failed"),
        ("late-response", 0.2, "a servo that writes its memory answers late"),
        ("no-response", 0.1, "a servo that writes its memory may not answer"),
    ),
    *for_(
        "retry-storm",
        ("retry-storm", 5.0, "one request again and again, the others wait"),
        ("no-response", 0.5, "none of them is answered"),
        ("away-for-a-while", 0.5, "the servo is away, and is not left alone"),
        ("away-again-and-again", 0.5, "the servo is away, and is not left alone"),
        ("misses-now-and-then", 0.3, "the servo is away, and is not left alone"),
        ("comes-and-goes", 0.3, "the servo is away, and is not left alone"),
        ("damaged-response", 0.3, "the answers are torn"),
        ("joint-not-following", 0.1, "others get no goals meanwhile"),
        *(
            (code, 0.2, "the loop waits, and goes on out of step")
            for code in (
                "unrelated-periods",
                "streams-apart",
                "rounds-cross",
                "interleaved-requests",
                "loop-jitters",
            )
        ),
        ("torque-survives", 0.1, "it did not restart"),
        ("away-without-a-tear", 0.1, "it answers nothing of this"),
        ("one-question-unanswered", 1.0, "the servo answers all but what is asked again"),
        ("supply-steady", 0.1, "its supply is in order"),
    ),
    *for_(
        "servo-absent",
        ("absent-costs", 0.5, "waiting for it takes much of the time"),
    ),
    *for_(
        "slow-servo",
        ("coarse-stamps", -0.5, "the stamps cannot tell small differences"),
    ),
)
"""One line each."""
