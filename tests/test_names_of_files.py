"""How a script names files: as text or as paths, one or several."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

import sniffer
from sniffer.ground.model import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

CAPTURE: Final = Path(__file__).parents[1] / "sample_captures" / "mightyzap_clean.log"
PART: Final = sniffer.Window(0.0, 0.5)

WRITES: Final[dict[str, Callable[[Any], object]]] = {
    "convert": lambda files: sniffer.convert(CAPTURE, files),
    "cut": lambda files: sniffer.cut(CAPTURE, files, PART),
    "split": lambda files: sniffer.split(CAPTURE, files, 10 * 10**9),
    "merge": lambda files: sniffer.merge([CAPTURE], files, together=True),
}


@pytest.mark.parametrize("job", WRITES)
@pytest.mark.parametrize("naming", ["text", "path", "texts"])
def test_outputs_are_named_as_text_or_as_paths(job: str, naming: str, tmp_path: Path) -> None:
    path = tmp_path / "x.log"
    named: dict[str, Any] = {"text": str(path), "path": path, "texts": [str(path)]}
    WRITES[job](named[naming])
    assert [file.stat().st_size > 1000 for file in tmp_path.glob("x*.log")] == [True]


READS: Final[dict[str, Callable[[Any], object]]] = {
    "diagnose": sniffer.diagnose,
    "stats": sniffer.stats,
    "query": lambda data: sniffer.query("SELECT 1", [data]),
}


@pytest.mark.parametrize("job", READS)
def test_bytes_in_place_of_a_name_are_refused_in_words(job: str) -> None:
    with pytest.raises(InputError, match="a path is needed, or several: bytes are for"):
        READS[job](CAPTURE.read_bytes())
