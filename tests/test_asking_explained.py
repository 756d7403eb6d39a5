"""Bytes of a capture that are asked for by place, explained field by field."""

from __future__ import annotations

import json

from tests.commands import within
from tests.test_asking import CAPTURE, Capsys, told


def test_the_byte_that_a_message_names_is_explained(capsys: Capsys) -> None:
    ran = within(capsys, "explain", f"{CAPTURE}@12175")
    assert ran.status == 0
    assert "request: load_data, servo 1" in ran.out
    assert "response: load_data, servo 1" in ran.out
    assert ran.out.index("at byte 12164") < ran.out.index("at byte 12173")
    gap = within(capsys, "explain", f"{CAPTURE}@99999")
    assert (gap.status, gap.complaint) == (
        2,
        f"{CAPTURE}: there is no byte 99999: it has bus0 18442",
    )
    assert within(capsys, "explain", "run@x").complaint.startswith("'@x': there is no such place")
    assert within(capsys, "explain", "@12").complaint.endswith("as FILE@12175")


def test_a_byte_is_explained_with_what_was_found_there(capsys: Capsys) -> None:
    out = within(capsys, "decode", CAPTURE, "--format", "jsonl").out
    found = [r for r in map(json.loads, out.splitlines()) if r["type"] == "anomaly"]
    for one in found[::7]:
        at = one["evidence"][0][0]
        for place in (str(at), f"bus0:{at}", f"byte:{at}", f"byte:bus0:{at}"):
            head, *_ = within(capsys, "explain", f"{CAPTURE}@{place}").out.splitlines()
            assert f"{one['code']}: {one['detail']}" in head


def test_what_an_anomaly_is_about_is_explained_without_asking_for_its_byte(capsys: Capsys) -> None:
    rows = told(capsys, "--code", "bad-checksum")[:-1]
    assert [row["servo_id"] for row in rows] == [1, 1]
    places = ("bad-checksum:1", "bad-checksum:2", "bad-checksum:2:servo=1")
    for place, row in zip(places, [*rows, rows[1]], strict=True):
        ran = within(capsys, "explain", f"{CAPTURE}@{place}")
        (at, _), *_ = row["evidence"]
        head, what, *rest = ran.out.splitlines()
        assert head == f"{CAPTURE}, byte {at} of bus0"
        assert what == f"bad-checksum: {row['detail']}"
        byte = within(capsys, "explain", f"{CAPTURE}@{at}")
        assert (ran.status, rest) == (1, byte.out.splitlines()[1:])
    nothing = within(capsys, "explain", f"{CAPTURE}@bad-checksum:9")
    assert (nothing.status, nothing.out) == (2, "")
    assert nothing.complaint == "@bad-checksum:9: the capture has 2 of them"
