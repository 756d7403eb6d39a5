"""Inputs that are known by sight and not read: what they are, and what to do instead.

Every message is one line and ends in something the user can type or click.
"""

from __future__ import annotations

import re
from typing import Final, NamedTuple

from sniffer.ground.model import InputError
from sniffer.ground.patterns import later
from sniffer.ground.wording import Sentence
from sniffer.sources.logic_forms import ZIP_MAGIC


class _Kind(NamedTuple):
    pattern: re.Pattern[bytes]
    what: str
    instead: str


_PCAPNG: Final = "write it anew: `editcap -F pcapng FILE new.pcapng`"
_LINES: Final = "write it as lines `(seconds.fraction) bus0 #HEX`, or keep only the hex bytes"
_UNIT: Final = (
    "write the unit of times behind them (`12 ms TX: FF A0`), a point behind numbers of lines, or "
    "all of it as lines `(seconds.fraction) bus0 #HEX`"
)
_FORM: Final = (
    "write `(1732142106.123456) bus0 RX#FAAF01`: ten digits of seconds, bytes without blanks"
)
_SIGROK: Final = "write raw bytes with `sigrok-cli -i FILE -P uart:rx=... -B uart=rx > bus.bin`"
_CAPTURE: Final = "give the file that your logger wrote"
_WORDS: Final = "dump it again with `hexdump -C`, `xxd` or `od -tx1`"

_LOGIC_2: Final = "in Logic 2, File > Export raw data gives CSV or binary files that are"
_LOGIC_1: Final = "in Logic 1, export the data as VCD"
_DIGITAL: Final = "capture the line with a logic analyser, or a serial adapter"
_DUMPED: Final = "export it as a value change dump (VCD)"

_MAGICS: Final = (
    (b"\x34\xcd\xb2\xa1", "a modified pcap capture (a1b2cd34)", _PCAPNG),
    (b"\xa1\xb2\xcd\x34", "a modified pcap capture (a1b2cd34)", _PCAPNG),
    (b"\x89PNG\r\n\x1a\n", "a PNG image", _CAPTURE),
    (b"%PDF-", "a PDF document", _CAPTURE),
    (b"\x7fELF", "a program", _CAPTURE),
    (b"\x7f\x01\x05\x01\x09Data save", "a Saleae capture (.logicdata)", _LOGIC_1),
    (b"\x16\x00\x00\x00serialization::archive", "a Saleae capture (.logicdata)", _LOGIC_1),
    (b"AGILENT_BINARY_DATA", "a capture of an Agilent analyser", _DUMPED),
    (b":WFMPRE:", "a waveform of a Tektronix oscilloscope", _DIGITAL),
    (b"RIFF", "a RIFF file, such as .wav,", _DIGITAL),
    (b"RRF", "a Rerun recording (.rrd)", "decode the .mcap or the capture it was made from"),
    (
        b"=~=~=~=~=~=~=~=~=~=~=~= PuTTY log",
        "a log of PuTTY, which has a line of its own before the bytes,",
        "remove that line: `tail -n +2 FILE > bus.bin`",
    ),
    (b"PAR1", "a Parquet table", "decode the .mcap or the capture it was made from"),
    (
        b"\x1f\x8b\x08",
        "a gzip file in a packed one",
        "unpack it: `gunzip -c FILE | sniffer decode -`",
    ),
    (
        b"\x28\xb5\x2f\xfd",
        "a zstd file in a packed one",
        "unpack it: `zstd -dc FILE | sniffer decode -`",
    ),
    (b"\xfd7zXZ\x00", "an xz file", "unpack it: `xz -dc FILE | sniffer decode -`"),
    (b"BZh", "a bzip2 file", "unpack it: `bzip2 -dc FILE | sniffer decode -`"),
)

