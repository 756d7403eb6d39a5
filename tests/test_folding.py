"""What is printed into a pipe has a sentence in one line; a window and COLUMNS fold it."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest

from tests.commands import within
from tests.golden import CAPTURES
from tests.lists import in_turn

if TYPE_CHECKING:
    from pathlib import Path

Capsys = pytest.CaptureFixture[str]

WCK = str(CAPTURES / "wck_damaged.log")
ZAP = str(CAPTURES / "mightyzap_damaged.log")


@in_turn(3)
@pytest.mark.parametrize(
    "asked",
    [
        ("decode", WCK, "--summary"),
        ("decode", ZAP, "--summary", "--verbose"),
        ("decode", WCK),
        ("decode", ZAP, "--servo", "3", "--op", "store_data"),
        ("replay", WCK, "--speed", "0"),
        ("report", ZAP),
        ("report", ZAP, "-o", "OUT.md"),
        ("check", "--rules", "RULES", ZAP),
        ("diagnose", WCK),
        ("discover", ZAP),
        ("diff", str(CAPTURES / "wck_clean.log"), WCK),
        ("fleet", WCK, ZAP, "-o", "OUT"),
    ],
    ids=lambda asked: " ".join(word.rpartition("/")[2] for word in asked),
)
def test_nothing_is_folded_in_a_pipe(
    asked: tuple[str, ...], tmp_path: Path, capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text(within(capsys, "check", "--example").out)

    def told(folder: str) -> str:
        out = tmp_path / folder
        out.mkdir()
        stands = {"OUT.md": out / "x.md", "OUT": out / "set", "RULES": rules}
        ran = within(capsys, *(stands.get(word, word) for word in asked))
        assert ran.status in (0, 1), ran.err
        page = stands["OUT.md"]
        written = page.read_text() if "OUT.md" in asked else ran.out
        _, _, below = written.replace(str(out), "").rpartition("\nbus0: ")  # cells have more room
        return re.sub("  +", "  ", below)

    monkeypatch.delenv("COLUMNS", raising=False)
    piped = told("piped")
    monkeypatch.setenv("COLUMNS", "9999")
    assert piped == told("wide")
    assert piped


def test_the_sentences_of_stats_are_lines_in_a_pipe(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)
    (bus,) = json.loads(within(capsys, "stats", WCK, "--format", "json").out)["buses"]
    gaps = ", ".join(f"{n} {reason}" for reason, n in bus["gaps"].items())
    told = f"{bus['bytes_in_gaps']} in gaps ({gaps})"
    assert sum(line.endswith(told) for line in within(capsys, "stats", WCK).out.splitlines()) == 1
    monkeypatch.setenv("COLUMNS", "70")
    assert max(map(len, within(capsys, "stats", WCK).out.splitlines())) <= 80
