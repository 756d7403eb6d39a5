"""The tables of the diagnosis agree with each other."""

from __future__ import annotations

from collections import Counter

import pytest

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.diagnosis.causes import CAUSES
from sniffer.diagnosis.rules import FINDINGS
from sniffer.diagnosis.rules.symptoms import SILENT
from sniffer.diagnosis.weights import LINES, WEIGHTS


@pytest.mark.parametrize("slug", CAUSES)
def test_every_weight_names_a_finding_that_there_is(slug: str) -> None:
    for weight in WEIGHTS[slug].values():
        assert weight.finding in FINDINGS or weight.finding in CATALOGUE, weight
        assert weight.finding not in SILENT, weight


@pytest.mark.parametrize("slug", CAUSES)
def test_every_cause_has_a_finding_that_brings_it_up(slug: str) -> None:
    assert any(weight.is_key for weight in WEIGHTS[slug].values())


def test_no_finding_is_weighed_twice_for_one_cause() -> None:
    times = Counter((weight.cause, weight.finding) for weight in LINES)
    assert [pair for pair, n in times.items() if n > 1] == []


def test_every_finding_counts_for_or_against_something() -> None:
    used = {finding for rows in WEIGHTS.values() for finding in rows}
    assert not set(FINDINGS) - used


def test_no_finding_has_the_name_of_an_anomaly() -> None:
    assert not set(FINDINGS) & set(CATALOGUE)
