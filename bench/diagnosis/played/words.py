"""What servos say that they should not: refusals, and words that nobody asked for."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, Any, Final

from bench.diagnosis.played.cases import Cases
from bench.diagnosis.played.draft import ALL, TURN
from bench.diagnosis.played.tongue import Say
from sniffer.ground.model import NS
from sniffer.protocols.lss.grammar import reply
from sniffer.protocols.mightyzap.grammar import EXECUTE
from sniffer.simulation.mightyzap_servo import command, packet
from sniffer.simulation.rs30x_servo import returned
from sniffer.simulation.talk import US, Message

if TYPE_CHECKING:
    from collections.abc import Callable

    from bench.diagnosis.played.draft import Draft, Play

CASES: Final = Cases()

LISTENS_NS: Final = 150 * US
"""How long the line must be silent for a device that listens before it speaks."""

PERIODS_S: Final = (0.4, 0.7, 1.3, 2.0)

NOT_PROCESSABLE: Final = 1 << 1
"""Flag of an RS30x return packet. Source: RS305CR manual, table 4.3."""


def _repeatedly(
    draft: Draft, first_s: float, last_s: float, say: Callable[[Play], Say]
) -> list[float]:
    """Let the controller say something now and then; return the times."""
    period = draft.rng.choice(PERIODS_S)
    times = [first_s + n * period for n in range(int((last_s - first_s) / period) + 1)]
    for t in times:
        draft.cue(t, functools.partial(_tell, say=say))
    return times


def _tell(play: Play, say: Callable[[Play], Say]) -> None:
    play.tell([say(play)])


@CASES("mightyzap", polls=(ALL, TURN))
def servo_refuses(draft: Draft) -> None:
    """It is asked beyond its map, told what its registers do not take, or to execute nothing."""
    who, first_s = draft.pick(), draft.onset()
    asks = {
        "beyond": lambda play: play.tongue.load(who, 0x96, 8),
        "value": lambda play: Say(play.tongue.store(who, 0x10, b"\x07").raw),
        "nothing": lambda play: Say(command(who, EXECUTE).data),
    }
    ask = asks[draft.rng.choice(sorted(asks))]

    def answers_all(play: Play) -> None:
        play.servo(who).memory.raw["feedback_return_mode"] = play.tongue.mode = 2
        for servo in play.stage.bus.servos.values():
            servo.memory.raw["feedback_return_mode"] = 2  # type: ignore[attr-defined]

    draft.start(answers_all)
    times = _repeatedly(draft, first_s, draft.seconds - 1, ask)
    draft.truth("servo-refuses", who, first_s, times[-1] + 0.2)


def _nack(servo: Any, request: Message, address: int) -> Message | None:
    if request.op == "write" and request.data[4] == address:
        return Message(servo.refuse(request.op).data, servo.servo_id, request.op)
    return None


def _unable(servo: Any, request: Message) -> Message | None:
    """Answer a read of 0x80 and beyond with the flag for what cannot be processed."""
    if request.op == "read" and request.data[4] >= 0x80:
        data = bytes(request.data[5])
        built = returned(servo.servo_id, request.data[4], data, NOT_PROCESSABLE)
        return Message(built, servo.servo_id, request.op)
    return None


@CASES("rs30x", polls=(ALL, TURN))
def servo_refuses_packets(draft: Draft) -> None:
    """It answers a write with NACK, or a read beyond its map with the flag for that."""
    who, first_s = draft.pick(), draft.onset()
    is_write = draft.rng.random() < 0.6
    torque = bytes([draft.rng.randrange(60, 101)])

    def refuse(play: Play) -> None:
        refusal = functools.partial(_nack, address=0x23) if is_write else _unable
        play.stage.refusals[who] = refusal

    def say(play: Play) -> Say:
        if is_write:
            told: Say = play.tongue.write(who, 0x23, torque, ack=True)
        else:
            told = play.tongue.read(who, 0x84, 4)
        return told

    draft.start(refuse)
    times = _repeatedly(draft, first_s, draft.seconds - 1, say)
    draft.truth("servo-refuses", who, first_s, times[-1] + 0.2)


def _unasked(play: Play, who: int) -> bytes:
    """Return what a servo of the protocol may say by itself."""
    servo, name = play.servo(who), play.stage.bus.name
    match name:
        case "mightyzap":
            return packet(who, 0x00)
        case "rs30x":
            return bytes(servo.give(0x2A, 18).data)
        case "lss":
            return reply(who, "Q", 6)
    return bytes([4, 128])


def _chat(play: Play, who: int, waits: bool) -> None:
    stage = play.stage
    if waits and stage.busy_until_ns + LISTENS_NS > stage.bus.now_ns:
        later = functools.partial(_chat, play, who, waits)
        stage.at((stage.busy_until_ns + LISTENS_NS + 1) / NS, later)
        return
    stage.speak(stage.bus.now_ns, _unasked(play, who))


def chats(draft: Draft) -> None:
    """Let a servo speak when it likes, or when nobody else does."""
    rng, who, first_s = draft.rng, draft.pick(), draft.onset()
    last_s = draft.seconds - 0.5
    waits = rng.random() < 0.7
    if rng.random() < 0.5:
        period = rng.choice((0.25, 0.5, 1.0))
        times = [first_s + n * period for n in range(int((last_s - first_s) / period))]
    else:
        times = sorted(rng.uniform(first_s, last_s) for _ in range(rng.randint(6, 20)))
    for t in times:
        draft.at(t, functools.partial(_chat, who=who, waits=waits))
    draft.truth("chatty-device", who, times[0], times[-1])


@CASES("mightyzap", "lss", "rs30x", polls=(ALL, TURN))
def chatty_device(draft: Draft) -> None:
    """A device that speaks unasked, into the pauses mostly, and into talk at times."""
    chats(draft)
