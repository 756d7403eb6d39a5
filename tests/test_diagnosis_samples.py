"""What is wrong in the sample captures is found: their page says what was built in."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from sniffer.jobs.diagnose import diagnose
from tests.diagnosed import verdicts
from tests.golden import CAPTURES

if TYPE_CHECKING:
    from collections.abc import Sequence


@pytest.mark.parametrize(
    ("file", "causes"),
    [
        ("mightyzap_damaged.log", [("brownout", (1,)), ("bus-noise", ()), ("duplicate-id", (2,))]),
        ("lss_damaged.log", [("duplicate-id", (2,)), ("bus-noise", ()), ("brownout", (5,))]),
        ("rs30x_damaged.log", [("bus-noise", ()), ("brownout", (5,))]),
        ("wck_damaged.log", [("bus-noise", ())]),
    ],
)
def test_the_faults_of_a_damaged_sample_are_named(
    file: str, causes: Sequence[tuple[str, tuple[int, ...]]]
) -> None:
    assert verdicts(diagnose([str(CAPTURES / file)]).incidents) == causes


@pytest.mark.parametrize(
    "file", ["mightyzap_clean.log", "lss_clean.bin", "wck_clean.log", "rs30x_clean.hex"]
)
def test_a_clean_sample_has_no_incident(file: str) -> None:
    assert not diagnose([str(CAPTURES / file)]).incidents


def test_noise_on_the_line_is_no_rival_to_a_supply_that_is_low() -> None:
    """It tears frames of all, and has an incident of its own; one voltage it does not make low."""
    incidents = diagnose([str(CAPTURES / "lss_damaged.log")]).incidents
    (brownout,) = (i for i in incidents if i.causes[0].cause == "brownout")
    assert brownout.causes[0].confidence > 0.8
    assert any(i.causes[0].cause == "bus-noise" for i in incidents)