_IN_SAL: Final = (b"meta.json", b"digital-", b"analog-")  # in any order
_CHANNELS: Final = (
    rb"(?i)[\"']?times?\b[^,;]*"
    rb"(?:[,;] *[\"']?(?:ch|channel|d|di|dio|bit|pin)?[ _]?\d+[^,;]*)+$"
)
_SESSION: Final = "save the session: `sigrok-cli -i FILE -o wave.sr`"
_SOME: Final = (
    rb"(?:.*[^0-9A-Za-z])?(?:(?:0x|\\x)?[0-9A-Fa-f]{2}[ ,:-]{1,2}(?:0x)?[0-9A-Fa-f]{2}\b"
    rb"|[0-9a-f]{8}: [0-9a-f]{4} )"
)
"""Bytes in hex further on in the line, or a line of xxd."""

_STAMPED: Final = (
    rb"[\[(P]?(?:\d{4}[-/.]\d\d[-/.]\d\d|\d{1,2}[-/.]\d{1,2}[-/.]\d{4}|\d\d:\d\d:\d\d(?![:0-9])"
    rb"|\d+\.\d{3,9}(?= *[,;\])]? ))"
)
_KNOWN_TIME: Final = (
    rb"[\[(]?(?:\d{4}[-/]\d\d[-/]\d\d[ T])?\d\d:\d\d:\d\d(?:[.,]\d{1,9})?(?:Z|[+-]\d\d:?\d\d)?"
    rb"(?=[\s\])])"
)
"""As ``logstamps`` reads it: what is not taken of such a line stands behind it."""

