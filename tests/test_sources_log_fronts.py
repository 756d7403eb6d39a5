"""What known programs put in front of the lines of a log, and what only looks so."""

from __future__ import annotations

import pytest

from sniffer.ground.model import Direction
from sniffer.sources import open_source
from tests.inputs import chunks, notes, read, refusal

ASKED = bytes.fromhex("FF FF FF 01 02 F1 0B")
SAID = bytes.fromhex("FF FF FF 01 02 00 FC")


def numbers(data: bytes) -> str:
    return str(list(data))


def hexes(data: bytes) -> str:
    return data.hex(" ")


def two(asked: str, said: str) -> bytes:
    """Return two lines, with the bytes where ``{}`` stands, twice."""
    lines = [asked.format(hexes(ASKED)), said.format(hexes(SAID))]
    return "\n".join([*lines, *lines, ""]).encode()


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (
            "[2026-11-20T22:55:06.001Z DEBUG servo::bus] tx {}",
            "[2026-11-20T22:55:06.004Z DEBUG servo::bus] rx {}",
        ),
        (
            "[2026-11-20T22:55:06.001Z INFO  arm] -> {}",
            "[2026-11-20T22:55:06.004Z TRACE arm] <- {}",
        ),
        (
            "2026/11/20 22:55:06.001000 servo.go:31: -> {}",
            "2026/11/20 22:55:06.004000 servo.go:44: <- {}",
        ),
        (
            "[Fri Nov 20 22:55:06.001 2026] TX {}",
            "[Fri Nov 20 22:55:06.004 2026] RX {}",
        ),
        (
            "Nov 20 22:55:06.001112 pi robot[812]: TX {}",
            "Nov 20 22:55:06.004112 pi robot[812]: RX {}",
        ),
        (
            "11-20 22:55:06.001  1234  1250 D ServoBus: TX: {}",
            "11-20 22:55:06.004  1234  1250 D ServoBus: RX: {}",
        ),
        ('"0.001","TX","{}"', '"0.004","RX","{}"'),
    ],
)
def test_what_a_known_program_puts_in_front_is_no_byte(asked: str, said: str) -> None:
    log = two(asked, said)
    assert open_source(log).format == "labelled"
    got = chunks(log)
    assert b"".join(c.data for c in got) == (ASKED + SAID) * 2
    assert [c.direction for c in got] == [Direction.TX, Direction.RX] * 2
    moments = [c.t_ns for c in got]
    assert None not in moments
    assert [t // 1_000_000 % 1000 for t in moments if t is not None] == [1, 4, 1, 4]


def test_a_list_of_bytes_by_the_name_of_its_direction_is_read() -> None:
    log = "".join(
        f'{{"time": 1795215306.{k:03d}, "{way}": {numbers(data)}}}\n'
        for k, way, data in ((1, "tx", ASKED), (4, "rx", SAID))
    )
    assert [c.data for c in chunks(log.encode())] == [ASKED, SAID]


def test_dates_without_a_year_are_told_and_days_go_on() -> None:
    log = (
        b"Dec 31 23:59:59.900000 pi robot: TX ff ff ff 01 02 f1 0b\n"
        b"Jan  1 00:00:00.100000 pi robot: RX ff ff ff 01 02 00 fc\n"
    )
    first, last = (c.t_ns for c in chunks(log))
    assert first is not None
    assert last is not None
    assert last - first == 200_000_000
    assert "its dates have no year" in notes(log)


def test_the_year_behind_a_time_is_that_of_its_date() -> None:
    log = two("[Fri Nov 20 22:55:06.001 2026] TX {}", "[Fri Nov 20 22:55:06.004 2026] RX {}")
    iso = two("[2026-11-20 22:55:06.001] TX {}", "[2026-11-20 22:55:06.004] RX {}")
    assert [c.t_ns for c in chunks(log)] == [c.t_ns for c in chunks(iso)]


def test_what_others_write_into_the_same_log_is_left_out() -> None:
    log = (
        b"11-20 22:55:06.001  1234  1250 D ServoBus: TX: ff ff ff 01 02 f1 0b\n"
        b"11-20 22:55:06.002   812   812 D Battery: 85\n"
        b"11-20 22:55:06.003   812   812 I Wifi: ab\n"
        b"11-20 22:55:06.004  1234  1250 D ServoBus: RX: ff ff ff 01 02 00 fc\n"
    )
    assert read(log) == ASKED + SAID
    assert "2 lines" in notes(log)


@pytest.mark.parametrize(
    "line",
    [
        "2026-11-20T22:55:06.001Z DEBUG servo] tx {}",  # nothing was opened
        "servo.go:31: {}",  # neither a time nor a direction
        "[Fri Nux 20 22:55:06.001 2026] TX {}",
        "[Fri Nov 31 22:55:06.001 2026] TX {}",
        "[Fri Nov 20 22:55:06.001 26] TX {}",
        "Nov 20 22:55:06 pi robot[812]: TX {}",  # a second is no time of a line
        "Nov 20 22:55:06.001112 pi robot 812 TX {}",
        "13 11-20 22:55:06.001  1234  1250 D ServoBus: TX: {}",
        "11-20 22:55:06.001  1234  1250 Q ServoBus: TX: {}",
        '"0.001","TX","{}',
        '"first","TX","{}"',
        '{{"time": 1795215306.001, "in": [255, 255, 255, 1, 2, 241, 11]}}',
        '{{"time": 1795215306.001, "tx": 255, "rx": 17}}',
        '{{"time": 1795215306.001, "tx": [255, 256]}}',
    ],
)
def test_what_only_looks_so_is_refused(line: str) -> None:
    assert refusal(two(line, line))


def test_a_time_that_is_known_is_not_told_as_unknown() -> None:
    line = f"[2026-11-20T22:55:06.001Z DEBUG the left arm] tx {ASKED.hex()}"
    assert "other words between its times and its bytes" in refusal(line.encode())


def test_a_time_of_an_unknown_kind_is_told_as_one() -> None:
    assert "unknown kind" in refusal(b"11/20/2026 10:55:06.000 PM: TX FF FF FF 01 02 F1 0B")
