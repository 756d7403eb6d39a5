"""Ports that pySerial opens: addresses on the network, and devices as other systems have them."""

from __future__ import annotations

import logging
import socket
import threading
from typing import TYPE_CHECKING, Any

import pytest
import serial
from serial import rfc2217
from serial.urlhandler import protocol_loop

from sniffer.ground.model import InputError
from sniffer.ports import PortLostError, PortOptions, open_port
from sniffer.ports.base import READ_MAX
from sniffer.ports.remote import SerialPort
from tests.terminals import (
    AT_115200,
    EVERY_BYTE,
    HEADERS,
    LINUX_ONLY,
    PATIENCE_S,
    Terminal,
    listen,
    refusal,
)

if TYPE_CHECKING:
    from collections.abc import Iterator


@pytest.fixture
def line() -> Iterator[Terminal]:
    with Terminal() as terminal:
        yield terminal


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(PATIENCE_S)
        yield listening


def address(server: socket.socket) -> str:
    return f"socket://127.0.0.1:{server.getsockname()[1]}"


def test_a_server_on_the_network_is_a_port(server: socket.socket) -> None:
    port = open_port(address(server), AT_115200)
    far, _ = server.accept()
    assert port.pollable
    assert port.read() == b""
    assert port.latency_ns is None
    assert not port.marks_errors
    assert port.path == port.name == address(server)
    data = HEADERS + EVERY_BYTE * 400
    with far:
        far.sendall(data)
        assert listen(port, len(data)) == (data, [])
        far.setblocking(False)
        with pytest.raises(BlockingIOError):  # nothing was said to it
            far.recv(1)
    with pytest.raises(PortLostError, match="the port is gone"):
        listen(port, 1)
    assert port.facts()["line_errors"] == "not known"
    assert port.counters() is None
    port.close()


def test_what_a_server_says_at_once_is_heard(server: socket.socket) -> None:
    far: list[socket.socket] = []

    def greet(record: logging.LogRecord) -> bool:
        if "configuration" in record.getMessage():
            far.append(server.accept()[0])
            far[0].sendall(HEADERS)
        return False

    # pySerial tells of its steps: between connecting and the end of the opening it speaks of this
    steps = logging.getLogger("pySerial.socket")
    steps.addFilter(greet)
    port = open_port(f"{address(server)}?logging=debug", AT_115200)
    steps.removeFilter(greet)
    assert listen(port, len(HEADERS)) == (HEADERS, [])
    port.close()
    far[0].close()


def test_an_address_where_nobody_listens_is_told_in_one_line(server: socket.socket) -> None:
    name = address(server)
    server.close()
    assert refusal(name).startswith(f"{name}: cannot be reached (")
    assert "check host and port" in refusal(name)
    assert "cannot be reached" in refusal("socket://127.0.0.1")
    assert "no kind of address that is known" in refusal("gopher://127.0.0.1:70")


@pytest.mark.parametrize("kind", ["spy", "alt", "hwgrep", "loop", "cp2110", "SPY", ""])
def test_an_address_that_pyserial_opens_for_writing_is_refused(line: Terminal, kind: str) -> None:
    name = f"{kind}://{line.path}"
    assert refusal(name) == (
        f"{name}: no kind of address that is known to be listened to only; give "
        "socket://host:port, rfc2217://host:port, or the device itself"
    )
    if line.path.startswith("/dev/pts/"):
        import termios

        assert line.settings()[3] & termios.ECHO  # nobody has touched it


def test_a_port_that_is_no_file_waits_a_little_for_bytes() -> None:
    port = SerialPort("loop://", AT_115200)
    assert not port.pollable
    assert port.read() == b""
    port._serial.write(HEADERS)  # what nothing but a test does
    assert listen(port, len(HEADERS)) == (HEADERS, [])
    with pytest.raises(OSError, match="fileno"):
        port.fileno()
    port.close()
    with pytest.raises(PortLostError):
        port.read()


class _Unplugged(protocol_loop.Serial):
    """A port that goes away between two looks at it."""

    @property
    def in_waiting(self) -> int:
        raise serial.SerialException("unplugged")