_WAY: Final = (
    rb"(?:[\[(]?\b(?:[TtRr][Xx]|READ|WRITE|[Ii][Nn]|[Oo][Uu][Tt]|[RW])\b|<?-+>?|<+|>+)"
    rb"(?:[\]):]* |=)"
)
_TIMED: Final = "a log whose times are of an unknown kind"
_TABLE: Final = "a table of times and bytes of another tool"
_SPOKEN: Final = "a log whose directions are of an unknown kind"
_TRACED: Final = (
    rb"(?:\[pid +\d+\] |\d+ +)?(?:\d[\d:.]* )?(?:open(?:at)?|read|write|ioctl|poll|p?select6?)\("
)
_TRACE_WAY: Final = "log with `socat -x` between program and port"
_HEADED: Final = "a dump with a heading"
_ANEW: Final = "dump with `xxd` or `hexdump -C`"
_LITERAL: Final = rb"(?:(?:bytearray)?\()?b(?:'.*'|\".*\")\)?[\]\s,;)]*$"
_PRINTED: Final = "print `f'({time.time():.6f}) bus0 #{data.hex()}'`"
_DEBUGGED: Final = "let it write the bytes: gdb `dump binary memory bus.bin FROM TO`"
_CAUGHT: Final = "let tcpdump write the capture: `tcpdump -w FILE.pcap`"
_LISTED: Final = "keep only the brackets and the numbers between them"
_WRITTEN: Final = (
    rb"(?:let|var|val|auto)\b[^=]*=|(?:static|const) \w+:|\[\]byte\{|<Buffer "
    rb"|U?[Ii]nt8Array\b|.*\bfromhex\("
)
_PREFIXED: Final = rb"[A-Z][a-z]{2} [ \d]\d \d\d:\d\d:\d\d\b"
_DATE: Final = rb"\d{4}[-/]\d\d[-/]\d\d[ T]\d\d:\d\d:\d\d"
_LOGS: Final = tuple(
    _Kind(later(pattern), what, instead)
    for pattern, what, instead in (
        (
            rb"Time ?\[s\],Packet ID",
            "a Saleae table of addresses (MP mode)",
            "set the analyzer's mode to Normal and export again with the radix Hexadecimal",
        ),
        (rb"(?:\d+-\d+ )?uart-\d+: ", "a sigrok annotation log", _SIGROK),
        (
            rb"\d+-\d+ [^:]+: (?:[^:]+: )?[0-9A-Fa-f]{2}$",
            "a list of annotations of PulseView",
            _SIGROK,
        ),
        (rb":[0-9A-Fa-f]{10,}$", "an Intel hex file", "`objcopy -I ihex -O binary FILE bus.bin`"),
        (rb"S[0-3][0-9A-F]{8,}$", "an S-record file", "`objcopy -I srec -O binary FILE bus.bin`"),
        (
            rb"Id,Time\[ns\],",
            "a table of DSView's decoder",
            "open the capture (.dsl), or export it as CSV",
        ),
        (rb" +0x[0-9a-f]{4}:  ", "what tcpdump shows", _CAUGHT),
        (rb"\d\d:\d\d:\d\d\.\d{6} IP6? ", "what tcpdump shows", _CAUGHT),
        (rb"0x[0-9a-f]+(?: <[^>]*>)?: |\$\d+ = ", "what a debugger shows", _DEBUGGED),
        (rb" *\| [0-9a-f]{5}  ", "a trace of system calls", _TRACE_WAY),
        (
            _PREFIXED + rb" \S+ [^:]+: " + _SOME,
            "a log with the journal's prefix",
            "print the messages alone: `journalctl -o cat`",
        ),
        (_PREFIXED + rb" " + _SOME, _TIMED, _LINES),
        (rb"\d{9,}\.\d+ [0-9a-f]+: ", _TIMED, _LINES),
        (
            rb" *\[?\d{1,19}\]?[ :,;\t]+[\[(]?(?:[TtRr][Xx]|SEND|RECV|READ|WRITE)\b",
            "a log with numbers in front of which nobody says whether they are times",
            _UNIT,
        ),
        (rb"(?:Host|Device) *-->", _SPOKEN, _LINES),
        (rb"\d+,.*,IRP_MJ_|#,Time,|#\d+ +(?:Write|Read)\b", "a log of a port monitor", _LINES),
        (rb"\d{6}: .*\((?:UP|DOWN)\)", "a log of a port monitor", _LINES),
        (
            _WRITTEN,
            "an array as a program writes it",
            _LISTED,
        ),
        (
            rb"(?:[0-9A-Fa-f]{2}h[ ,]){2}|(?:[$%][0-9A-Fa-f]{2} ?){2}",
            "hex with a mark at each byte",
            "remove the marks: `tr -d 'h$%' < FILE | sniffer decode -`",
        ),
        (rb"[\"']?(?:\\[0-3][0-7]{2}){2}", "a list of bytes in octal", "write them in hex"),
        (
            rb"(?:[\"']?\w+[\"']?,)*[\"']?start_time\b",
            "a Saleae table of other columns",
            "export it again with all of them: name, type, start_time, duration, data",
        ),
        (rb" {4,}00 01 02 03 04 05 06 07 08 09 0A 0B 0C 0D 0E 0F$", _HEADED, _ANEW),
        (rb" *Offset(?:\(h\))? ", _HEADED, _ANEW),
        (rb"\d+ .* IRP_MJ_|#,Date/Time,Function", "a log of a port monitor", _LINES),
        (rb"(?i)[\"']?(?:\w+,)?(?:time|t)\b[^,]*,.*(?:byte|data|result|value)", _TABLE, _LINES),
        (
            _CHANNELS,
            "a table of the channels of an analyser or oscilloscope",
            f"{_DUMPED}, or with the head `Time [s],NAME` and levels 0 and 1",
        ),
        (
            rb"(?i)x-axis,|x,ch\d|model,|source,ch\d|record length,",
            "a table of an oscilloscope",
            _DIGITAL,
        ),
        (rb"\[ *\d+\.\d+\]" + _SOME, _TIMED, _LINES),
        (rb"[VDIWE] \(\d+\) [^:]+: " + _SOME, _TIMED, _LINES),
        (rb"(?:Sent|Received|Host|Device|Written|Read)\b.*\W[0-9A-Fa-f]{2}\b", _SPOKEN, _LINES),
        (rb"(?:TX|RX|tx|rx|<?-+>?|<+|>+)[:=]? ?(?:[0-9A-Fa-f]{2}){2,}$", _SPOKEN, _LINES),
        (
            rb"[0-9a-f]{8,16} \d+ [SCE] [BCIZ][io]:\d+:\d+:\d+ ",
            "usbmon's trace as text, which leaves bytes out,",
            "capture it: `dumpcap -i usbmon1 -w FILE.pcapng`",
        ),
        (rb"\d+\.\d{3,9},(?:0x)?[0-9A-Fa-f]{2}$", _TABLE, _LINES),
        (rb'\{"traceEvents"', "a sigrok JSON trace", _SIGROK),
        (_DATE + rb"\.\d+ \| [A-Z] \|", "a port sniffer log", _LINES),
        (rb"[IO] " + _DATE, "text2pcap input", _LINES),
        (rb"date [A-Z][a-z]{2} ", "a Vector ASC log", "log it with `candump -L` instead"),
        (rb"libsigrok \d", "sigrok's output as text", _SESSION),
        (rb"(?:[a-z]+seconds,)?logic(?:,logic)*$", "sigrok's CSV without its header", _SESSION),
        (rb"# ?CSV,? generated by libsigrok", "sigrok's CSV with other comments", _SESSION),
        (rb"; ?Rate: ?\d+", "a capture of the OLS client", "export it from there as VCD"),
        (
            rb"\(\d{1,10}(?:[.,]\d*)?\)[ \t]+(?=\S*[#()])\S+[ \t]+\w{0,8}#(?:[0-9A-Fa-f]{2})*$",
            "a log line of a bus with # or brackets in its name",
            "write it without: `(1732142106.123456) bus0 RX#FAAF01`",
        ),
        (rb"\(-?\d[\d.,]*\)[ \t]+\S+[ \t]+[^\s#]*#", "a log line of another form", _FORM),
        (_TRACED, "a trace of system calls", _TRACE_WAY),
        (
            rb"[\[(]?(?!b[\"'])[A-Za-z\d](?:.*[:= ,])?" + _LITERAL,
            "a log of bytes as Python shows them",
            _PRINTED,
        ),
        (
            _KNOWN_TIME + rb"(?:" + _SOME + rb"|.*\b(?:[0-9A-Fa-f]{2}){4,}\b)",
            "a log with other words between its times and its bytes",
            _LINES,
        ),
        (rb"(?!" + _KNOWN_TIME + rb")" + _STAMPED + _SOME, _TIMED, _LINES),
        (_WAY + _SOME, _SPOKEN, _LINES),
        (rb"timestamp,arbitration_id,", "a python-can CSV log", "log to a .log file instead"),
        (
            rb" *(?:\([\d.: -]+\) +)?\S+ +(?:[TR]X [-BE ]{3} +)?[0-9A-F]{3,8} +\[\d+\]",
            "candump's screen output",
            "log it with `candump -L` instead",
        ),
        (  # with a letter that no hex has
            rb"(?=[0-9A-Fa-f]*[G-Zg-z+/])(?:[A-Za-z0-9+/]{4}){5,}(?:[A-Za-z0-9+/]{2,3}={1,2})?\r?$",
            "base64",
            "`base64 -d FILE | sniffer decode -`",
        ),
    )
)
_NARROW: Final = "save it as UTF-8 or ASCII (PowerShell: `| Out-File -Encoding ascii FILE`)"
_WIDE: Final = 32  # bytes without a mark, of which every other one is none and the rest text
_TEXT: Final = frozenset(b"\t\r\n" + bytes(range(32, 127)))
_WORD_LINE: Final = later(rb"([0-9A-Fa-f]{6,8})((?: +[0-9A-Fa-f]+)+) *$")
_UNDER: Final = later(rb" {6,}\S")  # od's second type stands under the first
# numbers of up to three digits in columns, of which one at least has fewer: octal ones have zeros
_TRIPLES: Final = later(rb"(?=.*  +\d)[0-9A-Fa-f]{6,8}(?: (?:  \d| [1-9]\d|[12]\d\d))+ *$")
_SEVEN: Final = later(rb"[0-9A-Fa-f]{7} ")


