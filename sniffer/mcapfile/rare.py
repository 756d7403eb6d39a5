"""What is rare, as messages: gaps, anomalies, and these once more for panels that show logs.

On a bad line they are a third of the work, so their bytes are put together from parts that protobuf
has written: messages side by side are one message with the fields of both. An object for each, and
one for each piece of evidence in it, takes three times as long.
"""

from __future__ import annotations

import functools
import json
import struct
from typing import TYPE_CHECKING, Final

from google.protobuf.timestamp_pb2 import Timestamp

from sniffer.anomalies.found import CODES, GROUP, NUMBER, SEVERITY, Anomalies
from sniffer.ground.model import NS
from sniffer.mcapfile.levels import LEVELS, SEVERITIES, named
from sniffer.mcapfile.varints import key, sized, varint
from sniffer.messages.log_pb2 import Log
from sniffer.messages.recording_pb2 import Anomaly, Gap

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from sniffer.anomalies.found import Told
    from sniffer.decoding.called import ServoNames
    from sniffer.ground import model
    from sniffer.ground.model import Batch

_NUMBERS: Final = json.JSONEncoder(default=repr).encode

_LONG: Final = struct.Struct("<q")
_SPAN: Final = struct.Struct("<sQsQ")
_PLACE: Final = struct.Struct("<sqsQsI")
"""Fields of a fixed width with their keys, each of one byte."""

_FOUND_AT: Final = key(Anomaly, "t_ns")
_FOUND_DETAIL: Final = key(Anomaly, "detail")
_EVIDENCE: Final = key(Anomaly, "evidence") + bytes([_SPAN.size])
_SPAN_AT: Final = key(Anomaly.Evidence, "offset")
_SPAN_LENGTH: Final = key(Anomaly.Evidence, "length")
_GAP_AT: Final = key(Gap, "t_ns")
_GAP_OFFSET: Final = key(Gap, "offset")
_GAP_LENGTH: Final = key(Gap, "length")
_GAP_DETAIL: Final = key(Gap, "detail")
_GAP_DATA: Final = key(Gap, "data")
_NOBODY: Final = -1
_NANOS: Final = varint(Timestamp.DESCRIPTOR.fields_by_name["nanos"].number << 3)
"""The key of a varint."""
_LOG_AT: Final = key(Log, "timestamp")
_LOG_MESSAGE: Final = key(Log, "message")


def gap_messages(batch: Batch) -> Iterator[bytes]:
    """Yield the gaps of a batch."""
    base, data = batch.base, batch.data
    for g in batch.gaps:
        place = _PLACE.pack(_GAP_AT, g.t_ns, _GAP_OFFSET, base + g.start, _GAP_LENGTH, g.length)
        detail = _NUMBERS(dict(g.detail)).encode()
        run = data[g.start : g.start + g.length]
        yield b"".join(
            (place, _reason(g.reason), _GAP_DETAIL, sized(detail), _GAP_DATA, sized(run))
        )


def anomaly_messages(found: Sequence[model.Anomaly]) -> Iterator[bytes]:
    """Yield anomalies, but for what the catalogue says of them."""
    for code, who, t_ns, (detail, evidence) in _rows(found):
        parts = [_FOUND_AT, _LONG.pack(t_ns), _kind(code, who), _FOUND_DETAIL]
        parts.append(sized(detail.encode()))
        for at, n in evidence:
            parts += _EVIDENCE, _SPAN.pack(_SPAN_AT, at, _SPAN_LENGTH, n)
        yield b"".join(parts)


def log_messages(found: Sequence[model.Anomaly], bus: str, names: ServoNames) -> Iterator[bytes]:
    """Yield anomalies as lines of a log, which people read: servos are called by their names."""
    for code, who, t_ns, (detail, _) in _rows(found):
        second, ns = divmod(t_ns, NS)
        t = _second(second) + (_NANOS + varint(ns) if ns else b"")
        told = names.sentence(bus, f"{named(who, detail)}{detail}")
        text = f"{told} [{CODES[code]}]".encode()
        yield b"".join((_LOG_AT, sized(t), _line(code, bus), _LOG_MESSAGE, sized(text)))


def _rows(found: Sequence[model.Anomaly]) -> Iterable[tuple[int, int, int, Told]]:
    """Return code, servo (-1: none), time, and sentence and evidence of each.

    Of columns no object is made for it.
    """
    if isinstance(found, Anomalies):
        columns = (found.code.tolist(), found.servo_id.tolist(), found.t_ns.tolist())
        return zip(*columns, found.told(), strict=True)
    return (
        (
            NUMBER[a.code],
            _NOBODY if a.servo_id is None else a.servo_id,
            a.t_ns,
            (a.detail, a.evidence),
        )
        for a in found
    )


@functools.cache
def _reason(reason: str) -> bytes:
    return Gap(reason=reason).SerializeToString()


@functools.cache
def _kind(code: int, servo_id: int) -> bytes:
    told = Anomaly(severity=SEVERITIES[SEVERITY[code]], group=GROUP[code], code=CODES[code])
    if servo_id >= 0:
        told.servo_id = servo_id
    return told.SerializeToString()


@functools.cache
def _line(code: int, bus: str) -> bytes:
    return Log(level=LEVELS[SEVERITY[code]], name=bus).SerializeToString()


@functools.lru_cache(maxsize=64)
def _second(second: int) -> bytes:
    return Timestamp(seconds=second).SerializeToString()
