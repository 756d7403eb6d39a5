"""Levels of wires with known truth, and the files that logic analysers write of them."""

from __future__ import annotations

import struct
import zipfile
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.ground.model import NS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from sniffer.ground.model import I64, U8

LEAD_BITS: Final = 30
"""What a line is idle for before and behind what is said."""


@dataclass
class Wire:
    """A wire that idles high: what is said is added piece by piece; times are in seconds."""

    now: float = 0.0
    toggles: list[float] = field(default_factory=list)
    starts: list[float] = field(default_factory=list)

    def say(
        self, data: bytes, baud: float, *, after: float = 0.0, parity: str = "", wrong: str = ""
    ) -> float:
        """Say bytes back to back; return when the last one ends.

        ``after``: a pause before them. ``wrong``: of the last byte, "parity" or "stop".
        """
        self.now += after
        bit = 1 / baud
        for nth, byte in enumerate(data):
            is_last = nth == len(data) - 1
            bits = [0, *(byte >> place & 1 for place in range(8))]
            if parity:
                even = byte.bit_count() & 1
                bits.append(even ^ (parity == "O") ^ (is_last and wrong == "parity"))
            bits.append(int(not (is_last and wrong == "stop")))
            self.starts.append(self.now)
            level = 1
            for place, value in enumerate(bits):
                if value != level:
                    self.toggles.append(self.now + place * bit)
                    level = value
            self.now += len(bits) * bit
            if not level:
                self.toggles.append(self.now)
                self.now += 2 * bit
        return self.now

    def low(self, seconds: float, *, after: float = 0.0) -> None:
        """Hold the line low: a break, a pulse, or a glitch."""
        self.toggles += [self.now + after, self.now + after + seconds]
        self.now += after + seconds


def sampled(wire: Wire, rate: float, seconds: float = 0.0, *, invert: bool = False) -> U8:
    """Return the levels that an analyser sees, one a sample."""
    count = int(np.ceil(max(seconds, wire.now) * rate)) + 1
    flips = np.zeros(count + 1, np.int64)
    at = np.ceil(np.array(wire.toggles) * rate - 1e-9).astype(np.int64)
    np.add.at(flips, np.minimum(at, count), 1)
    levels = 1 - (np.cumsum(flips[:count]) & 1)
    return (levels ^ int(invert)).astype(np.uint8)


def spoken(data: bytes, baud: float, *, every: int = 9, pause_bits: float = 30) -> Wire:
    """Return a wire on which bytes are said, with a pause behind every few of them."""
    wire = Wire(LEAD_BITS / baud)
    for at in range(0, len(data), every):
        wire.say(data[at : at + every], baud, after=pause_bits / baud)
    wire.now += LEAD_BITS / baud
    return wire


def edges_of(levels: U8) -> I64:
    """Return the samples that differ from the one before."""
    return np.flatnonzero(np.diff(levels)) + 1


def sr(
    path: Path, channels: Mapping[str, U8], rate: int, *, chunk: int = 1 << 20, unit: int = 1
) -> Path:
    """Write a sigrok session (https://sigrok.org/wiki/File_format:Sigrok/v2)."""
    count = max(map(len, channels.values()))
    packed = np.zeros((count, unit), np.uint8)
    for nth, levels in enumerate(channels.values()):
        padded = np.concatenate([levels, np.full(count - len(levels), levels[-1], np.uint8)])
        packed[:, nth >> 3] |= padded << np.uint8(nth & 7)
    probes = "".join(f"probe{nth}={name}\n" for nth, name in enumerate(channels, 1))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("version", "2")
        archive.writestr(
            "metadata",
            "[global]\nsigrok version=0.5.2\n\n[device 1]\ncapturefile=logic-1\n"
            f"total probes={len(channels)}\nsamplerate={rate}\ntotal analog=0\n"
            f"{probes}unitsize={unit}\n",
        )
        for nth, at in enumerate(range(0, count, chunk), 1):
            archive.writestr(f"logic-1-{nth}", packed[at : at + chunk].tobytes())
    return path