def refused(what: str, instead: str) -> InputError:
    """Return the error that says what the input is and what to do instead."""
    return InputError(f"{what} is not read: {instead}")


def decimal_or_hex() -> InputError:
    """Return the error that asks of what radix numbers are."""
    return InputError(
        Sentence("this looks like decimal numbers: say {input_format:decimal} (or hex)")
    )


def decimal_dump() -> InputError:
    """Return the error that a dump has its bytes in decimal."""
    return refused("a dump in decimal (od -tu1)", "dump it again with `od -v -tx1`")


_TAR_AT: Final = 257
"""Where in the header of a tar archive its magic stands: POSIX, ustar interchange format."""


def refuse_binary(head: bytes, suffix: str = "") -> None:
    """Raise InputError where ``head`` begins a container that is no capture of bytes.

    ``suffix``: of the file, in lower case, where it has one.
    """
    for magic, what, instead in _MAGICS:
        if head.startswith(magic):
            raise refused(what, instead)
    if head[_TAR_AT:].startswith(b"ustar"):
        raise refused("a tar archive", "unpack it and decode what is in it")
    if head.startswith(ZIP_MAGIC):
        if suffix == ".sal" or any(name in head for name in _IN_SAL):
            raise refused("a Saleae capture (.sal)", _LOGIC_2)
        raise refused("a zip archive", "unpack it and decode what is in it")


