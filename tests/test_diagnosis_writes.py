"""What a controller writes, where, and how often."""

from __future__ import annotations

import pytest

from sniffer.ground.model import Chunk, Clock
from tests import dynamixel
from tests.conversations import (
    TONGUES,
    Conversation,
    robot,
)
from tests.diagnosed import codes, diagnosed, found, verdicts
from tests.lists import each_in_turn
from tests.streams import mightyzap, rs30x, wck

PROTOCOLS = tuple(TONGUES)


# ----------------------------------------------------------------------------------- what it writes

WRITE = {
    "mightyzap": lambda servo, address, data: mightyzap.packet(
        servo, 0xF3, bytes([address]) + data
    ),
    "rs30x": rs30x.write,
}


def writing(protocol: str, servo: int, address: int, data: bytes, every: int = 5) -> Conversation:
    def also(talk: Conversation, cycle: int) -> None:
        if cycle % every == 0:
            talk.write(WRITE[protocol](servo, address, data))

    return robot(protocol, 6, behind=also)


@pytest.mark.parametrize(("protocol", "address"), [("mightyzap", 0x8C), ("rs30x", 0x2A)])
def test_a_write_to_what_is_measured_is_to_what_is_read_only(protocol: str, address: int) -> None:
    told = writing(protocol, 2, address, b"\x10\x01").diagnosed()
    assert "writes-read-only" in codes(told)
    assert verdicts(told.incidents()) == [("read-only-write", (2,))]


@pytest.mark.parametrize(("protocol", "address"), [("mightyzap", 0x6A), ("rs30x", 0x38)])
def test_a_write_where_the_map_has_nothing_is_told(protocol: str, address: int) -> None:
    told = writing(protocol, 2, address, b"\x10\x01").diagnosed()
    assert "writes-unnamed" in codes(told)
    assert verdicts(told.incidents()) == [("read-only-write", (2,))]


def test_a_write_that_the_servo_acknowledges_is_of_another_model_not_of_nothing() -> None:
    def also(talk: Conversation, cycle: int) -> None:
        talk.say(mightyzap.packet(2, 0xF3, b"\x6a\x10"))
        talk.rest(0.3)
        talk.say(mightyzap.packet(2, 0))
        talk.rest(0.4)

    told = robot("mightyzap", 4, behind=also, goals=False).diagnosed()
    assert "writes-unnamed" not in codes(told)


@pytest.mark.parametrize(("protocol", "address"), [("mightyzap", 0x86), ("rs30x", 0x1E)])
def test_a_goal_of_one_byte_is_half_a_register(protocol: str, address: int) -> None:
    told = writing(protocol, 2, address, b"\x10").diagnosed()
    assert "writes-part" in codes(told)
    assert verdicts(told.incidents()) == [("partial-write", (2,))]


@each_in_turn(4, "protocol", PROTOCOLS)
def test_whole_writes_of_what_may_be_written_are_sound(protocol: str) -> None:
    assert not robot(protocol, 6).diagnosed().incidents()


KEEPING = {
    "mightyzap": lambda n: mightyzap.packet(2, 0xF3, bytes([0x27, n % 200])),
    "lss": lambda n: b"#2CLED%d\r" % (n % 8),
    "rs30x": lambda n: rs30x.packet(2, 0x40, 0xFF),
    "wck": lambda n: wck.command(7 << 5 | 2, 0x0D, bytes([n % 30, 50])),
}
"""What is kept without power: a gain, a colour, the command that keeps all, a speed."""


def keeping(protocol: str, cycles: range) -> Conversation:
    def also(talk: Conversation, cycle: int) -> None:
        if cycle in cycles:
            talk.write(KEEPING[protocol](cycle))
            if protocol == "wck":
                talk.say(bytes([cycle % 30, 50]))
                talk.rest(0.4)

    return robot(protocol, 8, behind=also)


@each_in_turn(4, "protocol", KEEPING)
def test_memory_that_is_written_in_the_loop_wears_out(protocol: str) -> None:
    diagnosis = keeping(protocol, range(0, 10_000, 4)).diagnosed()
    assert verdicts(diagnosis.incidents()) == [("nv-wear", (2,))]
    (wear,) = [f for f in found(diagnosis) if f.code == "memory-written-often"]
    assert wear.value("writes") == 80
    assert "hours at this pace" in wear.what


def tuned(*cycles: int, values: tuple[int, ...] = (20,)) -> Conversation:
    """Let a wCK be told its gains in some cycles, these values in turn."""

    def also(talk: Conversation, cycle: int) -> None:
        if cycle in cycles:
            gains = bytes([values[cycles.index(cycle) % len(values)], 30])
            talk.write(wck.command(7 << 5 | 2, 0x09, gains))
            talk.say(gains)
            talk.rest(0.4)

    return robot("wck", 8, behind=also)


def test_four_writes_of_one_value_by_the_clock_are_those_of_a_loop() -> None:
    assert verdicts(tuned(20, 100, 180, 260).diagnosed().incidents()) == [("nv-wear", (2,))]


def test_four_writes_by_hand_or_of_several_values_are_tuning() -> None:
    assert not tuned(20, 100, 150, 260).diagnosed().incidents()
    assert not tuned(20, 100, 180, 260, values=(20, 22)).diagnosed().incidents()


@each_in_turn(4, "protocol", KEEPING)
def test_memory_that_is_set_up_once_does_not(protocol: str) -> None:
    assert not keeping(protocol, range(2)).diagnosed().incidents()


