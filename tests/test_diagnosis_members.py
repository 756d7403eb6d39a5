"""Diagnoses of the example protocols: rules find what registers and errors mean in their tables."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.anomalies.device import device_code
from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.testing import Exchange, checks
from tests.diagnosed import codes, diagnosed, verdicts
from tests.members import protocol
from tests.servos import BEGAN_NS
from tests.streams.members import ALL, joint, number, packet, status

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from sniffer.diagnosis import Diagnosis
    from sniffer.ground.model import Anomaly

PING, READ, WRITE = 1, 2, 3

GOAL: Final = {"dynamixel1": 30, "dynamixel2": 116, "feetech": 42}
PRESENT: Final = {"dynamixel1": 36, "dynamixel2": 132, "feetech": 56}
TORQUE: Final = {"dynamixel1": 24, "dynamixel2": 64, "feetech": 40}
WIDE: Final = {"dynamixel1": 2, "dynamixel2": 4, "feetech": 2}
NAMES: Final = tuple(GOAL)

Said = list[tuple[float, bytes]]


def heard(name: str, said: Iterable[tuple[float, bytes]]) -> Diagnosis:
    """Return the diagnosis of packets that end at seconds, on a line of a million baud."""
    chunks = [Chunk(raw, BEGAN_NS + round(t * NS), Clock.SAMPLE) for t, raw in said]
    return diagnosed(chunks, protocol(name), baud=1_000_000)


def anomalies(name: str, *said: bytes) -> list[Anomaly]:
    decoder = Decoder(protocol(name))
    return [*decoder.feed(Chunk(b"".join(said))).anomalies, *decoder.close().anomalies]


def ask(name: str, who: int, address: int, count: int) -> bytes:
    return packet(name, who, READ, number(name, address) + number(name, count))


def tell(name: str, who: int, address: int, data: bytes) -> bytes:
    return packet(name, who, WRITE, number(name, address) + data)


def exchange(t: float, request: bytes, answer: bytes | None) -> Said:
    return [(t, request)] + ([] if answer is None else [(t + 0.0005, answer)])


def polled(
    name: str, ids: Iterable[int], seconds: float, answers: Callable[[int, float], bytes | None]
) -> Said:
    """Return a loop that gives each servo a goal and reads where it is, twenty times a second."""
    said: Said = []
    for k in range(round(seconds * 20)):
        t = k / 20
        for i, who in enumerate(ids):
            swing = round(2048 + 500 * math.sin(t + i)).to_bytes(WIDE[name], "little")
            goal = tell(name, who, GOAL[name], swing)
            at = t + 0.008 * i
            is_there = answers(who, t) is not None
            said += exchange(at, goal, status(name, who, 0) if is_there else None)
            place = ask(name, who, PRESENT[name], WIDE[name])
            said += exchange(at + 0.002, place, answers(who, t))
    return said


def follows(name: str, who: int, t: float) -> bytes:
    place = round(2048 + 500 * math.sin(t - 0.05 + who - 1)).to_bytes(WIDE[name], "little")
    return status(name, who, 0, place)


def test_an_error_that_is_a_number_is_told_by_its_name_each_time_it_refuses() -> None:
    refused = [tell("dynamixel2", 1, 9, b"\0"), status("dynamixel2", 1, 7)]
    told = [(a.code, a.detail) for a in anomalies("dynamixel2", *refused, *refused)]
    assert (
        told
        == [
            ("device-packet-not-processable", "servo 1 reports access (status 07)"),
        ]
        * 2
    )


def test_a_bit_beside_an_error_that_is_a_number_is_a_state() -> None:
    read = ask("dynamixel2", 1, 132, 4)
    said = [read, status("dynamixel2", 1, 0x80, bytes(4))] * 3
    assert [a.code for a in anomalies("dynamixel2", *said)] == ["device-alarm"]


def test_a_register_of_flags_raises_an_alarm_and_ends_it() -> None:
    read = ask("dynamixel2", 1, 70, 1)
    said = [
        part
        for raw in (0, 0x24, 0x24, 0)
        for part in (read, status("dynamixel2", 1, 0, bytes([raw])))
    ]
    told = sorted(a.code for a in anomalies("dynamixel2", *said))
    assert told == ["device-overheating", "device-overload", "device-recovered", "device-recovered"]


def test_a_manuals_own_name_of_a_fault_is_the_alarm_that_it_means() -> None:
    read = ask("feetech", 1, 56, 2)
    said = anomalies("feetech", read, status("feetech", 1, 1, b"\0\x08"))
    assert [(a.code, a.detail) for a in said] == [
        ("device-input-voltage", "servo 1 reports voltage (status 01)")
    ]


@pytest.mark.parametrize("name", ALL)
def test_what_names_mean_stands_in_the_catalogue(name: str) -> None:
    meant = getattr(protocol(name), "reports", {})
    assert all(f"device-{one.replace('_', '-')}" in CATALOGUE for one in meant.values())
    known = {n for bit in range(15) for n in protocol(name).status_names(1 << bit)}
    known |= {n for code in range(128) for n in protocol(name).status_names(code)}
    known |= {n for r in protocol(name).registers for n in (*r.values.values(), *r.bits.values())}
    assert meant.keys() <= known
    assert all(device_code(one) != "device-alarm" for one in meant.values())


@pytest.mark.parametrize("name", ["dynamixel1", "feetech"])
def test_a_tap_that_hears_requests_only_hears_no_answers_in_them(name: str) -> None:
    said: Said = []
    for who in (1, 2, 3):
        for k, (at, n) in enumerate(((3, 2), (9, 2), (5, 1))):
            said.append((who + k * 0.003, ask(name, who, at, n)))
        said.append((who + 0.01, packet(name, who, PING)))
        for k, switch in enumerate((b"\0", b"\1")):  # on stands where the answer to off would
            said.append((who + 0.02 + k * 0.003, tell(name, who, TORQUE[name], switch)))
    loop = polled(name, (1, 2, 3), 8, lambda who, t: None)
    d = heard(name, [*said, *((t + 5, raw) for t, raw in loop)])
    assert verdicts(d.incidents()) == [("tap-one-way", ())]


@pytest.mark.parametrize("name", NAMES)
def test_who_never_answers_is_absent_whatever_is_asked_in_turn(name: str) -> None:
    setup = [(k * 0.1, tell(name, 2, TORQUE[name], b"\1")) for k in range(3)]
    said = polled(name, (1, 2), 8, lambda who, t: None if who == 2 else follows(name, 1, t))
    d = heard(name, [*setup, *((t + 1, raw) for t, raw in said)])
    assert verdicts(d.incidents()) == [("servo-absent", (2,))]


def test_what_is_written_to_nobody_wears_no_memory() -> None:
    name = "feetech"
    said = polled(name, (1, 2), 8, lambda who, t: None if who == 2 else follows(name, 1, t))
    said += [(0.04 + k / 5, tell(name, 2, 7, b"\0")) for k in range(30)]
    assert "memory-written-often" not in codes(heard(name, sorted(said)))


def test_a_load_in_per_cent_pushes_as_one_in_steps_does() -> None:
    name = "feetech"

    def state(who: int, place: int, load: int) -> bytes:
        return status(
            name, who, 0, place.to_bytes(2, "little") + b"\0\0" + load.to_bytes(2, "little")
        )

    said: Said = []
    for k in range(240):
        t = k / 20
        for who in (1, 2):
            goal = round(2048 + 500 * math.sin(t + who - 1))
            raw = goal.to_bytes(2, "little")
            said += exchange(t + 0.01 * who, tell(name, who, 42, raw), status(name, who, 0))
            blocked = who == 1 and t > 6
            there = 2048 + (0 if blocked else round(500 * math.sin(t - 0.05 + who - 1)))
            answer = state(who, there, 980 if blocked else 120)
            said += exchange(t + 0.01 * who + 0.002, ask(name, who, 56, 6), answer)
    assert verdicts(heard(name, said).incidents()) == [("stall", (1,))]


def test_a_limit_of_temperature_is_found_by_what_it_limits() -> None:
    name = "feetech"
    said: Said = exchange(0.0, ask(name, 1, 13, 1), status(name, 1, 0, b"\x41"))
    for k in range(400):
        t = 1 + k / 10
        hot = min(30 + k // 10, 66)
        said += exchange(t, ask(name, 1, 63, 1), status(name, 1, 0, bytes([hot])))
        said += exchange(t + 0.02, ask(name, 2, 63, 1), status(name, 2, 0, b"\x1e"))
    d = heard(name, said)
    assert verdicts(d.incidents()) == [("overheat", (1,))]
    assert any("its limit is 65" in f.what for i in d.incidents() for f in i.findings)


def test_the_kit_tells_of_a_meaning_that_no_anomaly_has(monkeypatch: pytest.MonkeyPatch) -> None:
    servo = protocol("feetech")
    monkeypatch.setattr(servo, "reports", {"voltage": "supply"})
    talk = [Exchange("ping", packet("feetech", 1, PING), (status("feetech", 1, 0),), {}, ())]
    with pytest.raises(AssertionError, match="there is no anomaly device-supply"):
        next(one for one in checks(servo, talk) if one.name == "talk")()
    monkeypatch.setattr(servo, "reports", {"voltgae": "input_voltage"})
    with pytest.raises(AssertionError, match=r"what voltgae means.*: did you mean voltage\?"):
        next(one for one in checks(servo, talk) if one.name == "talk")()


def test_all_servos_answer_a_ping_to_all_of_them() -> None:
    said = [packet("feetech", 254, PING), *(status("feetech", who, 0) for who in (1, 2, 5))]
    assert anomalies("feetech", *said) == []


def test_a_write_of_half_a_register_is_told_from_when_it_was_said() -> None:
    said: Said = []
    for k in range(40):
        raw = (2000 + k).to_bytes(2, "little")
        goal = raw if k < 20 else raw[:1]
        said += exchange(k / 10, tell("feetech", 1, 42, goal), status("feetech", 1, 0))
    told = [i for i in heard("feetech", said).incidents() if i.cause == "partial-write"]
    assert [round((i.first_ns - BEGAN_NS) / NS, 1) for i in told] == [2.0]


def test_who_refuses_a_write_of_what_is_read_only_has_one_fault() -> None:
    name = "dynamixel2"
    said: Said = []
    for k in range(60):
        write = tell(name, 1, 132, (2000 + k).to_bytes(4, "little"))
        said += exchange(k / 10, write, status(name, 1, 7))
        said += exchange(k / 10 + 0.01, ask(name, 1, 132, 4), status(name, 1, 0, b"\0\x08\0\0"))
    assert verdicts(heard(name, said).incidents()) == [("read-only-write", (1,))]


def test_who_refuses_goals_beyond_its_limits_is_sent_too_far() -> None:
    name = "dynamixel2"
    said: Said = []
    for k in range(60):
        write = tell(name, 1, 116, (4000 + 5 * k).to_bytes(4, "little"))
        said += exchange(k / 10, write, status(name, 1, 6 if k > 19 else 0))
        said += exchange(k / 10 + 0.01, ask(name, 1, 132, 4), status(name, 1, 0, b"\0\x08\0\0"))
    assert "goal-out-of-range" in [i.cause for i in heard(name, said).incidents()]
    assert "servo-refuses" not in [i.cause for i in heard(name, said).incidents()]


LISTED: Final = (1, 2, 3, 4)

LISTS: Final = {
    "dynamixel1": packet(
        "dynamixel1", 254, 0x92, b"\0" + bytes(x for s in LISTED for x in (2, s, 36))
    ),
    "dynamixel2": packet(
        "dynamixel2", 254, 0x82, number("dynamixel2", 132) + b"\x04\0" + bytes(LISTED)
    ),
    "feetech": packet("feetech", 254, 0x82, b"\x38\x02" + bytes(LISTED)),
}


def listed(name: str, is_silent: Callable[[int, int], bool]) -> Diagnosis:
    """Return the diagnosis of three hundred reads of four servos at once, fifty a second."""
    said: Said = []
    for k in range(300):
        t = k / 50
        said.append((t, LISTS[name]))
        for i, who in enumerate(LISTED, 1):
            place = (2000 + 10 * who + k % 50).to_bytes(WIDE[name], "little")
            told = status(name, who, 0, place)
            said += [] if is_silent(who, k) else [(t + 0.0006 * i, told)]
    return heard(name, said)


@pytest.mark.parametrize("name", NAMES)
def test_a_read_of_several_servos_that_all_answer_has_nothing_wrong(name: str) -> None:
    assert not listed(name, lambda who, k: False).incidents()


@pytest.mark.parametrize("name", NAMES)
def test_a_servo_that_stops_answering_reads_of_several_is_dead(name: str) -> None:
    told = listed(name, lambda who, k: who == 4 and k > 180).incidents()
    assert verdicts(told) == [("servo-dead", (4,))]


@pytest.mark.parametrize("name", NAMES)
def test_a_servo_that_a_list_names_and_nobody_ever_heard_is_absent(name: str) -> None:
    told = listed(name, lambda who, k: who == 2).incidents()
    assert verdicts(told) == [("servo-absent", (2,))]


@pytest.mark.parametrize("name", NAMES)
def test_a_loop_that_waits_for_a_listed_servo_in_vain_does_not_stall(name: str) -> None:
    said: Said = []
    for k in range(300):
        t = k / 50 + 0.05 * max(k - 295, 0)
        said.append((t, LISTS[name]))
        for i, who in enumerate(LISTED, 1):
            place = (2000 + 10 * who + k % 50).to_bytes(WIDE[name], "little")
            is_there = who < 4 or k < 295
            said += [(t + 0.0006 * i, status(name, who, 0, place))] if is_there else []
    assert "loop-stalls" not in codes(heard(name, said))


def test_a_packet_for_all_that_is_cut_short_blames_nobody_who_is_in_it() -> None:
    ask_all = packet("dynamixel2", 254, 0x8A, number("dynamixel2", 132) + b"\x04\0" + bytes(LISTED))
    said: Said = []
    for k in range(300):
        whole = joint([(who, 0, (2000 + k % 50).to_bytes(4, "little")) for who in LISTED])
        said += [(k / 50, ask_all), (k / 50 + 0.001, whole[:24] if k > 180 else whole)]
    told = heard("dynamixel2", said).incidents()
    assert verdicts(told)[0] == ("servo-dead", (3, 4))
