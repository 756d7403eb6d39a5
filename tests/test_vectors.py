"""Every example frame of the manuals, decoded: the good ones as stated, the wrong ones as wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import sniffer
from sniffer.decoding.rows import FrameRow, GapRow, TransactionRow
from sniffer.protocols import PROTOCOLS
from tests.vectors import Vector, vectors

if TYPE_CHECKING:
    from collections.abc import Iterator

ALL = [v for name in PROTOCOLS for v in vectors(name)]
MODELS = {"12lf": "mightyzap-12lf", "lsspro_": "lss-pro", "rs301_": "rs301cr"}
"""Tables other than the default, by what the name of a vector holds."""
GOOD = [v for v in ALL if v.verdict == "good"]
WRONG = [v for v in ALL if v.verdict == "bad_checksum"]


def named(some: list[Vector]) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("vector", some, ids=lambda v: v.name)


def decoded(vector: Vector) -> list[Any]:
    model = next((model for mark, model in MODELS.items() if mark in vector.name), None)
    models: dict[int | None, str] | None = {None: model} if model else None
    return list(
        sniffer.decode(
            vector.after + vector.data, vector.protocol, input_format="bin", models=models
        )
    )


def leaves(value: Any) -> Iterator[Any]:
    """Yield every plain value inside fields, and dictionary keys (servo ids, register names)."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield key
            yield from leaves(inner)
    elif isinstance(value, (list, tuple)):
        for inner in value:
            yield from leaves(inner)
    else:
        yield value


def stated(want: Any, among: list[Any]) -> bool:
    if isinstance(want, dict):
        return all(stated(k, among) and stated(v, among) for k, v in want.items())
    if isinstance(want, list):
        return all(stated(w, among) for w in want)
    if isinstance(want, bool):
        return True  # a name or a missing value says it; the vector's own test file checks them
    if isinstance(want, str):
        text = want.lower().replace(" ", "_")
        return any(isinstance(x, str) and text in x.lower().replace(" ", "_") for x in among)
    among = [int(x) if isinstance(x, str) and x.isdecimal() else x for x in among]
    numbers = [float(x) for x in among if isinstance(x, (int, float)) and not isinstance(x, bool)]
    # the manuals state milliseconds and amperes where the tables have seconds and milliamperes
    return any(n * k == pytest.approx(want, abs=0.006) for n in numbers for k in (1, 1000, 0.001))


@named(GOOD)
def test_a_good_example_is_one_frame_that_says_what_the_manual_says(vector: Vector) -> None:
    rows = decoded(vector)
    frames = [r for r in rows if isinstance(r, FrameRow) and r.offset == len(vector.after)]
    assert len(frames) == 1, f"{vector.name} ({vector.source}): {rows}"
    frame = frames[0]
    assert bytes.fromhex(frame.hex) == vector.data
    assert frame.kind == vector.kind
    assert frame.op == vector.op
    if vector.servo_id is not None:
        assert frame.servo_id == vector.servo_id
    among = [*leaves(frame.fields), frame.servo_id]
    missing = {k: v for k, v in vector.fields.items() if not stated(v, among)}
    assert not missing, f"{vector.name}: not among {frame.fields}"


@named([v for v in GOOD if v.after])
def test_a_good_answer_belongs_to_its_request(vector: Vector) -> None:
    pairs = [r for r in decoded(vector) if isinstance(r, TransactionRow)]
    mine = [p for p in pairs if p.response_offset == len(vector.after)]
    assert [(p.request_offset, p.outcome) for p in mine] == [(0, "ok")]


@named(WRONG)
def test_a_wrong_example_is_reported_with_the_checksum_it_should_have(vector: Vector) -> None:
    rows = decoded(vector)
    assert not [r for r in rows if isinstance(r, FrameRow) and r.offset == len(vector.after)]
    gaps = [r for r in rows if isinstance(r, GapRow) and r.offset == len(vector.after)]
    assert [g.reason for g in gaps] == ["damaged"]
    assert gaps[0].detail["checksum_got"] != gaps[0].detail["checksum_expected"]
