"""What a diagnosis remembers does not grow with the time that it listens."""

from __future__ import annotations

import numpy as np
import pytest

from sniffer.diagnosis.ledger.buckets import BUCKET_NS, COARSE, FINE, TimedBuckets

COLUMNS = {"n": "sum", "low": "min", "high": "max", "t_first": "first", "t_last": "last"}
HOUR = 3600 * 10**9


def heard(t_ns: np.ndarray, group: int) -> TimedBuckets:
    table = TimedBuckets(COLUMNS, turn=4)
    for k in range(0, len(t_ns), group):
        t = t_ns[k : k + group]
        servo = (np.arange(k, k + len(t)) % 3).astype(np.int16) - 1
        turn = np.arange(k, k + len(t)) % 4
        table.add(t, servo, turn, n=1, low=turn, high=turn, t_first=t, t_last=t)
    return table


def test_a_day_takes_no_more_room_than_some_hours() -> None:
    day = np.arange(0, 24 * HOUR, BUCKET_NS)
    table = TimedBuckets(COLUMNS)
    for k in range(0, len(day), 5000):
        t = day[k : k + 5000]
        table.add(t, np.ones(len(t), np.int16), n=1, low=t, high=t, t_first=t, t_last=t)
    assert len(table.table()["n"]) < 4 * HOUR / BUCKET_NS


def test_nothing_is_lost_when_old_buckets_are_joined() -> None:
    every = np.arange(0, 8 * HOUR, 3 * BUCKET_NS)
    table = heard(every, 5000).table()
    assert table["n"].sum() == len(every)
    assert (table["t_first"].min(), table["t_last"].max()) == (every[0], every[-1])
    recent = table["bucket"] > every[-1] // BUCKET_NS - FINE
    assert table["n"][recent].max() == 1
    assert not (table["bucket"][table["n"] > 1] % COARSE).any()


@pytest.mark.parametrize("group", [1, 7, 4000, 100_000])
def test_joining_does_not_depend_on_how_rows_came(group: int) -> None:
    every = np.arange(0, 4 * HOUR, 60 * BUCKET_NS)
    one, other = heard(every, group).table(), heard(every, len(every)).table()
    assert {name: column.tolist() for name, column in one.items()} == {
        name: column.tolist() for name, column in other.items()
    }


def test_a_late_row_goes_where_its_time_is_kept_by_now() -> None:
    table = TimedBuckets(COLUMNS)
    nobody = np.array([-1], np.int64)
    for t in (0, 12 * HOUR, 3 * BUCKET_NS):
        at = np.array([t], np.int64)
        table.add(at, nobody, n=1, low=at, high=at, t_first=at, t_last=at)
    rows = table.table()
    assert rows["bucket"].tolist() == [0, 12 * HOUR // BUCKET_NS]
    assert rows["n"].tolist() == [2, 1]
