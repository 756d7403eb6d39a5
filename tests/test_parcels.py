"""What goes through the pipe to the process that shows a recording."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.model import Chunk, Clock, Direction, Mark, MarkKind
from sniffer.viewers.companion.parcels import Parcel, Unpacker, packed

MARKS = st.builds(
    Mark, st.sampled_from(MarkKind), st.integers(-9, 9), st.integers(0, 99), st.integers(0, 1 << 62)
)
CHUNKS = st.lists(
    st.builds(
        Chunk,
        st.binary(max_size=9),
        st.none() | st.integers(-(1 << 62), 1 << 62),
        st.sampled_from(Clock),
        st.just("left arm"),
        st.sampled_from(Direction),
        st.lists(MARKS, max_size=2).map(tuple),
    ),
    max_size=9,
)


@given(st.lists(st.tuples(CHUNKS, st.integers(0, 1 << 40))), st.integers(1, 99))
def test_what_is_packed_comes_out_of_the_pipe_in_pieces_of_any_size(
    groups: list[tuple[list[Chunk], int]], size: int
) -> None:
    data = b"".join(packed("left arm", chunks, missing) for chunks, missing in groups)
    unpacker, out = Unpacker(), list[Parcel]()
    for at in range(0, len(data), size):
        unpacker.feed(data[at : at + size])
        out += unpacker.parcels()
    assert out == [Parcel("left arm", missing, chunks) for chunks, missing in groups]
