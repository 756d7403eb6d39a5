"""Two faults at once, and evidence that only looks like it: each with its counterpart."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import pytest

from sniffer.diagnosis.physics.misread import of_peers
from sniffer.ground.model import Direction
from sniffer.ground.registers import RegisterMap, schema_path
from tests.conversations import Conversation, one_wire, robot, swinging, through_usb
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn
from tests.servos import lss, suffering
from tests.streams import rs30x, wck
from tests.test_diagnosis_beside import torn_read
from tests.test_diagnosis_tap import holes

if TYPE_CHECKING:
    from collections.abc import Callable

SERVOS = (1, 2, 3, 4, 5)


def altered(data: bytes) -> bytes:
    """Return a frame with one byte read otherwise."""
    return data[:-2] + bytes((data[-2] ^ 0x18, data[-1]))


def hit(data: bytes, rng: random.Random) -> bytes:
    """Return a frame that a pulse has hit anywhere, for a bit or some."""
    k, bits = rng.randrange(3, len(data)), rng.choice((1, 3, 7, 1)) << rng.randrange(6)
    return data[:k] + bytes((data[k] ^ bits,)) + data[k + 1 :]


# -------------------------------------------------------------------------- twins, and noise beside


def twins_and(noise: float) -> Conversation:
    """Servo 2 answers twice, the second time into the next request; of all others some are torn."""
    rng = random.Random(3)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        place = swinging(servo, talk.now_s)
        if servo == 2:
            talk.say(talk.tongue.ask(2))
            talk.rest(0.3)
            talk.say(talk.tongue.answer(2, place))
            talk.rest(0.2)
            talk.say(talk.tongue.answer(2, place + 0.1))
            if cycle % 2:
                talk.say(altered(talk.tongue.ask(3)))
            talk.rest(0.4)
            return True
        if noise and servo != 3 and rng.random() < noise:
            if rng.random() < 0.5:
                talk.say(hit(talk.tongue.ask(servo), rng))
                talk.rest(5)
            else:
                torn_read(talk, servo, lambda data: hit(data, rng))
            return True
        return False

    return robot("mightyzap", 10, servos=SERVOS, instead=instead, goals=False)


def test_noise_is_told_beside_a_servo_that_answers_twice() -> None:
    told = verdicts(twins_and(0.04).diagnosed().incidents())
    assert ("duplicate-id", (2,)) in told
    assert "bus-noise" in {cause for cause, _ in told}


def test_what_a_second_answer_tears_is_no_noise() -> None:
    assert verdicts(twins_and(0.0).diagnosed().incidents()) == [("duplicate-id", (2,))]


# ------------------------------------------------------------------------------ who tore what it is


@pytest.mark.parametrize(("in_answers", "sent_so"), [(True, False), (False, True)])
def test_the_same_bytes_time_and_again_are_a_command_only_where_no_answer_is_due(
    in_answers: bool, sent_so: bool
) -> None:
    odd = b"\x7e\xbf\x7e\xfe\xff\xb7\x6b"

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 3 or cycle < 20:
            return False
        if in_answers:
            torn_read(talk, servo, lambda data: odd)
        else:
            talk.read(servo, 0.4)
            talk.rest(5)
            talk.write(odd)
        return True

    told = robot("lss", 6, instead=instead, goals=False).diagnosed()
    assert ("same-bytes-torn" in codes(told)) is sent_so


def test_answers_that_name_the_servo_asked_before_come_to_a_controller_that_did_not_wait() -> None:
    talk = Conversation("rs30x")
    for cycle in range(120):
        talk.until(cycle / 25)
        talk.say(talk.tongue.ask(3))
        talk.rest(2.5)
        talk.say(talk.tongue.ask(24))
        talk.rest(0.3)
        talk.say(altered(talk.tongue.answer(3, swinging(3, talk.now_s))))
        talk.rest(0.4)
        talk.say(talk.tongue.answer(24, swinging(2, talk.now_s)))
    told = talk.diagnosed()
    assert "answers-twice" not in codes(told)
    assert verdicts(told.incidents())[0] == ("impatient-controller", ())


def test_ids_that_are_written_as_text_are_put_in_place_of_a_peers() -> None:
    known = {b"#25QD\r": (b"*25QD-128\r",), b"#8QD\r": (b"*8QD5\r",), b"#26QV\r": (b"*26QV1\r",)}
    assert of_peers(b"#80QD\r", known) == (b"*80QD-128\r",)
    assert not of_peers(b"#80QT\r", known)


# ------------------------------------------------------------------------------ silences and resets


def silences(lengths: Callable[[random.Random], int], every: int) -> Conversation:
    """Servo 3 misses so many requests in a row, every so many cycles."""
    rng, away = random.Random(5), 0

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        nonlocal away
        if servo != 3:
            return False
        if not away and cycle % every == every - 1:
            away = lengths(rng)
        away = max(away - 1, -1) if away else 0
        if away:
            talk.ask_in_vain(servo, 20)
        return bool(away)

    return robot("mightyzap", 20, servos=(1, 2, 3, 4), rate_hz=10, instead=instead, goals=False)


def test_silences_of_which_most_are_of_one_request_are_no_restarts() -> None:
    told = codes(silences(lambda rng: rng.choice((2, 2, 2, 2, 2, 5)), 10).diagnosed())
    assert "away-again-and-again" not in told


def test_silences_that_are_as_long_each_time_are_restarts() -> None:
    told = codes(silences(lambda rng: 5, 20).diagnosed())
    assert "away-again-and-again" in told


def test_one_silence_is_one_moment_however_often_was_asked_meanwhile() -> None:
    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 1 or not 300 <= cycle < 310:
            return False
        talk.ask_in_vain(servo, 87)
        return True

    told = robot("wck", 12, servos=SERVOS, rate_hz=100, instead=instead, goals=False).diagnosed()
    assert "away-for-a-while" in codes(told)
    assert "comes-and-goes" not in codes(told)


# --------------------------------------------------------------------- what a servo says of itself


@pytest.mark.parametrize(("degrees", "cool"), [(46, True), (72, False)])
def test_a_servo_that_protects_itself_far_from_its_limit_is_not_too_hot(
    degrees: int, cool: bool
) -> None:
    told = [(k / 5, f"#6QT *6QT{300 + (degrees - 30) * k // 2}") for k in range(21)]
    told += [(k / 5 + 0.05, f"#6Q *6Q{6 if k < 20 else 10}") for k in range(24)]
    diagnosis = lss(*told)
    assert "device-safe-mode" in codes(diagnosis)
    assert ("saved-while-cool" in codes(diagnosis)) is cool


@pytest.mark.parametrize(("every", "refuses"), [(1, True), (3, False)])
def test_who_refuses_a_command_does_so_each_time(every: int, refuses: bool) -> None:
    def behind(talk: Conversation, cycle: int) -> None:
        talk.say(wck.command(0xE0, 0xC9, b"\x02\x02"))
        talk.rest(0.3)
        talk.say(b"\x03\x40" if cycle % every else b"\x0b\x40")  # ten bits: the first has three
        talk.rest(0.4)

    told = robot("wck", 3, behind=behind).diagnosed()
    assert ("refuses-command" in codes(told)) is refuses
    assert ("echoes-differ" in codes(told)) is not refuses
    (incident,) = told.incidents()
    assert incident.cause == ("servo-refuses" if refuses else "duplicate-id")


# --------------------------------------------------------------------------- what the tap has lost


def test_ends_of_lines_with_any_number_in_them_are_what_is_left_of_lost_bytes() -> None:
    rng = random.Random(9)

    def behind(talk: Conversation, cycle: int) -> None:
        if cycle % 9 == 4:
            talk.rest(4)
            talk.say(b"%d\r" % rng.randrange(1, 999))

    told = robot("lss", 6, servos=(1, 2), behind=behind, path=lambda servo, s: 0.5).diagnosed()
    assert "pieces-complete" in codes(told)


def test_a_clock_that_is_off_is_told_beside_bytes_that_the_tap_lost() -> None:
    rng = random.Random(2)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        lost = rng.random() < 0.06
        if lost:
            talk.say(talk.tongue.ask(servo)[: rng.choice((4, 5))])
            talk.rest(0.3)
            talk.say(talk.tongue.answer(servo, swinging(servo, talk.now_s)))
            talk.rest(0.4)
        elif servo == 1 and cycle > 100:
            torn_read(talk, 1, lambda data: data[:6] + bytes(b | 0xC0 for b in data[6:]))
        return lost or (servo == 1 and cycle > 100)

    told = verdicts(
        robot("mightyzap", 10, servos=SERVOS, instead=instead, goals=False).diagnosed().incidents()
    )
    assert {"tap-loss", "clock-drift"} <= {cause for cause, _ in told}
    assert ("clock-drift", (1,)) in told


@each_in_turn(3, "protocol", ["mightyzap", "rs30x", "lss"])
def test_what_noise_leaves_behind_requests_to_a_dead_servo_is_no_answer(protocol: str) -> None:
    rng = random.Random(4)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo == 2 and cycle > 160:
            talk.say(talk.tongue.ask(servo))
            if rng.random() < 0.1:
                talk.rest(0.3)
                talk.say(bytes((0xC1, 0x41)))
            talk.rest(20)
        elif rng.random() < 0.03:
            torn_read(talk, servo, altered)
        else:
            return False
        return True

    told = robot(protocol, 10, instead=instead, goals=False).diagnosed()
    assert ("servo-dead", (2,)) in verdicts(told.incidents())


@each_in_turn(2, "protocol", ["mightyzap", "rs30x"])
def test_what_is_lost_of_a_servo_that_is_not_there_is_not_the_taps_loss(protocol: str) -> None:
    def asks(talk: Conversation, cycle: int) -> None:
        if cycle % 8 == 0:
            talk.ask_in_vain(9, 20)

    talk = robot(protocol, 10, behind=asks)
    told = talk.diagnosed(holes(one_wire(talk))).incidents()
    assert verdicts(told) == [("servo-absent", (9,)), ("tap-loss", ())]
    loss = next(i for i in told if i.cause == "tap-loss")
    assert 9 not in {f.servo_id for f in loss.findings if f.code == "no-response"}


@pytest.mark.parametrize(("torn", "at_turn"), [(0.0, True), (0.02, False)])
def test_strays_that_spare_all_frames_come_when_the_direction_changes(
    torn: float, at_turn: bool
) -> None:
    rng = random.Random(8)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if rng.random() < 0.3:
            talk.say(bytes((rng.choice((0x00, 0xFC, 0xFE)),)))
            talk.rest(0.5)
        if rng.random() < torn:
            torn_read(talk, servo, altered)
            return True
        return False

    talk = robot("mightyzap", 10, rate_hz=20, instead=instead, goals=False)
    told = codes(talk.diagnosed(through_usb(talk.chunks)))
    assert ("strays-at-turn" in told) is at_turn


@pytest.mark.parametrize(
    ("protocol", "other", "cause"),
    [
        ("rs30x", "impatient:3%", "impatient-controller"),
        ("mightyzap", "noise:2.3%", "bus-noise"),
        ("rs30x", "reset-loop:2:1.2%", "servo-reset-loop"),
    ],
)
def test_a_loop_that_trembles_is_told_beside_what_fails(
    protocol: str, other: str, cause: str
) -> None:
    told = {one.cause for one in suffering(protocol, f"jitter {other}", 8.0).incidents()}
    assert told == {"controller-jitter", cause}


def test_what_fails_makes_no_loop_tremble() -> None:
    for other in ("impatient:5%", "noise:5%", "drop-reply:2:20%"):
        assert "loop-jitters" not in codes(suffering("mightyzap", other, 8.0))


def test_whole_second_answers_are_a_servos_also_where_the_controller_speaks_into_answers() -> None:
    d = suffering("lss", "duplicate-id:2:60% impatient:3%", 8.0)
    assert set(verdicts(d.incidents())) == {("duplicate-id", (2,)), ("impatient-controller", ())}


def test_torque_that_the_controller_switches_on_again_has_not_outlived_a_silence() -> None:
    d = suffering("rs30x", "reset-loop:5:1.5% dead:1@6s", 14.0)
    assert "torque-survives" not in codes(d)
    assert verdicts(d.incidents()) == [("servo-reset-loop", (5,)), ("servo-dead", (1,))]


def test_of_a_model_without_torque_nothing_is_told_by_its_torque() -> None:
    text = schema_path("registers", "mightyzap-l12.toml").read_text(encoding="utf-8")
    head, *rows = text.replace('"mightyzap-l12"', '"limp"').split("[[register]]")
    without = "[[register]]".join(
        [head, *(r for r in rows if 'quantity = "torque_enable"' not in r)]
    )
    own = RegisterMap.from_text(without, "limp.toml")
    d = suffering("mightyzap", "reset-loop:2:1.5%", model=own)
    assert ("servo-reset-loop", (2,)) in verdicts(d.incidents())


@pytest.mark.parametrize(
    ("other", "told"),
    [("chatty:3:7%", ("chatty-device", (3,))), ("impatient:5%", ("impatient-controller", ()))],
)
def test_a_limp_joint_is_told_beside_who_speaks_into_bare_answers(
    other: str, told: tuple[str, tuple[int, ...]]
) -> None:
    d = suffering("wck", f"limp:2@2s {other}", 9.0)
    assert set(verdicts(d.incidents())) == {("torque-off", (2,)), told}


def contact_with_torque(*, reads_off: bool) -> frozenset[str]:
    """Return what is found of a contact without a torn answer, late in a run that wrote torque.

    ``reads_off``: between the silences the servo says once that its torque is off.
    """
    rng, until = random.Random(3), 0

    def beside(talk: Conversation, cycle: int) -> None:
        if cycle < 200 and cycle % 20 == 0:
            talk.say(rs30x.write(2, 0x24, b"\x01"), Direction.TX)
            talk.rest(0.4)
        if cycle == 390 and reads_off:
            talk.say(rs30x.packet(2, 0x0F, 0x24, 1, 0), Direction.TX)
            talk.rest(0.3)
            talk.say(rs30x.returned(2, 0x24, b"\x00"), Direction.RX)
            talk.rest(0.4)

    def opens(talk: Conversation, cycle: int, servo: int) -> bool:
        nonlocal until
        if servo != 2 or cycle < 320 or cycle % 40 > 16:
            return False
        if cycle % 40 == 0:
            until = cycle + rng.randint(3, 16)
        if cycle >= until:
            return False
        talk.ask_in_vain(servo, 5)
        return True

    d = robot("rs30x", 16, before=beside, instead=opens).diagnosed()
    return frozenset(codes(d)) | {cause for cause, _ in verdicts(d.incidents())}


def test_torque_that_was_switched_before_the_silences_has_outlived_them() -> None:
    told = contact_with_torque(reads_off=False)
    assert {"torque-survives", "bad-cable"} <= told
    assert "servo-reset-loop" not in told


def test_torque_that_is_read_as_off_has_not() -> None:
    assert "torque-survives" not in contact_with_torque(reads_off=True)
