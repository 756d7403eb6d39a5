"""What is told by the shape of many cases: rhythms, remains of frames, complaints at once."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from sniffer.diagnosis.evidence.chances import so_alike
from tests.conversations import Conversation, one_wire, robot, swinging
from tests.diagnosed import codes, verdicts
from tests.lists import each_in_turn
from tests.servos import finding, heard, lss, mightyzap_read, suffering
from tests.streams import mightyzap, rs30x
from tests.test_diagnosis_beside import torn_read
from tests.test_diagnosis_controller import collided
from tests.test_diagnosis_tap import holes
from tests.test_diagnosis_two_at_once import hit


@each_in_turn(3, "protocol", ["mightyzap", "rs30x", "wck"])
def test_what_a_lossy_tap_leaves_lacks_its_beginning_and_nothing_else(protocol: str) -> None:
    talk = robot(protocol, 10)
    assert "pieces-complete" in codes(talk.diagnosed(holes(one_wire(talk))))


def test_what_a_lossy_tap_leaves_is_known_beside_a_servo_whose_answers_are_torn() -> None:
    """Its altered answers are many more, and most that is asked has an answer of one byte."""
    rng = random.Random(3)

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or cycle % 2:
            return False
        torn_read(talk, servo, lambda data: hit(data, rng))
        return True

    talk = robot("rs30x", 10, instead=instead)
    told = talk.diagnosed(holes(one_wire(talk)))
    assert "pieces-complete" in codes(told)
    assert "tap-loss" in {cause for cause, _ in verdicts(told.incidents())}


def test_pieces_that_noise_leaves_are_not_whole_behind_any_beginning() -> None:
    talk, rng, torn = robot("rs30x", 8), random.Random(3), []
    for chunk in one_wire(talk):
        data = bytearray(chunk.data)
        if rng.random() < 0.05:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        torn.append(replace(chunk, data=bytes(data)))
    assert "pieces-complete" not in codes(talk.diagnosed(torn))


def spoken_into(protocol: str, *, for_long: bool) -> set[str]:
    """Return what is found where answers are torn for long, or by a bit."""
    rng = random.Random(6)

    def torn(talk: Conversation, cycle: int, servo: int) -> bool:
        if rng.random() > 0.05:
            return False
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        answer = talk.tongue.answer(servo, swinging(servo, talk.now_s))
        if for_long:
            talk.say(collided(answer, rs30x.packet(9, 0x0F, 0x2A, 2, 0), 6))
        else:
            at = rng.randrange(3, len(answer))
            talk.say(answer[:at] + bytes([answer[at] ^ 8]) + answer[at + 1 :])
        talk.rest(25)
        return True

    return codes(robot(protocol, 8, instead=torn).diagnosed())


def test_answers_that_are_torn_for_long_from_somewhere_on_are_spoken_into() -> None:
    assert "answers-spoken-into" in spoken_into("rs30x", for_long=True)


def test_answers_that_lose_a_bit_are_not_spoken_into() -> None:
    assert "answers-spoken-into" not in spoken_into("rs30x", for_long=False)


def complaining(*servos: int) -> Conversation:
    """Return three servos of which some complain of their supply for half a second."""
    talk = Conversation("mightyzap")
    for cycle in range(200):
        talk.until(cycle / 40)
        for servo in (1, 2, 3):
            low = servo in servos and 80 <= cycle < 100
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3)
            talk.say(mightyzap.packet(servo, low, b"\x00\x08"))
            talk.rest(0.4)
    return talk


def test_servos_that_complain_at_once_share_a_supply() -> None:
    told = complaining(1, 2, 3).diagnosed()
    assert "complaints-together" in codes(told)
    assert verdicts(told.incidents()) == [("brownout", (1, 2, 3))]


def test_a_servo_that_complains_alone_does_not_complain_together() -> None:
    assert "complaints-together" not in codes(complaining(2).diagnosed())


@pytest.mark.parametrize(
    ("is_even", "code"), [(True, "outages-evenly"), (False, "outages-anytime")]
)
def test_the_rhythm_of_outages_is_told(code: str, *, is_even: bool) -> None:
    rng = random.Random(1)
    away = {n * 30 for n in range(1, 20)} if is_even else {rng.randrange(600) for _ in range(20)}

    def miss(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2 or cycle not in away:
            return False
        talk.ask_in_vain(servo, 15)
        return True

    told = codes(robot("mightyzap", 15, instead=miss, goals=False).diagnosed())
    assert {"outages-evenly", "outages-anytime"} & told == {code}


def test_how_alike_stretches_are_is_as_seldom_as_chance_has_it() -> None:
    """Restarts are alike; what ends at any time is not, nor what may be."""
    rng = random.Random(2)
    drawn = [so_alike([(x, x) for _ in range(7) if (x := rng.expovariate(1))]) for _ in range(999)]
    for chance in (0.01, 0.1):
        assert sum(p <= chance for p in drawn) / 999 < 2 * chance
    assert so_alike([(1.9, 2.1)] * 5) < 2e-3
    assert so_alike([(0.0, 2.0)] * 5) == 1.0


def test_a_servo_that_speaks_now_and_then_is_no_second_one() -> None:
    assert "unasked-now-and-then" in codes(suffering("mightyzap", "chatty:1:4%", 10.0))


@each_in_turn(3, "protocol", ["mightyzap", "lss", "rs30x"])
def test_a_second_servo_that_answers_now_and_then_is_no_device_that_speaks_unasked(
    protocol: str,
) -> None:
    d = suffering(protocol, "duplicate-id:1:8%", 8.0)
    assert "behind-its-own-alone" in codes(d)
    assert verdicts(d.incidents()) == [("duplicate-id", (1,))]


def test_who_speaks_behind_others_too_is_no_second_servo() -> None:
    assert "behind-its-own-alone" not in codes(suffering("mightyzap", "chatty:1:8%", 10.0))


def test_a_sound_bus_has_nobody_who_speaks_now_and_then() -> None:
    assert "unasked-now-and-then" not in codes(suffering("mightyzap", seconds=10.0))


@pytest.mark.parametrize("line", ["#5D", "#5D1 5", "#5D12T"])
def test_a_line_that_lacks_a_number_again_and_again_is_malformed(line: str) -> None:
    asked = [(n / 10, "#5QD *5QD120") for n in range(40)]
    lines = [(n / 10 + 0.05, line.encode() + b"\r") for n in range(5, 40, 5)]
    said = [(t, f"{part}\r".encode()) for t, text in asked for part in text.split()]
    said = [(t + 0.002 * (k % 2), data) for k, (t, data) in enumerate(said)]
    told = heard(sorted([*said, *lines]), "lss")
    assert verdicts(told.incidents()) == [("malformed-command", (5,))]


def test_lines_as_the_page_has_them_are_not_malformed() -> None:
    told = lss(*((n / 10, "#5QD *5QD120 #5D120T500 #5L") for n in range(40)))
    assert "odd-commands" not in codes(told)


def test_the_place_of_a_sag_is_the_lowest_voltage() -> None:
    sag = finding(suffering("mightyzap", "brownout:1:100%@3s+0.05s", 10.0), "voltage-sag")
    assert sag is not None
    (place,) = sag.places
    assert place.what == f"voltage {sag.value('least'):.4g} V"


def test_a_voltage_that_is_written_was_not_measured() -> None:
    talk = Conversation("rs30x")
    for cycle in range(120):
        talk.until(cycle / 20)
        talk.say(rs30x.packet(1, 0x0F, 0x34, 2, 0))
        talk.rest(0.3)
        talk.say(rs30x.returned(1, 0x34, (740).to_bytes(2, "little")))
        talk.rest(0.5)
        if cycle % 20 == 10:
            talk.write(rs30x.write(1, 0x34, (300).to_bytes(2, "little")))
    assert "voltage-sag" not in codes(talk.diagnosed())


def test_a_controller_that_nobody_answers_and_that_waits_may_have_another_rate() -> None:
    def in_vain(talk: Conversation, cycle: int, servo: int) -> bool:
        del cycle
        talk.ask_in_vain(servo, 25)
        return True

    told = robot("mightyzap", 8, instead=in_vain, rate_hz=10).diagnosed()
    assert [incident.cause for incident in told.incidents()] == ["wrong-baud"]


def away_together(low_v: float) -> list[tuple[float, bytes]]:
    """Return four servos, three of which are silent at once, behind a supply of so much."""
    said = []
    for k in range(700):
        t = k * 0.05
        before, silent = t > 5 and t % 10 > 8.2, t > 5 and t % 10 > 9.5
        for servo in (1, 2, 3, 4):
            level = low_v if before and servo < 4 else 12.0
            ask, answer = mightyzap_read(servo, t + servo / 100, 0x92, bytes([round(level * 10)]))
            said += [ask] if silent and servo < 4 else [ask, answer]
    return said


def test_servos_that_fall_silent_together_behind_a_sag_share_a_supply_and_not_a_cable() -> None:
    sagging, steady = (heard(away_together(v), "mightyzap").incidents() for v in (9.2, 12.0))
    assert verdicts(sagging) == [("brownout", (1, 2, 3))]
    assert verdicts(steady) == [("bad-cable", (1, 2, 3))]


def test_a_torn_line_that_reads_as_a_modifier_is_no_command_of_the_wrong_form() -> None:
    rng = random.Random(4)
    talk = robot("lss", 6)
    heard_so = []
    for k, chunk in enumerate(talk.chunks):
        data = bytearray(chunk.data)
        if data.startswith(b"#") and rng.random() < 0.03:
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        if k == 400:
            data = bytearray(b"#3D-3Y0\r")
        heard_so.append(replace(chunk, data=bytes(data)))
    assert verdicts(talk.diagnosed(heard_so).incidents()) == [("bus-noise", ())]
    talk.write(b"#3D-3Y0\r")
    talk.read(1, 0.5)
    assert "modifier-misused" in codes(talk.diagnosed())


@each_in_turn(3, "protocol", ["mightyzap", "lss", "rs30x"])
def test_a_servo_whose_answer_another_one_tears_is_two_though_few_of_both_are_whole(
    protocol: str,
) -> None:
    def twice(talk: Conversation, cycle: int, servo: int) -> bool:
        if servo != 2:
            return False
        place = swinging(servo, talk.now_s)
        talk.say(talk.tongue.ask(servo))
        talk.rest(0.3)
        first = talk.tongue.answer(servo, place)
        is_whole = not cycle % 25
        talk.say(first if is_whole else first[:-2])
        talk.rest(0.3 if is_whole else 0.0)
        talk.say(talk.tongue.answer(servo, 0.9 * place))
        talk.rest(0.5)
        return True

    told = robot(protocol, 12, instead=twice).diagnosed()
    assert "unasked-now-and-then" not in codes(told)
    assert verdicts(told.incidents())[:1] == [("duplicate-id", (2,))]


def without_blocks(*, never: bool) -> Conversation:
    """Return a loop whose writes state no block, always or each second time."""

    def writes(talk: Conversation, cycle: int) -> None:
        for servo in (1, 2, 3):
            whole = rs30x.write(servo, 0x1E, (cycle % 200 + 30).to_bytes(2, "little"))
            talk.rest(1)
            talk.say(whole if not never and cycle % 2 else whole[:6] + b"\x00" + whole[7:])
            talk.rest(1)

    return robot("rs30x", 8, goals=False, before=writes)


def test_a_kind_of_command_that_is_never_whole_was_sent_so() -> None:
    told = without_blocks(never=True).diagnosed()
    assert verdicts(told.incidents())[0] == ("malformed-command", ())
    assert "kind-never-whole" not in codes(without_blocks(never=False).diagnosed())
