"""What the tap does to a capture is told as the tap's doing, once, and nobody else is accused."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest

from sniffer.ground.model import Chunk, Clock, Direction, Mark, MarkKind, Severity
from sniffer.simulation import Fault, simulate
from tests.conversations import (
    MS,
    TONGUES,
    Conversation,
    one_wire,
    robot,
    through_usb,
    without_clock,
)
from tests.diagnosed import alarms, chunks_of, codes, diagnosed, found, verdicts
from tests.lists import each_in_turn

PROTOCOLS = tuple(TONGUES)
ADDRESSED = tuple(name for name in PROTOCOLS if name != "wck")
"""Protocols whose answers are something without their requests."""


def only(talk: Conversation, side: Direction) -> list[Chunk]:
    heard = [chunk for chunk in talk.chunks if chunk.direction == side]
    return [replace(chunk, direction=Direction.UNKNOWN) for chunk in heard]


def holes(chunks: list[Chunk], *, told: bool = False, seed: int = 7) -> list[Chunk]:
    """Lose a few dozen bytes every so often, wherever they stand."""
    rng = random.Random(seed)
    out: list[Chunk] = []
    until, gone = rng.randint(300, 700), 0
    for chunk in chunks:
        kept = bytearray()
        for value in chunk.data:
            if gone:
                gone -= 1
                continue
            kept.append(value)
            until -= 1
            if not until:
                until, gone = rng.randint(300, 700), rng.randint(8, 40)
        if kept:
            out.append(replace(chunk, data=bytes(kept)))
        if told and gone and len(kept) < len(chunk.data):
            out.append(Chunk(b"", chunk.t_ns, Clock.SAMPLE, marks=(Mark(MarkKind.OVERRUN, 0),)))
    return out


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        (MarkKind.LOST, "Plug it in again: the recording goes on by itself"),
        (MarkKind.OVERRUN, "Do not blame the servos for what is missing here."),
    ],
)
def test_what_the_tap_told_itself_says_what_to_do_about_it(kind: MarkKind, told: str) -> None:
    talk = robot("mightyzap", 4)
    chunks = [replace(chunk, direction=Direction.UNKNOWN) for chunk in talk.chunks]
    chunks[900:1100] = [Chunk(b"", chunks[900].t_ns, Clock.SAMPLE, marks=(Mark(kind, 0),))]
    (incident,) = (i for i in talk.diagnosed(chunks).incidents() if i.cause == "tap-loss")
    assert incident.next.startswith(told)


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_tap_on_the_controllers_wire_is_one_note(protocol: str) -> None:
    talk = robot(protocol, 4)
    (incident,) = talk.diagnosed(only(talk, Direction.TX)).incidents()
    assert (incident.cause, incident.severity) == ("tap-one-way", Severity.NOTE)
    assert "goes-on-unanswered" in {finding.code for finding in incident.findings} or (
        protocol in ("lss", "rs30x")  # their manuals leave a servo more time than it takes
    )


@pytest.mark.parametrize("protocol", ADDRESSED)
def test_a_tap_on_the_servos_wire_is_one_note(protocol: str) -> None:
    talk = robot(protocol, 4)
    (incident,) = talk.diagnosed(only(talk, Direction.RX)).incidents()
    assert (incident.cause, incident.severity) == ("tap-one-way", Severity.NOTE)


def test_answers_of_a_byte_on_the_servos_wire_are_no_strays_at_a_turn() -> None:
    def acknowledged(talk: Conversation, cycle: int) -> None:
        talk.rest(0.3 if cycle else 0)
        talk.say(b"\x07", Direction.RX)
        talk.rest(0.3)

    talk = robot("rs30x", 4, behind=acknowledged)
    (incident,) = talk.diagnosed(only(talk, Direction.RX)).incidents()
    assert (incident.cause, incident.severity) == ("tap-one-way", Severity.NOTE)


@each_in_turn(4, "protocol", PROTOCOLS)
def test_a_controller_that_breaks_requests_off_is_no_tap_that_loses_bytes(protocol: str) -> None:
    def breaks_off(talk: Conversation, cycle: int) -> None:
        if cycle % 40 == 20:
            talk.say(talk.tongue.ask(2)[:-1], Direction.TX)
            talk.rest(600)

    talk = robot(protocol, 6, before=breaks_off)
    told = talk.diagnosed(one_wire(talk))
    assert not codes(told) & {"requests-torn-short", "headless-frames", "answered-though-torn"}
    assert "tap-loss" not in alarms(told)


def test_a_controller_that_waits_in_vain_hears_no_answer_either() -> None:
    def in_vain(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.ask_in_vain(servo, 25)
        return True

    told = codes(robot("mightyzap", 8, instead=in_vain, rate_hz=10).diagnosed())
    assert {"nobody-answers", "waits-in-vain"} <= told
    assert "goes-on-unanswered" not in told


def test_who_asks_once_a_cycle_waits_as_long_whether_he_is_answered_or_not() -> None:
    def once(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.ask_in_vain(servo, 25)
        return True

    def again(talk: Conversation, cycle: int, servo: int) -> bool:
        talk.ask_in_vain(servo, 25)
        return once(talk, cycle, servo)

    sure = {}
    for wait in (once, again):
        talk = robot("mightyzap", 8, instead=wait, rate_hz=6, goals=False)
        (incident,) = talk.diagnosed().incidents()
        sure[wait] = {one.cause: one.confidence for one in incident.causes}
    assert sure[again]["wrong-baud"] > 0.7 > sure[once]["wrong-baud"]
    assert sure[once]["tap-one-way"] > 0.2 > sure[again]["tap-one-way"]


def test_a_scan_that_finds_servos_late_is_not_heard_one_way() -> None:
    talk = Conversation("mightyzap")
    for servo in range(10, 40):
        talk.ask_in_vain(servo, 8)
    for n in range(200):
        talk.read(1, n / 400)
        talk.rest(10)
    assert not talk.diagnosed().incidents()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_swapped_wires_are_one_finding_and_one_incident(protocol: str) -> None:
    talk = robot(protocol, 3)
    other = {Direction.TX: Direction.RX, Direction.RX: Direction.TX}
    swapped = [replace(chunk, direction=other[chunk.direction]) for chunk in talk.chunks]
    diagnosis = talk.diagnosed(swapped)
    assert verdicts(diagnosis.incidents()) == [("tap-swapped", ())]
    assert [f.code for f in found(diagnosis)].count("wires-swapped") == 1


def test_wires_as_they_should_be_are_not_swapped() -> None:
    assert not robot("rs30x", 3).diagnosed().incidents()


@each_in_turn(3, "protocol", ["mightyzap", "rs30x", "lss"])
def test_bytes_that_the_driver_says_it_lost_are_the_taps(protocol: str) -> None:
    talk = robot(protocol, 8)
    (incident,) = talk.diagnosed(holes(one_wire(talk), told=True)).incidents()
    assert (incident.cause, incident.servo_ids) == ("tap-loss", ())


@each_in_turn(4, "protocol", PROTOCOLS)
def test_bytes_that_are_missing_without_a_word_are_the_taps_too(protocol: str) -> None:
    talk = robot(protocol, 12)
    told = talk.diagnosed(holes(one_wire(talk)))
    assert alarms(told) == ["tap-loss"], [f.what for f in found(told)]


def test_missing_bytes_are_told_without_a_clock() -> None:
    talk = robot("mightyzap", 12)
    told = talk.diagnosed(without_clock(holes(one_wire(talk))))
    assert alarms(told) == ["tap-loss"]


def test_altered_bytes_are_not_lost_by_the_tap() -> None:
    talk = robot("mightyzap", 12)
    rng = random.Random(2)
    heard = []
    for chunk in one_wire(talk):
        if rng.random() < 0.02:
            torn = bytearray(chunk.data)
            torn[rng.randrange(len(torn))] ^= 1 << rng.randrange(8)
            chunk = replace(chunk, data=bytes(torn))
        heard.append(chunk)
    assert "tap-loss" not in alarms(talk.diagnosed(heard))


def test_a_clock_that_is_set_back_is_a_finding_and_no_incident() -> None:
    talk = robot("mightyzap", 4)
    middle = len(talk.chunks) // 2
    stepped = [
        replace(c, clock=Clock.FILE, t_ns=(c.t_ns or 0) - 3_000 * MS * (k > middle))
        for k, c in enumerate(one_wire(talk))
    ]
    told = talk.diagnosed(stepped)
    assert "clock-stepped" in codes(told)
    assert not told.incidents()


def test_a_recorder_that_reads_late_is_a_finding_and_no_incident() -> None:
    talk = robot("mightyzap", 4)
    late = Mark(MarkKind.HELD, 0, 1, 80 * MS)
    heard = [
        replace(c, clock=Clock.READ, marks=(late,) if k == 200 else ())
        for k, c in enumerate(one_wire(talk))
    ]
    told = talk.diagnosed(heard)
    assert "tap-was-late" in codes(told)
    assert not told.incidents()


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_host_of_16_ms_is_a_finding_and_no_incident(protocol: str) -> None:
    talk = robot(protocol, 6)
    told = talk.diagnosed(through_usb(one_wire(talk)))
    assert "coarse-stamps" in codes(told)
    assert not told.incidents(), [f.what for f in found(told)]


def few_holes(cycles: tuple[int, ...], *, altered: bool = False) -> Conversation:
    """Lose an answer and the beginning of the request behind it, in some cycles; or alter those."""

    def instead(talk: Conversation, cycle: int, servo: int) -> bool:
        if cycle not in cycles or servo == 3:
            return False
        answer, asked = talk.tongue.answer(servo, 0.5), talk.tongue.ask(servo + 1)
        if servo == 2:  # its request is what is left of the one behind the hole
            talk.say(asked[:2] + b"\x55" + asked[3:] if altered else talk.tongue.ask(servo)[2:])
        else:
            talk.say(talk.tongue.ask(servo))
            talk.rest(0.3 + len(answer) * talk.byte_ns / MS)
            if altered:
                talk.say(b"\x55" + answer[1:])
            return True
        talk.rest(0.3)
        talk.say(answer)
        talk.rest(0.4)
        return True

    return robot("rs30x", 20, instead=instead, goals=False)


def test_an_answer_that_is_missing_up_to_within_the_next_request_is_lost_by_the_tap() -> None:
    """Two such holes in ten thousand frames: the servo asked next answers, so it was asked."""
    talk = few_holes((200, 500))
    for chunks in (talk.chunks, through_usb(talk.chunks), without_clock(talk.chunks)):
        told = talk.diagnosed(chunks)
        assert "answered-though-torn" in codes(told)
        assert verdicts(told.incidents()) == [("tap-loss", ())]


def test_answers_and_requests_that_are_altered_are_not_lost_by_the_tap() -> None:
    assert "answered-though-torn" not in codes(few_holes((200, 500), altered=True).diagnosed())


def test_without_times_a_request_behind_an_answer_is_no_sure_loss_of_the_tap() -> None:
    # two bare bytes of an answer over the beginning of the next request leave what a hole leaves
    frames = simulate("wck", seed=1, faults=[Fault("impatient", 0.02)], duration_s=12.0)
    d = diagnosed(without_clock(chunks_of(frames)), "wck")
    (told,) = (f for f in found(d) if f.code == "pieces-complete")
    assert told.strength < 1
    assert "request-swallowed" in codes(d)


def parcels_lost(talk: Conversation, size: int, lost: range) -> list[Chunk]:
    """Return what is left where an adapter's parcels of so many bytes are lost whole; no times."""
    data = b"".join(chunk.data for chunk in talk.chunks)
    parcels = [data[k : k + size] for k in range(0, len(data), size)]
    left = (parcel for k, parcel in enumerate(parcels) if k not in lost)
    return [Chunk(b"".join(left), 0, Clock.NONE)]