def test_settings_that_stay_in_ram_until_they_are_kept_wear_nothing() -> None:
    talk = writing("rs30x", 2, 0x18, b"\x02", every=2)
    assert "memory-written-often" not in codes(talk.diagnosed())


# ------------------------------------------------------------------------------- where it sends it


def too_far(talk: Conversation, cycle: int) -> None:
    if 100 <= cycle < 140:
        request = {
            "mightyzap": mightyzap.packet(2, 0xF3, b"\x86\x88\x13"),
            "rs30x": rs30x.write(2, 0x1E, (1700).to_bytes(2, "little")),
            "lss": b"#2P2900\r",
        }[talk.protocol]
        talk.write(request)


@each_in_turn(3, "protocol", ["mightyzap", "rs30x", "lss"])
def test_goals_beyond_the_manuals_range_are_out_of_range(protocol: str) -> None:
    told = robot(protocol, 6, behind=too_far).diagnosed()
    assert "goal-beyond-range" in codes(told)
    assert verdicts(told.incidents()) == [("goal-out-of-range", (2,))]


def test_goals_are_not_counted_by_other_numbers_that_are_out_of_range_as_well() -> None:
    def too_fast(talk: Conversation, cycle: int) -> None:
        too_far(talk, cycle)
        if cycle % 10 == 0:
            talk.write(mightyzap.packet(2, 0xF3, b"\x88" + (2000).to_bytes(2, "little")))

    (goals,) = (
        f
        for f in found(robot("mightyzap", 6, behind=too_fast).diagnosed())
        if f.code == "goal-beyond-range"
    )
    assert goals.what.startswith("goals of servo 2 are out of range")
    (goals,) = (
        f
        for f in found(robot("mightyzap", 6, behind=too_far).diagnosed())
        if f.code == "goal-beyond-range"
    )
    assert goals.what.startswith("40 goals of servo 2 are out of range")


def limited(protocol: str, low: int, high: int) -> Conversation:
    """Read the limits of servo 2, then move it."""

    def read_limits(talk: Conversation, cycle: int) -> None:
        if cycle:
            return
        if protocol == "mightyzap":
            talk.say(mightyzap.packet(2, 0xF2, b"\x06\x04"))
            talk.rest(0.3)
            limits = low.to_bytes(2, "little") + high.to_bytes(2, "little")
            talk.say(mightyzap.packet(2, 0, limits))
        else:
            talk.say(wck.command(7 << 5 | 2, 0x12, b"\0\0"))
            talk.rest(0.3)
            talk.say(bytes([low, high]))
        talk.rest(5)

    return robot(protocol, 8, before=read_limits)


@pytest.mark.parametrize(("protocol", "low", "high"), [("mightyzap", 400, 3000), ("wck", 30, 180)])
def test_goals_beyond_limits_that_the_servo_told_are_out_of_range(
    protocol: str, low: int, high: int
) -> None:
    told = limited(protocol, low, high).diagnosed()
    assert "goal-beyond-limits" in codes(told)
    assert verdicts(told.incidents()) == [("goal-out-of-range", (2,))]


@pytest.mark.parametrize(("protocol", "low", "high"), [("mightyzap", 0, 4095), ("wck", 0, 254)])
def test_goals_within_the_limits_are_sound(protocol: str, low: int, high: int) -> None:
    assert not limited(protocol, low, high).diagnosed().incidents()


@pytest.mark.parametrize(("goal", "beyond"), [(1000, False), (3500, True)])
def test_limits_of_a_protocol_that_is_plugged_in_are_those_its_table_names(
    goal: int, beyond: bool
) -> None:
    read, limits = (
        dynamixel.packet(2, dynamixel.READ, b"\x06\x04"),
        (0).to_bytes(2, "little") + b"\xb8\x0b",
    )
    goals = [
        (
            dynamixel.packet(2, dynamixel.WRITE, b"\x1e" + goal.to_bytes(2, "little")),
            dynamixel.packet(2, 0),
        )
        for _ in range(20)
    ]
    chunks = [
        Chunk(half, (10 * n + k) * 1_000_000, Clock.SAMPLE)
        for n, exchange in enumerate([(read, dynamixel.packet(2, 0, limits)), *goals], 1)
        for k, half in enumerate(exchange)
    ]
    told = found(diagnosed(chunks, dynamixel.Dynamixel1(), baud=115200))
    assert [f.what for f in told if f.code == "goal-beyond-limits"] == (
        ["servo 2 is sent to 307.6 deg, and its limits are 0 deg and 263.7 deg"] if beyond else []
    )


@pytest.mark.parametrize(("is_late", "told"), [(True, False), (False, True)])
def test_what_was_asked_for_before_a_write_tells_nothing_of_it(
    *, is_late: bool, told: bool
) -> None:
    """Who does not wait for the answer switches torque on meanwhile: it was off till then."""
    talk = Conversation("mightyzap")
    ask, on = (mightyzap.packet(1, code, b"\x80\x01") for code in (0xF2, 0xF3))
    off, done = mightyzap.packet(1, 0, b"\0"), mightyzap.packet(1, 0)
    for _ in range(2):
        for frame in (ask, on, off, done) if is_late else (on, done, ask, off):
            talk.say(frame)
            talk.rest(3)
        for _ in range(5):
            talk.read(1, 0.5)
            talk.rest(20)
    assert ("torque-gone" in codes(talk.diagnosed())) == told
