"""What Linux' terminal drivers are asked: one function a question, none of them sends or waits.

Python's termios knows neither free baud rates nor the serial ioctls' records, so both are packed
here as linux/serial.h and asm-generic/termbits.h have them.
"""

from __future__ import annotations

import errno
import fcntl
import struct
import sys
import termios
from dataclasses import dataclass
from typing import Final

from sniffer.ports.base import Counters

DTR: Final = termios.TIOCM_DTR
RTS: Final = termios.TIOCM_RTS

_TCGETS2: Final = 0x802C542A  # asm-generic/ioctls.h: _IOR('T', 0x2A, struct termios2)
_TCSETS2: Final = 0x402C542B  # at once: TCSETSW2 would wait for output, TCSETSF2 throw input away
_TIOCGEXCL: Final = 0x80045440
_TERMIOS2: Final = struct.Struct("=4IB19s2I")
_ICOUNTER: Final = struct.Struct("=20i")  # serial_icounter_struct
_SERIAL: Final = struct.Struct("@iiIiiiiiHcciHHPHIL")  # serial_struct, in the machine's word size
_SERIAL_FLAGS: Final = struct.calcsize("@iiIi")  # where its flags stand
_LOW_LATENCY: Final = 1 << 13  # ASYNC_LOW_LATENCY of linux/tty_flags.h
_BOTHER: Final = 0o010000  # a baud rate in numbers
_LFLAG: Final = slice(12, 16)  # where the local flags stand in termios2
_ECHO: Final = termios.ECHO | termios.ECHONL
_SPD_MASK: Final = 0x1030  # ASYNC_SPD_MASK of linux/tty_flags.h
_SPD_CUST: Final = 0x0030
_SPD: Final = {0x0010: 57600, 0x0020: 115200, 0x1000: 230400, 0x1010: 460800}  # ASYNC_SPD_HI ...
_MAGIC_MULTIPLIER: Final = 1 << 16  # ASYNC_MAGIC_MULTIPLIER
_NO_ANSWER: Final = (errno.ENOTTY, errno.EINVAL)
_LINES: Final = (
    (termios.TIOCM_DTR, "DTR"),
    (termios.TIOCM_RTS, "RTS"),
    (termios.TIOCM_CTS, "CTS"),
    (termios.TIOCM_DSR, "DSR"),
    (termios.TIOCM_CAR, "DCD"),
    (termios.TIOCM_RNG, "RI"),
)


@dataclass(frozen=True, slots=True)
class LineSettings:
    """A terminal's settings; of the baud rates the one of the input is ours."""

    iflag: int
    oflag: int
    cflag: int
    lflag: int
    line: int
    cc: bytes
    ispeed: int
    ospeed: int

    @property
    def is_8n1(self) -> bool:
        """Whether a byte has eight bits, no parity and one stop bit."""
        shape = self.cflag & (termios.CSIZE | termios.PARENB | termios.CSTOPB)
        return shape == termios.CS8

    @property
    def echoes(self) -> bool:
        """Whether what is heard is sent back."""
        return bool(self.lflag & _ECHO)

    @property
    def is_plain(self) -> bool:
        """Whether bytes come as they were on the line: nothing altered, echoed, held or marked."""
        altering = termios.ISTRIP | termios.INLCR | termios.IGNCR | termios.ICRNL | termios.IXON
        local = termios.ICANON | termios.ECHO | termios.ISIG | termios.IEXTEN
        return not (self.iflag & (altering | termios.PARMRK) or self.lflag & local) and self.is_8n1

    @property
    def is_listening(self) -> bool:
        """Whether line errors are marked, and nothing else is done to the bytes."""
        return self.iflag == termios.PARMRK | termios.INPCK and not self.lflag and self.is_8n1

    def listening(self, baud: int, *, hangs_up: bool | None = None) -> LineSettings:
        """Return settings for 8N1 at ``baud`` that echo nothing and mark line errors.

        Args:
            baud: any rate.
            hangs_up: whether closing lowers DTR and RTS; None leaves that as it is.
        """
        hupcl = self.cflag & termios.HUPCL
        if hangs_up is not None:
            hupcl = termios.HUPCL if hangs_up else 0
        cc = bytearray(self.cc)
        # a read of nothing is then EAGAIN, and an empty one says that the port is gone
        cc[termios.VMIN], cc[termios.VTIME] = 1, 0
        return LineSettings(
            iflag=termios.PARMRK | termios.INPCK,  # without INPCK bad bytes come unmarked
            oflag=0,
            cflag=_BOTHER | termios.CS8 | termios.CREAD | termios.CLOCAL | hupcl,
            lflag=0,
            line=self.line,
            cc=bytes(cc),
            ispeed=baud,
            ospeed=baud,
        )


@dataclass(frozen=True, slots=True)
class Divider:
    """How a UART makes its baud rate.

    ``base`` is the fastest one, for a divisor of 1; ``at_38400`` the rate that stands in the place
    of 38400 (setserial's ``spd_hi`` to ``spd_cust``), None where it is that itself; ``multiplies``
    whether it goes beyond the base in a way of its own.
    """

    base: int
    at_38400: int | None = None
    multiplies: bool = False


def is_known() -> bool:
    """Tell whether ioctls have the numbers used here (Alpha, MIPS, PowerPC and SPARC differ)."""
    return (termios.TCGETS, termios.TIOCMGET) == (0x5401, 0x5415)


