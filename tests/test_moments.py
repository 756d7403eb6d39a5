"""Times as people read them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sniffer.ground.model import NS
from sniffer.ground.moments import of_day
from tests.commands import within

if TYPE_CHECKING:
    from pathlib import Path

DAY = 86_400 * NS


@pytest.mark.parametrize(
    ("t_ns", "digits", "told"),
    [
        (1_795_215_306_365_183_999, 6, "22:55:06.365183"),
        (1_795_215_306_965_183_000, 0, "22:55:06"),
        (365_183_000, 3, "00:00:00.365"),
        (2 * DAY + 1, 1, "48:00:00.0"),  # a capture that counts from its begin is not at midnight
        (-1_500_000_000, 1, "-00:00:01.5"),  # in front of a trigger
    ],
)
def test_a_time_is_one_of_day_or_counts_on(t_ns: int, digits: int, told: str) -> None:
    assert of_day(t_ns, digits) == told


def test_a_time_without_a_date_is_the_same_wherever_it_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "a.log"
    asks = (f"({n / 10:.6f}) bus0 #FFFFFF0102F10B\n" for n in range(1, 30))
    log.write_text("".join(asks), encoding="ascii")
    table = within(capsys, "decode", log, "--protocol", "mightyzap").out
    assert "00:00:00.1" in table
    assert "at byte 0, 00:00:00.1" in within(capsys, "explain", f"{log}@0").out
    told = within(capsys, "diagnose", log, "--protocol", "mightyzap").out
    assert "00:00:00.1 error" in told
