"""Rules of the user's own: what they say, when they are met, what counts for them."""

from __future__ import annotations

import itertools
import json
import re
from typing import TYPE_CHECKING, Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.anomalies.alarms import OPERATORS, Alarm, alarm_in, quantities, refusal
from sniffer.decoding.decoder import Decoder
from sniffer.ground.model import NS, Anomaly, Chunk, Clock, InputError
from sniffer.protocols import PROTOCOLS
from tests.commands import log, records, sniffer, talk, within
from tests.recordings import messages
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    import random
    from collections.abc import Sequence
    from pathlib import Path

MS: Final = 1_000_000
START_NS: Final = 1_700_000_000 * NS
POSITION, VOLTAGE, TEMPERATURE, GOAL = 0x8C, 0x92, 0x93, 0x86


def asked(servo: int, address: int, *reply: int) -> bytes:
    return packet(servo, 0xF2, bytes([address, len(reply)])) + packet(servo, 0, bytes(reply))


def at(ms: float, data: bytes) -> Chunk:
    return Chunk(data, START_NS + int(ms * MS), Clock.SAMPLE)


def hot(*degrees: int, step_ms: int = 500, servo: int = 1) -> list[Chunk]:
    """A temperature every half second."""
    return [at(k * step_ms, asked(servo, TEMPERATURE, c)) for k, c in enumerate(degrees)]


def found(chunks: Sequence[Chunk], *rules: str, cuts: Sequence[int] = ()) -> list[Anomaly]:
    """Return what the rules find, the chunks being decoded in passes that end at the cuts."""
    decoder = Decoder("mightyzap", baud=57600, alarms=[alarm_in(rule) for rule in rules])
    edges = [0, *cuts, len(chunks)]
    parts = [decoder.feed(*chunks[a:b]) for a, b in itertools.pairwise(edges)]
    every = [a for batch in (*parts, decoder.close()) for a in batch.anomalies]
    return [a for a in every if a.group == "yours"]


def told(chunks: Sequence[Chunk], *rules: str) -> list[str]:
    return [a.detail for a in found(chunks, *rules)]


# --- what is written -----------------------------------------------------------------------------


@given(
    st.sampled_from(["temperature", "position_error", "goal_position", "present_load"]),
    st.sampled_from(sorted(OPERATORS)),
    st.floats(-1e6, 1e6).map(lambda x: round(x, 3)),
    st.none() | st.integers(0, 255),
    st.sampled_from(["", "deg", "deg/s", "%", "mV"]),
    st.integers(0, 10**7).map(lambda n: n * 1000),
)
def test_a_rule_is_read_as_it_is_written(
    quantity: str, op: str, limit: float, servo: int | None, unit: str, for_ns: int
) -> None:
    rule = Alarm(quantity, op, limit, servo, unit, for_ns)
    assert alarm_in(str(rule)) == rule


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("temperature > 70 for 2s", "temperature > 70 for 2s"),
        ("temperature>70 °C", "temperature > 70 degC"),
        (" 3.voltage<9.0V for 500 ms ", "3.voltage < 9 V for 500ms"),
        ("position_error > 5 for 1min", "position_error > 5 for 60s"),
        ("load != -3", "load != -3"),
        ("force_on == 0", "force_on == 0"),
        ("arm:3 . voltage<9", "arm:3.voltage < 9"),
        ("left knee.voltage < 9", "left knee.voltage < 9"),
        ("left.knee.voltage < 9", "left.knee.voltage < 9"),
    ],
)
def test_a_rule_may_be_written_as_people_do(text: str, rule: str) -> None:
    assert str(alarm_in(text)) == rule


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("hot", "is no rule: write it like 'temperature > 70'"),
        ("temperature = 70", "is no rule"),
        ("temperature > hot", "is no rule"),
        ("temperature > 70 for", "is no rule"),
        ("temperature > 70 for ever", "'ever' is no time: write 2s or 500ms"),
        ("temperature > 70 for 2", "'2' is no time"),
        ("256.temperature > 70", "an id is 0..255"),
        ("arm:256.temperature > 70", "an id is 0..255"),
        ("x" * 100, "is no rule"),
    ],
)
def test_what_is_no_rule_is_refused_with_how_one_is_written(text: str, why: str) -> None:
    with pytest.raises(InputError, match=why.replace("?", r"\?")) as caught:
        alarm_in(text)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("rule", "protocol", "why"),
    [
        (
            "temprature > 70",
            "mightyzap",
            "mightyzap has no quantity 'temprature': did you mean temperature?",
        ),
        ("temperature > 70 deg", "rs30x", "temperature is in degC, not in deg"),
        ("temperature > 70", "wck", "wck has no quantity 'temperature': one of goal_position, "),
        ("position > 3 mm", "lss", "position is in deg, not in mm"),
    ],
)
def test_a_rule_that_no_servo_can_meet_is_refused_with_the_nearest_one(
    rule: str, protocol: str, why: str
) -> None:
    assert (refusal(alarm_in(rule), [PROTOCOLS[protocol]]) or "").startswith(why)