def dsl(path: Path, channels: Mapping[str, U8], rate: int, *, block: int = 1 << 10) -> Path:
    """Write a capture as DSView 1.x does: bits of one channel after the other, eight a byte."""
    levels = list(channels.values())
    count = len(levels[0])
    probes = "".join(f"probe{2 * n} = {name}\n enable0 = 1\n" for n, name in enumerate(channels))
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(
            "header",
            "[version]\nversion = 3\n[header]\ndriver = DSLogic\ndevice mode = 0\n"
            f"capturefile = data\ntotal samples = {count}\ntotal probes = {len(levels)}\n"
            f"samplerate = {rate // 1000} kHz\ntrigger pos = 0\n{probes}",
        )
        for nth, bits in enumerate(levels):
            packed = np.packbits(bits, bitorder="little").tobytes()
            for part, at in enumerate(range(0, len(packed), block)):
                archive.writestr(f"L-{2 * nth}/{part}", packed[at : at + block])
    return path


def saleae_0(levels: U8, rate: int, *, trigger: float = 0.0) -> bytes:
    """Return raw data of Logic 2, version 0 (support.saleae.com, Binary Export Format)."""
    times = edges_of(levels) / rate - trigger
    head = struct.pack("<8sii", b"<SALEAE>", 0, 0)
    span = struct.pack("<IddQ", int(levels[0]), -trigger, len(levels) / rate - trigger, len(times))
    return head + span + times.astype("<f8").tobytes()


def saleae_1(parts: Sequence[tuple[U8, int]], rate: int, *, trigger: float = 0.0) -> bytes:
    """Return raw data of Logic 2, version 1: levels, and the sample that each part begins with."""
    out = struct.pack("<8siiQ", b"<SALEAE>", 1, 0, len(parts))
    for levels, begin in parts:
        times = (edges_of(levels) + begin) / rate - trigger
        span = (begin / rate - trigger, (begin + len(levels)) / rate - trigger)
        out += struct.pack("<IdddQ", int(levels[0]), rate, *span, len(times))
        out += times.astype("<f8").tobytes()
    return out


def saleae_csv(channels: Mapping[str, U8], rate: int, *, trigger: float = 0.0) -> bytes:
    """Return the digital CSV of Logic 2: a row where any channel changes."""
    rows = np.stack(list(channels.values()), axis=1)
    at = np.concatenate([[0], np.flatnonzero((rows[1:] != rows[:-1]).any(axis=1)) + 1])
    lines = ["Time [s]," + ",".join(channels)]
    lines += [f"{n / rate - trigger:.9f}," + ",".join(map(str, rows[n])) for n in at.tolist()]
    return "\n".join([*lines, ""]).encode()


def vcd(channels: Mapping[str, U8], rate: int, *, scale: str = "1 ns") -> bytes:
    """Return a value change dump, each change on a line of its own, within two scopes."""
    number, unit = scale.split()
    tick = int(number) * {"ns": 1, "us": 1000}[unit]
    signs = [chr(33 + nth) for nth in range(len(channels))]
    lines = [f"$timescale {scale} $end", "$scope module top $end", "$scope module bus $end"]
    lines += [f"$var wire 1 {sign} {name} $end" for sign, name in zip(signs, channels, strict=True)]
    lines += ["$var wire 8 zz word [7:0] $end", "$upscope $end", "$upscope $end"]
    lines += ["$enddefinitions $end", "#0", "$dumpvars", "bxxxxxxxx zz"]
    lines += [f"{levels[0]}{sign}" for sign, levels in zip(signs, channels.values(), strict=True)]
    lines.append("$end")
    changes = sorted(
        (int(at), nth, int(levels[at]))
        for nth, levels in enumerate(channels.values())
        for at in edges_of(levels)
    )
    for at, nth, level in changes:
        lines += [f"#{round(at * NS / rate / tick)}", f"{level}{signs[nth]}", "b1010 zz"]
    return "\n".join([*lines, ""]).encode()
