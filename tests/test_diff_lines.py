"""The lines of ``sniffer diff``: broken where somebody looks, whole in a pipe."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.commands import within
from tests.test_diff import CAPTURES, Capsys

if TYPE_CHECKING:
    import pytest


def test_a_difference_is_broken_between_words_where_somebody_looks_and_one_line_in_a_pipe(
    capsys: Capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = [CAPTURES / f"mightyzap_{kind}.log" for kind in ("clean", "damaged")]
    monkeypatch.delenv("COLUMNS", raising=False)
    plain = within(capsys, "diff", *runs).out.splitlines()
    assert max(map(len, plain)) > 80
    monkeypatch.setenv("COLUMNS", "80")
    narrow = within(capsys, "diff", *runs).out.splitlines()
    assert max(map(len, narrow)) <= 80
    assert " ".join(" ".join(narrow).split()) == " ".join(" ".join(plain).split())
