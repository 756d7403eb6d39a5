"""The picture of a report in the documentation: ``python -m tests.pictures`` takes it anew."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

from sniffer.jobs.report import report
from tests.browser import Browser
from tests.transcripts import ROOT

CAPTURE: Final = "sample_captures/mightyzap_damaged.log"
PICTURE: Final = ROOT / "docs" / "images" / "report.png"

LESS: Final = """
  const drop = (which) => document.querySelectorAll(which).forEach((e) => e.remove());
  drop(".incident ~ .incident, .exhibit ~ .exhibit ~ .exhibit, .servo ~ .servo, footer");
  drop("#times, #anomalies, #bytes, #recorded, nav");
"""
"""Leaves of each kind of thing the first one: a page is longer than a picture may be."""


def main() -> None:
    """Take the picture."""
    with tempfile.TemporaryDirectory() as folder, Browser(Path(folder) / "profile") as browser:
        page = Path(folder) / "report.html"
        done = report(ROOT / CAPTURE, page)
        text = page.read_text(encoding="utf-8")
        page.write_text(text.replace(done.content.name, CAPTURE), encoding="utf-8")
        browser.open(page, width=1100)
        browser.eval(LESS)
        browser.picture(PICTURE, whole=True)


if __name__ == "__main__":
    main()
