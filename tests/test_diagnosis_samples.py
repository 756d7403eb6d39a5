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