def refuse_utf16(head: bytes) -> None:
    """Raise InputError where ``head`` is UTF-16 text; FF FE alone may be servo traffic."""
    for mark, high in ((b"\xff\xfe", head[3::2]), (b"\xfe\xff", head[2::2])):
        if head.startswith(mark) and len(high) > 1 and high.count(0) >= 0.9 * len(high):
            raise refused("UTF-16 text", _NARROW)
    for high, low in ((head[1:_WIDE:2], head[:_WIDE:2]), (head[:_WIDE:2], head[1:_WIDE:2])):
        if len(low) == _WIDE // 2 and not any(high) and all(c in _TEXT for c in low):
            raise refused("UTF-16 text", _NARROW)


def refuse_log(lines: list[bytes]) -> None:
    """Raise InputError where the first lines are a log of another tool."""
    for line in lines:
        for kind in _LOGS:
            if kind.pattern.match(line):
                raise refused(kind.what, kind.instead)


def refuse_words(lines: list[bytes]) -> None:
    """Raise InputError where the lines are a dump of words: whose byte order nobody knows."""
    if len(lines) > 1 and re.match(rb"[0-9A-Fa-f]{6,8} ", lines[0]) and _UNDER.match(lines[1]):
        raise refused("a dump in several types", "dump it again with `od -v -tx1`")
    if all(map(_TRIPLES.match, lines[:2])):
        raise decimal_dump()
    rows = [match for line in lines[:2] if (match := _WORD_LINE.match(line))]
    # seven digits are an offset: plain hex would have an even number
    if _SEVEN.match(lines[0]) or (len(rows) == 2 and _steps(rows)):
        what = "a dump of words (hexdump without -C, od without -tx1), bytes swapped in pairs,"
        raise refused(what, _WORDS)


def _steps(rows: list[re.Match[bytes]]) -> bool:
    """Tell whether the first token of both rows counts the words of the first."""
    words = rows[0][2].split()
    sizes = {len(word) for word in words}
    if sizes == {2}:
        return False
    counted = (1, 2, 4, 8) if len(sizes) == 1 else (1,)  # decimal ones have one to three digits
    for radix in (8, 10, 16):
        try:
            step = int(rows[1][1], radix) - int(rows[0][1], radix)
        except ValueError:
            continue
        if step in {size * len(words) for size in counted}:
            return True
    return False
