"""What conversations that were drawn were once taken for, and is not in them."""

from __future__ import annotations

import pytest

from bench.diagnosis.catalogue import scenarios
from bench.diagnosis.hosts import HOSTS
from bench.diagnosis.judging import diagnosed
from tests.lists import each_in_turn
from tests.test_diagnosis_line import drawn


@each_in_turn(
    19,
    ("name", "draw", "host", "cause"),
    [
        # the next request lies over a servo's answers: one torn frame, over and over
        ("impatient-with-a-slow-setting-rs30x", 0, "usb16", "clock-drift"),
        # the copies of the first requests stand where answers are due until the echo is known
        ("echo-mightyzap", 0, "log", "impatient-controller"),
        # half a goal is one the program never meant: its motor holds where it was told to be
        ("partial-write-rs30x", 0, "raw", "stall"),
        # an alarm is in one frame of hundreds that are torn, and gone in the next
        ("mixed-duplicate-and-noise-mightyzap", 0, "exact", "goal-out-of-range"),
        # line errors told by the packet are those of its other exchanges: few answers are torn
        ("impatient-controller-rs30x", 0, "usb16", "clock-drift"),
        # ends of requests that are said again later are no second answers
        ("impatient-controller-wck", 99917, "exact", "duplicate-id"),
        # what a slow clock makes of a joint that moves is here and there, too
        ("mixed-tap-loss-and-drift-wck", 99917, "exact", "duplicate-id"),
        # a servo's own fault comes in the rhythm of its requests
        ("clock-drift-fast-lss", 99917, "exact", "two-masters"),
        # three ends of frames beside a hundred that a second answer lies over
        ("duplicate-id-apart-rs30x", 99917, "raw", "tap-loss"),
        # damage that may as well go with the motors
        ("emi-load-mightyzap", 99917, "exact", "bus-noise"),
        # one bit that no checksum covers is altered in goals as in positions
        ("signal-integrity-bit-wck", 99931, "exact", "position-jump"),
        # a torn answer that holds names who is not there
        ("duplicate-id-overlap-mightyzap", 99931, "usb16", "overheat"),
        # of a servo that was asked seldom nobody knows whether it loses fewer answers
        ("echo-differs-mightyzap", 99931, "log", "bad-cable"),
        # two ask, and several servos answer twice now and then
        ("two-masters-wck", 99919, "exact", "duplicate-id"),
        # a byte of noise is what some request is at some rate, one by one
        ("emi-load-mightyzap", 400, "exact", "rate-search"),
        ("emi-load-lss", 405, "exact", "rate-search"),
        # goals that are written by halves send a joint anywhere
        ("partial-write-mightyzap", 99929, "exact", "position-jump"),
        # looks come right behind goals that jump each time: motors start
        ("sound-sixteen-rs30x", 99929, "exact", "overload"),
        # requests are missing behind a servo's torn answers: they were said into them
        ("impatient-controller-lss", 99929, "exact", "duplicate-id"),
    ],
)
def test_what_is_not_there_is_not_surely_told(name: str, draw: int, host: str, cause: str) -> None:
    (scenario,) = scenarios(draw, name)
    told, _ = diagnosed(HOSTS[host](scenario, scenario.make(draw), draw))
    first = [one.causes[0] for one in told if one.causes]
    assert not [sure for what, sure in first if what == cause and sure > 0.65]


@each_in_turn(
    4,
    ("name", "host", "servo"),
    [
        # its second answer stands for that of 7, whose own one stands for that of 9
        ("duplicate-id-apart-wck", "exact", 0),
        # its second answer begins as steadily as the first, but where a request lies over it
        ("mixed-duplicate-and-noise-wck", "exact", 1),
        # its second answer lies over that of 7, from which it differs in one bit
        ("duplicate-id-apart-rs30x", "usb16", 6),
        ("duplicate-id-apart-rs30x", "raw", 6),
    ],
)
def test_a_second_answer_is_that_of_the_servo_that_was_asked_for_it(
    name: str, host: str, servo: int
) -> None:
    (scenario,) = scenarios(99917, name)
    told, _ = diagnosed(HOSTS[host](scenario, scenario.make(99917), 99917))
    assert [one.servo_ids for one in told if one.cause == "duplicate-id"] == [(servo,)]


@pytest.mark.parametrize("protocol", ["rs30x", "wck", "lss"])
def test_noise_that_comes_in_episodes_meets_episodes_of_motion_by_chance(protocol: str) -> None:
    """Of quarters of a second that are like the ones before not each tells anew."""
    told = drawn(f"bus-noise-episodes-{protocol}", 99927)
    assert not told & {"damage-while-moving", "damage-behind-steps"}
