"""A servo that was given another id, and is asked by both."""

from __future__ import annotations

import pytest

from tests.diagnosed import verdicts
from tests.servos import lss
from tests.test_diagnosis_findings import asked


@pytest.mark.parametrize("another", [False, True])
def test_an_old_id_that_is_asked_beside_the_new_one_is_to_be_left_out(*, another: bool) -> None:
    """Two lists: the new id answers. Not where another servo has answered by it all along."""
    d = lss(
        *(asked(7, since=0, until=2) if another else ()),
        *asked(5, since=0, until=2),
        (2.05, "#5CID7"),
        *asked(5, since=2.2, until=6, answered=False),
        *asked(7, since=2.2, until=6),
    )
    assert ("id-changed", (5,)) in verdicts(d.incidents())
    told = [i.next for i in d.incidents() if i.cause == "id-changed"]
    assert told[0].startswith("Leave the old id out") != another
