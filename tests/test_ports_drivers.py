"""What is known of serial drivers: the rate at which a port really runs, and what they tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import InputError, MarkKind
from sniffer.ports import Counters, PortOptions, open_port
from sniffer.ports.listing import PortInfo
from sniffer.tap.events import Back, Counted, Read
from sniffer.tap.tap import PortSpec, Tap
from tests.terminals import LINUX_ONLY, Terminal

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


@LINUX_ONLY
def test_a_driver_that_sets_something_else_is_refused(line: Terminal) -> None:
    from dataclasses import replace

    from sniffer.ports import kernel
    from sniffer.ports.rates import refuse_other

    port = open_port(line.path, PortOptions(1_000_000))
    got = kernel.settings(port.fileno())
    port.close()
    assert refuse_other("ttyX", 1_000_000, replace(got, ispeed=981_000)) == 981_000
    # FTDI's driver falls back to 9600, though the adapter can do 3000000
    with pytest.raises(InputError) as caught:
        refuse_other("ttyX", 4_000_000, replace(got, ispeed=9600))
    assert str(caught.value) == (
        "ttyX: the adapter cannot do 4000000 baud, and its driver has set 9600 instead; use "
        "another adapter or baud rate"
    )
    with pytest.raises(InputError, match="cannot do 8N1"):
        refuse_other("ttyX", 1_000_000, replace(got, cflag=got.cflag & ~0o60))


@LINUX_ONLY
def test_a_uart_that_says_76800_and_runs_at_57600_is_refused(line: Terminal) -> None:
    from dataclasses import replace

    from sniffer.ports import kernel
    from sniffer.ports.rates import refuse_other

    port = open_port(line.path, PortOptions(76800))
    got = kernel.settings(port.fileno())
    port.close()
    assert got.ispeed == 76800
    assert refuse_other("ttyS1", 76800, got, kernel.Divider(1_536_000)) == 76800
    with pytest.raises(InputError) as caught:
        refuse_other("ttyS1", 76800, got, kernel.Divider(115_200))
    assert str(caught.value) == (
        "ttyS1: this UART cannot do 76800 baud: it divides 115200 by a whole number, and would "
        "run at 57600; use another adapter or baud rate"
    )
    faster = replace(got, ispeed=74880)
    assert refuse_other("ttyS1", 74880, faster, kernel.Divider(1_497_600)) == 74880


@LINUX_ONLY
@pytest.mark.parametrize(
    ("asked", "base", "at_38400", "multiplies", "runs_at"),
    [
        (115_200, 115_200, None, False, 115_200),
        (74_880, 115_200, None, False, 57_600),  # 1.54
        (100_000, 115_200, None, False, 115_200),  # 1.15
        (9600, 115_200, None, False, 9600),
        (250_000, 4_000_000, None, False, 250_000),
        (1_000_000, 921_600, None, False, 921_600),  # no divisor below 1
        (38_400, 115_200, 57_600, False, 57_600),  # setserial spd_hi
        (19_200, 115_200, 57_600, False, 19_200),
        (460_800, 115_200, None, True, 460_800),  # ASYNC_MAGIC_MULTIPLIER
    ],
)
def test_a_uarts_rate_is_its_clock_by_the_nearest_whole_number(
    asked: int, base: int, at_38400: int | None, multiplies: bool, runs_at: int
) -> None:
    from sniffer.ports.kernel import Divider
    from sniffer.ports.rates import true_baud

    assert true_baud(asked, Divider(base, at_38400, multiplies)) == runs_at


@LINUX_ONLY
def test_only_uarts_that_divide_by_whole_numbers_are_reckoned() -> None:
    from sniffer.ports.rates import divides

    assert divides(PortInfo("/dev/ttyS0", "serial", "16550A"))
    assert divides(PortInfo("/dev/ttyS0", "serial8250", "8250"))
    for other in ("dw-apb-uart", "uart-pl011", "exar_serial"):
        assert not divides(PortInfo("/dev/ttyS0", other, "16550A"))
    assert not divides(PortInfo("/dev/ttyUSB0", "ftdi_sio", "FT232R", vendor_id=0x0403))


@pytest.mark.parametrize(
    ("info", "marks", "counts", "counts_sent"),
    [
        (PortInfo("/dev/ttyS0", "serial", "16550A"), True, True, True),
        (PortInfo("/dev/ttyAMA0", "uart-pl011", "PL011"), True, True, True),
        (PortInfo("/dev/ttyUSB0", "ftdi_sio", vendor_id=0x0403), True, True, True),
        (PortInfo("/dev/ttyUSB0", "cp210x", vendor_id=0x10C4), None, None, False),
        (PortInfo("/dev/ttyUSB0", "ch341-uart", vendor_id=0x1A86), False, False, False),
        (PortInfo("/dev/ttyUSB0", "pl2303", vendor_id=0x067B), True, False, False),
        (PortInfo("/dev/ttyACM0", "cdc_acm", vendor_id=0x2341), None, None, False),
        (PortInfo("/dev/ttyXY0", "unheard"), None, None, False),
    ],
    ids=lambda value: value.driver if isinstance(value, PortInfo) else str(value),
)
def test_a_driver_is_said_to_tell_only_what_it_tells(
    info: PortInfo, marks: bool | None, counts: bool | None, counts_sent: bool
) -> None:
    from sniffer.ports.drivers import tells

    told = tells(info)
    assert (told.marks, told.counts, told.counts_sent) == (marks, counts, counts_sent)
    assert ("unknown" in told.words) == (not marks)


@LINUX_ONLY
def test_line_errors_are_unknown_until_one_is_told_where_the_driver_may_be_deaf(
    line: Terminal,
) -> None:
    from sniffer.ports.tty import TtyPort

    port = TtyPort(line.path, PortOptions(115200))
    assert Tap(PortSpec("arm", line.path), port).line_errors == 0  # a pseudo terminal has none
    port.marks_errors = None
    deaf = Tap(PortSpec("arm", line.path), port)
    assert deaf.line_errors is None
    (chunk,) = deaf.chunks(Read(0, 1, b"\xff\x00\x41"))
    assert [mark.kind for mark in chunk.marks] == [MarkKind.FRAMING]
    assert deaf.line_errors == 1
    # a driver counts before the bytes can be read: the mark that comes then is no other error
    port.marks_errors = True
    tap = Tap(PortSpec("arm", line.path), port)
    assert not list(tap.chunks(Counted(0, 1, Counters(frame=1), Counters())))  # none was read yet
    (chunk,) = tap.chunks(Read(0, 1, b"\xff\x00\x41"))
    assert ([mark.count for mark in chunk.marks], tap.line_errors) == ([1], 1)
    tap = Tap(PortSpec("arm", line.path), port)
    assert list(tap.chunks(Read(0, 1, b"A")))
    (chunk,) = tap.chunks(Counted(0, 1, Counters(frame=1, parity=1), Counters()))
    assert [mark.count for mark in chunk.marks] == [1, 1]
    (chunk,) = tap.chunks(Read(0, 2, b"\xff\x00\x41"))
    assert (len(chunk.marks), tap.line_errors) == (1, 2)
    # two of four more are marked, and the late one was told of already
    (chunk,) = tap.chunks(Read(0, 3, b"AB\xff\x00\x41C\xff\x00\x42"))
    assert [mark.count for mark in chunk.marks] == [1, 1]
    (chunk,) = tap.chunks(Counted(0, 4, Counters(frame=5, parity=1), Counters(frame=1, parity=1)))
    assert ([mark.count for mark in chunk.marks], tap.line_errors) == ([1], 6)
    # a port that comes back counts from the beginning
    assert list(tap.chunks(Back(0, 5, port)))
    assert not list(tap.chunks(Counted(0, 6, Counters(brk=1), Counters())))
    assert tap.line_errors == 7
    assert Tap(PortSpec("arm", line.path), port).line_errors == 0
    port.close()
