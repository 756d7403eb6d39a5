"""Each code of the catalogue on a bus that earns it, and silence where nothing is wrong."""

from __future__ import annotations

import pytest

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import Anomaly, Chunk, Clock, Direction, Severity
from sniffer.sources.sides import handed_over
from tests.streams.members import example
from tests.streams.mightyzap import packet

MS = 1_000_000
T0 = 1_700_000_000_000_000_000
READ = packet(1, 0xF2, bytes([0x8C, 2]))
REPLY = packet(1, 0, b"\xff\x07")


def anomalies(*chunks: Chunk, protocol: str = "mightyzap") -> list[Anomaly]:
    decoder = Decoder(protocol)
    return [a for b in (decoder.feed(*chunks), decoder.close()) for a in b.anomalies]


def codes(*data: bytes, protocol: str = "mightyzap") -> list[str]:
    return [a.code for a in anomalies(Chunk(b"".join(data)), protocol=protocol)]


def at(ms: float, data: bytes, direction: Direction = Direction.UNKNOWN) -> Chunk:
    return Chunk(data, T0 + int(ms * MS), Clock.FILE, direction=direction)


def test_an_answered_read_is_no_anomaly() -> None:
    assert codes(READ, REPLY) == []


def test_a_bad_checksum_is_told_with_both_sums_and_its_bytes() -> None:
    found = anomalies(Chunk(READ + REPLY + bytes.fromhex("FFFFFF010200FD") + READ + REPLY))
    assert [a.code for a in found] == ["bad-checksum"]
    assert "FC" in found[0].detail
    assert "FD" in found[0].detail
    assert found[0].evidence == ((18, 7),)
    assert found[0].servo_id == 1
    assert found[0].severity is Severity.ERROR


def test_a_read_without_answer_names_the_servo() -> None:
    found = anomalies(Chunk(READ + packet(2, 0xF1) + packet(2, 0) + READ + REPLY))
    assert [(a.code, a.servo_id) for a in found] == [("no-response", 1)]


def test_torn_bytes_behind_a_request_are_a_damaged_answer_not_a_silent_servo() -> None:
    assert "damaged-response" in codes(READ, REPLY[:6], READ, REPLY)
    assert "no-response" not in codes(READ, REPLY[:6], READ, REPLY)


def test_a_frame_is_truncated_by_the_next_one_an_idle_tail_by_silence_and_cut_by_the_end() -> None:
    assert "truncated-frame" in codes(READ, REPLY, REPLY[:7], READ, REPLY)
    silence = anomalies(at(0, READ), at(3, REPLY), at(9, READ[:7]), at(300, READ), at(303, REPLY))
    assert [a.code for a in silence] == ["idle-tail"]
    assert codes(READ, REPLY, READ[:7]) == ["capture-end"]


def test_bytes_before_the_first_frame_are_the_start_of_the_capture_and_later_ones_noise() -> None:
    assert codes(b"\x12\x34", READ, REPLY) == ["capture-start"]
    assert codes(READ, REPLY, b"\x12\x34", READ, REPLY) == ["noise"]


def test_an_impossible_size_is_a_damaged_frame() -> None:
    assert "damaged-frame" in codes(READ, REPLY, b"\xff\xff\xff\x01\x01\xf2", READ, REPLY)


def test_an_answer_beyond_the_window_is_late_by_the_clock() -> None:
    found = anomalies(at(0, READ), at(60, REPLY), at(61, READ), at(63, REPLY))
    assert [a.code for a in found] == ["late-response"]
    assert "58." in found[0].detail  # 60 ms less the reply's own wire time


def test_who_answers_late_is_named_also_where_all_were_asked() -> None:
    (found,) = anomalies(at(0, packet(0, 0xF1)), at(67, packet(3, 0)))
    assert (found.code, found.servo_id) == ("late-response", 3)
    assert found.detail.startswith("servo 3 answered echo after ")


def test_an_id_that_is_given_to_all_is_not_given_to_a_servo() -> None:
    (found,) = anomalies(Chunk(packet(254, 0xF3, b"\x03\x07")))
    assert (found.code, found.detail) == ("id-changed", "all servos (254) were given the id 7")


def test_an_answer_that_could_be_a_command_is_no_odd_one_but_says_nothing() -> None:
    read, says = bytes.fromhex("FFFF0104022402D2"), bytes.fromhex("FFFF0104022403D1")
    decoder = Decoder(example("dynamixel1").PROTOCOL)
    found = [
        a for b in (decoder.feed(Chunk((read + says) * 2)), decoder.close()) for a in b.anomalies
    ]
    doubted = [a.detail for a in found if a.code == "doubtful-response"]
    assert len(doubted) == 2
    assert doubted[0].startswith("an answer that could be the command read as well: no values")
    assert "unusual-form" not in {a.code for a in found}


def test_an_answer_after_the_silence_is_late_too_and_its_request_unanswered() -> None:
    found = [a.code for a in anomalies(at(0, READ), at(400, REPLY))]
    assert sorted(found) == ["late-response", "no-response"]


