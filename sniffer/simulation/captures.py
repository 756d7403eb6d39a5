"""The sample captures: ``python -m sniffer.simulation.captures OUTDIR`` writes them anew.

Simulated ones from fixed seeds, and the manuals' own example frames from the test vectors; the
latter need a checkout. The same program writes the same bytes.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.model import NS
from sniffer.simulation import faults as f
from sniffer.simulation.buses import BUSES, simulate
from sniffer.simulation.faults import Fault
from sniffer.simulation.render import candump, frame_reads, hexdump, raw, usb_reads, xxd
from sniffer.simulation.talk import NOISE, TrueFrame

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

START_NS: Final = 1_795_215_306 * NS
"""When the simulated captures begin: an afternoon in November 2026."""

VECTORS: Final = Path(__file__).parents[2] / "tests" / "vectors"

FRAMES, READS, RAW, XXD, HEXDUMP = "frames", "reads", "raw", "xxd", "hexdump"
FORMS: Final = {
    FRAMES: "log, a line a frame",
    READS: "log, a line a read of a USB adapter with 1 ms latency",
    RAW: "raw bytes, no times",
    XXD: "`xxd` dump, no times",
    HEXDUMP: "`hexdump -C` dump, no times",
}


@dataclass(frozen=True, slots=True)
class SampleCapture:
    """One simulated file: what is on the bus, and how it is written down."""

    file: str
    protocol: str
    seed: int
    seconds: float
    form: str
    faults: tuple[Fault, ...] = ()
    rate_hz: int | None = None

    def frames(self) -> list[TrueFrame]:
        """Return the truth behind the file."""
        return list(
            simulate(
                self.protocol,
                seed=self.seed,
                rate_hz=self.rate_hz,
                faults=self.faults,
                start_ns=START_NS,
                duration_s=self.seconds,
            )
        )

    def render(self, frames: Sequence[TrueFrame]) -> bytes:
        """Return the file's content."""
        match self.form:
            case "raw":
                return raw(frames)
            case "xxd":
                return xxd(raw(frames)).encode()
            case "hexdump":
                return hexdump(raw(frames)).encode()
            case "reads":
                return candump(usb_reads(frames, BUSES[self.protocol].baud)).encode()
            case _:
                return candump(frame_reads(frames)).encode()


def _faults(twin: int, weak: int, *, scale: float = 1.0) -> tuple[Fault, ...]:
    """Return a bit of everything; ``twin`` is an id given twice, ``weak`` a badly wired servo."""
    rates = {f.DROP: 0.006, f.FLIP: 0.004, f.CUT: 0.005, f.LATE: 0.005, f.NOISE: 0.008}
    return (
        *(Fault(kind, rate * scale) for kind, rate in rates.items()),
        Fault(f.DUPLICATE, 0.02 * scale, twin),
        Fault(f.BROWNOUT, 0.008 * scale, weak),
    )


CAPTURES: Final = (
    SampleCapture("mightyzap_clean.log", "mightyzap", 11, 8, FRAMES),
    SampleCapture("mightyzap_damaged.log", "mightyzap", 12, 8, READS, _faults(2, 1, scale=2)),
    SampleCapture("lss_clean.bin", "lss", 21, 8, RAW),
    SampleCapture("lss_damaged.log", "lss", 25, 8, READS, _faults(2, 5), rate_hz=25),
    SampleCapture("wck_clean.log", "wck", 31, 5, FRAMES),
    SampleCapture("wck_damaged.log", "wck", 32, 5, FRAMES, _faults(1, 2)),
    SampleCapture("rs30x_clean.hex", "rs30x", 41, 4, HEXDUMP),
    SampleCapture("rs30x_damaged.log", "rs30x", 44, 5, FRAMES, _faults(2, 5)),
)


def manual(protocol: str) -> bytes:
    """Return the manuals' good example frames in order, each answer behind its question.

    LSS, whose frames are text, goes as it is; the others as a hex dump with comments.
    """
    out = bytearray()
    for comment, data in _examples(protocol):
        if protocol == "lss":
            out += data
        else:
            out += f"# {comment}\n{data.hex(' ').upper()}\n".encode()
    return bytes(out)


