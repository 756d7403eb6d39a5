"""The laws of the design, on streams made of a talk; each raises AssertionError with the bytes."""

from __future__ import annotations

import contextlib
from random import Random
from typing import TYPE_CHECKING, Any, Final

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.reference import Reference
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols.base import view
from sniffer.testing.case import shown
from sniffer.testing.records import batches, gaps, records
from sniffer.testing.streams import chunked, noise, recut, stream

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from sniffer.ground.model import Anomaly, Batch, Chunk
    from sniffer.protocols.base import BusProtocol
    from sniffer.testing.talk import Exchange

SLACK: Final = 2 * 1024
"""Bytes of a gap that may wait for its piece to be whole."""


def decoded(protocol: BusProtocol, groups: Sequence[Sequence[Chunk]]) -> list[Batch]:
    """Return what one decoder makes of the groups, each fed in one call."""
    return batches(Decoder(protocol), groups)


def same(what: str, got: Any, want: Any, chunks: Sequence[Chunk]) -> None:
    """Hold two lists of records equal; the first that differ are told.

    Raises:
        AssertionError: they differ.
    """
    if got == want:
        return
    at = next((i for i, (a, b) in enumerate(zip(got, want, strict=False)) if a != b), -1)
    at = min(len(got), len(want)) if at < 0 else at
    one, other = (repr(x[at]) if at < len(x) else "nothing" for x in (got, want))
    raise AssertionError(f"{what} {at}: {one}, not {other}\n  {_told(chunks)}")


def _told(chunks: Sequence[Chunk]) -> str:
    edges, at = [], 0
    for c in chunks[:-1]:
        at += len(c.data)
        edges.append(at)
    return shown(b"".join(c.data for c in chunks), edges)


def equal(what: str, got: Sequence[Batch], want: Sequence[Batch], chunks: Sequence[Chunk]) -> None:
    """Hold frames, pairs, values, gaps and anomalies of two decodings equal."""
    one, other = records(got), records(want)
    same(f"{what}: frame", one.frames, other.frames, chunks)
    same(f"{what}: transaction", one.transactions, other.transactions, chunks)
    same(f"{what}: sample", one.samples, other.samples, chunks)
    same(f"{what}: gap", gaps(got), gaps(want), chunks)


def anomalies(parts: Sequence[Batch]) -> list[Anomaly]:
    """Return what was found, in order."""
    return [a for b in parts for a in b.anomalies]


def uncertainties(parts: Sequence[Batch]) -> list[int]:
    """Return that of each frame, in ns."""
    return [x for b in parts for x in b.frames.uncertainty.tolist()]


def every_byte_once(protocol: BusProtocol, chunks: Sequence[Chunk], rng: Random) -> None:
    """Frames and gaps, joined in order, are exactly the input."""
    del rng
    parts = decoded(protocol, [[c] for c in chunks])
    data = b"".join(c.data for c in chunks)
    spans = sorted([f[:2] for f in records(parts).frames] + [g[:2] for g in gaps(parts)])
    at = 0
    for start, length in spans:
        if start != at or length < 1:
            break
        at += length
    if at != len(data) or b"".join(b.data for b in parts) != data:
        raise AssertionError(f"byte {at} is claimed twice or never\n  {_told(chunks)}")


def reference(protocol: BusProtocol, chunks: Sequence[Chunk], rng: Random) -> None:
    """The columns say what the slow forms say, one frame at a time."""
    del rng
    got, want = records(decoded(protocol, [chunks])), Reference(protocol).decode(chunks)
    same("columns and slow form: frame", got.frames, want.frames, chunks)
    same("columns and slow form: transaction", got.transactions, want.transactions, chunks)
    same("columns and slow form: sample", got.samples, want.samples, chunks)


def any_recut(protocol: BusProtocol, chunks: Sequence[Chunk], rng: Random) -> None:
    """The same bytes at the same times, cut otherwise, give the same records."""
    again = recut(rng, protocol, chunks, 4)
    got = decoded(protocol, [[c] for c in again])
    equal("recut", got, decoded(protocol, [chunks]), again)


def any_grouping(protocol: BusProtocol, chunks: Sequence[Chunk], rng: Random) -> None:
    """The same chunks, fed one by one or all at once, give the same, anomalies included."""
    k = rng.randint(0, len(chunks))
    one, two = decoded(protocol, [[c] for c in chunks]), decoded(protocol, [chunks[:k], chunks[k:]])
    equal("grouping", one, two, chunks)
    same("grouping: anomaly", anomalies(one), anomalies(two), chunks)
    same("grouping: uncertainty of frame", uncertainties(one), uncertainties(two), chunks)


