"""Which tool wrote a log, told by its first lines; what of its options is not read is said here."""

from __future__ import annotations

from typing import Final

from sniffer.ground.patterns import later
from sniffer.sources import (
    docklight,
    grabserial,
    interceptty,
    jpnevulator,
    saleae,
    socat,
    spy,
)
from sniffer.sources.refusals import refused
from sniffer.sources.text import FIRST_LINES

_LITERAL: Final = later(rb"(?:bytearray\(|bytes\()?b[\"']")


def tool_log(lines: list[bytes]) -> str:
    """Return the name of the format that ``lines`` begin, nothing where it is none of these.

    Raises InputError where the tool was told to write what cannot be read.
    """
    if spy.is_log(lines[:FIRST_LINES]):
        return "spy"
    if _is_jpnevulator(lines[:FIRST_LINES]):
        return "jpnevulator"
    table = lines[: FIRST_LINES + 1]
    if saleae.TABLE_1.match(table[0]) or saleae.TABLE_2.match(table[0]):
        if not saleae.is_hexadecimal(table):
            raise refused("a Saleae table in this radix", saleae.HEXADECIMAL)
        return "saleae"
    if docklight.is_docklight(lines[:FIRST_LINES]):
        return "docklight"
    said = next((line for line in lines if not line.startswith(b"#")), b"")
    if interceptty.is_line(said):
        return "interceptty"
    if grabserial.is_row(lines[0]):
        return "grabserial"
    return "socat" if _is_socat(lines) else ""


def _is_jpnevulator(lines: list[bytes]) -> bool:
    for line in lines:
        if stamp := jpnevulator.STAMP.fullmatch(line):
            # a program of one's own may write bytes where this tool writes the port
            return not _LITERAL.match(stamp[4] or b"")
        if not jpnevulator.is_row(line):  # of a block whose begin was cut away
            return False
    return False


def _is_socat(lines: list[bytes]) -> bool:
    """Tell whether the first line that is not socat's talk is the header of a block."""
    said = [line for line in lines if not socat.TALK.match(line) and line != b"--"]
    if not said or not socat.HEADER.match(said[0]):
        return False
    if len(said) > 1 and not socat.is_row(said[1]):
        raise refused("a socat log without the bytes", _IN_HEX)
    return True


_IN_HEX: Final = "log it with `socat -x`, or `socat -x -v`"