def _examples(protocol: str) -> Iterator[tuple[str, bytes]]:
    vectors = tomllib.loads((VECTORS / f"{protocol}.toml").read_text(encoding="utf-8"))["vector"]
    before = b""
    for vector in vectors:
        if vector["verdict"] != "good" or not vector["source"].startswith(SOURCES[protocol]):
            continue
        asked = _bytes(vector, "after") if "after" in vector else before
        if asked != before:
            yield f"{vector['op']}: the request again", asked
        before = _bytes(vector, "ascii" if "ascii" in vector else "hex")
        yield f"{vector['source']}: {vector['kind']}, {vector['op']}", before


def _bytes(vector: dict[str, Any], key: str) -> bytes:
    text: str = vector[key]
    return text.encode() if "ascii" in vector else bytes.fromhex(text)


def _line(file: str, what: str) -> str:
    return f"| `{file}` | {what} | `sniffer decode sample_captures/{file}` |\n"


def _told(capture: SampleCapture, frames: Sequence[TrueFrame]) -> str:
    """Describe a simulated capture in a table cell."""
    kinds = Counter(frame.fault for frame in frames if frame.fault)
    said = sum(1 for frame in frames if frame.wire and frame.kind != NOISE)
    size = sum(len(frame.wire) for frame in frames)
    servos = ", ".join(str(i) for i in BUSES[capture.protocol].servo_ids)
    struck = ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items())) or "no faults"
    return (
        f"simulated, seed {capture.seed}: servos {servos}, {BUSES[capture.protocol].baud} bit/s, "
        f"{capture.seconds:g} s, {said} frames, {size} bytes; {struck}; {FORMS[capture.form]}"
    )


HEAD: Final = """# Sample captures

Small captures that anyone can decode. All are written by `make captures`
(`python -m sniffer.simulation.captures sample_captures`) and change only with it.

The simulated ones come from `sniffer/simulation/`: servos with inertia, friction and a common
supply, a controller that commands and polls them, and the true times on the wire. What is damaged
in a `_damaged` file is known frame by frame; the numbers count frames by what befell them:
"""

MANUALS: Final = {
    "mightyzap": "mightyZAP user manual v1.02 and 12Lf IR Protocol page",
    "lss": "Lynxmotion LSS Communication Protocol page, version 106.1",
    "wck": "RoboBuilder wCK series user's manual 1.07",
    "rs30x": "Futaba RS305CR manual (2021-09)",
}


SOURCES: Final = {
    "mightyzap": ("mightyZAP User Manual V.1.02", "mightyZAP 12Lf IR Protocol"),
    "lss": ("Lynxmotion LSS Communication Protocol",),
    "wck": ("RoboBuilder wCK",),
    "rs30x": ("Futaba RS305CR",),
}
"""How the vectors cite these manuals; those of siblings are other manuals."""


def write(out: Path) -> None:
    """Write all files and their README."""
    out.mkdir(parents=True, exist_ok=True)
    told = [HEAD, "\n", *(f"- *{kind}*: {what}.\n" for kind, what in f.LINE_FAULTS.items()), "\n"]
    told.append("| file | what | decode it |\n|---|---|---|\n")
    for capture in CAPTURES:
        frames = capture.frames()
        (out / capture.file).write_bytes(capture.render(frames))
        told.append(_line(capture.file, _told(capture, frames)))
    for protocol, title in MANUALS.items():
        file = f"{protocol}_manual.{'bin' if protocol == 'lss' else 'hex'}"
        (out / file).write_bytes(manual(protocol))
        kind = "raw text" if protocol == "lss" else "plain hex with comments"
        told.append(_line(file, f"every good example frame of the {title}, in order; {kind}"))
    (out / "README.md").write_text("".join(told), encoding="utf-8")


def main(argv: Sequence[str] | None = None) -> int:
    """Write the captures to the folder named on the command line."""
    parser = argparse.ArgumentParser(prog="python -m sniffer.simulation.captures")
    parser.add_argument("outdir", type=Path, help="folder to write to, usually sample_captures")
    outdir: Path = parser.parse_args(argv).outdir
    if not VECTORS.is_dir():
        parser.error(f"the manuals' examples are read from {VECTORS}: run this in a checkout")
    write(outdir)
    return 0


if __name__ == "__main__":
    sys.exit(main())
