"""Inputs, whatever their format, as groups of chunks: ``open_source(path)`` and iterate.

One group is about 256 KiB of payload, because the decoder's cost is per pass; files larger than
memory stream through. What cannot be read at all raises InputError when it is opened; a file that
is damaged further in yields what came before and then raises DamagedInputError.
"""

from __future__ import annotations

import contextlib
import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.limits import GROUP, GROUP_CHUNKS
from sniffer.ground.model import Chunk, DamagedInputError, InputError, SnifferError
from sniffer.ground.runs import ChunkRun
from sniffer.ground.wording import Sentence, offered
from sniffer.sources.binary import read_binary
from sniffer.sources.candump import read_candump
from sniffer.sources.docklight import read_docklight
from sniffer.sources.grabserial import read_grabserial
from sniffer.sources.grouping import ManyBusesError, grouped
from sniffer.sources.hexdump import read_hexdump, read_od, read_xxd
from sniffer.sources.interceptty import read_interceptty
from sniffer.sources.jpnevulator import read_jpnevulator
from sniffer.sources.jsonl import read_jsonl
from sniffer.sources.labelled import read_labelled
from sniffer.sources.logic_forms import LABELS, ZIPPED
from sniffer.sources.opening import Origin, Spooled, find
from sniffer.sources.packed import unpacked
from sniffer.sources.plain import read_decimal, read_hex
from sniffer.sources.recognise import HEAD, recognise
from sniffer.sources.refusals import refuse_utf16
from sniffer.sources.saleae import read_saleae
from sniffer.sources.socat import read_socat
from sniffer.sources.source import Source
from sniffer.sources.spy import read_spy
from sniffer.sources.text import DamagedLine, Opened

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.ground.registers import RegisterMap
    from sniffer.ground.wiring import Wiring
    from sniffer.sources.logic import LogicCapture

__all__ = ["SOURCES", "SingleSource", "Source", "open_source"]

Reader = Callable[[Opened], Iterator[Chunk | ChunkRun]]

LAG_S: Final = 0.1
"""A slow input is handed on after this time, in seconds, however little has come."""


def _read_mcap(opened: Opened) -> Iterator[Chunk]:
    assert opened.path is not None, "open_source spools what has none"
    from sniffer.mcapfile import source

    try:
        yield from source.chunks(opened.path)
    except SnifferError as error:
        # what was spooled has a name that says nothing
        told = str(error).replace(str(opened.path), opened.name)
        raise type(error)(told) from None


def _read_pcap(opened: Opened) -> Iterator[Chunk]:
    from sniffer.pcapfile.source import PcapSource

    try:
        yield from PcapSource(opened.stream, opened.bus, opened.notes)
    except SnifferError as error:
        raise type(error)(f"{opened.name}: {error}") from None


def _levels(form: str) -> Reader:
    """Return the reader of a form of captures of levels, all of them found from the edges."""

    def read(opened: Opened) -> Iterator[Chunk]:
        from sniffer.sources.logic import LogicCapture

        return LogicCapture(lambda: contextlib.nullcontext(opened), form).chunks()

    return read


SOURCES: Final[Mapping[str, Reader]] = MappingProxyType(
    {
        "bin": read_binary,
        "hex": read_hex,
        "decimal": read_decimal,
        "xxd": read_xxd,
        "hexdump": read_hexdump,
        "od": read_od,
        "candump": read_candump,
        "socat": read_socat,
        "jpnevulator": read_jpnevulator,
        "spy": read_spy,
        "docklight": read_docklight,
        "interceptty": read_interceptty,
        "grabserial": read_grabserial,
        "labelled": read_labelled,
        "saleae": read_saleae,
        "jsonl": read_jsonl,
        "pcap": _read_pcap,
        "mcap": _read_mcap,
        **{form: _levels(form) for form in LABELS},
    }
)
"""Readers by the name of their format, as ``--input-format`` knows it."""

_BINARY: Final = frozenset({"bin", "pcap", "mcap", *LABELS})
"""Formats that are no text: they have no lines."""

MIXED: Final = frozenset({"candump"})
"""Formats of inputs that name a wire and may be mixed; what this tool wrote has one order."""

_LABELS: Final[Mapping[str, str]] = {
    "bin": "raw bytes, no times",
    "hex": "plain hex, no times",
    "decimal": "decimal numbers, no times",
    "xxd": "an xxd dump, no times",
    "hexdump": "a hexdump -C dump, no times",
    "od": "an od -tx1 dump, no times",
    "candump": "log lines with times in the manner of candump -L",
    "socat": "a log of socat -x",
    "jpnevulator": "a log of jpnevulator",
    "spy": "a log of pySerial's spy://",
    "docklight": "a log of Docklight in HEX",
    "interceptty": "a log of interceptty",
    "grabserial": "a log of grabserial in hex",
    "labelled": "bytes in hex behind times or directions",
    "saleae": "a table of Saleae's Async Serial analyzer",
    "jsonl": "frames and gaps as this tool writes them to JSON lines",
    "pcap": "a capture of Wireshark's kind (pcap, pcapng)",
    "mcap": "an MCAP recording",
    **LABELS,
}


