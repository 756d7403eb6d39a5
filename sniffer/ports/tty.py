"""Serial ports of Linux, opened for reading only and set up so that nothing is sent from then on.

What opening a port does to a bus, and what is done about it, in this order:

- A port that another program has locked, or has open without a lock, is not opened at all: its
  settings and its modem lines are that program's.
- A port that nobody has set up echoes what it hears, from within ``open`` on. So the echo is
  switched off by the very first calls, before any that the adapter must answer. What was sent until
  then cannot be taken back: whether the echo was on is a fact of the port.
- The kernel raises DTR and RTS before ``open`` returns, and an adapter whose driver is switched by
  RTS then holds the bus. Both are lowered next.
- Then come the other settings. What was heard before them is kept where the settings then let bytes
  pass as they are, else dropped. The kernel keeps them when the port is closed, until it is
  unplugged: the next opening finds no echo.
- Closing lowers DTR and RTS where ``HUPCL`` says so. They are low already; where they are to be
  kept, ``HUPCL`` is cleared.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer.ground.devices import is_pseudo
from sniffer.ground.model import InputError
from sniffer.ground.wording import Sentence
from sniffer.ports import kernel
from sniffer.ports.base import READ_MAX, PortLostError, forbidden, missing, no_port, shown
from sniffer.ports.drivers import NO_LINE, tells
from sniffer.ports.listing import UARTS, Holder, PortInfo, holders_of, port_at
from sniffer.ports.locks import locked_by, program
from sniffer.ports.rates import divides, refuse_other
from sniffer.ports.unmark import Unmarker

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.ground.model import Mark
    from sniffer.ports.base import Counters, PortOptions

HOST_NS: Final = 1_000_000
"""What a host takes at most, as a rule, from an interrupt to a read that returns."""

PTY_NS: Final = HOST_NS
"""A pseudo terminal holds nothing back: what is written can be read as soon as we are run."""

USB_FRAME_NS: Final = 1_000_000
"""A full-speed adapter is asked for data once in a frame (USB 2.0, 5.3.3)."""

UART_HOLDS: Final = 20
"""Bytes' time that a UART's FIFO may wait: a 16550A is emptied at 14 bytes at the latest and a
PL011 at 16, and both tell of a rest after a silence of four (data sheets of NS and ARM)."""

_TERMINALS_MAJOR: Final = 5  # /dev/tty, /dev/console, /dev/ptmx
_CONSOLES: Final = (4, range(64))  # /dev/tty0 to /dev/tty63, the same file
_GONE: Final = (errno.ENXIO, errno.EIO, errno.ENODEV)


EARLY_MAX: Final = 1 << 20
"""What may have been waiting in the port before it was opened, in bytes; a pty holds the most."""


class TtyPort:
    """A serial port, or a pseudo terminal that stands for one; see ``Port``."""

    pollable = True

    def __init__(self, name: str, options: PortOptions) -> None:
        self.name = name
        self.baud = options.baud
        try:
            found = _refuse_terminals(name)
            self._info = info = _info(name)
            self.path = _lasting(name, info)
        except OSError as error:  # it went away while it was looked at
            raise _explained(name, error, PortInfo(name)) from None
        self.is_virtual = is_pseudo(found)
        self.usb = info.usb
        self._tells = NO_LINE if self.is_virtual else tells(info)
        self.marks_errors = self._tells.marks
        self.counts_errors = self._tells.counts
        self._unmarker = Unmarker(widen=self.usb)
        self._early = b""
        if (pid := locked_by(found)) is not None:
            raise _busy(name, program(pid))
        self._rivals = [holder for holder in info.holders if holder.pid != os.getpid()]
        if self._rivals and not options.shared:
            raise _shared(name, self._rivals)
        try:
            self._fd = os.open(name, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        except OSError as error:
            raise _explained(name, error, info) from None
        try:
            self._facts = self._set_up(options, found, info)
        except OSError as error:
            os.close(self._fd)
            raise _explained(name, error, info) from None
        except BaseException:
            os.close(self._fd)
            raise

    def fileno(self) -> int:
        """Return the descriptor to wait for."""
        return self._fd

    def read(self) -> bytes:
        """Return what has come, still escaped; nothing where nothing is there."""
        if self._early:
            early, self._early = self._early, b""
            return early
        try:
            data = os.read(self._fd, READ_MAX)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise PortLostError(
                f"{shown(self.name)}: the port is gone ({error.strerror})"
            ) from None
        if not data:
            raise PortLostError(f"{shown(self.name)}: the port is gone (hung up)")
        return data

    def unmark(self, raw: bytes) -> tuple[bytes, tuple[Mark, ...]]:
        """Take the reads in order; return the bytes of the line and what is known of them."""
        return self._unmarker.take(raw)

    def set_baud(self, baud: int) -> None:
        """Listen at another baud; what has come and was not read is thrown away.

        Raises:
            InputError: the adapter cannot do it.
            PortLostError: the port is gone.
        """
        self.retune(baud)
        thrown = 0
        while thrown < EARLY_MAX and (waits := self.read()):  # the kernel gives it in pieces
            self.unmark(waits)  # which must see every escape to its end
            thrown += len(waits)

    def retune(self, baud: int) -> None:
        """Listen at another baud, and leave what has come: it may be of either.

        Only the settings of this port change, nothing is sent or thrown away.

        Raises:
            InputError: the adapter cannot do it.
            PortLostError: the port is gone.
        """
        try:
            before = kernel.settings(self._fd)
            kernel.set_settings(self._fd, before.listening(baud))
            got = kernel.settings(self._fd)
        except OSError as error:
            raise self._lost(error.strerror) from None
        true = refuse_other(self.name, baud, got, self._divider())
        self.baud = baud
        self.latency_ns = self._latency_ns()
        self._facts |= {"baud_asked": str(baud), "baud_got": str(true)}

    def counters(self) -> Counters | None:
        """Return the driver's counters; None where it has none, or never counts."""
        return None if self.counts_errors is False else kernel.counters(self._fd)

    def facts(self) -> dict[str, str]:
        """Return what a recording should say about the port."""
        return dict(self._facts)

    def close(self) -> None:
        """Let go of the port, without a change on its lines; once is enough."""
        fd, self._fd = self._fd, -1
        if fd >= 0:
            os.close(fd)

    def _set_up(
        self, options: PortOptions, found: os.stat_result, info: PortInfo
    ) -> dict[str, str]:
        """Make the port listen; return its facts."""
        fd = self._fd
        before = kernel.hush(fd)  # the first thing of all: see above
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if kernel.is_reserved(fd):
                raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
        except OSError as error:  # since we looked; what it has set stays so
            if before.echoes:
                kernel.set_settings(fd, before)
            if isinstance(error, BlockingIOError):
                raise _busy(self.name, program(locked_by(found) or 0)) from None
            raise
        opened = kernel.modem_lines(fd)
        if options.modem == "low":
            kernel.lower_lines(fd)
        keeps = options.modem == "keep"
        to = before.listening(options.baud, hangs_up=False if keeps else None)
        early = _rest(fd) if before.is_plain else b""
        plain = kernel.waiting(fd)
        kernel.set_settings(fd, to)
        known = kernel.waiting(fd)
        between = b"" if before.is_listening else _rest(fd)
        # An FF stands alone among the first of these and twice among the last; whether it does in
        # what came while the settings changed cannot be told, and without that there is a hole.
        kept = before.is_plain and b"\xff" not in between[plain:known]
        alone, twice = early + between[:plain], between[plain:]
        self._early = alone.replace(b"\xff", b"\xff\xff") + twice if kept else b""
        dropped = 0 if kept else len(early + between[:known] + _halved(between[known:]))
        lines = kernel.modem_lines(fd)
        if options.modem == "low" and lines and lines & (kernel.DTR | kernel.RTS):
            # leaving a baud rate of 0 raises them again
            kernel.lower_lines(fd)
            lines = kernel.modem_lines(fd)
        got = kernel.settings(fd)
        true = refuse_other(self.name, options.baud, got, self._divider())
        quick = kernel.low_latency(fd, ask=options.low_latency)
        timer_ms = self._timer_ms = _latency_timer_ms(info)
        self.latency_ns = self._latency_ns()
        return {
            "device": self.path,
            **_adapter(info),
            "baud_asked": str(options.baud),
            "baud_got": str(true),
            "echo_at_open": "on" if before.echoes else "off",
            "sent_since_plugged": self._sent(),
            "modem": options.modem,
            "modem_after_open": kernel.names(opened),
            "modem_after_lowering": "not lowered" if keeps else kernel.names(lines),
            "low_latency_asked": "yes" if options.low_latency else "no",
            "low_latency_got": {True: "yes", False: "no", None: "not known"}[quick],
            "latency_timer_ms": "none" if timer_ms is None else str(timer_ms),
            "locked": "yes",
            "also_open_in": _named(self._rivals) or ("none" if info.all_seen else "not known"),
            "line_errors": self._tells.words,
            "dropped_at_open": str(dropped),
        }

    def _lost(self, why: str | None) -> PortLostError:
        return PortLostError(f"{shown(self.name)}: the port is gone ({why})")

    def _latency_ns(self) -> int | None:
        return PTY_NS if self.is_virtual else latency_ns(self._info, self._timer_ms, self.baud)

    def _sent(self) -> str:
        """Return how many bytes the driver has sent since it has the port, an echo among them."""
        count = kernel.sent(self._fd) if self._tells.counts_sent else None
        return "not known" if count is None else str(count)

    def _divider(self) -> kernel.Divider | None:
        return kernel.divider(self._fd) if divides(self._info) else None


