"""Questions for a number: how fast, how often, how much, how far, how sure."""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pytest

from tests.questions.asking import each

if TYPE_CHECKING:
    from tests.questions.asking import Asker, Capture, Row, Rows

NS = 1_000_000_000
Z = 1.959963984540054
"""Of the normal distribution: 95 % are within it."""


def asked(capture: Capture) -> dict[tuple[int | None, str], Rows]:
    """Return the exchanges by servo and command."""
    return dict(each(capture.of("transaction"), lambda r: (r["servo_id"], r["op"])))


def took(rows: Rows) -> list[int]:
    return [r["response_time_ns"] for r in rows if r["response_time_ns"] is not None]


def commands(bus: Row) -> dict[tuple[int | None, str], Row]:
    return {(c["servo_id"], c["op"]): c for c in bus["commands"]}


def servos(bus: Row) -> dict[int, Row]:
    return {s["servo_id"]: s for s in bus["servos"]}


def is_timed(capture: Capture) -> bool:
    return any(took(rows) for rows in asked(capture).values())


def test_which_command_is_slowest(capture: Capture, asker: Asker) -> None:
    told = commands(asker.bus(capture.path, led_by="how fast"))
    longest = {key: max(took(rows)) for key, rows in asked(capture).items() if took(rows)}
    for key, true in longest.items():
        low, high = told[key]["response_time_ns"]["max"]
        assert low <= true <= high
    slowest = max(longest, key=lambda key: longest[key])
    assert max(
        (key for key in longest), key=lambda key: sum(told[key]["response_time_ns"]["max"])
    ) in {key for key in longest if longest[key] >= longest[slowest] * 0.98}


def test_the_longest_reply_is_one_figure_wherever_it_is_told(
    capture: Capture, asker: Asker
) -> None:
    told = servo_maxima(asker.bus(capture.path))
    summary = asker.ask("decode", capture.path, "--summary", led_by="summary only").out
    report = asker.ask("report", capture.path, led_by="response times").out
    for who, rows in each(capture.of("transaction"), lambda r: r["servo_id"]):
        if not took(rows):
            continue
        slowest = max(
            (r for r in rows if r["response_time_ns"] is not None),
            key=lambda r: r["response_time_ns"] + r["uncertainty_ns"],
        )
        ns, spread = slowest["response_time_ns"], slowest["uncertainty_ns"]
        if spread > ns / 10:
            continue  # told as bounds
        written = f"{ns / 1e6:.2f}"
        assert told[who] == [ns - spread, ns + spread]
        assert re.search(rf"^ +{who} .* {re.escape(written)} ", summary, re.M), (who, written)
        assert written in report


def servo_maxima(bus: Row) -> dict[int | None, list[int]]:
    """Return the bounds of the longest reply of each servo."""
    out: dict[int | None, list[int]] = {}
    for (who, _), command in commands(bus).items():
        if command["response_time_ns"]:
            bounds = command["response_time_ns"]["max"]
            out[who] = [max(a, b) for a, b in zip(bounds, out.get(who, [0, 0]), strict=True)]
    return out


def test_how_long_an_answer_takes_in_the_middle_and_at_worst(
    capture: Capture, asker: Asker
) -> None:
    told = commands(asker.bus(capture.path))
    for key, rows in asked(capture).items():
        if not took(rows):
            continue
        times = np.array(took(rows))
        assert told[key]["response_time_ns"]["count"] == len(times)
        for name, share in (("p50", 0.5), ("p95", 0.95), ("p99", 0.99)):
            low, high = told[key]["response_time_ns"][name]
            inner = np.quantile(times, share, method="lower")
            outer = np.quantile(times, share, method="higher")
            assert low <= outer * 1.02, (key, name)
            assert high >= inner * 0.98, (key, name)


def test_which_servo_answers_last(capture: Capture, asker: Asker) -> None:
    told = asker.rows(
        "query", "SELECT servo_id, median(response_time_ns) AS ns FROM transactions "
        "WHERE response_time_ns IS NOT NULL GROUP BY servo_id ORDER BY ns DESC", capture.path,
        "--format", "json", led_by="max(response_time_ns)",
    )  # fmt: skip
    rows = pd.DataFrame(capture.of("transaction"))
    mine = rows.groupby("servo_id")["response_time_ns"].median().dropna()
    assert {r["servo_id"]: r["ns"] for r in told} == pytest.approx(mine.to_dict())
    assert told[0]["ns"] == mine.max()


