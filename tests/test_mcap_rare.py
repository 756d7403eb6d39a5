"""Gaps and anomalies of a recording: put together from parts, they are what protobuf makes."""

from __future__ import annotations

import json
from typing import Final

import pytest
from google.protobuf.timestamp_pb2 import Timestamp
from hypothesis import example, given
from hypothesis import strategies as st

from sniffer.anomalies.rules import anomaly
from sniffer.decoding.called import Named, ServoNames
from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import NS, Anomaly, Chunk
from sniffer.mcapfile.levels import LEVELS, SEVERITIES, named
from sniffer.mcapfile.rare import anomaly_messages, gap_messages, log_messages
from sniffer.mcapfile.varints import key
from sniffer.messages import log_pb2, recording_pb2
from tests.commands import damaged, talk

LONG: Final = st.integers(0, (1 << 63) - 1)
FOUND: Final = st.builds(
    lambda code, t, who, text, spans: anomaly(code, t, who, text, *spans),
    st.sampled_from(["noise", "no-response", "clock-step", "rate-found"]),
    st.integers(-(1 << 40), (1 << 62)),
    st.integers(-1, 254),
    st.text(max_size=300),
    st.lists(st.tuples(LONG, LONG), max_size=3),
)


@given(st.lists(FOUND, max_size=4), st.sampled_from([{}, {("arm", 3): "knee", 0: "hip"}]))
@example([anomaly("no-response", 0, 3, "servo 3 did not answer")], {("arm", 3): "knee"})
def test_an_anomaly_is_the_message_that_protobuf_makes_and_a_line_with_names(
    found: list[Anomaly], called: dict[Named, str]
) -> None:
    names = ServoNames(called)
    for a, body, line in zip(
        found, anomaly_messages(found), log_messages(found, "arm", names), strict=True
    ):
        spans = [recording_pb2.Anomaly.Evidence(offset=at, length=n) for at, n in a.evidence]
        assert recording_pb2.Anomaly.FromString(body) == recording_pb2.Anomaly(
            t_ns=a.t_ns,
            severity=SEVERITIES[a.severity],
            group=a.group,
            code=a.code,
            servo_id=a.servo_id,
            detail=a.detail,
            evidence=spans,
        )
        who = named(-1 if a.servo_id is None else a.servo_id, a.detail)
        assert log_pb2.Log.FromString(line) == log_pb2.Log(
            timestamp=Timestamp(seconds=a.t_ns // NS, nanos=a.t_ns % NS),
            level=LEVELS[a.severity],
            message=f"{names.sentence('arm', f'{who}{a.detail}')} [{a.code}]",
            name="arm",
        )


@pytest.mark.parametrize("base", [0, 1 << 40])
def test_a_gap_is_the_message_that_protobuf_makes(base: int) -> None:
    batch = Decoder("mightyzap", base=base).feed(Chunk(damaged(talk(40))))
    assert {g.reason for g in batch.gaps} >= {"damaged", "noise"}
    for g, body in zip(batch.gaps, gap_messages(batch), strict=True):
        told = recording_pb2.Gap.FromString(body)
        assert json.loads(told.detail) == json.loads(json.dumps(dict(g.detail), default=repr))
        told.ClearField("detail")
        assert told == recording_pb2.Gap(
            t_ns=g.t_ns,
            offset=base + g.start,
            length=g.length,
            reason=g.reason,
            data=batch.data[g.start : g.start + g.length],
        )


def test_a_field_whose_type_is_not_written_here_has_no_key() -> None:
    with pytest.raises(KeyError):
        key(recording_pb2.Anomaly, "servo_id")