@pytest.mark.parametrize("protocol", list(PROTOCOLS.built_in))
def test_whatever_a_protocol_has_can_be_judged(protocol: str) -> None:
    p = PROTOCOLS[protocol]
    known = quantities([p])
    assert "position_error" in known
    numbers = [r.name for r in p.registers if r.type not in ("none", "text")]
    for name in (*known, *numbers[:3]):
        assert refusal(alarm_in(f"{name} > 1"), [p]) is None
        assert refusal(alarm_in(f"{name} > 1"), PROTOCOLS.values()) is None


# --- when it is met ------------------------------------------------------------------------------


def test_a_rule_is_told_when_it_begins_to_be_met_and_when_it_is_over() -> None:
    both = found(hot(60, 71, 72, 75, 70, 70, 80), "temperature > 70")
    assert [(a.code, a.servo_id, a.detail) for a in both] == [
        ("alarm", 1, "temperature > 70: servo 1 has 71 degC"),
        (
            "alarm-over",
            1,
            "temperature > 70: over after 1.5 s, servo 1 has 70 degC; at most it was 75 degC",
        ),
        ("alarm", 1, "temperature > 70: servo 1 has 80 degC"),
    ]
    length = len(asked(1, TEMPERATURE, 60))
    assert both[0].evidence == ((2 * length - 8, 8),), "the answer that says it"
    assert (both[0].severity.name, both[1].severity.name) == ("WARN", "NOTE")


def test_a_rule_with_a_time_is_met_once_a_value_shows_that_it_still_is_so() -> None:
    rule = "temperature > 70 for 1900ms"
    assert told(hot(71, 71, 71, 71), rule) == [], "1.5 s"
    assert told(hot(71, 71, 71, 71, 71, 71), rule) == [
        "temperature > 70 for 1900ms: servo 1 has 71 degC, for 2.0 s now"
    ]
    assert told(hot(71, 71, 71, 60, 71, 71, 71, 60), rule) == [], "it begins anew each time"
    apart = [*hot(71), at(5000, asked(1, TEMPERATURE, 71))]
    assert told(apart, rule) == ["temperature > 70 for 1900ms: servo 1 has 71 degC, for 5.0 s now"]


def test_a_stamp_that_may_be_late_proves_no_time() -> None:
    """Of 2 s by stamps that a host may have held for 16 ms, 1984 ms are sure."""
    sure, unsure = "temperature > 70 for 1900ms", "temperature > 70 for 1995ms"
    chunks = [Chunk(c.data, c.t_ns, Clock.READ) for c in hot(71, 71, 71, 71, 71)]
    assert len(told(chunks, sure, unsure)) == 1


def test_each_servo_meets_a_rule_for_itself_and_one_may_be_meant() -> None:
    both = [*hot(71, 71, 60), *(at(2000 + k, asked(2, TEMPERATURE, 90)) for k in range(2))]
    assert [a.servo_id for a in found(both, "temperature > 70")] == [1, 1, 2]
    assert [a.servo_id for a in found(both, "2.temperature > 70")] == [2]


def test_a_number_is_compared_as_it_is_written() -> None:
    """78 times 0.1 V is 7.800000000000001."""
    supply = [at(10 * k, asked(1, VOLTAGE, raw)) for k, raw in enumerate((80, 78, 77))]
    assert told(supply, "voltage < 7.8") == ["voltage < 7.8: servo 1 has 7.7 V"]
    assert told(supply, "voltage <= 7.8") == ["voltage <= 7.8: servo 1 has 7.8 V"]
    assert told(supply, "voltage == 7.8 V")[0] == "voltage == 7.8 V: servo 1 has 7.8 V"
    assert told(supply, "voltage > 7.8")[0] == "voltage > 7.8: servo 1 has 8 V"


def test_the_distance_from_the_goal_is_that_of_the_last_goal_of_that_servo() -> None:
    goal = packet(1, 0xF3, bytes([GOAL, 0x00, 0x04]))
    everyone = packet(254, 0xF3, bytes([GOAL, 0x00, 0x08]))
    here = asked(1, POSITION, 0x00, 0x04)
    chunks = [at(0, here), at(50, goal), at(100, here), at(150, everyone), at(200, here)]
    assert told(chunks, "position_error > 1 mm") == [
        "position_error > 1 mm: servo 1 has 7.50183 mm"
    ], "1024 ticks; without a goal nobody knows"
    assert told([*chunks, at(250, goal), at(300, here)], "position_error > 1")[1].startswith(
        "position_error > 1: over after 100 ms, servo 1 has 0 mm; at most it was 7.5"
    )


