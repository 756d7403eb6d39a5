"""Which format an input has, told by its first 64 KiB; the suffix decides only where those cannot.

Strong shapes first (offsets that count, times, this tool's own records), then the logs that are
refused by name, then plain hex, which nearly anything short could be. What is no text is bytes.
"""

from __future__ import annotations

import itertools
import re
from typing import Final

from sniffer.ground.model import InputError
from sniffer.ground.patterns import later
from sniffer.ground.wording import Sentence
from sniffer.messages import MAGIC
from sniffer.pcapfile.layout import BYTE_ORDERS, PCAP_MAGICS, PCAPNG_MAGIC
from sniffer.sources import candump, jsonl, labelled
from sniffer.sources.hexdump import HEXDUMP, OD, XXD, Dialect, DumpLine, bytes_in, counted, tidy
from sniffer.sources.locales import with_points
from sniffer.sources.logbytes import LSS_LINE
from sniffer.sources.logic_forms import logic_form
from sniffer.sources.misreads import refuse_decimal_dump, refuse_gutter, refuse_misread
from sniffer.sources.plain import BadLineError, bare, decimal_line, hex_line, share_of_hex
from sniffer.sources.refusals import (
    decimal_or_hex,
    refuse_binary,
    refuse_log,
    refuse_utf16,
    refuse_words,
    refused,
)
from sniffer.sources.text import FIRST_LINES, UTF8_BOM, quoted
from sniffer.sources.toollogs import tool_log

HEAD: Final = 1 << 16
"""Bytes that recognition may look at."""

RAW_SUFFIXES: Final = frozenset({".bin", ".dat", ".raw"})
MCAP_MAGIC: Final = MAGIC[:5]  # of any version

_CONTROL: Final = bytes(set(range(32)) - set(b"\t\n\v\f\r")) + b"\x7f"
_CARRIAGE: Final = later(rb"\r(?!\n)")
_AROUND: Final = later(rb"^[ \t]*(?:[-+]|\d{1,6}[.)])[ \t]+|[ \t]{1,8}(?://|[(;]).*$")
"""A mark of a list in front of a line of text, a note behind it."""

_COLOUR: Final = later(rb"\x1b\[[0-9;]*m")
_LIST: Final = later(rb"[{\[(]")
_LISTED: Final = later(rb"[0-9]+")
_BETWEEN: Final = b" ,;:<>{}[]()\"'xX\\-"
_OD_OF_NOTHING: Final = b"0000000"
_MOSTLY: Final = 0.6  # share of hex tokens that makes the rest of a line a mistake in hex
_FENCE: Final = b"```"
_FEW_DIGITS: Final = 8  # so short a text of hex digits may as well be raw bytes
_FORMATS: Final = "give raw bytes, or a dump made by `xxd` or `hexdump -C`"


def recognise(head: bytes, suffix: str = "") -> str:
    """Return the name of the format that ``head`` begins.

    ``suffix`` is the file's, with its dot. Raises InputError, without the input's name, where it
    is nothing that is read.
    """
    if not head:
        return "bin"
    if head.startswith(MCAP_MAGIC):
        return "mcap"
    if _is_pcap(head):
        return "pcap"
    text = with_points(head.removeprefix(UTF8_BOM))
    if found := logic_form(text, suffix):
        return found
    refuse_binary(head, suffix)
    refuse_utf16(head)
    if _is_lss(text):
        return "bin"
    lines = _lines(text)
    if not lines:
        return _raw_or_refused(text, suffix, "there are only blank lines: nothing to decode")
    found = _strong(lines)
    if found:
        return found
    if not is_printable(b"\n".join(lines[:FIRST_LINES])):
        _refuse_colours(lines)
        return "bin"
    first = lines[:FIRST_LINES]
    ended_so = [line for line in labelled.lines_of(text) if line.strip()][:FIRST_LINES]
    if len(ended_so) > len(lines) == 1 and labelled.is_log(ended_so):
        return "labelled"
    refuse_log(labelled.others(first))
    if labelled.is_log(first):
        return "labelled"
    labelled.refuse_bare(first)
    refuse_log(first)
    refuse_words(lines)
    refuse_gutter(lines)
    _refuse_bits(lines[:FIRST_LINES])
    if suffix not in RAW_SUFFIXES and _is_decimal_only(lines):
        return "decimal"
    if _is_plain_hex(lines, suffix in RAW_SUFFIXES):
        refuse_misread(lines)
        return "hex"
    return _raw_or_refused(text, suffix, _why_not(lines))