def hush(fd: int) -> LineSettings:
    """Switch the echo off and leave the rest as it is; return the settings as they were.

    For the very first thing after opening: until then a port that nobody has set up sends back
    what it hears. To ask is not to be helped if the rest is to be left, but it asks the kernel's
    own memory, never the adapter. Where the echo is off already, nothing is set.

    Raises:
        OSError: the port is gone; with ENOTTY: it is no terminal.
    """
    record = fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size))
    flags = int.from_bytes(record[_LFLAG], sys.byteorder)
    if flags & _ECHO:
        quiet = (flags & ~_ECHO).to_bytes(4, sys.byteorder)
        fcntl.ioctl(fd, _TCSETS2, record[: _LFLAG.start] + quiet + record[_LFLAG.stop :])
    return LineSettings(*_TERMIOS2.unpack(record))


def settings(fd: int) -> LineSettings:
    """Return the settings as the driver has them; OSError with ENOTTY: it is no terminal."""
    return LineSettings(*_TERMIOS2.unpack(fcntl.ioctl(fd, _TCGETS2, bytes(_TERMIOS2.size))))


def set_settings(fd: int, to: LineSettings) -> None:
    """Make these the settings, at once."""
    packed = _TERMIOS2.pack(
        to.iflag, to.oflag, to.cflag, to.lflag, to.line, to.cc, to.ispeed, to.ospeed
    )
    fcntl.ioctl(fd, _TCSETS2, packed)


def waiting(fd: int) -> int:
    """Return how many bytes can be read at once, escapes among them."""
    return int.from_bytes(fcntl.ioctl(fd, termios.FIONREAD, bytes(4)), sys.byteorder)


def is_reserved(fd: int) -> bool:
    """Tell whether a program has the port for itself; root is let in all the same."""
    return bool(int.from_bytes(fcntl.ioctl(fd, _TIOCGEXCL, bytes(4)), sys.byteorder))


def modem_lines(fd: int) -> int | None:
    """Return which modem lines are up, as bits; None where the port has no such lines."""
    try:
        return int.from_bytes(fcntl.ioctl(fd, termios.TIOCMGET, bytes(4)), sys.byteorder)
    except OSError as error:
        if error.errno in _NO_ANSWER:
            return None
        raise


def lower_lines(fd: int) -> None:
    """Lower DTR and RTS where there are such lines."""
    try:
        fcntl.ioctl(fd, termios.TIOCMBIC, (DTR | RTS).to_bytes(4, sys.byteorder))
    except OSError as error:
        if error.errno not in _NO_ANSWER:
            raise


def names(lines: int | None) -> str:
    """Return the modem lines that are up, in words."""
    if lines is None:
        return "none"
    return " ".join(name for bit, name in _LINES if lines & bit) or "all low"


def low_latency(fd: int, *, ask: bool) -> bool | None:
    """Return whether the driver hands bytes on at once, after asking it to; None: it does not say.

    Nothing is lost where it refuses, so no error leaves here.
    """
    try:
        record = bytearray(fcntl.ioctl(fd, termios.TIOCGSERIAL, bytes(_SERIAL.size)))
    except OSError:
        return None
    (flags,) = struct.unpack_from("@i", record, _SERIAL_FLAGS)
    if flags & _LOW_LATENCY or not ask:
        return bool(flags & _LOW_LATENCY)
    struct.pack_into("@i", record, _SERIAL_FLAGS, flags | _LOW_LATENCY)
    try:
        fcntl.ioctl(fd, termios.TIOCSSERIAL, bytes(record))
        record = bytearray(fcntl.ioctl(fd, termios.TIOCGSERIAL, bytes(_SERIAL.size)))
    except OSError:
        return False
    (flags,) = struct.unpack_from("@i", record, _SERIAL_FLAGS)
    return bool(flags & _LOW_LATENCY)


def divider(fd: int) -> Divider | None:
    """Return how the port makes its baud rate; None where the driver does not say."""
    try:
        record = fcntl.ioctl(fd, termios.TIOCGSERIAL, bytes(_SERIAL.size))
    except OSError:
        return None
    # type, line, port, irq, flags, xmit_fifo_size, custom_divisor, baud_base
    flags, _, custom, base = _SERIAL.unpack(record)[4:8]
    if base <= 0:
        return None
    spd = flags & _SPD_MASK
    other = base // custom if spd == _SPD_CUST and custom > 0 else _SPD.get(spd)
    return Divider(base, other, bool(flags & _MAGIC_MULTIPLIER))


def counters(fd: int) -> Counters | None:
    """Return the driver's counters; None where it has none, or is gone."""
    counted = _counted(fd)
    if counted is None:
        return None
    # cts, dsr, rng, dcd, rx, tx stand in front
    frame, overrun, parity, brk, buf_overrun = counted[6:11]
    return Counters(frame, parity, overrun, brk, buf_overrun)


def sent(fd: int) -> int | None:
    """Return how many bytes the driver has given to the line since it has it, if it counts them."""
    counted = _counted(fd)
    return None if counted is None else counted[5] % (1 << 32)


def _counted(fd: int) -> tuple[int, ...] | None:
    try:
        return _ICOUNTER.unpack(fcntl.ioctl(fd, termios.TIOCGICOUNT, bytes(_ICOUNTER.size)))
    except OSError:
        return None
