"""Golden files: what every sample capture decodes to, and the pages written from code.

``python -m tests.golden`` (``make golden``) writes them anew; read the diff before committing it.
A golden decode holds the first records, every gap and anomaly, the summary, and a digest over all
records, so that it stays small enough to be read.
"""

from __future__ import annotations

import hashlib
import io
from pathlib import Path

from sniffer.anomalies import catalogue
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.diagnosis import causes, rules, weights
from sniffer.sinks.jsonl import JsonlSink
from sniffer.sources import open_source

ROOT = Path(__file__).parent.parent
CAPTURES = ROOT / "sample_captures"
FOLDER = Path(__file__).parent / "golden_decodes"
FIRST = 60
PAGES = {
    "anomalies.md": catalogue.markdown,
    "findings.md": rules.markdown,
    "causes.md": causes.markdown,
    "weighing.md": weights.markdown,
}
"""Pages of docs/ that are written from code, and what writes each."""


def captures() -> list[Path]:
    """Return the sample captures."""
    return sorted(p for p in CAPTURES.iterdir() if p.is_file() and p.suffix != ".md")


def protocol_of(path: Path) -> str:
    """Return the protocol a capture is named after."""
    return path.name.split("_")[0]


def golden(path: Path) -> str:
    """Decode a capture into its golden form."""
    out = io.StringIO()
    pipeline = Pipeline(Options(protocol=protocol_of(path)), [JsonlSink(out)])
    for group in open_source(path):
        pipeline.feed(group)
    pipeline.close()
    pipeline.finish()
    lines = out.getvalue().splitlines()
    kept = [
        line
        for i, line in enumerate(lines)
        if i < FIRST or line.startswith(('{"type":"gap"', '{"type":"anomaly"', '{"type":"summary"'))
    ]
    digest = hashlib.sha256(out.getvalue().encode()).hexdigest()
    return "\n".join([*kept, f"{len(lines)} records, sha256 {digest}"]) + "\n"


def golden_path(capture: Path) -> Path:
    """Return where a capture's golden decode lies."""
    return FOLDER / f"{capture.name}.txt"


def main() -> None:
    """Write all golden files."""
    FOLDER.mkdir(exist_ok=True)
    for old in FOLDER.iterdir():
        old.unlink()
    for capture in captures():
        golden_path(capture).write_text(golden(capture), encoding="utf-8")
    for page, write in PAGES.items():
        (ROOT / "docs" / page).write_text(write(), encoding="utf-8")


if __name__ == "__main__":
    main()