def _info(name: str) -> PortInfo:
    """Return what is known of a port before it is opened: who has it open, above all."""
    if (info := port_at(name)) is not None:
        return info
    path = os.path.realpath(name)
    holders, all_seen = holders_of(path)
    return PortInfo(path, holders=holders, all_seen=all_seen)


def _rest(fd: int) -> bytes:
    """Return what is there to be read."""
    out = b""
    with contextlib.suppress(BlockingIOError):
        while len(out) < EARLY_MAX and (data := os.read(fd, READ_MAX)):
            out += data
    return out


def _halved(escaped: bytes) -> bytes:
    """Return bytes of the line whose FF came twice."""
    return escaped.replace(b"\xff\xff", b"\xff")


def latency_ns(info: PortInfo, timer_ms: int | None, baud: int) -> int | None:
    """Return how long adapter and driver may hold bytes back; None where nobody says."""
    if timer_ms is not None:  # FTDI: bytes wait for a full packet or for this timer
        return timer_ms * 1_000_000 + HOST_NS
    if info.driver.startswith("ch341"):
        # Its driver switches off that the chip waits for a full packet (bit 7 in ch341.c).
        return USB_FRAME_NS + HOST_NS
    if not info.usb and info.chip in UARTS.values():
        return UART_HOLDS * 10 * 1_000_000_000 // baud + HOST_NS
    return None


