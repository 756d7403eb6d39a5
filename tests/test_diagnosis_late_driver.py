"""A wCK whose driver comes on a third of a byte late: its one answer is torn, no second one comes.

``data/wck_driver_late.log.gz`` is a line by its bits: a controller of five servos at 115200, each
answer of servo 4 without the first 0.3 byte times, the controller waiting 20 ms where one is torn.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tests.commands import within

if TYPE_CHECKING:
    import pytest

LATE: Final = Path(__file__).parent / "data" / "wck_driver_late.log.gz"
SURE: Final = 0.8


def test_requests_torn_behind_one_servos_exchanges_are_no_sure_sign_of_a_second_answer(
    capsys: pytest.CaptureFixture[str],
) -> None:
    done = within(capsys, "diagnose", LATE, "--baud", "115200", "--format", "json")
    (incident, *_) = json.loads(done.out)["incidents"]
    assert incident["servo_ids"] == [4]
    sure = {c["cause"]: c["confidence"] for c in incident["causes"]}
    assert sure.get("duplicate-id", 0.0) < SURE