def test_an_answer_nobody_asked_for_is_unsolicited() -> None:
    assert codes(READ, REPLY, packet(2, 0xF1), packet(2, 0), packet(3, 0)) == [
        "unsolicited-response"
    ]


def test_two_answers_of_one_id_are_told_as_a_shared_id() -> None:
    assert codes(READ, REPLY, REPLY) == ["duplicate-response"]


def test_an_answer_of_another_servo_or_length_does_not_fit() -> None:
    assert codes(READ, packet(2, 0, b"\xff\x07")) == ["mismatched-response"]
    assert codes(READ, packet(1, 0, b"\xff")) == ["mismatched-response"]


def test_a_body_its_command_cannot_have_is_malformed_and_an_unlisted_command_unknown() -> None:
    assert "malformed-body" in codes(packet(1, 0xF2, b"\x8c"))
    assert "malformed-body" in codes(packet(254, 0x73, bytes.fromhex("860201FF0302FF")))
    assert "unknown-command" in codes(packet(1, 0xF7))


def test_a_goal_outside_the_manual_s_range_is_told_each_time_it_is_written() -> None:
    goal = packet(1, 0xF3, b"\x86\x00\x20")
    assert codes(goal, goal) == ["value-out-of-range"] * 2


def test_what_a_servo_reports_is_told_when_it_begins_and_when_it_ends() -> None:
    hot = packet(1, 0x24, b"\xff\x07")
    found = codes(READ, REPLY, READ, hot, READ, hot, READ, REPLY)
    assert found == [
        "device-overheating",
        "device-overload",
        "device-recovered",
        "device-recovered",
    ]


def test_a_refused_command_is_told_each_time() -> None:
    no = packet(1, 0x08)
    assert codes(READ, no, READ, no) == ["device-range", "device-range"]


@pytest.mark.parametrize(
    ("bit", "code"),
    [
        (0, "device-input-voltage"),
        (1, "device-stroke-limit"),
        (2, "device-overheating"),
        (3, "device-range"),
        (4, "device-checksum"),
        (5, "device-overload"),
        (6, "device-instruction"),
    ],
)
def test_every_error_bit_has_its_own_code(bit: int, code: str) -> None:
    assert codes(READ, packet(1, 1 << bit)) == [code]


def test_a_new_id_and_a_new_baud_rate_are_noted() -> None:
    assert codes(packet(1, 0xF3, b"\x03\x07"), packet(7, 0)) == ["id-changed"]
    found = anomalies(Chunk(packet(1, 0xF3, b"\x04\x10") + packet(1, 0)))
    assert [a.code for a in found] == ["baud-changed"]
    assert "115200" in found[0].detail


def test_a_request_on_the_servos_wire_is_a_swapped_tap() -> None:
    found = anomalies(at(0, READ, Direction.RX), at(3, REPLY, Direction.TX))
    # the first frame alone could be all that one tap hears
    assert [a.code for a in found] == ["direction-mismatch"]
    assert anomalies(at(0, READ, Direction.TX), at(3, REPLY, Direction.RX)) == []


def test_one_tap_that_calls_all_it_hears_rx_is_not_swapped() -> None:
    assert anomalies(at(0, READ, Direction.RX), at(3, REPLY, Direction.RX)) == []


def test_a_time_without_a_word_about_its_clock_counts() -> None:
    found = anomalies(Chunk(READ, T0), Chunk(REPLY, T0 + 60 * MS))
    assert [a.code for a in found] == ["late-response"]


def test_stamps_in_order_are_no_clock_that_steps_back_whenever_what_was_sent_was_over() -> None:
    """A long write may have been over at its stamp, or when its last byte was."""
    log = [at(0, READ * 20, Direction.TX), at(40, READ * 20, Direction.TX)]
    log += [at(41, READ, Direction.TX), at(43, REPLY, Direction.RX)]
    assert "clock-step" not in [a.code for a in anomalies(*handed_over(log, Direction.TX))]


def test_a_clock_that_steps_back_is_noted() -> None:
    assert "clock-step" in [a.code for a in anomalies(at(5000, READ + REPLY), at(10, READ + REPLY))]


def test_every_device_name_a_protocol_can_report_stands_in_the_catalogue() -> None:
    from sniffer.anomalies.device import device_code
    from sniffer.protocols import PROTOCOLS

    for protocol in PROTOCOLS.values():
        for bit in range(15):
            for name in protocol.status_names(1 << bit):
                if not name.startswith("bit"):
                    assert device_code(name) != "device-alarm", f"{protocol.name}: {name}"
        for register in protocol.registers:
            for raw in register.alarms:
                assert device_code(register.values[raw]) in CATALOGUE


def test_every_code_says_what_it_means_what_causes_it_and_what_to_try() -> None:
    for code in CATALOGUE.values():
        assert code.means
        assert code.causes
        assert code.remedy
