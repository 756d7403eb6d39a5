"""Simulated servos obey their manuals, as far as a controller can tell: settings, ids, resets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import pytest

from sniffer.ground.model import NS
from sniffer.simulation import BUSES
from sniffer.simulation.respond import Responder
from tests.streams.mightyzap import packet as zap
from tests.streams.rs30x import long, packet, returned, write
from tests.streams.wck import command as wck

if TYPE_CHECKING:
    from collections.abc import Mapping


class Talk:
    """A controller and simulated servos, one second between two requests."""

    def __init__(
        self, name: str, *servo_ids: int, models: Mapping[int | None, str] | None = None
    ) -> None:
        self.servos = Responder(name, servo_ids=servo_ids, models=models or {})
        self._now_ns = 0

    def ask(self, request: bytes) -> bytes:
        """Return all that is answered."""
        self._now_ns += NS
        said = self.servos.hear(request, self._now_ns)
        return b"".join(s.frame.wire for s in said if s.ours)

    def all_of(self, *requests: bytes) -> list[bytes]:
        return [self.ask(request) for request in requests]


# --- mightyZAP -----------------------------------------------------------------------------------

ECHO: Final = 0xF1
LOAD, STORE, SEND, EXECUTE, RESET = 0xF2, 0xF3, 0xF4, 0xF5, 0xF6
OPTION_ID, OPTION_BAUD = 1, 2


def test_mightyzap_id_0_reaches_every_servo_but_for_echo_and_load_data() -> None:
    talk = Talk("mightyzap", 3)
    assert talk.ask(zap(0, STORE, b"\x81\x02")) == zap(3, 0)
    assert talk.all_of(zap(0, ECHO), zap(0, LOAD, b"\x81\x01")) == [b"", b""]
    assert talk.ask(zap(3, LOAD, b"\x81\x01")) == zap(3, 0, b"\x02")


def test_a_mightyzap_whose_own_id_is_0_answers_under_it() -> None:
    talk = Talk("mightyzap", 0)
    assert talk.all_of(zap(0, ECHO), zap(0, LOAD, b"\x03\x01"), zap(0, STORE, b"\x03\x04")) == [
        zap(0, 0),
        zap(0, 0, b"\x00"),
        zap(0, 0),
    ]
    assert talk.all_of(zap(0, ECHO), zap(4, ECHO)) == [b"", zap(4, 0)]


@pytest.mark.parametrize(
    ("option", "servo_id", "baud"), [(0, 3, 16), (OPTION_ID, 0, 16), (OPTION_BAUD, 3, 32)]
)
def test_a_mightyzap_factory_reset_takes_id_and_baud_by_its_option(
    option: int, servo_id: int, baud: int
) -> None:
    talk = Talk("mightyzap", 3)
    talk.all_of(zap(3, STORE, b"\x04\x10"), zap(3, STORE, b"\x06\x64\x00"))
    assert talk.ask(zap(3, RESET, bytes([option]))) == zap(3, 0), "the old id answers it"
    assert talk.ask(zap(servo_id, LOAD, b"\x03\x05")) == zap(
        servo_id, 0, bytes([servo_id, baud, 250, 0, 0])
    )


def test_a_mightyzap_reports_the_errors_of_the_manual() -> None:
    talk = Talk("mightyzap", 1)
    limits = zap(1, STORE, b"\x06\x64\x00\xe8\x03")  # 100..1000
    broken = bytearray(zap(1, STORE, b"\x81\x02"))
    broken[-1] ^= 0x10
    assert (
        talk.all_of(
            limits,
            zap(1, STORE, b"\x86\x63\x00"),  # a goal below the short stroke limit
            zap(1, STORE, b"\x86\xe9\x03"),  # above the long one
            zap(1, STORE, b"\x86\xe8\x03"),
            zap(1, SEND, b"\x86\xe9\x03"),  # it is told when it takes effect
            zap(1, EXECUTE),
            zap(1, EXECUTE),  # nothing was sent
            zap(1, LOAD, b"\x99\x02"),  # beyond the map
            zap(1, STORE, b"\x99\x01\x01"),
            zap(1, STORE, b"\x10\x07"),  # a value out of its range
            zap(1, 0xA0),  # no such instruction
            bytes(broken),
            zap(1, LOAD, b"\x81\x01"),
            bytes(broken)[:5] + b"\x00" * 3,
        )
        == [
            zap(1, 0),
            zap(1, 1 << 1),
            zap(1, 1 << 1),
            zap(1, 0),
            zap(1, 0),
            zap(1, 1 << 1),
            zap(1, 1 << 6),
            zap(1, 1 << 3),
            zap(1, 1 << 3),
            zap(1, 1 << 3),
            zap(1, 1 << 6),
            zap(1, 1 << 4),
            zap(1, 0, b"\x00"),
            b"",
        ]
    )


def test_a_mightyzap_in_return_mode_1_complains_of_broken_reads_only() -> None:
    talk = Talk("mightyzap", 1)
    read, stored = (bytearray(zap(1, code, b"\x81\x01")) for code in (LOAD, STORE))
    read[-1] ^= 1
    stored[-1] ^= 1
    talk.ask(zap(1, STORE, b"\x10\x01"))
    assert talk.all_of(bytes(read), bytes(stored)) == [zap(1, 1 << 4), b""]
    assert talk.ask(bytes(read) + bytes(read)) == zap(1, 1 << 4) * 2


def test_a_mightyzap_counts_in_its_resolution_and_keeps_what_is_locked() -> None:
    talk = Talk("mightyzap", 1)
    talk.ask(zap(1, STORE, b"\x80\x01"))
    talk.ask(zap(1, STORE, b"\x86\xff\x07"))
    for _ in range(9):
        before = talk.ask(zap(1, LOAD, b"\x8c\x02"))
    talk.ask(zap(1, STORE, b"\x16\x03"))
    after = talk.ask(zap(1, LOAD, b"\x8c\x02"))
    fine, coarse = (int.from_bytes(answer[6:8], "little") for answer in (before, after))
    assert fine == pytest.approx(2047, abs=40)
    assert coarse == pytest.approx(fine / 4, abs=2)
    talk.all_of(zap(1, STORE, b"\x97\x01"), zap(1, STORE, b"\x05\x07"), zap(1, STORE, b"\x81\x08"))
    assert talk.ask(zap(1, LOAD, b"\x05\x01")) == zap(1, 0, b"\xfa")
    assert talk.ask(zap(1, LOAD, b"\x81\x01")) == zap(1, 0, b"\x08")


def test_a_12lf_has_its_own_map() -> None:
    talk = Talk("mightyzap", 1, 2, models={2: "mightyzap-12lf"})
    wrote = zap(2, STORE, b"\x15\x00\x02")  # the goal of its speed, 512
    assert talk.ask(wrote) == b"", "it is shipped to answer reads only"
    assert talk.ask(zap(2, LOAD, b"\x15\x02")) == zap(2, 0, b"\x00\x02")
    assert talk.ask(zap(2, LOAD, b"\x8a\x02")) == zap(2, 0, (800).to_bytes(2, "little"))
    assert talk.ask(zap(1, LOAD, b"\x8a\x02")) == zap(1, 0, (1023).to_bytes(2, "little"))


def test_the_force_of_a_12lf_goes_on_by_itself_with_the_next_goal() -> None:
    """12Lf IR Protocol, 2.4.6.1; the L12 manual v1.02 says nothing of the kind."""
    talk = Talk("mightyzap", 1, 2, models={2: "mightyzap-12lf"})
    for who, on in ((1, b"\x00"), (2, b"\x01")):
        talk.all_of(zap(who, STORE, b"\x80\x00"), zap(who, STORE, b"\x86\x00\x02"))
        assert talk.ask(zap(who, LOAD, b"\x80\x01")) == zap(who, 0, on)


# --- LSS -----------------------------------------------------------------------------------------


def lss(*requests: str, servos: tuple[int, ...] = (5,)) -> list[str]:
    talk = Talk("lss", *servos)
    return [talk.ask(f"{request}\r".encode()).decode().replace("\r", "") for request in requests]


def test_an_lss_first_position_is_disabled_until_it_is_set_and_the_last_one_counts() -> None:
    assert lss(
        *("#5QFD", "#5QFP", "#5CFD64", "#5QFD", "#5QFD1", "#5CP1550", "#5QFD", "#5QFP"),
        *("#5CFD", "#5QFP", "#5QFD"),
    ) == [
        *("*5QFDDIS", "*5QFPDIS", "", "*5QFD64", "*5QFD64", "", "*5QFDDIS", "*5QFP1550"),
        *("", "*5QFPDIS", "*5QFDDIS"),
    ]


def test_an_lss_goes_to_its_first_position_at_power_on() -> None:
    answers = lss("#5CFD300", "#5Q", "#5RESET", "#5QDT", "#5QD", servos=(5,))
    assert answers[1] == "*5Q1"
    assert answers[3:] == ["*5QDT300", "*5QD300"]


def test_an_lss_is_as_shipped_after_default_and_confirm_unless_something_comes_between() -> None:
    assert lss(
        *("#5CSD900", "#5CFD64", "#5DEFAULT", "#5QSD", "#5CONFIRM", "#5QSD"),
        *("#5DEFAULT", "#5CONFIRM", "#5QID", "#0QID", "#0QSD1", "#0QFD"),
    ) == [
        *("", "", "", "*5QSD900", "", "*5QSD900"),
        *("", "", "", "*0QID0", "*0QSD0", "*0QFDDIS"),
    ]


def test_an_lss_has_one_speed_limit_in_two_units() -> None:
    assert lss("#5SR40", "#5QSD", "#5QSR", "#5SD900", "#5QSR", "#5QSD3", "#5CSR20", "#5QSD1") == [
        *("", "*5QSD2400", "*5QSR40", "", "*5QSR15", "*5QSD900", "", "*5QSD1200")
    ]


def test_an_lss_in_rc_mode_hears_nothing_more_after_a_reset() -> None:
    assert lss("#5CRC1", "#5QMS", "#5RESET", "#5QMS", "#254QID", servos=(5, 6)) == [
        *("", "*5QMSLSS-ST1", "", "", "*6QID6")
    ]


def test_an_lss_pro_speaks_in_hundredths_of_a_degree_and_says_what_it_is() -> None:
    talk = Talk("lss", 5, 6, models={6: "lss-pro"})
    words = ("#%dQMS\r", "#%dD300\r", "#%dQDT\r", "#%dSR10\r", "#%dQSD\r", "#%dQEF\r", "#%dQ\r")
    said = {who: [talk.ask((word % who).encode()) for word in words] for who in (5, 6)}
    assert said[5][:5] == [b"*5QMSLSS-ST1\r", b"", b"*5QDT300\r", b"", b"*5QSD600\r"]
    assert said[6][:5] == [b"*6QMSLSS-P-S1\r", b"", b"*6QDT300\r", b"", b"*6QSD6000\r"]
    assert (said[5][5], said[6][5]) == (b"", b"*6QEF0\r")
    places = [talk.ask(f"#{who}QD\r".encode()) for who in (5, 6)]
    assert places == [b"*5QD300\r", b"*6QD300\r"]
    whereabouts = [talk.servos.bus.servos[who].joint.position - 0.5 for who in (5, 6)]
    assert whereabouts[0] == pytest.approx(10 * whereabouts[1], rel=0.05)


# --- wCK -----------------------------------------------------------------------------------------


def test_a_wck_module_with_an_id_above_30_hears_the_commands_of_10_bits_only() -> None:
    talk = Talk("wck", 0)
    assert talk.ask(wck(0xE0, 0x0C, bytes([200, 200]))) == bytes([200, 200])
    assert talk.ask(wck(0xA0, 0)) == b""
    moved = wck(0xE0, 0xC8, bytes([200, 100, 2, 0x90]))
    assert len(talk.ask(moved)) == 2
    h3, l7 = talk.ask(wck(0xE0, 0xC9, bytes([200, 200])))
    assert (h3 << 7 | l7 >> 1) == pytest.approx(2 << 7 | 0x90 >> 1, abs=12)
    assert talk.ask(wck(0xE0, 0xC9, bytes([8, 8]))) == b"", "200 & 31 is another module"
    assert talk.ask(wck(0xDF, 0x20)) == b"", "no reply can name it"


# --- RS30x ---------------------------------------------------------------------------------------

FLASH, REBOOT, FACTORY = (packet(9, flags, 0xFF) for flags in (0x40, 0x20, 0x10))


def test_an_rs30x_factory_reset_clears_the_rom_area_and_gives_it_the_id_1() -> None:
    talk = Talk("rs30x", 9)
    talk.all_of(write(9, 0x07, b"\x0c"), write(9, 0x18, b"\x07\x07"), write(9, 0x24, b"\x01"))
    assert talk.ask(FACTORY) == b""
    assert talk.ask(packet(9, 0x0F, 0x04, 1)) == b""
    assert talk.ask(packet(1, 0x0F, 0x04, 4)) == returned(1, 0x04, b"\x01\x00\x07\x00")
    assert talk.ask(packet(1, 0x0F, 0x18, 2)) == returned(1, 0x18, b"\x02\x02")
    assert talk.ask(packet(1, 0x0F, 0x24, 1)) == returned(1, 0x24, b"\x01"), "no ROM area"


def test_what_an_rs30x_did_not_write_to_its_flash_is_gone_after_a_restart() -> None:
    talk = Talk("rs30x", 9)
    talk.ask(write(9, 0x07, b"\x0c"))
    talk.ask(FLASH)
    talk.all_of(write(9, 0x07, b"\x20"), write(9, 0x04, b"\x11"))
    assert talk.ask(packet(0x11, 0x0F, 0x07, 1)) == returned(0x11, 0x07, b"\x20")
    talk.ask(packet(0x11, 0x20, 0xFF))
    assert talk.ask(packet(9, 0x0F, 0x07, 1)) == returned(9, 0x07, b"\x0c")


def test_a_long_packet_tells_each_rs30x_its_own() -> None:
    talk = Talk("rs30x", 1, 2)
    talk.ask(long(0x1E, (1, b"\x0a\x00"), (2, b"\x0b\x00")))
    asked = [talk.ask(packet(i, 0x0F, 0x1E, 2)) for i in (1, 2)]
    assert asked == [returned(1, 0x1E, b"\x0a\x00"), returned(2, 0x1E, b"\x0b\x00")]


# --- all of them ---------------------------------------------------------------------------------

RENUMBER: Final = {
    "mightyzap": (zap(1, STORE, b"\x03\x02"), zap(2, ECHO), zap(2, 0)),
    "lss": (b"#1CID2\r#1RESET\r", b"#2QID\r", b"*2QID2\r"),
    "wck": (wck(0xE1, 0x0C, b"\x02\x02"), wck(0xE2, 0x12, b"\0\0"), b"\x01\xfe"),
    "rs30x": (write(1, 0x04, b"\x02"), packet(2, 0x0F, 4, 1, 0, b""), returned(2, 4, b"\x02")),
}
"""What gives servo 1 the id of servo 2, a question to 2, and its answer."""


@pytest.mark.parametrize("name", BUSES)
def test_a_servo_that_is_given_an_id_in_use_takes_it_and_both_answer(name: str) -> None:
    told, question, answer = RENUMBER[name]
    talk = Talk(name, 1, 2)
    assert talk.ask(question) == answer
    talk.ask(told)
    assert talk.ask(question) == answer * 2


def test_servos_that_share_an_id_move_on_together() -> None:
    talk = Talk("rs30x", 1, 2, 3)
    talk.ask(write(1, 0x04, b"\x02"))
    talk.ask(write(2, 0x04, b"\x07"))
    asked = {i: talk.ask(packet(i, 0x0F, 0x04, 1)) for i in (1, 2, 3, 7)}
    assert {i: answer.count(returned(i, 0x04, bytes([i]))) for i, answer in asked.items()} == {
        1: 0,
        2: 0,
        3: 1,
        7: 2,
    }
