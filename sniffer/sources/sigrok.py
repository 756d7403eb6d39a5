"""Session files of sigrok and PulseView (.sr): a zip of packed samples.

The layout is that of https://sigrok.org/wiki/File_format:Sigrok/v2. Three things are easily got
wrong: chunks are in the order of their numbers, not of their names; a rate may be ``1 MHz`` or
``1000000``; and what ends one chunk is the level before the next.
"""

from __future__ import annotations

import re
from collections import Counter
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS, InputError
from sniffer.signals.stretch import LogicInput, Sampler
from sniffer.sources.archives import SampleArchive

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.signals.stretch import Stretch
    from sniffer.sources.text import Opened

UNIT_MOST: Final = 64
"""Bytes of a sample: 512 channels."""

_RATE: Final = re.compile(r"([0-9]{1,15}(?:\.[0-9]{1,15})?) *([kMG]?)(?:Hz)?", re.IGNORECASE)
_TIMES: Final = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9}
_PROBE: Final = re.compile(r"probe([1-9][0-9]{0,3})")


def read_sr(opened: Opened) -> LogicInput:
    """Open a session.

    Raises:
        InputError: it is none, or has no logic channels.
        DamagedInputError: it is damaged.
    """
    assert opened.path is not None, "open_source spools what has none"
    archive = SampleArchive(opened.path, opened.name)
    device = _device(archive.text("metadata"))
    if not device:
        raise InputError(f"{opened.name}: the session has no logic channels, only analog ones")
    rate = rate_in(device.get("samplerate", ""))
    unit = device.get("unitsize", "1")
    if not rate or not unit.isdecimal() or not 1 <= int(unit[:3]) <= UNIT_MOST:
        raise InputError(f"{opened.name}: the session does not say how it was sampled")
    bits = {
        int(match[1]) - 1: name.strip()
        for key, name in device.items()
        if (match := _PROBE.fullmatch(key)) and int(match[1]) <= 8 * int(unit)
    }
    chunks = _chunks(archive.names, device["capturefile"])
    if not bits or not chunks:
        raise InputError(f"{opened.name}: the session has no samples of logic channels")
    archive.expect(chunks)
    names = unlike([name or f"D{bit}" for bit, name in bits.items()])
    stretches = _stretches(archive, chunks, Sampler([*bits], int(unit)), int(unit))
    return LogicInput(names, NS / rate, 1, stretches)


def rate_in(text: str) -> float:
    """Return the samples a second that a text states; 0 where it states none."""
    match = _RATE.fullmatch(text.strip())
    return float(match[1]) * _TIMES[match[2].lower()] if match else 0.0


def unlike(names: list[str]) -> list[str]:
    """Return names that are all different: of equal ones all but the first are numbered."""
    out: dict[str, None] = {}
    met = Counter[str]()
    for name in names:
        own = name
        while own in out:
            met[name] += 1
            own = f"{name} ({met[name] + 1})"
        out[own] = None
    return list(out)


def _device(metadata: str) -> Mapping[str, str]:
    """Return the section that says where logic samples are; empty where none does.

    ``configparser`` would trip over names of channels: they may hold anything.
    """
    section: dict[str, str] = {}
    for line in [*metadata.splitlines(), "["]:
        if line.lstrip().startswith("["):
            if "capturefile" in section:
                return section
            section = {}
        elif "=" in line:
            key, _, value = line.partition("=")
            section.setdefault(key.strip().lower(), value.strip())
    return {}


def _chunks(names: list[str], base: str) -> list[str]:
    """Return the entries with samples, in order."""
    found = {
        int(number or 0): name
        for name in names
        if name.startswith(base)
        and ((number := name[len(base) :].removeprefix("-")).isdecimal() or name == base)
        and len(number) < 10
    }
    return [found[number] for number in sorted(found)]


def _stretches(
    archive: SampleArchive, chunks: list[str], sampler: Sampler, unit: int
) -> Iterator[Stretch]:
    with archive:
        for piece in archive.pieces(chunks, unit):
            stretch = sampler.take(piece)
            if stretch is not None:
                yield stretch