def test_a_byte_that_was_read_when_a_port_goes_away_is_kept() -> None:
    port = SerialPort("loop://", AT_115200)
    port._serial.write(b"x")
    port._serial.__class__ = _Unplugged
    assert port.read() == b"x"
    with pytest.raises(PortLostError, match="unplugged"):
        port.read()
    port.close()


@LINUX_ONLY
def test_a_device_is_heard_through_pyserial_too(line: Terminal) -> None:
    port = SerialPort(line.path, PortOptions(250_000))
    assert port.facts()["baud_got"] == "250000"
    line.say(EVERY_BYTE)
    assert listen(port, 256) == (EVERY_BYTE, [])
    assert "is in use by" in refusal(line.path)
    with pytest.raises(InputError, match="is in use by another program"):
        SerialPort(line.path, AT_115200)
    line.hang_up()
    with pytest.raises(PortLostError, match="the port is gone"):
        listen(port, 1)
    port.close()
    with pytest.raises(InputError, match="there is no such port"):
        SerialPort(line.path, AT_115200)


OLD_CALLS = pytest.mark.filterwarnings("ignore:set(Daemon|Name)")  # pySerial 3.5 makes them


class _FarPort:
    """A server as RFC 2217 has it, with pySerial's own end of the protocol; it answers once."""

    def __init__(self) -> None:
        self.port: Any = serial.serial_for_url("loop://", baudrate=9600, timeout=0.02)
        self.told = b""  # what was meant for the line
        self.asked = b""  # all that was heard
        self.last = b""
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.settimeout(PATIENCE_S)
        self.url = f"rfc2217://127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        far, _ = self._server.accept()
        far.settimeout(0.02)
        answers: Any = _Writer(far)
        manager = rfc2217.PortManager(self.port, answers)
        with far:
            while True:
                far.sendall(b"".join(manager.escape(self.port.read(self.port.in_waiting))))
                try:
                    asked = far.recv(1024)
                except TimeoutError:
                    asked = b""
                    if not self.last:
                        continue
                if self.last:
                    far.sendall(b"".join(manager.escape(self.last)))
                    return
                if not asked:
                    return
                self.asked += asked
                self.told += b"".join(manager.filter(asked))

    def hang_up(self, last: bytes) -> None:
        """Say something and hang up."""
        self.last = last
        self._thread.join(PATIENCE_S)

    def close(self) -> None:
        self._thread.join(PATIENCE_S)
        self._server.close()


class _Writer:
    def __init__(self, far: socket.socket) -> None:
        self.write = far.sendall


@OLD_CALLS
def test_a_port_on_another_machine_is_set_up_there_and_its_lines_lowered() -> None:
    far = _FarPort()
    port = open_port(far.url, PortOptions(250_000))
    assert (far.port.baudrate, far.port.dtr, far.port.rts) == (250_000, False, False)
    far.port.write(HEADERS + EVERY_BYTE)
    assert listen(port, len(HEADERS) + 256) == (HEADERS + EVERY_BYTE, [])
    port.close()
    far.close()
    assert far.told == b""


@OLD_CALLS
def test_what_waits_when_a_far_server_hangs_up_is_read_before_the_loss_is_told() -> None:
    far = _FarPort()
    port = open_port(far.url, AT_115200)
    assert isinstance(port, SerialPort)
    sent = EVERY_BYTE * 300  # more than one read returns
    far.hang_up(sent)
    port._serial._thread.join(PATIENCE_S)  # by now pySerial knows that the connection is gone
    heard = port.read()
    assert len(heard) == READ_MAX
    heard += port.read()
    assert heard == sent
    for _ in range(2):
        with pytest.raises(PortLostError, match="the port is gone"):
            port.read()
    port.close()
    far.close()


@OLD_CALLS
def test_what_waits_at_the_far_end_is_not_thrown_away() -> None:
    far = _FarPort()
    far.port.write(HEADERS)
    port = open_port(far.url, PortOptions(9600))
    assert listen(port, len(HEADERS)) == (HEADERS, [])
    port.close()
    far.close()
    purge = rfc2217.IAC + rfc2217.SB + rfc2217.COM_PORT_OPTION + rfc2217.PURGE_DATA
    assert purge[:-1] in far.asked
    assert purge not in far.asked
