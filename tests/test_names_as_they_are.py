"""Names of servos with signs that mean something to a library: they are shown as they are."""

from __future__ import annotations

import pytest

from tests.commands import within
from tests.lists import in_turn
from tests.test_names import DAMAGED


@in_turn(2)
@pytest.mark.parametrize("name", ["hip[left]", ":eye:"])
@pytest.mark.parametrize(
    "command", [("stats",), ("state",), ("diagnose",), ("decode", "--summary")], ids=" ".join
)
def test_a_name_with_brackets_or_colons_is_shown_as_it_is(
    command: tuple[str, ...], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was taken for markup of the library that lays tables out, or for a picture."""
    shown = within(capsys, *command, DAMAGED, *(f"--name={n}={name}" for n in (1, 2, 3))).out
    assert name in shown
    assert shown.count("hip") == shown.count("hip[left]")
    assert "\N{EYE}" not in shown