@each_in_turn(2, "protocol", ["mightyzap", "rs30x"])
def test_a_parcel_that_is_lost_with_a_request_and_a_part_of_its_answer_is_the_taps(
    protocol: str,
) -> None:
    talk = robot(protocol, 4)
    for first in (60, 71):
        diagnosis = talk.diagnosed(parcels_lost(talk, 62, range(first, 260, 15)))
        assert [one.cause for one in diagnosis.incidents()] == ["tap-loss"]


def without_some(talk: Conversation, most: int) -> list[Chunk]:
    """Return a conversation without times that lacks up to so many bytes in a row, 25 times."""
    data, rng = bytearray(b"".join(chunk.data for chunk in talk.chunks)), random.Random(3)
    for _ in range(25):
        at = rng.randrange(len(data) - 10)
        del data[at : at + rng.randint(1, most)]
    return [Chunk(bytes(data), 0, Clock.NONE)]


def test_bytes_that_are_missing_from_bare_answers_and_their_requests_are_the_taps() -> None:
    talk = robot("wck", 6, goals=False)
    diagnosis = talk.diagnosed(without_some(talk, 2))
    assert "order-lacks-bytes" in codes(diagnosis)
    assert verdicts(diagnosis.incidents()) == [("tap-loss", ())]


def test_requests_whose_last_byte_is_altered_are_not_lost_by_the_tap() -> None:
    rng, talk, heard, is_hit = random.Random(5), robot("wck", 6), [], False
    for chunk in one_wire(talk):
        if is_hit:  # nobody answers what was torn
            is_hit = False
            continue
        is_hit = len(chunk.data) == 4 and rng.random() < 0.05
        last = bytes((chunk.data[-1] ^ 8,)) if is_hit else chunk.data[-1:]
        heard.append(replace(chunk, data=chunk.data[:-1] + last))
    assert "order-lacks-bytes" not in codes(talk.diagnosed(heard))


def test_two_torn_requests_in_a_row_are_no_hole() -> None:
    """Each is shorter than both, which are missing from the order there."""
    rng, talk, heard, is_hit = random.Random(5), robot("rs30x", 6, goals=False), [], False
    requests = {chunk.data for n, chunk in enumerate(one_wire(talk)) if not n % 2}
    for chunk in one_wire(talk):
        if chunk.data in requests:
            is_hit = rng.random() < 0.25
            last = bytes((chunk.data[-1] ^ 8,)) if is_hit else chunk.data[-1:]
            heard.append(replace(chunk, data=chunk.data[:-1] + last))
        elif not is_hit:  # nobody answers what was torn
            heard.append(chunk)
    assert "order-lacks-bytes" not in codes(talk.diagnosed(heard))
