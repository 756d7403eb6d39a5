"""Captures of DSView (.dsl): a zip with the packed bits of each channel, block by block.

The layout is that which DSView 1.x writes: ``header`` names the channels (``probe0 = RX``), entries
``L-0/0``, ``L-0/1`` hold the samples of channel 0, eight a byte, the first one lowest.
"""

from __future__ import annotations

import re
from itertools import zip_longest
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import NS, DamagedInputError, InputError
from sniffer.signals.stretch import LogicInput, Stretch
from sniffer.sources.archives import SampleArchive
from sniffer.sources.sigrok import rate_in, unlike

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.ground.model import I64, U8
    from sniffer.sources.text import Opened

AT_ONCE: Final = 1 << 17
"""Bytes of each channel that are unpacked at once: a million samples."""

_PROBE: Final = re.compile(r"probe([0-9]{1,4})")
_BLOCK: Final = re.compile(r"L-([0-9]{1,4})/([0-9]{1,9})")


def read_dsl(opened: Opened) -> LogicInput:
    """Open a capture.

    Raises:
        InputError: it is none, or no logic capture.
        DamagedInputError: it is damaged.
    """
    assert opened.path is not None, "open_source spools what has none"
    archive = SampleArchive(opened.path, opened.name)
    header = _header(archive.text("header"))
    blocks: dict[int, dict[int, str]] = {}
    for name in archive.names:
        if match := _BLOCK.fullmatch(name):
            blocks.setdefault(int(match[1]), {})[int(match[2])] = name
    rate = rate_in(header.get("samplerate", ""))
    if not blocks or not rate:
        instead = "export the data from DSView as CSV or as a sigrok session"
        raise InputError(f"{opened.name}: a DSView capture without logic samples: {instead}")
    chosen = {probe: [found[n] for n in sorted(found)] for probe, found in sorted(blocks.items())}
    archive.expect(name for entries in chosen.values() for name in entries)
    named = {
        int(match[1]): name for key, name in header.items() if (match := _PROBE.fullmatch(key))
    }
    names = unlike([named.get(probe) or str(probe) for probe in chosen])
    total = header.get("total samples", "")
    most = int(total) if total.isdecimal() and len(total) < 16 else 1 << 62
    stretches = _stretches(archive, list(chosen.values()), most, opened.name)
    return LogicInput(names, NS / rate, 1, stretches)


def _header(text: str) -> Mapping[str, str]:
    """Return what it says; ``configparser`` would join `` enable0 = 1`` to the line before."""
    out: dict[str, str] = {}
    for line in text.splitlines():
        key, equals, value = line.partition("=")
        if equals:
            out.setdefault(key.strip().lower(), value.strip())
    return out


def _stretches(
    archive: SampleArchive, probes: list[list[str]], total: int, name: str
) -> Iterator[Stretch]:
    """Yield all channels together, a million samples at a time."""
    samplers = [_Bits() for _ in probes]
    left = total
    with archive:
        for parts in zip_longest(*(_even(archive.pieces(entries)) for entries in probes)):
            if any(part is None or len(part) != len(parts[0] or b"") for part in parts):
                raise DamagedInputError(f"{name}: its channels are not of one length")
            count = min(8 * len(parts[0] or b""), left)
            if not count:
                return
            taken = [
                sampler.take(part, count)
                for part, sampler in zip(parts, samplers, strict=True)
                if part is not None
            ]
            left -= count
            yield Stretch(
                [level for level, _ in taken], [edges for _, edges in taken], total - left - 1
            )


class _Bits:
    """The packed bits of a channel, piece by piece, as edges: only what changes is unpacked."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._at = 0

    def take(self, data: bytes, count: int) -> tuple[int, I64]:
        """Return the level before ``count`` bits, and the samples that begin another one."""
        packed = np.frombuffer(data, np.uint8)
        before = int(packed[0] & 1) if self._last is None else self._last
        flips = packed << np.uint8(1)
        flips[1:] |= packed[:-1] >> np.uint8(7)
        flips[0] |= before
        flips ^= packed
        rows = np.flatnonzero(flips != 0)
        if len(rows) > len(flips) // 8:
            edges = _set_in(flips)
        else:
            bits = _set_in(flips[rows])
            edges = 8 * rows[bits >> 3] + (bits & 7)
        if count < 8 * len(packed):
            edges = edges[edges < count]
        edges += self._at
        self._last = int(packed[(count - 1) >> 3] >> ((count - 1) & 7) & 1)
        self._at += count
        return before, edges


def _set_in(packed: U8) -> I64:
    """Return which bits are set."""
    return np.flatnonzero(np.unpackbits(packed, bitorder="little").view(bool))


def _even(pieces: Iterator[bytes]) -> Iterator[bytes]:
    """Yield the same bytes in pieces of one length."""
    held = b""
    for piece in pieces:
        held += piece
        while len(held) >= AT_ONCE:
            yield held[:AT_ONCE]
            held = held[AT_ONCE:]
    if held:
        yield held