class SingleSource(Source):
    """One input that is recognised; ``format`` is its name in :data:`SOURCES`."""

    def __init__(
        self, origin: Origin, input_format: str, bus: str, wiring: Wiring | None = None
    ) -> None:
        super().__init__(origin.name, input_format)
        self._origin = origin
        self.bus = bus
        self._first = GROUP, GROUP_CHUNKS
        self._known: Mapping[str, str] | None = None
        self._levels: LogicCapture | None = None
        if input_format in LABELS:
            from sniffer.sources.logic import LogicCapture

            self._levels = LogicCapture(self._opened, input_format, wiring)

    @property
    def label(self) -> str:
        """What kind of input it is, in words."""
        return _LABELS[self.format]

    @property
    def is_mixed(self) -> bool:
        """Whether lines of two taps may be mixed in it, by their host."""
        return self.format in MIXED

    @property
    def path(self) -> Path | None:
        """The file that it is read from; None where it is none, or several."""
        return self._origin.path

    @property
    def size(self) -> int | None:
        """Bytes of its file; None where it is none."""
        return None if self._origin.path is None else self._origin.path.stat().st_size

    def hasten(self, payload: int, chunks: int) -> None:
        """Let the first group have no more than so many bytes and chunks: somebody waits for it."""
        self._first = payload, chunks

    def __iter__(self) -> Iterator[Sequence[Chunk]]:
        lag_s = LAG_S if self._origin.live else math.inf
        if self._levels is None or not self._levels.is_ahead:
            self.notes.clear()
        if self._levels is not None:
            yield from self._told(self._levels.groups(lag_s))
            return
        with self._opened() as opened:
            yield from self._told(grouped(SOURCES[self.format](opened), lag_s, self._first))

    @contextlib.contextmanager
    def _opened(self) -> Iterator[Opened]:
        with self._origin.open() as stream:
            yield Opened(stream, self.name, self._origin.path, self.bus, self.notes)

    def _told(self, groups: Iterable[Sequence[Chunk]]) -> Iterator[Sequence[Chunk]]:
        """Add the input's name to what is wrong with it."""
        read = False
        try:
            for group in groups:
                read = True
                yield group
        except DamagedLine as damage:
            kind = DamagedInputError if read else InputError
            raise kind(f"{self.name}, {damage}") from None
        except ManyBusesError as error:
            raise DamagedInputError(f"{self.name}: {error}") from None

    def facts(self) -> Mapping[str, str]:
        """Return what a recording knows about itself: protocol and baud by bus, models.

        Of a capture of levels it is what was found from its edges.
        """
        if self._levels is not None:
            return self._levels.facts()
        if self.format == "pcap":
            return self._facts_of_pcap()
        if self.format != "mcap" or self._origin.path is None:
            return {}
        from sniffer.mcapfile import source

        return source.session(self._origin.path)

    def _facts_of_pcap(self) -> Mapping[str, str]:
        from sniffer.pcapfile.source import facts_of

        if self._known is None:
            if self._origin.live:  # what is read of it now would be missing later
                self._known = facts_of(io.BytesIO(self._origin.head), self.bus)
            else:
                with self._origin.open() as stream:
                    self._known = facts_of(stream, self.bus)
        return self._known

    def tables(self) -> list[RegisterMap]:
        """Return the register tables that are attached to a recording."""
        if self.format != "mcap" or self._origin.path is None:
            return []
        from sniffer.mcapfile import source

        return source.tables(self._origin.path)

    def rehearse(self) -> None:
        """Read the head only, so that a mistake in the first lines shows before any output.

        A capture of levels is read until its channels are known.
        """
        if self._levels is not None:
            self._levels.settle()
            return
        head = self._origin.head
        if len(head) >= HEAD and self.format not in _BINARY:
            head = head[: head.rfind(b"\n") + 1]
        opened = Opened(io.BytesIO(head), self.name, self._origin.path, self.bus)
        with contextlib.suppress(DamagedInputError):  # it comes again, behind what can be read
            next(self._told(grouped(SOURCES[self.format](opened), math.inf)), None)

    def close(self) -> None:
        """Release an input that is not read to its end."""
        if self._levels is not None:
            self._levels.close()
        self._origin.close()


def open_source(
    path: str | Path | bytes | bytearray | memoryview,
    input_format: str = "auto",
    *,
    bus: str = "bus0",
    again: bool = False,
    wiring: Wiring | None = None,
) -> Source:
    """Open a capture; ``"-"`` is standard input, bytes are a file's content themselves.

    ``bus`` names the bus where the input does not; ``wiring`` says how a capture of levels is to be
    read. ``again``: it will be read more than once; what cannot be (a pipe) is kept in a temporary
    file. Raises InputError with what to do instead, in one line.
    """
    if input_format != "auto" and input_format not in SOURCES:
        known = offered(str(input_format), ("auto", *SOURCES))
        raise InputError(f"there is no input format {input_format!r}: choose {known}")
    origin = find(path)
    try:
        if input_format != "bin":  # raw bytes are what somebody says they are
            origin = unpacked(origin)
        chosen = _chosen(origin, input_format)
        by_index = chosen in ("mcap", *ZIPPED)  # read here and there
        if (again and origin.live) or (by_index and origin.path is None):
            origin = Spooled(origin)
        source = SingleSource(origin, chosen, bus, wiring)
        if chosen not in ("bin", "mcap"):
            source.rehearse()
    except BaseException:
        origin.close()
        raise
    return source


def _chosen(origin: Origin, input_format: str) -> str:
    if not origin.head:
        return "bin"
    try:
        if input_format == "auto":
            return recognise(origin.head, origin.suffix.lower())
        if input_format not in _BINARY:
            refuse_utf16(origin.head)
    except InputError as error:
        raise InputError(Sentence("{name}: {error}", name=origin.name, error=error)) from None
    return input_format