def test_a_goal_for_id_0_is_that_of_all_until_a_servo_answers_so() -> None:
    goal = packet(0, 0xF3, bytes([GOAL, 0x00, 0x08]))
    here, of_zero = asked(1, POSITION, 0x00, 0x04), asked(0, POSITION, 0x00, 0x04)
    one, zero = "servo 1 has", "servo 0 has"
    for chunks, who in (
        ([at(0, goal), at(50, here)], [one]),
        ([at(0, of_zero), at(50, goal), at(100, here), at(150, of_zero)], [zero]),
        ([at(0, packet(0, 0xF1) + packet(0, 0)), at(50, goal), at(100, here)], []),
    ):
        for cuts in (range(0), range(1, len(chunks))):
            said = [a.detail for a in found(chunks, "position_error > 1", cuts=cuts)]
            assert [text.split(": ")[1][: len(one)] for text in said] == who


def test_a_goal_that_was_refused_is_none() -> None:
    goal = packet(1, 0xF3, bytes([GOAL, 0x00, 0x0F])) + packet(1, 0x08)
    here = asked(1, POSITION, 0x00, 0x04)
    assert told([at(0, goal), at(50, here)], "position_error > 1") == []


@given(st.randoms(use_true_random=False), st.sampled_from(["", " for 25ms", " for 195ms"]))
def test_how_the_stream_is_cut_changes_nothing(rng: random.Random, long: str) -> None:
    chunks = [
        at(
            10 * k,
            asked(rng.choice((1, 2)), TEMPERATURE, rng.choice((69, 70, 71, 72)))
            if rng.random() < 0.7
            else packet(rng.choice((1, 254)), 0xF3, bytes([GOAL, rng.choice((0, 9)), 4]))
            + asked(1, POSITION, 0, rng.choice((3, 4, 9))),
        )
        for k in range(40)
    ]
    rules = (f"temperature > 70{long}", f"position_error > 1{long}", "2.temperature != 70")
    cuts = sorted(rng.sample(range(1, 40), rng.randint(1, 12)))
    whole = found(chunks, *rules)
    assert found(chunks, *rules, cuts=cuts) == whole
    assert [a.t_ns for a in whole if a.detail.startswith("temperature")] == by_hand(
        chunks, rules[0]
    )


def by_hand(chunks: Sequence[Chunk], rule: str) -> list[int]:
    """Return when a rule about temperatures begins and ends, one value at a time."""
    alarm = alarm_in(rule)
    decoder = Decoder("mightyzap", baud=57600)
    since: dict[int, int] = {}
    on: set[int] = set()
    out = []
    for batch in (decoder.feed(*chunks), decoder.close()):
        s = batch.samples
        for t_ns, servo, register, value in zip(
            s.t_ns.tolist(), s.servo_id.tolist(), s.register.tolist(), s.value, strict=True
        ):
            if decoder.protocol.registers[register].quantity != "temperature":
                continue
            if value > alarm.limit:
                since.setdefault(servo, t_ns)
                if servo not in on and t_ns - since[servo] >= alarm.for_ns:
                    on.add(servo)
                    out.append(t_ns)
            else:
                since.pop(servo, None)
                if servo in on:
                    on.remove(servo)
                    out.append(t_ns)
    return out


# --- as a user meets it --------------------------------------------------------------------------


def test_decode_reports_a_rule_and_fails_on_it(tmp_path: Path) -> None:
    path = tmp_path / "walk.log"
    path.write_text(log(talk(30)), encoding="utf-8")
    rules = ("--alarm", "temperature > 38", "--alarm", "2.position > 1000 ticks")
    ran = sniffer("decode", path, "--alarm", "temperature > 38", "--format", "jsonl")
    mine = [r for r in records(ran.out) if r["type"] == "anomaly" and r["group"] == "yours"]
    assert {r["code"] for r in mine} == {"alarm", "alarm-over"}
    assert records(ran.out)[-1]["codes"]["alarm"] == sum(r["code"] == "alarm" for r in mine)
    told = sniffer("decode", path, "--quiet", "--alarm", "voltage < 13", "--fail-on", "warn")
    assert (told.status, told.out) == (1, "")
    refused = sniffer("decode", path, *rules)
    assert refused.status == 2
    assert "2.position > 1000 ticks: position is in mm or deg" in refused.complaint


def test_a_rule_that_this_bus_cannot_meet_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "walk.log"
    path.write_text(log(talk(5)), encoding="utf-8")
    ran = within(capsys, "decode", path, "--alarm", "elapsed_time > 3", "--quiet")
    assert ran.status == 0
    assert ran.err.startswith(
        "sniffer: the rule 'elapsed_time > 3' judges nothing: mightyzap has no quantity"
    )


