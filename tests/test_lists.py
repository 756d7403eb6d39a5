"""Cases that take turns: which of them everyday runs take."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tests import lists
from tests.lists import each_in_turn, in_turn, passed_over

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.fixture(autouse=True)
def everyday(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lists, "WHOLE", False)


def taken(test: object, request: pytest.FixtureRequest, count: int, name: str = "x") -> list[int]:
    """Return which of so many cases of a test are taken."""
    cases = [
        pytest.Function.from_parent(request.node.parent, name=f"{name}[{k}]", callobj=test)
        for k in range(count)
    ]
    over = passed_over(cases)
    return [k for k, case in enumerate(cases) if case not in over]


def one_in(of: int) -> Callable[[], None]:
    """Return a test of which one case in so many is taken."""

    @in_turn(of)
    def test() -> None:
        pass

    return test


@each_in_turn(2, "one", range(8))
def crossed(one: int) -> None:
    del one


def test_of_one_in_four_two_of_eight_are_taken(request: pytest.FixtureRequest) -> None:
    assert len(taken(one_in(4), request, 8)) == 2


def test_of_two_marks_the_wider_one_holds(request: pytest.FixtureRequest) -> None:
    assert len(taken(crossed, request, 8)) == 4
    assert len(taken(in_turn(8)(crossed), request, 8)) == 1


def test_at_least_one_case_is_taken_however_few_there_are(request: pytest.FixtureRequest) -> None:
    for count in (1, 2, 3):
        assert len(taken(one_in(50), request, count, f"of{count}")) == 1


def test_each_case_has_its_turn_in_some_test(request: pytest.FixtureRequest) -> None:
    names = (f"test_{n}" for n in range(40))
    met = {k for name in names for k in taken(one_in(4), request, 4, name)}
    assert met == {0, 1, 2, 3}


def test_where_all_is_run_none_is_passed_over(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lists, "WHOLE", True)
    assert taken(one_in(4), request, 8) == [*range(8)]
