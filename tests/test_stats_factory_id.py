"""Figures of servos with id 0: it addresses all mightyZAPs, and each leaves the factory with it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.options import Options
from sniffer.jobs.stats import stats
from sniffer.protocols import PROTOCOLS
from sniffer.simulation.buses import simulate
from sniffer.statistics.following import Follower
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from pathlib import Path


def test_a_servo_with_the_id_it_leaves_the_factory_with_has_all_figures(tmp_path: Path) -> None:
    path = tmp_path / "factory.bin"
    frames = simulate("mightyzap", seed=4, duration_s=2, servo_ids=[0, 1])
    path.write_bytes(b"".join(frame.wire for frame in frames))
    (bus,) = stats(path, Options(protocol="mightyzap")).as_dict()["buses"]
    assert [servo["servo_id"] for servo in bus["servos"]] == [0, 1]
    zero, one = bus["servos"]
    for key in ("values", "following_error", "steps"):
        told = [{(v.get("quantity"), v["unit"]) for v in servo[key]} for servo in (zero, one)]
        assert told[0] >= told[1] - {("force_limit", "")}
    assert zero["responses"] > 10


def test_what_is_said_to_id_0_is_for_all_until_a_servo_answers_so() -> None:
    def courses(*frames: bytes) -> dict[int, float]:
        decoder, follower = Decoder("mightyzap"), Follower(PROTOCOLS["mightyzap"])
        batches = decoder.feed(b"".join(frames)), decoder.close()
        told = [course for batch in batches for course in follower.add(batch)]
        return {course.servo_id: float(course.goal[-1]) for course in told}

    goal = packet(0, 0xF3, b"\x86\x00\x08")
    read = packet(1, 0xF2, b"\x8c\x02"), packet(1, 0, b"\x00\x02")
    own = packet(0, 0xF2, b"\x8c\x02"), packet(0, 0, b"\x00\x02")
    assert courses(goal, *read).keys() == {1}
    assert not math.isnan(courses(goal, *read)[1])
    assert math.isnan(courses(*own, goal, *read)[1])
    assert not math.isnan(courses(*own, goal, *read)[0])