def _is_pcap(head: bytes) -> bool:
    return head[:4] in PCAP_MAGICS or (head[:4] == PCAPNG_MAGIC and head[8:12] in BYTE_ORDERS)


def _lines(text: bytes) -> list[bytes]:
    lines = text.split(b"\n")
    if len(lines) > 1 and len(text) >= HEAD - len(UTF8_BOM):
        lines.pop()  # the head may end anywhere
    return [tidy(line) for line in lines if line.strip()]


def is_printable(text: bytes) -> bool:
    """Tell whether bytes are signs of a text, in any encoding that begins as ASCII does."""
    return len(text.translate(None, _CONTROL)) == len(text)


def _is_text(text: bytes) -> bool:
    try:
        text.decode()
    except UnicodeDecodeError as error:
        # the head may end in mid-character
        return error.start >= len(text) - 3 and len(text) >= HEAD - len(UTF8_BOM)
    return is_printable(text)


def _raw_or_refused(text: bytes, suffix: str, why: str) -> str:
    if suffix in RAW_SUFFIXES or not _is_text(text):
        return "bin"
    raise InputError(why)


def _is_lss(text: bytes) -> bool:
    """Tell raw LSS traffic, which is text, from dumps, comments and ``*`` lines."""
    lines = [
        _AROUND.sub(b"", line).strip()
        for line in re.split(rb"[\r\n]+", text[:4096])
        if line.strip()
    ]
    spoken = [line for line in lines if LSS_LINE.fullmatch(line)]
    if not spoken:
        return False
    # hex with comments like "#5QD" exists too: it has no answers, and no bare carriage returns
    sure = _CARRIAGE.search(text[:4096]) or any(line[:1] == b"*" for line in spoken)
    return len(spoken) == len(lines) or bool(sure and 2 * len(spoken) >= len(lines))


def _strong(lines: list[bytes]) -> str:
    """Return the format whose shape the first line has beyond doubt."""
    first = next((line for line in lines if not line.startswith(b"#")), b"")
    if first.startswith(b"{"):
        record = jsonl.record_in(first)
        if record is not None and record["type"] in jsonl.TYPES:
            return "jsonl"
    if candump.is_line(first) and (first[:1] == b"(" or not _is_hex(first.split()[0])):
        return "candump"
    if candump.are_nameless([line for line in lines if not line.startswith(b"#")]):
        return "candump"
    if found := tool_log(lines):
        return found
    first = lines[0]
    parts = XXD.split(first)
    if bytes_in(XXD, parts) or (parts and parts.gutter):
        _refuse_xxd_variants(lines)
        return "xxd" if bytes_in(XXD, parts) else ""
    if _is_dump(OD, lines):
        refuse_decimal_dump(lines)
        return "od"
    return "hexdump" if _is_dump(HEXDUMP, lines) else ""


def _is_hex(text: bytes, marks: bytes = b"") -> bool:
    return not text.translate(None, b"0123456789abcdefABCDEF" + marks)


def _is_dump(dialect: Dialect, lines: list[bytes]) -> bool:
    first = lines[0]
    parts = dialect.split(first)
    data = bytes_in(dialect, parts)
    if parts is None or not data:
        return dialect is OD and first == _OD_OF_NOTHING
    if dialect is OD:
        if b">" in first:
            return first.endswith(b"<")
        # an odd number of digits is no plain hex; an even one must count the bytes
        return len(parts.offset) == 7 or (_spaces(first, parts) != 2 and _counts(OD, lines))
    if b"|" in first:
        return True
    # Wireshark's window copies with three, od -td1 writes single numbers so
    spaces = 2 if len(data) < 2 else _spaces(first, parts)
    if _spaces(first, parts) != spaces or spaces not in (2, 3):
        return False
    return not parts.offset.strip(b"0") or _counts(HEXDUMP, lines)


def _spaces(line: bytes, parts: DumpLine) -> int:
    rest = line.lstrip(b" ")[len(parts.offset) :]
    return len(rest) - len(rest.lstrip(b" "))


def _counts(dialect: Dialect, lines: list[bytes]) -> bool:
    return counted(dialect, lines)[1] > 0


def _refuse_xxd_variants(lines: list[bytes]) -> None:
    """Raise InputError for ``xxd -b`` and, where the gutter gives it away, for ``xxd -e``."""
    for line in lines:
        parts = XXD.split(line)
        if parts is None:
            return
        groups = parts.pairs.split()
        bits = all(len(group) == 8 and not group.strip(b"01") for group in groups)
        if groups and bits and len(parts.gutter) == len(groups):
            raise refused("a dump in bits (xxd -b)", "dump it again with plain `xxd`")
        data = bytes_in(XXD, parts) or b""
        swapped = b"".join(bytes.fromhex(group.decode())[::-1] for group in groups if data)
        moved = parts.gutter and not groups  # a short last group of xxd -e stands to the right
        if moved or _shown(swapped) == parts.gutter != _shown(data):
            raise refused(
                "a dump in little-endian words (xxd -e)", "dump it again with plain `xxd`"
            )