def live_is_replay(protocol: BusProtocol, chunks: Sequence[Chunk], rng: Random) -> None:
    """Looking at the clock between two reads changes nothing."""
    del rng
    byte_ns = byte_time_ns(protocol.baud)
    decoder, live = Decoder(protocol), []
    for c in chunks:
        live += [decoder.idle((c.t_ns or 0) - len(c.data) * byte_ns), decoder.feed(c)]
    live.append(decoder.close())
    replayed = decoded(protocol, [chunks])
    equal("idle", live, replayed, chunks)
    same("idle: anomaly", anomalies(live), anomalies(replayed), chunks)


def bounded(protocol: BusProtocol, chunks: Sequence[Chunk], rng: Random) -> None:
    """No input raises, and what is held back stays bounded."""
    own = b"".join(c.data for c in chunks)
    data = b"".join(
        rng.choice((own, noise(rng, own), own[:9] * 40, rng.randbytes(300))) for _ in range(4)
    )
    decoder = Decoder(protocol)
    bound = protocol.longest + protocol.reach + SLACK
    at = 0
    while at < len(data):
        n = rng.randint(1, 700)
        decoder.feed(data[at : at + n])
        if decoder.pending > n + bound:
            told = f"{decoder.pending} bytes are held back, {n + bound} at most are bearable"
            raise AssertionError(f"{told}\n  {shown(data[: at + n])}")
        at += n
    decoder.close()
    if decoder.pending:
        raise AssertionError(f"{decoder.pending} bytes are left at the end\n  {shown(data)}")


def says_what_it_is(protocol: BusProtocol, chunks: Sequence[Chunk], rng: Random) -> None:
    """Each frame has a name, fields and a checksum that holds; its parts join to the whole."""
    del rng
    for batch in decoded(protocol, [chunks]):
        f, v = batch.frames, batch.values
        registers: dict[int, list[int]] = {}
        for row, register in zip(v.row.tolist(), v.register.tolist(), strict=True):
            registers.setdefault(row, []).append(register)
        for i in range(len(f)):
            raw = batch.data[int(f.start[i]) : int(f.end[i])]
            row = view(f, i, registers.get(i, ()))
            at = 0
            for span in protocol.dissect(raw, row):
                if span.offset != at or span.length < 0:
                    break
                at += span.length
            if at > len(raw):
                raise AssertionError(f"dissect tells of {at} bytes, not {len(raw)}: {shown(raw)}")
            if at < len(raw):
                raise AssertionError(f"dissect says nothing of byte {at} of {shown(raw)}")
            told = protocol.checksum_of(raw)
            if told is not None and told[0](told[1]) != told[2]:
                raise AssertionError(f"the checksum of a frame that holds does not: {shown(raw)}")
            if not protocol.op_name(row.op) or any(not k for k in protocol.fields(raw, row)):
                raise AssertionError(f"a frame, or a field of it, has no name: {shown(raw)}")


LAWS: Final = {
    "every byte is claimed once": every_byte_once,
    "columns say what the slow form says": reference,
    "any recut gives equal records": any_recut,
    "any grouping gives equal records": any_grouping,
    "live is replay": live_is_replay,
    "nothing raises, memory is bounded": bounded,
    "a frame says what it is": says_what_it_is,
}


def hold(
    law: Callable[[BusProtocol, Sequence[Chunk], Random], None],
    protocol: BusProtocol,
    exchanges: Sequence[Exchange],
    examples: int,
    seed: int,
) -> int:
    """Hold a law on as many streams; return how many bytes they were.

    Raises:
        AssertionError: it does not hold, or something raised on the way; with the bytes.
    """
    total = 0
    for k in range(examples):
        rng = Random(f"{seed}/{k}")
        chunks = chunked(rng, protocol, stream(rng, exchanges))
        total += sum(len(c.data) for c in chunks)
        with bytes_told(chunks):
            law(protocol, chunks, rng)
    return total


@contextlib.contextmanager
def bytes_told(chunks: Sequence[Chunk]) -> Iterator[None]:
    """Tell what raises inside together with the bytes it raised at.

    Raises:
        AssertionError: something raised.
    """
    try:
        yield
    except AssertionError:
        raise
    except Exception as error:
        raise AssertionError(f"{type(error).__name__}: {error}\n  {_told(chunks)}") from error
