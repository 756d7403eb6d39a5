"""What a report labels and leaves out: scales of histograms, findings of one kind."""

from __future__ import annotations

from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.called import ServoNames
from sniffer.decoding.durations import Quantiles
from sniffer.diagnosis.model import Finding
from sniffer.reports.content import ALIKE, found_of
from sniffer.reports.histograms import TimeScale

if TYPE_CHECKING:
    from sniffer.diagnosis.model import Incident

DAY_NS = 86_400_000_000_000
TIMES = st.lists(
    st.integers(-(10**15), 4 * 10**18) | st.integers(0, 10**10), min_size=1, max_size=60
)


@given(st.integers(10_000, 10**9), st.integers(0, 100))
def test_a_histogram_has_labels_that_tell_its_scale_however_narrow_it_is(
    ns: int, percent: int
) -> None:
    """One of a tenth of a decade had a 0 and nothing else."""
    q = Quantiles()
    q.add(np.array([ns, ns * (100 + percent) // 100]), np.zeros(2, np.int64))
    labels = [(at, float(told)) for at, told in TimeScale([q]).ticks()[1:]]
    assert 2 <= len(labels) <= 12
    assert labels == sorted(labels)
    assert len({told for _, told in labels}) == len(labels)


def test_of_findings_of_one_kind_a_report_tells_some_and_how_many_more_there_are() -> None:
    every = [Finding("goal-beyond-range", k % 2, 0, 0, 1, "x") for k in range(100)]
    every += [Finding("joint-not-following", 2, 0, 0, 1, "y")]
    incident = cast("Incident", SimpleNamespace(bus="bus0", findings=tuple(every)))
    told, more = found_of(incident, ServoNames())
    assert (len(told), more) == (ALIKE + 1, 100 - ALIKE)
    assert told[-1].what == "y"


def test_what_several_servos_have_alike_a_report_tells_once_with_their_names() -> None:
    every = [Finding("misses-now-and-then", k, 0, 0, 1, f"servo {k} misses") for k in range(1, 6)]
    incident = cast("Incident", SimpleNamespace(bus="bus0", findings=tuple(every)))
    told, more = found_of(incident, ServoNames())
    assert ([f.what for f in told], more) == (["servo 1 misses; likewise servos 2-5"], 0)
    (named,), _ = found_of(incident, ServoNames({3: "knee"}))
    assert named.what == "servo 1 misses; likewise servos 2, 3 knee, 4, 5"
