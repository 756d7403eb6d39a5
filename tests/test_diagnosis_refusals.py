"""What a servo refuses, and what only looks so."""

from __future__ import annotations

from tests.servos import finding, heard
from tests.streams import rs30x


def test_a_status_beside_all_that_was_asked_for_refuses_nothing() -> None:
    """The flash of an earlier write failed, or an order to another one: the values are there."""
    d = heard(
        (
            row
            for k in range(60)
            for row in (
                (k * 0.05, rs30x.packet(1, 0x0F, 0x2A, 18, 0)),
                (k * 0.05 + 0.004, rs30x.returned(1, 0x2A, bytes(18), 8 if k > 30 else 0)),
            )
        ),
        "rs30x",
    )
    assert finding(d, "refuses-command") is None
    assert not d.incidents()
