"""A chunk in two parts: nothing that was remarked about its bytes is lost or told twice."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.cutting import cut
from sniffer.ground.model import Chunk, Clock, Mark, MarkKind

if TYPE_CHECKING:
    from collections.abc import Sequence

a_mark = st.builds(
    Mark, st.sampled_from(MarkKind), st.integers(-5, 12), st.integers(0, 9), st.integers(1, 3)
)


@given(st.binary(min_size=2, max_size=10), st.lists(a_mark, max_size=3), st.data())
def test_marks_go_with_their_bytes_where_a_chunk_is_cut(
    data: bytes, marks: list[Mark], draw: st.DataObject
) -> None:
    at = draw.draw(st.integers(1, len(data) - 1))
    chunk = Chunk(data, 1000, Clock.READ, marks=tuple(marks))
    first, second = cut(chunk, at, 990)
    assert first.data + second.data == data
    assert len(first.data) == at
    assert (first.t_ns, second.t_ns) == (990, 1000)

    def places(kept: Sequence[Mark], shift: int) -> list[tuple[MarkKind, int, int]]:
        doubt = ((m, range(m.start, m.start + m.length)) for m in kept)
        return sorted((m.kind, m.count, shift + i) for m, where in doubt for i in where)

    assert sorted(places(first.marks, 0) + places(second.marks, at)) == places(marks, 0)
    points = [m for m in marks if not m.length]
    kept = [m for m in first.marks if not m.length]
    kept += [m._replace(start=m.start + at) for m in second.marks if not m.length]
    assert sorted(kept) == sorted(points)
