"""Sample captures decode as they did; pages written from code are up to date."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sniffer.decoding.detect import detect
from sniffer.protocols import PROTOCOLS
from sniffer.sources import open_source
from tests.golden import PAGES, ROOT, captures, golden, golden_path, protocol_of

if TYPE_CHECKING:
    from pathlib import Path

HINT = "if the change is meant: make golden, and read the diff"


@pytest.mark.parametrize("capture", captures(), ids=lambda p: p.name)
def test_a_sample_capture_decodes_as_its_golden_file_says(capture: Path) -> None:
    assert golden(capture) == golden_path(capture).read_text(encoding="utf-8"), HINT


@pytest.mark.parametrize("capture", captures(), ids=lambda p: p.name)
def test_the_protocol_of_a_sample_capture_is_told_from_its_bytes(capture: Path) -> None:
    chunks = [c for group in open_source(capture) for c in group]
    assert detect(chunks).protocol == protocol_of(capture)


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_protocol_has_a_clean_and_a_damaged_capture_and_a_page(name: str) -> None:
    kinds = {p.stem.split("_")[1] for p in captures() if protocol_of(p) == name}
    assert {"clean", "damaged", "manual"} <= kinds
    assert (ROOT / "docs" / "protocols" / f"{name}.md").is_file()


@pytest.mark.parametrize("page", PAGES)
def test_a_page_written_from_code_says_what_the_code_does(page: str) -> None:
    assert (ROOT / "docs" / page).read_text(encoding="utf-8") == PAGES[page](), HINT
