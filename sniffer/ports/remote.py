"""Ports that pySerial opens: addresses on the network, and the devices of other systems.

pySerial clears the kernel's error marks, so nothing is known here about line errors. It may open a
device for writing too; nothing is ever written to it from here.
"""

from __future__ import annotations

import contextlib
import errno
import os
import queue
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import InputError
from sniffer.ports.base import READ_MAX, PortLostError, forbidden, missing, shown

if TYPE_CHECKING:
    from sniffer.ground.model import Mark
    from sniffer.ports.base import Counters, PortOptions

FIRST_BYTE_S: Final = 0.1
"""How long a read waits for the first byte, in seconds, where there is nothing to poll."""

_NO_ADDRESS: Final = "no kind of address that is known"
_BUSY: Final = (errno.EAGAIN, errno.EBUSY)
_LOST: Final = (OSError, TypeError)  # pySerial's errors; it stumbles over a port closed meanwhile


class SerialPort:
    """A device or an address, opened with pySerial; see ``Port``."""

    marks_errors: bool | None = None
    counts_errors: bool | None = None
    usb = False
    latency_ns: int | None = None

    def __init__(self, name: str, options: PortOptions) -> None:
        import serial

        self.name = self.path = name
        self.baud = options.baud
        self._is_address = "://" in name
        self._is_rfc2217 = name.lower().startswith("rfc2217://")
        self._lost: str | None = None
        self.is_virtual = self._is_address and not self._is_rfc2217
        # A connection can be polled; of the other kinds some run a thread, or are no file at all.
        self.pollable = name.lower().startswith("socket://")
        if not self._is_address and os.name == "posix":
            self.path = os.path.abspath(name)  # noqa: PTH100 - links must stay links
        try:
            self._serial: Any = serial.serial_for_url(name, do_not_open=True)
        except ValueError:
            raise InputError(f"{shown(name)}: {_NO_ADDRESS}") from None
        try:
            self._serial.baudrate = options.baud
            self._serial.timeout = 0 if self.pollable else FIRST_BYTE_S
            self._serial.exclusive = True
            if options.modem == "low":
                # raised by the system for a moment all the same, but not by pySerial
                self._serial.dtr = self._serial.rts = False
            self._modem = options.modem
            if self._is_address:
                # opening ends with throwing away what has come, with RFC 2217 at the far end too
                opened: Any = self._serial
                opened.reset_input_buffer = opened.reset_output_buffer = _leave
            self._serial.open()
        except Exception as error:  # each kind of address has its own, of any class
            raise self._explained(error) from None

    def fileno(self) -> int:
        """Return the descriptor to wait for; OSError where there is none."""
        return int(self._serial.fileno())

    def read(self) -> bytes:
        """Return what has come; where it cannot be polled, wait a little for the first byte.

        What came before the port was lost is returned first.
        """
        data = b""
        try:
            if self._lost is None:
                data += self._serial.read(READ_MAX if self.pollable else 1)
                if data and not self.pollable:
                    more = min(self._serial.in_waiting, READ_MAX - 1)
                    data += self._serial.read(more) if more else b""
        except _LOST as error:
            self._lost = f"{shown(self.name)}: the port is gone ({error})"
        if self._lost is not None:
            data += self._left(READ_MAX - len(data))
            if not data:
                raise PortLostError(self._lost)
        return data

    def unmark(self, raw: bytes) -> tuple[bytes, tuple[Mark, ...]]:
        """Return the bytes as they are: there is nothing in between."""
        return raw, ()

    def counters(self) -> Counters | None:
        """Return None: pySerial does not know."""
        return None

    def facts(self) -> dict[str, str]:
        """Return what a recording should say about the port."""
        return {
            "device": self.path,
            "driver": f"pySerial, {type(self._serial).__module__}",
            "baud_asked": str(self.baud),
            "baud_got": "not known" if self._is_address else str(self._serial.baudrate),
            "modem": self._modem,
            "line_errors": "not known",
        }

    def close(self) -> None:
        """Let go of the port."""
        self._serial.close()

    def _left(self, most: int) -> bytes:
        """Return what an RFC 2217 connection that is lost holds: its ``read`` looks no more."""
        held = getattr(self._serial, "_read_buffer", None)
        out = bytearray()
        if self._is_rfc2217 and isinstance(held, queue.Queue):
            with contextlib.suppress(queue.Empty):
                while len(out) < most:
                    out += held.get_nowait() or b""  # None: its end
        return bytes(out)

    def _explained(self, error: Exception) -> InputError:
        """Turn what pySerial says into an InputError."""
        number = error.errno if isinstance(error, OSError) else None
        if number == errno.ENOENT and not self._is_address:
            return missing(self.name)
        if number == errno.EACCES and not self._is_address and os.name == "posix":
            return forbidden(self.name)
        if number in _BUSY:
            return InputError(f"{shown(self.name)} is in use by another program; end that first")
        # what the system said stands behind what pySerial made of it
        cause = error.__context__ if isinstance(error.__context__, OSError) else error
        why = (cause.strerror if isinstance(cause, OSError) else None) or str(cause)
        why = " ".join(why.split())
        if self._is_address:
            advice = "check host and port, and that its server runs"
            return InputError(f"{shown(self.name)}: cannot be reached ({why}); {advice}")
        advice = "`sniffer ports` lists those that are here"
        return InputError(f"{shown(self.name)}: cannot be opened ({why}); {advice}")


def _leave() -> None:
    """Throw nothing away."""
