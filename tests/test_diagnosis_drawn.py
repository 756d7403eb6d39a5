"""What conversations that were drawn were once taken for, and is not in them."""

from __future__ import annotations

from bench.diagnosis.catalogue import scenarios
from bench.diagnosis.hosts import HOSTS
from bench.diagnosis.judging import diagnosed
from tests.lists import each_in_turn


@each_in_turn(
    5,
    ("name", "host", "cause"),
    [
        # the next request lies over a servo's answers: one torn frame, over and over
        ("impatient-with-a-slow-setting-rs30x", "usb16", "clock-drift"),
        # the copies of the first requests stand where answers are due until the echo is known
        ("echo-mightyzap", "log", "impatient-controller"),
        # half a goal is one the program never meant: its motor holds where it was told to be
        ("partial-write-rs30x", "raw", "stall"),
        # an alarm is in one frame of hundreds that are torn, and gone in the next
        ("mixed-duplicate-and-noise-mightyzap", "exact", "goal-out-of-range"),
        # line errors told by the packet are those of its other exchanges: few answers are torn
        ("impatient-controller-rs30x", "usb16", "clock-drift"),
    ],
)
def test_what_is_not_there_is_not_surely_told(name: str, host: str, cause: str) -> None:
    (scenario,) = scenarios(0, name)
    told, _ = diagnosed(HOSTS[host](scenario, scenario.make(0), 0))
    first = [one.causes[0] for one in told if one.causes]
    assert not [sure for what, sure in first if what == cause and sure > 0.6]