def test_a_recording_keeps_its_rules_and_meets_them_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, kept = tmp_path / "walk.log", tmp_path / "walk.mcap"
    path.write_text(log(talk(30)), encoding="utf-8")
    rules = ("--alarm", "temperature > 38", "--alarm", "position_error > 2 for 100ms")
    assert within(capsys, "decode", path, *rules, "-o", kept, "--quiet").status == 0
    recorded = [a.detail for a in messages(kept)["/bus0/anomalies"] if a.code == "alarm"]
    again = records(within(capsys, "decode", kept, "--format", "jsonl").out)
    assert [r["detail"] for r in again if r.get("code") == "alarm"] == recorded
    assert len(recorded) > 3
    other = records(
        within(capsys, "decode", kept, "--format", "jsonl", "--alarm", "voltage < 1").out
    )
    assert not any(r.get("code") == "alarm" for r in other), "what is said now counts"


def two_arms(path: Path) -> Path:
    """Write down two buses that say the same, each with a servo 1 of 39 °C and more."""
    left = log(talk(30))
    path.write_text(left + left.replace(" bus0 #", " arm #"), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("rule", "names", "who"),
    [
        ("arm:1.temperature > 38", (), {("arm", 1)}),
        ("knee.temperature > 38", ("1=knee",), {("arm", 1), ("bus0", 1)}),
        ("knee.temperature > 38", ("arm:1=knee",), {("arm", 1)}),
        ("a.b.temperature > 38", ("arm:1=a.b", "bus0:2=a.b"), {("arm", 1), ("bus0", 2)}),
    ],
)
def test_a_rule_names_a_servo_as_a_selection_does(
    rule: str,
    names: tuple[str, ...],
    who: set[tuple[str, int]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, kept = two_arms(tmp_path / "x.log"), tmp_path / "x.mcap"
    asked = ("--alarm", rule, *(word for name in names for word in ("--name", name)))
    assert within(capsys, "decode", path, *asked, "-o", kept, "--quiet").status == 0
    found = [r for r in records(within(capsys, "decode", kept, "--format", "jsonl").out)
             if r.get("code") == "alarm"]  # fmt: skip
    assert {(r["bus"], r["servo_id"]) for r in found} == who
    assert all(r["detail"].startswith(f"{rule}: servo ") for r in found)
    stats = json.loads(within(capsys, "stats", path, *asked, "--format", "json").out)
    told = {(b["bus"], r["servo_id"]) for b in stats["buses"] for r in b["alarms"]}
    assert told == who


def test_a_rule_on_a_name_says_nobodys_name_where_a_capture_is_made_anonymous(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, kept = two_arms(tmp_path / "x.log"), tmp_path / "x.mcap"
    asked = ("--alarm", "knee.temperature > 38", "--name", "arm:1=knee")
    assert within(capsys, "convert", path, kept, *asked, "--anonymise", "-q").status == 0
    assert b"knee" not in kept.read_bytes()
    rows = records(within(capsys, "decode", kept, "--format", "jsonl").out)
    found = [r for r in rows if r.get("code") == "alarm"]
    assert {(r["bus"], r["servo_id"]) for r in found} == {("bus1", 1)}
    assert found[0]["detail"].startswith("bus1:1.temperature > 38: servo 1 has ")


@pytest.mark.parametrize(
    ("rule", "status", "why"),
    [
        ("kne.load > 1", 2, "kne.load > 1: no servo is called 'kne': did you mean knee?"),
        ("amr:1.load > 1", 0, "the rule 'amr:1.load > 1' judges nothing: amr:1 is on none of the"),
    ],
)
def test_a_rule_on_nobody_is_told(
    rule: str, status: int, why: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = two_arms(tmp_path / "x.log")
    ran = within(capsys, "decode", path, "--name", "1=knee", "--alarm", rule, "--quiet")
    assert ran.status == status
    assert f"sniffer: {why}" in ran.err


def test_a_rule_for_some_time_counts_what_the_bytes_alone_take_where_there_is_no_clock(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was so at least as long: there were pauses between. Figures of time are none, then."""
    path = tmp_path / "x.bin"
    path.write_bytes(b"".join(chunk.data for chunk in hot(*[80] * 900)))
    rule = ("--alarm", "temperature > 70 for 500ms", "--protocol", "mightyzap")
    ran = within(capsys, "decode", path, *rule, "--code", "alarm", "--format", "jsonl")
    (told,) = (row for row in records(ran.out) if row["type"] == "anomaly")
    assert 500 * MS <= told["t_ns"] <= 520 * MS
    assert re.search(r" met by +of values ", within(capsys, "stats", path, *rule).out)
