"""What people ask of a capture: one command answers, and pandas says the same of the tables.

Each question is a pair: what the command says, and what is reckoned from all rows. Everyday runs
ask each of one protocol, ``make test-thorough`` of all four.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest

from tests.commands import within
from tests.golden import CAPTURES
from tests.lists import each_in_turn
from tests.questions.asking import PROTOCOLS
from tests.questions.tables import Question, Told

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import pandas as pd

Capsys = pytest.CaptureFixture[str]
NS: Final = 1_000_000_000


def counts(grouped: Any) -> dict[Any, int]:
    """Return the sizes of groups that are not empty."""
    return {key: int(n) for key, n in grouped.size().items() if n}


def rows_in_order(table: pd.DataFrame, *names: str) -> list[tuple[Any, ...]]:
    """Return columns as tuples."""
    return list(table[list(names)].itertuples(index=False, name=None))


def first_error_ns(t: Told) -> int:
    """Return when the first error was found."""
    return int(t.anomalies[t.anomalies.severity == "error"].t_ns.iloc[0])


def between(t: Told, from_ns: float, to_ns: float) -> list[int]:
    """Return where the frames begin that end in a span of time."""
    return list(t.frames[(t.frames.t_ns >= from_ns) & (t.frames.t_ns <= to_ns)].offset)


def commands(bus: dict[str, Any], figure: str) -> dict[tuple[int | None, str], int]:
    """Return one count of each command, where there is one."""
    return {(c["servo_id"], c["op"]): c[figure] for c in bus["commands"] if c[figure]}


def of_commands(table: pd.DataFrame) -> dict[tuple[int | None, str], int]:
    """Return how many rows each command has."""
    given = table.servo_id.astype(object).where(table.servo_id.notna(), None)
    out: dict[tuple[int | None, str], int] = {}
    for who, op in zip(given, table.op, strict=True):
        key = (None if who is None else int(who), op)
        out[key] = out.get(key, 0) + 1
    return out


def extremes(bus: dict[str, Any], end: str) -> dict[tuple[int, str], float]:
    """Return the least or the greatest of each quantity of each servo."""
    return {
        (s["servo_id"], v["quantity"]): v[end]["value"] for s in bus["servos"] for v in s["values"]
    }


def of_values(t: Told, figure: str) -> dict[tuple[int, str], Any]:
    """Return one figure of each quantity of each servo."""
    known = t.samples[(t.samples.quantity != "") & t.samples.value.notna()]
    return dict(getattr(known.groupby(["servo_id", "quantity"]).value, figure)())


def slowest(bus: dict[str, Any]) -> tuple[int, str]:
    """Return the command whose answer took longest."""
    answered = [c for c in bus["commands"] if c["response_time_ns"] and c["slowest"]]
    first = max(answered, key=lambda c: float(c["slowest"]["value"]))
    return first["servo_id"], first["op"]


def following(t: Told) -> dict[int, float]:
    """Return how far each servo was from the goal that it had, where that was most."""
    out: dict[int, float] = {}
    goal: dict[int, float] = {}
    told = t.samples[t.samples.quantity.isin(["position", "goal_position"])]
    for who, quantity, value in rows_in_order(told, "servo_id", "quantity", "value"):
        if quantity == "goal_position":
            goal[who] = value
        elif who in goal and abs(goal[who] - value) > abs(out.get(who, 0.0)):
            out[who] = goal[who] - value
    return out


ASKED: Final[dict[str, tuple[Callable[[Question], Any], Callable[[Told], Any]]]] = {
    "which answer took longest": (
        lambda q: q.sql("SELECT max(response_time_ns) FROM transactions")[0][0],
        lambda t: t.exchanges.response_time_ns.max(),
    ),
    "which command is the slowest": (
        lambda q: slowest(q.stats()),
        lambda t: tuple(
            t.exchanges.loc[t.exchanges.response_time_ns.idxmax()][["servo_id", "op"]]
        ),
    ),
    "how far each servo was from its goal at most": (
        lambda q: {
            s["servo_id"]: f["worst"]["value"]
            for s in q.stats()["servos"]
            for f in s["following_error"]
        },
        lambda t: pytest.approx(following(t)),
    ),
    "how long an answer to each command takes as a rule": (
        lambda q: dict(
            q.sql(
                "SELECT op, quantile_disc(response_time_ns, 0.5) FROM transactions"
                " WHERE response_time_ns IS NOT NULL GROUP BY op"
            )
        ),
        lambda t: {
            op: np.quantile(times, 0.5, method="inverted_cdf")
            for op, times in t.exchanges.dropna(subset="response_time_ns")
            .groupby("op")
            .response_time_ns
        },
    ),
    "how many requests of each command there are": (
        lambda q: commands(q.stats(), "requests"),
        lambda t: of_commands(t.frames[t.frames.kind == "request"]),
    ),
    "which exchanges had no answer": (
        lambda q: sorted(
            q.sql("SELECT request_offset FROM transactions WHERE outcome = 'no_response'")
        ),
        lambda t: [
            (int(at),)
            for at in sorted(t.exchanges[t.exchanges.outcome == "no_response"].request_offset)
        ],
    ),
    "how many answers of each command are missing": (
        lambda q: commands(q.stats(), "missing"),
        lambda t: of_commands(t.exchanges[t.exchanges.outcome == "no_response"]),
    ),
    "how exchanges end": (
        lambda q: dict(q.sql("SELECT outcome, count(*) FROM transactions GROUP BY outcome")),
        lambda t: counts(t.exchanges.groupby("outcome")),
    ),
    "how many frames there are in each second": (
        lambda q: q.stats("--every", "1s")["slices"]["frames"],
        lambda t: list(counts(t.frames.groupby(t.frames.t_ns // NS)).values()),
    ),
    "which tenth of a second is the busiest": (
        lambda q: q.sql(
            "SELECT sum(length) FROM frames GROUP BY t_ns // 100000000 ORDER BY 1 DESC LIMIT 1"
        )[0][0],
        lambda t: t.frames.groupby(t.frames.t_ns // (NS // 10)).length.sum().max(),
    ),
    "how long the bus was silent at most": (
        lambda q: q.sql(
            "SELECT max(gap) FROM (SELECT t_start_ns - lag(t_ns) OVER (ORDER BY \"offset\") AS gap"
            " FROM frames)"
        )[0][0],
        lambda t: (t.frames.t_start_ns.to_numpy()[1:] - t.frames.t_ns.to_numpy()[:-1]).max(),
    ),
    "how many bytes belong to frames": (
        lambda q: q.stats()["bytes_in_frames"],
        lambda t: t.frames.length.sum(),
    ),
    "what the other bytes are": (
        lambda q: {k: v for k, v in q.stats()["gaps"].items() if v},
        lambda t: counts(t.gaps.groupby("reason")),
    ),
    "which anomalies each servo has": (
        lambda q: {
            (a["code"], a["servo_id"]): a["count"]
            for a in q.stats()["anomalies"]
            if a["servo_id"] is not None
        },
        lambda t: counts(t.anomalies.dropna(subset="servo_id").groupby(["code", "servo_id"])),
    ),
    "when the first and the last anomaly of each code was": (
        lambda q: sorted(q.sql("SELECT code, min(t_ns), max(t_ns) FROM anomalies GROUP BY code")),
        lambda t: sorted(
            t.anomalies.groupby("code").t_ns.agg(["min", "max"]).itertuples(name=None)
        ),
    ),
    "how many errors there are in each second": (
        lambda q: sum(q.stats("--every", "1s")["slices"]["errors"]),
        lambda t: int((t.anomalies.severity == "error").sum()),
    ),
    "where one kind of anomaly is": (
        lambda q: q.offsets("anomaly", "--code", q.told.code),
        lambda t: [e[0][0] for e in t.anomalies[t.anomalies.code == t.code].evidence],
    ),
    "what happened 200 ms around the first error": (
        lambda q: q.offsets("frame", "--from", "@first-error", "--around", "200ms"),
        lambda t: between(t, first_error_ns(t) - NS // 5, first_error_ns(t) + NS // 5),
    ),
    "what was said from second 2 to second 3": (
        lambda q: q.offsets("frame", "--from", "2", "--to", "3"),
        lambda t: between(t, t.began + 2 * NS, t.began + 3 * NS),
    ),
    "what one servo was asked": (
        lambda q: q.offsets("frame", "--servo", str(q.told.servo), "--kind", "request"),
        lambda t: list(
            t.frames[(t.frames.servo_id == t.servo) & (t.frames.kind == "request")].offset
        ),
    ),
    "what one servo said": (
        lambda q: q.offsets("frame", "--servo", str(q.told.servo), "--kind", "response"),
        lambda t: list(
            t.frames[(t.frames.servo_id == t.servo) & (t.frames.kind == "response")].offset
        ),
    ),
    "where one command is": (
        lambda q: q.offsets("frame", "--op", q.told.op),
        lambda t: list(t.frames[t.frames.op == t.op].offset),
    ),
    "which values were written to one servo": (
        lambda q: q.offsets("sample", "--where", f"servo_id = {q.told.servo} AND kind = 'request'"
                                                 " AND register IS NOT NULL"),
        lambda t: list(
            t.samples[(t.samples.servo_id == t.servo) & (t.samples.kind == "request")].offset
        ),
    ),
    "where a joint is above its middle": (
        lambda q: q.offsets("sample", "--where",
                            f"quantity = 'position' AND value > {q.told.middle}"),
        lambda t: list(t.positions[t.positions.value > t.middle].offset),
    ),
    "the least that each servo told of each quantity": (
        lambda q: extremes(q.stats(), "min"),
        lambda t: pytest.approx(of_values(t, "min")),
    ),
    "the greatest that each servo told of each quantity": (
        lambda q: extremes(q.stats(), "max"),
        lambda t: pytest.approx(of_values(t, "max")),
    ),
    "the mean position of each servo": (
        lambda q: dict(
            q.sql(
                "SELECT servo_id, avg(value) FROM samples WHERE quantity = 'position'"
                " GROUP BY servo_id"
            )
        ),
        lambda t: pytest.approx(dict(t.positions.groupby("servo_id").value.mean())),
    ),
    "how often each register was told": (
        lambda q: dict(q.sql("SELECT register, count(*) FROM samples GROUP BY register")),
        lambda t: counts(t.samples.groupby("register")),
    ),
    "the largest step of a position from one sample to the next": (
        lambda q: q.sql(
            "SELECT max(abs(step)) FROM (SELECT raw - lag(raw) OVER"
            " (PARTITION BY servo_id ORDER BY \"offset\") AS step FROM samples"
            " WHERE register = (SELECT register FROM samples WHERE quantity = 'position'"
            " GROUP BY register ORDER BY count(*) DESC LIMIT 1))"
        )[0][0],
        lambda t: (
            t.positions[t.positions.register == t.positions.register.mode()[0]]
            .groupby("servo_id")
            .raw.diff()
            .abs()
            .max()
        ),
    ),
    "how many different goals each servo was given": (
        lambda q: dict(
            q.sql(
                "SELECT servo_id, count(DISTINCT value) FROM samples"
                " WHERE quantity = 'goal_position' GROUP BY servo_id"
            )
        ),
        lambda t: dict(
            t.samples[t.samples.quantity == "goal_position"].groupby("servo_id").value.nunique()
        ),
    ),
    "which servos answer": (
        lambda q: [
            who
            for (who,) in q.sql(
                "SELECT DISTINCT servo_id FROM frames WHERE kind = 'response' ORDER BY 1"
            )
        ],
        lambda t: sorted(t.frames[t.frames.kind == "response"].servo_id.unique()),
    ),
    "the values of one servo as a table": (
        lambda q: sorted(
            (int(r["offset"]), r["register"], int(r["raw"]))
            for r in q.table("--servo", str(q.told.servo))
        ),
        lambda t: sorted(
            rows_in_order(
                t.samples[t.samples.servo_id == t.servo], "offset", "register", "raw"
            )
        ),
    ),
    "what the frame at a byte is": (
        lambda q: q.told.op in q.text("explain", f"{q.told.path}@{_middle_one(q.told).offset}"),
        lambda t: _middle_one(t).op == t.op,
    ),
    "how long was talked": (
        lambda q: q.sql("SELECT max(t_ns) - min(t_start_ns) FROM frames")[0][0],
        lambda t: t.frames.t_ns.max() - t.frames.t_start_ns.min(),
    ),
}  # fmt: skip


def _middle_one(t: Told) -> Any:
    """Return a frame of the commonest command from the middle."""
    mine = t.frames[t.frames.op == t.op]
    return mine.iloc[len(mine) // 2]


CASES: Final = [
    pytest.param(text, PROTOCOLS[(n + k) % 4], id=f"{text} ({PROTOCOLS[(n + k) % 4]})")
    for n, text in enumerate(ASKED)
    for k in range(4)
]

_TOLD: dict[str, Told] = {}


@each_in_turn(8, ("text", "protocol"), CASES)
def test_a_question_is_answered_by_one_command_as_pandas_answers_it(
    text: str, protocol: str, tmp_path: Path, capsys: Capsys
) -> None:
    def ask(*arguments: str | Path) -> str:
        ran = within(capsys, *arguments)
        assert ran.status == 0, ran.err
        return ran.out

    told = _TOLD.get(protocol)
    if told is None:
        told = _TOLD[protocol] = Told(CAPTURES / f"{protocol}_damaged.log", ask)
    command, reckoned = ASKED[text]
    assert command(Question(told, ask, tmp_path)) == reckoned(told)


def test_more_than_thirty_questions_are_asked() -> None:
    assert len(ASKED) > 30
