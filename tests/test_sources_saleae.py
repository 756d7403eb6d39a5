"""Tables of Saleae's Logic: bytes, times, errors, and what is refused."""

from __future__ import annotations

import pytest

from sniffer.ground.model import Clock, MarkKind
from sniffer.sources import open_source
from tests import toollogs
from tests.inputs import chunks, notes, read, refusal
from tests.toollogs import BYTE_NS, WRITERS, conversation

TALK = conversation()


@pytest.mark.parametrize("odd", ["1e9999999", "1e999999", "1e30", "nan"])
def test_a_number_beyond_all_exponents_is_no_time(odd: str) -> None:
    table = f'name,type,start_time,duration,data\n"a","data",{odd},1e-4,0xFF\n'
    assert f"'{odd}' is no number of seconds" in refusal(table.encode())


@pytest.mark.parametrize("name", ["saleae 1", "saleae 2"])
def test_a_byte_of_a_saleae_table_is_stamped_where_it_ends(name: str) -> None:
    log = WRITERS[name](TALK)
    got = chunks(log)
    assert {c.clock for c in got} == {Clock.SAMPLE}
    ends = [s.begun_ns + (k + 1) * BYTE_NS for s in TALK for k in range(len(s.data))]
    off = [(c.t_ns or 0) - (t - toollogs.BEGUN_NS) for c, t in zip(got, ends, strict=True)]
    assert max(map(abs, off)) < BYTE_NS // 100
    for between in (b";,", b"\t,", b"\t."):  # where numbers have a comma; tabs
        saved = log.translate(bytes.maketrans(b",.", between))
        assert open_source(saved).format == "saleae"
        assert chunks(saved) == got


def test_a_table_of_logic_1_that_does_not_tell_the_length_of_a_byte_says_so() -> None:
    log = b"Time [s],Value,Parity Error,Framing Error\n0.5,0xFF,,\n0.7,0x01,,\n"
    assert [(c.t_ns, c.clock) for c in chunks(log)] == [
        (500_000_000, Clock.FILE),
        (700_000_000, Clock.FILE),
    ]
    assert "does not tell how long a byte is" in notes(log)


def test_errors_of_a_saleae_table_are_marks() -> None:
    one = b"Time [s],Value,Parity Error,Framing Error\n0.1,0xFF,Error,\n0.2,0x01,,Error\n"
    two = (
        b'name,type,start_time,duration,"data","error"\n"A","data",0.1,8e-5,0xFF,"parity"\n'
        b'"A","data",0.2,8e-5,0x01,"framing"\n"A","data",0.3,8e-5,0x01,\n'
    )
    kinds = [MarkKind.PARITY, MarkKind.FRAMING]
    assert [m.kind for c in chunks(one) for m in c.marks] == kinds
    assert [m.kind for c in chunks(two) for m in c.marks] == kinds


def test_dates_names_and_other_analyzers_of_a_table_of_logic_2() -> None:
    log = (
        b'name,type,start_time,duration,data,error,ack\n"to, servo","data",'
        b"2026-11-20T22:55:17.000158397+01:00,0.000095,0x01,,\n"
        b"I2C,data,2026-11-20T22:55:18+01:00,0.0001,0x02,,true\n"
        b"b,data,2026-11-20 21:55:19Z,0,0x03,,\n"
    )
    at = 1_795_211_717 * 10**9  # 21:55:17 UTC
    got = [(c.t_ns, c.bus, c.data) for c in chunks(log)]
    assert got == [(at + 258_397, "to, servo", b"\x01"), (at + 2 * 10**9, "b", b"\x03")]
    assert "1 rows of other analyzers" in notes(log)
    assert "zone" in notes(
        b"name,type,start_time,duration,data\nb,data,2026-11-20T22:55:17,0,0x03\n"
    )


@pytest.mark.parametrize("value", ["5", "t", "'13'", "0x5F1", "21"])
def test_a_table_in_another_radix_is_refused_with_what_to_choose(value: str) -> None:
    for head, row in (
        ("Time [s],Value,Parity Error,Framing Error", f"0.1,{value},,"),
        ("name,type,start_time,duration,data", f"A,data,0.1,8e-5,{value}"),
    ):
        assert "radix Hexadecimal" in refusal(f"{head}\n{row}\n".encode())


def test_decimal_values_of_a_table_are_read_where_its_format_is_named() -> None:
    log = b"Time [s],Value,Parity Error,Framing Error\n0.1,5,,\n0.2,250,,\n"
    assert read(log, "saleae") == b"\x05\xfa"
    assert "'0xFA' is no byte" in refusal(log.replace(b"250", b"0xFA"), "saleae")