def _shown(data: bytes) -> bytes:
    return bytes(byte if 32 <= byte < 127 else 0x2E for byte in data).rstrip()


def _refuse_colours(lines: list[bytes]) -> None:
    if not any(map(_COLOUR.search, lines[:FIRST_LINES])):
        return
    plain = [_COLOUR.sub(b"", line) for line in lines]
    if _strong(plain):
        raise refused("a dump with terminal colours", "dump it without them: `xxd -R never`")
    if labelled.is_log(plain[:FIRST_LINES]):
        without = r"remove them: `sed 's/\x1b\[[0-9;]*m//g' < FILE | sniffer decode -`"
        raise refused("a log with terminal colours", without)


def _refuse_bits(lines: list[bytes]) -> None:
    """Raise InputError where all there is are groups of eight digits 0 and 1."""
    words = b" ".join(lines).split()
    if len(words) > 1 and all(len(word) == 8 and not word.strip(b"01") for word in words):
        raise refused("a list of bits", "write the bytes in hex")


def _is_plain_hex(lines: list[bytes], raw: bool) -> bool:
    """Tell whether the text is meant to be hex; mistakes in it are the reader's to report.

    ``raw``: the suffix says raw bytes, so hex must be more than a few digits without mistake.
    """
    stated = 0
    seen = 0
    for line in lines:
        try:
            data = hex_line(line)
        except BadLineError:
            if raw:
                return False
            if any(len(number) == 3 for number in _LISTED.findall(line)):
                _refuse_decimal(lines[:FIRST_LINES])
            return seen > 0 or _is_hex(bare(line), _BETWEEN) or share_of_hex(line) > _MOSTLY
        stated += len(data)
        seen += bool(data)
        if seen == FIRST_LINES:
            break
    # in the languages that write lists so, numbers without 0x are decimal
    if stated and any(_LIST.search(bare(line)) for line in lines[:FIRST_LINES]):
        _refuse_decimal(lines[:FIRST_LINES])
    return 2 * stated > (_FEW_DIGITS if raw else 0)


def _is_decimal_only(lines: list[bytes]) -> bool:
    """Tell whether every number is a decimal one, and one at least nothing else.

    Three digits are no byte in hex. In octal they are, and offsets have more of them or count.
    """
    rows: list[list[bytes]] = []
    try:
        for line in lines:
            decimal_line(line)
            rows.append(_LISTED.findall(bare(line)))
    except BadLineError:
        return False
    tokens = [token for row in rows for token in row]
    lengths = {len(token) for token in tokens}
    is_octal = lengths == {3} and not b"".join(tokens).translate(None, b"01234567")
    return max(lengths, default=0) == 3 and not is_octal and not _begin_with_offsets(rows)


def _begin_with_offsets(rows: list[list[bytes]]) -> bool:
    """Tell whether the first number of each line counts those behind it, in any radix."""
    pairs = list(itertools.pairwise(filter(None, rows)))
    for radix in (8, 10, 16):
        try:
            steps = [(int(b[0], radix) - int(a[0], radix), len(a) - 1) for a, b in pairs]
        except ValueError:  # a digit that this radix does not have
            continue
        if steps and all(step == size > 0 for step, size in steps):
            return True
    return False


def _refuse_decimal(lines: list[bytes]) -> None:
    """Raise InputError where every number is a decimal one."""
    try:
        stated = b"".join(map(decimal_line, lines))
    except BadLineError:
        return
    if stated:
        raise decimal_or_hex()


def _why_not(lines: list[bytes]) -> str:
    if lines[0].startswith(_FENCE):
        return "this is text in a fence of Markdown: `grep -v '```' FILE | sniffer decode -`"
    for number, _ in enumerate(lines[1:FIRST_LINES], 2):
        found = _strong(lines[number - 1 :])
        if found:
            return (
                f"line 1, {quoted(lines[0])}, is no part of a dump, but {found} seems to begin"
                f" further down: remove the lines before it"
            )
    return Sentence(
        "this is text, but no dump that is read ({line}): {formats}; if the text itself is the "
        "traffic, say {input_format:bin}",
        line=quoted(lines[0]),
        formats=_FORMATS,
    )
