"""Listening to serial ports of Linux: real pseudo terminals, and what is refused."""

from __future__ import annotations

import os
import random
import stat
import subprocess
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from sniffer.ports import Counters, Port, PortLostError, PortOptions, open_port
from sniffer.ports.listing import PortInfo
from tests.terminals import (
    AT_115200,
    EVERY_BYTE,
    HEADERS,
    LINUX_ONLY,
    PATIENCE_S,
    Terminal,
    listen,
    refusal,
    wait,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.ports.tty import TtyPort


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


@pytest.fixture
def opened(line: Terminal) -> Iterator[Port]:
    port = open_port(line.path, AT_115200)
    yield port
    port.close()


# --- pseudo terminals ----------------------------------------------------------------------------


@LINUX_ONLY
def test_the_kernel_doubles_ff_and_every_byte_comes_back(line: Terminal, opened: Port) -> None:
    line.say(EVERY_BYTE)
    raw = bytearray()

    def whole() -> bool:
        raw.extend(opened.read())
        return len(raw) >= 257

    wait(whole, "the bytes did not come")
    assert raw == bytes(range(255)) + b"\xff\xff"
    assert opened.unmark(bytes(raw)) == (EVERY_BYTE, ())


@LINUX_ONLY
def test_bytes_are_the_same_however_the_reads_fall(line: Terminal, opened: Port) -> None:
    source = random.Random(4)
    data = HEADERS + EVERY_BYTE + source.randbytes(20_000) + b"\xff" * 3000
    speaker = threading.Thread(target=_say_in_pieces, args=(line, data, source))
    speaker.start()
    heard, marks = listen(opened, len(data))
    speaker.join()
    assert heard == data
    assert marks == []


def _say_in_pieces(line: Terminal, data: bytes, source: random.Random) -> None:
    begun = 0
    while begun < len(data):
        size = source.choice((1, 2, 7, 64, 1000))
        line.say(data[begun : begun + size])
        begun += size


@LINUX_ONLY
def test_a_tap_echoes_nothing(line: Terminal) -> None:
    import termios

    assert line.settings()[3] & termios.ECHO  # a terminal that nobody has set up does
    port = open_port(line.path, AT_115200)
    assert not line.settings()[3] & termios.ECHO
    line.say(EVERY_BYTE)
    assert listen(port, 256)[0] == EVERY_BYTE
    port.close()
    assert line.answers() == b""


@LINUX_ONLY
def test_what_was_heard_before_the_settings_held_is_dropped_and_counted(line: Terminal) -> None:
    line.say(b"early\n\xff")
    port = open_port(line.path, AT_115200)
    # 8 where the kernel came to the FF only under the new settings
    assert port.facts()["dropped_at_open"] in ("7", "8")
    line.say(b"now")
    assert listen(port, 3)[0] == b"now"
    port.close()


@LINUX_ONLY
def test_reading_does_not_wait(opened: Port) -> None:
    assert opened.pollable
    assert opened.read() == b""


@LINUX_ONLY
@pytest.mark.parametrize(
    "baud", [9600, 14400, 28800, 76800, 115200, 153600, 250_000, 400_000, 460_800, 1_000_000]
)
def test_any_baud_rate_is_set_and_read_back(line: Terminal, baud: int) -> None:
    port = open_port(line.path, PortOptions(baud))
    assert port.baud == baud
    assert port.facts()["baud_asked"] == port.facts()["baud_got"] == str(baud)
    port.close()


@LINUX_ONLY
def test_the_baud_rate_is_changed_without_opening_again(line: Terminal) -> None:
    port = tty_at(line.path)
    line.say(b"heard at the old rate\xff")
    port.set_baud(57600)
    assert port.baud == 57600
    assert port.facts()["baud_got"] == "57600"
    line.say(EVERY_BYTE)
    assert listen(port, 256)[0] == EVERY_BYTE
    line.hang_up()
    with pytest.raises(PortLostError):
        port.set_baud(9600)
    port.close()


@LINUX_ONLY
def test_all_that_waits_is_thrown_away_however_often_the_kernel_gives_some(
    line: Terminal, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = tty_at(line.path)
    waiting = [bytes(4095), bytes(4095), b"\xff"]  # a pty of Linux gives 4095 bytes at once
    monkeypatch.setattr(port, "read", lambda: waiting.pop(0) if waiting else b"")
    port.set_baud(57600)
    assert not waiting
    port.close()


def tty_at(path: str) -> TtyPort:
    from sniffer.ports import tty

    return tty.TtyPort(path, AT_115200)


@LINUX_ONLY
@pytest.mark.parametrize(
    ("modem", "hangs_up"), [("low", True), ("keep", False)], ids=["low", "keep"]
)
def test_lines_that_are_to_be_kept_are_kept_when_the_port_is_closed(
    line: Terminal, modem: str, hangs_up: bool
) -> None:
    import termios

    with open(line.path, "rb", buffering=0, opener=_quietly) as other:
        settings = termios.tcgetattr(other)
        settings[2] |= termios.HUPCL
        termios.tcsetattr(other, termios.TCSANOW, settings)
        port = open_port(line.path, PortOptions(9600, modem="keep" if modem == "keep" else "low"))
        port.close()
        assert bool(termios.tcgetattr(other)[2] & termios.HUPCL) == hangs_up


def _quietly(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOCTTY)


@LINUX_ONLY
def test_a_port_says_what_a_recording_should_know(line: Terminal, opened: Port) -> None:
    assert opened.name == opened.path == line.path
    assert opened.latency_ns == 1_000_000
    assert (opened.marks_errors, opened.counts_errors) == (True, False)
    assert not opened.usb
    assert opened.counters() is None
    assert opened.facts() == {
        "device": line.path,
        "baud_asked": "115200",
        "baud_got": "115200",
        "echo_at_open": "on",
        "sent_since_plugged": "not known",
        "modem": "low",
        "modem_after_open": "none",
        "modem_after_lowering": "none",
        "low_latency_asked": "yes",
        "low_latency_got": "not known",
        "latency_timer_ms": "none",
        "locked": "yes",
        "also_open_in": "none" if os.geteuid() == 0 else "not known",
        "line_errors": "none: a pseudo terminal has no line",
        "dropped_at_open": "0",
    }


@LINUX_ONLY
def test_a_port_is_opened_again_by_the_name_that_leads_to_it(
    line: Terminal, tmp_path: Path
) -> None:
    link = tmp_path / "arm"
    line.plug_in_at(link)
    first = open_port(str(link), AT_115200)
    assert first.path == str(link)
    line.hang_up()
    with pytest.raises(PortLostError):
        listen(first, 1)
    first.close()
    with Terminal() as other:
        other.plug_in_at(link)
        again = open_port(first.path, AT_115200)
        other.say(b"back")
        assert listen(again, 4)[0] == b"back"
        again.close()


@LINUX_ONLY
def test_a_port_whose_far_end_closes_is_lost(line: Terminal, opened: Port) -> None:
    line.say(b"last")
    assert listen(opened, 4)[0] == b"last"
    line.hang_up()
    with pytest.raises(PortLostError, match="the port is gone") as caught:
        listen(opened, 1)
    assert line.path in str(caught.value)
    opened.close()
    opened.close()  # again is no error


# --- what is refused -----------------------------------------------------------------------------


@LINUX_ONLY
def test_the_second_to_open_a_port_is_told_who_has_it(line: Terminal, opened: Port) -> None:
    who = f"{Path('/proc/self/comm').read_text(encoding='utf-8').strip()} (process {os.getpid()})"
    assert refusal(line.path) == f"{line.path} is in use by {who}; end that first"
    opened.close()
    open_port(line.path, AT_115200).close()


@LINUX_ONLY
def test_a_port_that_another_program_reserved_is_left_to_it(line: Terminal) -> None:
    import fcntl
    import termios

    with open(line.path, "rb", buffering=0, opener=_quietly) as other:
        fcntl.ioctl(other, termios.TIOCEXCL)
        assert refusal(line.path) == f"{line.path} is in use by another program; end that first"
        fcntl.ioctl(other, termios.TIOCNXCL)
        open_port(line.path, AT_115200).close()


def test_a_name_that_is_no_port_is_told_what_to_use_instead(tmp_path: Path) -> None:
    if os.name != "posix":
        pytest.skip("there, ports are no files")
    lists = "`sniffer ports` lists those that are here"
    assert refusal("/dev/ttyNONE7") == f"/dev/ttyNONE7: there is no such port; {lists}"
    assert refusal("bad\nname") == f"'bad\\nname': there is no such port; {lists}"
    assert refusal("nul\0l").endswith(f"there is no such port; {lists}")
    file = tmp_path / "run.mcap"
    file.write_bytes(b"")
    assert refusal(file) == f"{file} is a file, no port: `sniffer decode` reads it"
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    assert refusal(pipe) == f"{pipe} is a pipe, no port: `sniffer decode` reads it"
    assert "is a directory: give the port in it" in refusal(tmp_path)
    assert refusal(os.devnull) == f"{os.devnull} is no serial port; {lists}"
    (tmp_path / "gone").symlink_to(tmp_path / "nowhere")
    assert "there is no such port" in refusal(tmp_path / "gone")


@LINUX_ONLY
@pytest.mark.parametrize("name", ["/dev/tty", "/dev/console", "/dev/ptmx", "/dev/tty1"])
def test_a_terminal_for_people_is_no_port(name: str) -> None:
    if not Path(name).exists():
        pytest.skip(f"no {name} here")
    assert "is a terminal, no serial port" in refusal(name)


@LINUX_ONLY
def test_the_terminal_that_we_run_in_is_no_port(line: Terminal) -> None:
    code = (
        "import sys; from sniffer.ground.model import InputError\n"
        "from sniffer.ports import PortOptions, open_port\n"
        "try: open_port(sys.argv[1], PortOptions(9600))\n"
        "except InputError as error: print(error)"
    )
    with open(line.path, "rb", buffering=0, opener=_quietly) as ours:
        done = subprocess.run(
            [sys.executable, "-c", code, line.path],
            stdin=ours,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=True,
        )
    assert "is the terminal you type in, no serial port" in done.stdout


@pytest.mark.parametrize("baud", [0, -9600, 1 << 32])
def test_a_baud_rate_of_nothing_would_hang_up_and_is_refused(baud: int) -> None:
    assert refusal("loop://", PortOptions(baud)).startswith(f"{baud} is no baud rate")


@LINUX_ONLY
def test_without_permission_the_group_to_join_is_named(line: Terminal) -> None:
    import grp

    if os.geteuid() == 0:
        os.chown(line.path, -1, next(g.gr_gid for g in grp.getgrall() if g.gr_gid))
    group = grp.getgrgid(Path(line.path).stat().st_gid)
    Path(line.path).chmod(stat.S_IRGRP | stat.S_IWGRP)
    code = (
        "import grp, os, sys\n"  # all of it while we may still read it
        "from sniffer.ground.model import InputError\n"
        "from sniffer.ports import PortOptions, kernel, open_port, tty\n"
        "if os.geteuid() == 0: os.setgroups([]), os.setgid(65534), os.setuid(65534)\n"
        "try: open_port(sys.argv[1], PortOptions(9600))\n"
        "except InputError as error: print(error)"
    )
    told = subprocess.run(
        [sys.executable, "-c", code, line.path],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=True,
    ).stdout.strip()
    advice = f"join its group with `sudo usermod -aG {group.gr_name} $USER`, and log in again"
    assert told == f"{line.path}: no permission to read it; {advice}"


# --- what is known of drivers --------------------------------------------------------------------


def test_counters_are_compared_over_their_wrap() -> None:
    before = Counters(frame=5, overrun=(1 << 32) - 1)
    assert Counters(frame=7, overrun=1).since(before) == Counters(frame=2, overrun=2)
    # the record has signed numbers
    assert Counters(brk=-(1 << 31)).since(Counters(brk=(1 << 31) - 1)) == Counters(brk=1)


@LINUX_ONLY
@pytest.mark.parametrize(
    ("info", "timer_ms", "latency_ns"),
    [
        (PortInfo("/dev/ttyUSB0", "ftdi_sio", vendor_id=0x0403), 16, 17_000_000),
        (PortInfo("/dev/ttyUSB0", "ftdi_sio", vendor_id=0x0403), 1, 2_000_000),
        (PortInfo("/dev/ttyUSB0", "ch341-uart", vendor_id=0x1A86), None, 2_000_000),
        (PortInfo("/dev/ttyUSB0", "cp210x", vendor_id=0x10C4), None, None),
        (PortInfo("/dev/ttyACM0", "cdc_acm", vendor_id=0x2341), None, None),
        (PortInfo("/dev/ttyS0", "serial", "16550A"), None, 2_736_111),
        (PortInfo("/dev/ttyXY0", "unheard"), None, None),
    ],
    ids=lambda value: value.driver if isinstance(value, PortInfo) else str(value),
)
def test_how_long_bytes_are_held_back_follows_from_the_driver(
    info: PortInfo, timer_ms: int | None, latency_ns: int | None
) -> None:
    from sniffer.ports import tty

    assert tty.latency_ns(info, timer_ms, 115200) == latency_ns


@LINUX_ONLY
def test_modem_lines_are_named() -> None:
    from sniffer.ports import kernel

    assert kernel.names(None) == "none"
    assert kernel.names(0) == "all low"
    assert kernel.names(kernel.DTR | kernel.RTS | 0x20) == "DTR RTS CTS"