def _latency_timer_ms(info: PortInfo) -> int | None:
    """Return the adapter's latency timer as it is now; asking for low latency changes it."""
    timer = Path("/sys/class/tty") / Path(info.path).name / "device/latency_timer"
    try:
        return int(timer.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None


def _adapter(info: PortInfo) -> dict[str, str]:
    """Return what is known about the adapter, without what is not."""
    ids = f"{info.vendor_id:04x}:{info.product_id:04x}" if info.usb else ""
    told = {"adapter": info.device, "chip": info.chip, "usb_id": ids, "driver": info.driver}
    return {key: text for key, text in told.items() if text}


def _lasting(name: str, info: PortInfo) -> str:
    """Return the name to open the port by again: a link is the user's own choice."""
    path = os.path.abspath(name)  # noqa: PTH100 - links must stay links
    return path if os.path.realpath(name) != path else info.stable or path


def _refuse_terminals(name: str) -> os.stat_result:
    """Raise InputError for devices that are none, and for the terminal that we run in."""
    found = Path(name).stat()
    major, minor = os.major(found.st_rdev), os.minor(found.st_rdev)
    # Opening some devices does something (a watchdog starts), so they are looked up first.
    kind = Path(f"/sys/dev/char/{major}:{minor}/subsystem")
    if kind.exists() and kind.resolve().name != "tty":
        raise no_port(name)
    is_console = major == _CONSOLES[0] and minor in _CONSOLES[1]
    is_ours = any(os.fstat(fd).st_rdev == found.st_rdev for fd in range(3) if _is_terminal(fd))
    is_used = is_pseudo(found) and _has_a_session(major, minor)
    if major == _TERMINALS_MAJOR or is_console or is_ours or is_used:
        what = "the terminal you type in" if is_ours else "a terminal"
        what += " that somebody types in" if is_used and not is_ours else ""
        raise InputError(
            f"{shown(name)} is {what}, no serial port; `sniffer ports` lists those that are here"
        )
    return found


def _has_a_session(major: int, minor: int) -> bool:
    """Tell whether a terminal controls processes: a shell runs in it. Source: proc_pid_stat(5)."""
    number = str((minor & 0xFF) | (major << 8) | ((minor & ~0xFF) << 12))
    for stat_file in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):  # that process has ended
            fields = stat_file.read_text(errors="replace").rpartition(")")[2].split()
            if fields[4:5] == [number]:
                return True
    return False


def _is_terminal(fd: int) -> bool:
    try:
        return os.isatty(fd)
    except OSError:  # closed
        return False


def _busy(name: str, who: str) -> InputError:
    return InputError(f"{shown(name)} is in use by {who}; end that first")


def _shared(name: str, rivals: Sequence[Holder]) -> InputError:
    told = (
        "{name} is open in {who}, and not locked: to open it would change its settings under that "
        "program, and take bytes from it; end that first, or say {shared:True}"
    )
    return InputError(Sentence(told, name=shown(name), who=_named(rivals)))


def _named(holders: Sequence[Holder]) -> str:
    return ", ".join(f"{holder.name} (process {holder.pid})" for holder in holders)


def _explained(name: str, error: OSError, info: PortInfo) -> InputError:
    """Turn what the system says about a port into an InputError."""
    if isinstance(error, FileNotFoundError):
        return missing(name)
    if isinstance(error, PermissionError):
        return forbidden(name)
    if error.errno == errno.ENOTTY:
        return no_port(name)
    if error.errno == errno.EBUSY:
        others = [program(holder.pid) for holder in info.holders]
        return _busy(name, ", ".join(others) or "another program")
    if error.errno in _GONE:
        return InputError(
            f"{shown(name)}: nothing answers behind it ({error.strerror}); "
            "`sniffer ports` lists the ports that are here"
        )
    return InputError(f"{shown(name)}: cannot be opened ({error.strerror})")
