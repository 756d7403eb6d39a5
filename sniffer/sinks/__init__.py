"""Outputs by file suffix. Each is imported only when it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import OutputError
from sniffer.ground.needs import need_pyarrow, need_rerun
from sniffer.ground.wording import offered

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.decoding.sink import Sink

Session = Mapping[str, str]
"""Facts of a recording: tool, source, protocol, baud ..."""


def _jsonl(path: Path, session: Session) -> Sink:
    from sniffer.sinks.jsonl import JsonlSink

    return JsonlSink(path)


def _table(path: Path, session: Session) -> Sink:
    from sniffer.sinks.tables import TableSink

    return TableSink(path)


def _mcap(path: Path, session: Session) -> Sink:
    from sniffer.mcapfile.sink import McapSink

    return McapSink(path, session)


def _rerun(path: Path, session: Session) -> Sink:
    from sniffer.sinks.rerun.judged import JudgedRerunSink

    return JudgedRerunSink(path)


def _pcapng(path: Path, session: Session) -> Sink:
    from sniffer.pcapfile.sink import PcapngSink

    return PcapngSink(path, session)


SINKS: Final[Mapping[str, Callable[[Path, Session], Sink]]] = MappingProxyType(
    {".jsonl": _jsonl, ".csv": _table, ".parquet": _table, ".mcap": _mcap, ".rrd": _rerun}
    | {".pcapng": _pcapng}
)
"""Makers of outputs by suffix, of what was decoded."""

RECORDING: Final = ".mcap"
"""Suffix of a recording."""

BYTES: Final = (".log", ".bin", ".hex")
"""Suffixes of files that hold the bytes themselves (``raw``)."""

_CANDUMP: Final = ".candump"
"""What people call a ``.log`` who know where its form is from."""

_NEEDS: Final = MappingProxyType(
    {".csv": need_pyarrow, ".parquet": need_pyarrow, ".rrd": need_rerun}
)
"""What refuses an output whose library is not there."""


def suffix_known(path: Path, *, raw: bool = False) -> str:
    """Return the path's suffix as ``SINKS`` has it, or, where it may be ``raw``, ``BYTES``.

    Raises:
        OutputError: it has none of these, or the library that writes it is not installed.
    """
    suffix = path.suffix.lower()
    known = (*SINKS, *BYTES) if raw else tuple(SINKS)
    if suffix not in known:
        if raw and suffix == _CANDUMP:
            raise OutputError(f"{path}: lines as candump -L writes them are a .log")
        raise OutputError(f"{path}: the suffix must be {offered(suffix, known)}")
    if suffix in _NEEDS:
        _NEEDS[suffix]()
    return suffix


def open_sink(path: Path, session: Session) -> Sink:
    """Open the output that the path's suffix names.

    Raises:
        OutputError: the suffix is not known, or the file cannot be written.
    """
    return SINKS[suffix_known(path)](path, session)
