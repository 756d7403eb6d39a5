"""What a servo is said to state is something that it stated, and no mean over what it did not."""

from __future__ import annotations

from tests.diagnosed import found
from tests.servos import lss


def test_a_current_that_was_borne_is_told_as_it_was_stated() -> None:
    said = [
        (k * 0.05, f"#5QC *5QC{900 if 2.1 < k * 0.05 < 6.1 else 60 + k % 2}") for k in range(240)
    ]
    (borne,) = (f for f in found(lss(*said)) if f.code == "load-high")
    assert borne.brief == "servo 5 at current 900 mA"
    assert {place.what for place in borne.places} == {"current 900 mA"}
    assert borne.what.endswith(", usually current 61 mA")


def test_a_servo_that_heats_up_is_told_from_the_degrees_that_it_stated() -> None:
    said = [(k * 0.1, f"#5QT *5QT{10 * (30 + k // 2)}") for k in range(79)]
    (heats,) = (f for f in found(lss(*said)) if f.code == "temperature-rising")
    assert heats.what.startswith("servo 5 rises from 30 °C to 69 °C in ")
