"""The lines of ``sniffer diff``: broken where somebody looks, whole in a pipe."""

from __future__ import annotations

from tests.commands import within
from tests.terminals import LINUX_ONLY
from tests.test_cli_terminal import on_a_terminal
from tests.test_diff import CAPTURES, Capsys


@LINUX_ONLY
def test_a_difference_is_broken_between_words_where_somebody_looks_and_one_line_in_a_pipe(
    capsys: Capsys,
) -> None:
    runs = [CAPTURES / f"mightyzap_{kind}.log" for kind in ("clean", "damaged")]
    plain = within(capsys, "diff", *runs).out.splitlines()
    assert max(map(len, plain)) > 80
    narrow = on_a_terminal("diff", *runs, status=1, COLUMNS="80").splitlines()
    assert max(map(len, narrow)) <= 80
    assert " ".join(" ".join(narrow).split()) == " ".join(" ".join(plain).split())
