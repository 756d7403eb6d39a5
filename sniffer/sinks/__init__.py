"""Outputs by file suffix. Each is imported only when it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import OutputError
from sniffer.ground.needs import need_pyarrow, need_rerun
from sniffer.ground.wording import nearly

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

_READ_INSTEAD: Final[Mapping[str, str]] = MappingProxyType(
    dict.fromkeys((".xlsx", ".xls", ".ods", ".tsv"), ".csv")
    | dict.fromkeys((".mat", ".h5", ".hdf5", ".npz", ".feather", ".pkl"), ".parquet")
    | dict.fromkeys((".bag", ".db3"), RECORDING)
)
"""What programs take in place of a form of their own: spreadsheets, MATLAB and Python, ROS."""

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
        meant = _READ_INSTEAD.get(suffix)
        told = f": what reads {suffix} reads {meant}, too" if meant else nearly(suffix, known)
        raise OutputError(f"{path}: the suffix must be one of {', '.join(known)}{told}")
    if suffix in _NEEDS:
        _NEEDS[suffix]()
    return suffix


def open_sink(path: Path, session: Session) -> Sink:
    """Open the output that the path's suffix names.

    Raises:
        OutputError: the suffix is not known, or the file cannot be written.
    """
    return SINKS[suffix_known(path)](path, session)
