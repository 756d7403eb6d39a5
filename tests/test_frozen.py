"""Frozen dataclasses are what the standard library makes of them, in less time."""

from __future__ import annotations

import dataclasses
import pickle
from typing import Any

import numpy as np
import pytest

from sniffer.ground.frozen import dataclass
from sniffer.ground.model import Chunk, Spans

MAKERS = (dataclass, dataclasses.dataclass)


def both(**options: Any) -> list[Any]:
    """Return one class as it is made here and by the library."""
    made = []
    for maker in MAKERS:

        class Told:
            """A class of three fields, two of which are compared."""

            name: str
            size: int = 0
            note: Any = dataclasses.field(default=None, compare=False, repr=False)

        made.append(maker(frozen=True, slots=True, **options)(Told))
    return made


def seen(act: Any) -> Any:
    """Return what comes of it, or what kind of error."""
    try:
        return act()
    except Exception as error:
        return type(error), str(error)


@pytest.mark.parametrize("options", [{}, {"kw_only": True}, {"order": True}, {"eq": False}])
def test_what_can_be_seen_of_a_frozen_dataclass_is_what_the_library_makes(
    options: dict[str, bool],
) -> None:
    def told(kind: Any) -> list[Any]:
        one, same, other = kind(name="a", note=[]), kind(name="a", note=1), kind(name="b", size=2)
        return [
            one == same,
            one == other,
            one != same,
            one == ("a", 0),
            {one, same, other} == {one, other} if options.get("eq", True) else None,
            repr(other).rpartition(".")[2] if options.get("eq", True) else None,
            seen(lambda: one < other)[0] if not options.get("order") else one < other,
            seen(lambda: setattr(one, "size", 1)),
            seen(lambda: delattr(one, "size")),
            seen(lambda: kind()),
            dataclasses.asdict(dataclasses.replace(other, size=3)),
            kind.__match_args__,
            kind.__slots__,
        ]

    mine, library = both(**options)
    assert told(mine) == told(library)
    if not options:
        assert hash(mine(name="a", size=1)) == hash(library(name="a", size=1))
        assert hash(mine(name="a", note=[])) == hash(mine(name="a"))


def test_what_a_class_says_itself_stays() -> None:
    @dataclass(frozen=True, slots=True)
    class Named:
        name: str

        def __eq__(self, other: object) -> bool:
            return True

        def __hash__(self) -> int:
            return 7

        def __repr__(self) -> str:
            return "named"

    assert Named("a") == Named("b")
    assert (hash(Named("a")), repr(Named("a"))) == (7, "named")


def test_one_that_holds_itself_can_be_shown() -> None:
    @dataclass(frozen=True, slots=True)
    class Holder:
        held: list[Any]

    one = Holder([])
    one.held.append(one)
    assert repr(one).endswith("Holder(held=[...])")
    nothing = float("nan")
    assert Holder([nothing]) == Holder([nothing]), "one field is compared as many are"


def test_chunks_are_pickled_and_compared_and_columns_hold_arrays() -> None:
    chunk = Chunk(b"ab", 5)
    assert pickle.loads(pickle.dumps(chunk)) == chunk
    assert hash(chunk) == hash(Chunk(b"ab", 5))
    assert chunk != Chunk(b"ab", 6)
    spans = Spans(np.array([1]), np.array([2]), np.array([0], np.uint8))
    assert repr(spans) == "Spans(start=array([1]), end=array([2]), kind=array([0], dtype=uint8))"