def test_how_much_of_the_time_the_bus_is_busy(capture: Capture, asker: Asker) -> None:
    bus = asker.bus(capture.path, "--every", "1s", led_by="load second")
    slices = bus["slices"]
    counted = np.zeros(len(slices["bytes"]))
    for r in capture.in_order:
        counted[(r["t_ns"] - slices["first_ns"]) // NS] += len(r["hex"]) // 2
    assert sum(slices["bytes"]) == counted.sum() == capture.rows[-1]["bytes"]
    longest = max(len(r["hex"]) // 2 for r in capture.in_order)
    assert np.abs(np.array(slices["bytes"]) - counted).max() <= 2 * longest, "a frame at each edge"
    shares = np.array(slices["bytes"]) * 10 / bus["baud"]
    assert bus["load"]["shares"] == pytest.approx(shares, abs=1e-5)
    assert bus["load"]["peak"] == pytest.approx(shares.max(), abs=1e-5)


def test_where_every_byte_went(capture: Capture, asker: Asker) -> None:
    bus = asker.bus(capture.path, led_by="where the bytes went")
    lengths = Counter({"frame": 0, "gap": 0})
    for r in capture.in_order:
        lengths[r["type"]] += len(r["hex"]) // 2
    assert (bus["bytes_in_frames"], bus["bytes_in_gaps"]) == (lengths["frame"], lengths["gap"])
    assert bus["gaps"] == Counter(r["reason"] for r in capture.of("gap"))


def test_how_often_a_servo_is_asked_a_second(capture: Capture, asker: Asker) -> None:
    bus = asker.bus(capture.path, led_by="how often")
    first = min(r["t_start_ns"] for r in capture.of("frame"))
    assert bus["seconds"] == pytest.approx((bus["last_ns"] - bus["first_ns"]) / NS)
    assert abs(bus["first_ns"] - first) < NS // 50
    for key, told in commands(bus).items():
        sent = [r for r in capture.of("frame", kind="request") if (r["servo_id"], r["op"]) == key]
        assert told["requests"] == len(sent)
        assert told["rate_hz"] == pytest.approx(len(sent) / bus["seconds"])


def test_what_share_of_the_bus_a_command_takes(capture: Capture, asker: Asker) -> None:
    bus = asker.bus(capture.path)
    total = capture.rows[-1]["bytes"]
    for key, told in commands(bus).items():
        mine = sum(r["length"] for r in capture.of("frame") if (r["servo_id"], r["op"]) == key)
        assert told["bytes"] == mine
        assert told["bytes_share"] == pytest.approx(mine / total)
        assert told["bus_time_share"] == pytest.approx(
            mine * 10 / bus["baud"] / bus["seconds"], rel=1e-5
        )


def test_the_period_of_a_poll_and_how_it_wavers(capture: Capture, asker: Asker) -> None:
    told = commands(asker.bus(capture.path, led_by="how regularly"))[capture.servo, capture.poll]
    sent = capture.of("frame", kind="request", servo_id=capture.servo, op=capture.poll)
    words = ("address", "length", "flags")  # flags say which block, where there are blocks

    def like(r: Row) -> tuple[str, ...]:
        return str(r["length"]), *(str(r["fields"].get(word)) for word in words)

    alike = [rows for _, rows in each(sent, like)]
    spans = [np.diff([r["t_ns"] for r in rows]) for rows in alike]
    periods = np.concatenate(spans)
    changes = np.concatenate([np.abs(np.diff(one)) for one in spans])
    for figures, true in ((told["period_ns"], periods), (told["jitter_ns"], changes)):
        assert figures["count"] == len(true)
        for name, share in (("p50", 0.5), ("p95", 0.95)):
            low, high = figures[name]
            assert low * 0.98 <= np.quantile(true, share, method="higher")
            assert high * 1.02 >= np.quantile(true, share, method="lower")
        assert figures["max"][0] <= true.max() <= figures["max"][1]
    busiest = max(range(len(spans)), key=lambda k: len(spans[k]))
    loop = told["loop"]
    assert (loop["requests"], loop["offset"]) == (len(alike[busiest]), alike[busiest][0]["offset"])
    assert loop["period_ns"]["count"] == len(spans[busiest])
    changed = np.abs(np.diff(spans[busiest]))
    for figures, true in ((loop["period_ns"], spans[busiest]), (loop["jitter_ns"], changed)):
        for name, share in (("p50", 0.5), ("p95", 0.95)):
            low, high = figures[name]
            assert low * 0.98 <= np.quantile(true, share, method="higher")
            assert high * 1.02 >= np.quantile(true, share, method="lower")
    longest, (low, high) = told["longest_period"], told["longest_period"]["value_ns"]
    # ends of frames, of one length: as far apart as their beginnings
    assert low - 1 <= spans[busiest].max() <= high + 1
    assert longest["t_ns"] in {r["t_start_ns"] for r in alike[busiest]}


def test_which_servo_lost_most_answers_and_how_sure_that_is(capture: Capture, asker: Asker) -> None:
    told = commands(asker.bus(capture.path, led_by="how much is missing"))
    for key, rows in asked(capture).items():
        n = sum(r["outcome"] not in ("not_expected", "unsolicited") for r in rows)
        lost = sum(r["outcome"] == "no_response" for r in rows)
        mine = told[key]
        assert mine["missing"] == lost, key
        assert mine["damaged"] == sum(r["outcome"] == "damaged" for r in rows), key
        if not mine["asked"]:
            continue
        assert mine["asked"] == n, key
        middle = (lost + Z * Z / 2) / (n + Z * Z)
        half = Z / (n + Z * Z) * (lost * (n - lost) / n + Z * Z / 4) ** 0.5
        low, high = mine["missing_interval"]
        assert mine["missing_share"] == pytest.approx(lost / n)
        assert (low, high) == pytest.approx((middle - half, middle + half), abs=1e-6)


def test_the_lowest_and_highest_value_of_each_servo_and_when(
    capture: Capture, asker: Asker
) -> None:
    told = servos(asker.bus(capture.path, led_by="extremes"))
    table = pd.DataFrame(capture.of("sample"))
    table = table[table["part"].isna() & table["value"].notna() & (table["quantity"] != "")]
    for who, servo in told.items():
        for v in servo["values"]:
            of = table[(table["servo_id"] == who) & (table["quantity"] == v["quantity"])]
            mine = of[of["unit"].fillna("") == (v["unit"] or "")]
            assert v["count"] == len(mine), (who, v["quantity"])
            for end, at in (("min", mine["value"].min()), ("max", mine["value"].max())):
                assert v[end]["value"] == pytest.approx(at)
                hits = mine[np.isclose(mine["value"], at)]
                assert v[end]["t_ns"] in hits["t_ns"].tolist()
                assert v[end]["offset"] in hits["offset"].tolist()


def test_how_long_a_servo_was_above_a_limit(capture: Capture, asker: Asker) -> None:
    for quantity in ("temperature", "position"):
        values = capture.of("sample", quantity=quantity, role="measured", part=None)
        if not values:
            continue
        limit = round(float(np.quantile([r["value"] for r in values], 0.7)), 1)
        bus = asker.bus(
            capture.path, "--alarm", f"{quantity} > {limit}", led_by="how long met the rule"
        )
        assert bus["alarms"]
        for told in bus["alarms"]:
            mine = [r for r in values if r["servo_id"] == told["servo_id"]]
            above = [(r["t_ns"], r["value"] > limit) for r in mine]
            assert (told["values"], told["met"]) == (len(above), sum(is_so for _, is_so in above))
            surely = sum(b - a for (a, one), (b, two) in pairwise(above) if one and two)
            atmost = sum(b - a for (a, one), (b, two) in pairwise(above) if one or two)
            low, high = told["met_ns"]
            assert 0.999 * low <= atmost
            assert surely <= 1.001 * high + 1
            assert low <= high
            assert low == pytest.approx(surely, rel=1e-3, abs=5e7)
            assert high == pytest.approx(atmost, rel=1e-3, abs=5e7)


def test_how_often_each_anomaly_happened_to_whom_and_when(capture: Capture, asker: Asker) -> None:
    bus = asker.bus(capture.path, led_by="each anomaly when how often")
    told = {(a["code"], a["servo_id"]): a for a in bus["anomalies"]}
    mine = dict(each(capture.of("anomaly"), lambda r: (r["code"], r["servo_id"])))
    assert {k: a["count"] for k, a in told.items()} == {k: len(rows) for k, rows in mine.items()}
    for key, rows in mine.items():
        times = sorted(r["t_ns"] for r in rows)
        assert (told[key]["first_ns"], told[key]["last_ns"]) == (times[0], times[-1])
        assert told[key]["rate_hz"] == pytest.approx(len(rows) / bus["seconds"])


def test_the_largest_following_error(capture: Capture, asker: Asker) -> None:
    told = servos(asker.bus(capture.path, led_by="how far from its goals"))
    for who, servo in told.items():
        for error in servo["following_error"]:
            worst = error["worst"]
            is_at = next(
                r for r in capture.of("sample", servo_id=who, quantity="position", part=None)
                if r["offset"] == worst["offset"]
            )  # fmt: skip
            goals = [
                r for r in capture.of("sample", servo_id=who, quantity="goal_position", part=None)
                if r["unit"] == error["unit"] and r["offset"] < worst["offset"]
            ]  # fmt: skip
            near = [g["value"] - is_at["value"] for g in goals[-3:]]
            assert any(worst["value"] == pytest.approx(e, abs=1e-6) for e in near), (who, near)


def test_the_longest_silence_on_the_bus(capture: Capture, asker: Asker) -> None:
    (told,) = asker.rows(
        "query", "SELECT max(silence) AS ns FROM (SELECT t_start_ns - lag(t_ns) "
        "OVER (ORDER BY \"offset\") AS silence FROM frames)", capture.path, "--format", "json",
    )  # fmt: skip
    rows = capture.of("frame")
    assert told["ns"] == max(b["t_start_ns"] - a["t_ns"] for a, b in pairwise(rows))


def test_how_often_a_question_was_asked_again(capture: Capture, asker: Asker) -> None:
    told = commands(asker.bus(capture.path, led_by="stats"))
    data = {r["offset"]: r["hex"] for r in capture.of("frame")}
    for key, rows in asked(capture).items():
        again = 0
        for before, after in pairwise(rows):
            lost = before["outcome"] in ("no_response", "damaged", "mismatched")
            again += lost and data.get(before["request_offset"]) == data.get(
                after["request_offset"]
            )
        assert told[key]["retries"] <= again, key
