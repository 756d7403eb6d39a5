"""Error marks taken out of what the kernel read: any bytes, any errors, any cut."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, Final

from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.model import Mark, MarkKind
from sniffer.ports.unmark import Unmarker

if TYPE_CHECKING:
    from collections.abc import Sequence

Heard = tuple[int, MarkKind | None]


def escaped(heard: Sequence[Heard]) -> bytes:
    """Escape as termios(3) says under PARMRK."""
    out = b""
    for byte, error in heard:
        if error is not None:
            out += bytes([0xFF, 0x00, byte])
        else:
            out += b"\xff\xff" if byte == 0xFF else bytes([byte])
    return out


def runs(heard: Sequence[Heard]) -> list[Mark]:
    """Return what should be said about these bytes: one mark for neighbours of a kind."""
    out = []
    for error, group in itertools.groupby(enumerate(heard), key=lambda item: item[1][1]):
        places = [place for place, _ in group]
        if error is not None:
            out.append(Mark(error, places[0], len(places), len(places)))
    return out


def cut(raw: bytes, cuts: Sequence[int]) -> list[bytes]:
    edges = sorted({0, len(raw), *(c % (len(raw) + 1) for c in cuts)})
    return [raw[a:b] for a, b in itertools.pairwise(edges)]


BYTES: Final = st.one_of(st.just(0xFF), st.just(0), st.just(0x41), st.integers(0, 255))
HEARD: Final = st.lists(
    st.one_of(
        BYTES.map(lambda byte: (byte, None)),
        BYTES.map(lambda byte: (byte, MarkKind.FRAMING if byte else MarkKind.BREAK)),
    ),
    max_size=40,
)
CUTS: Final = st.lists(st.integers(0, 200), max_size=20)


@given(heard=HEARD)
def test_bytes_and_marks_come_out_as_they_were_escaped(heard: list[Heard]) -> None:
    unmarker = Unmarker(widen=False)
    data, marks = unmarker.take(escaped(heard))
    assert data == bytes(byte for byte, _ in heard)
    assert list(marks) == runs(heard)
    assert unmarker.take(b"") == (b"", ())


@given(heard=HEARD, cuts=CUTS)
def test_an_escape_may_be_cut_anywhere(heard: list[Heard], cuts: list[int]) -> None:
    unmarker = Unmarker(widen=False)
    data = b""
    found: list[Heard] = []
    for piece in cut(escaped(heard), cuts):
        part, marks = unmarker.take(piece)
        errors: dict[int, MarkKind] = {}
        for mark in marks:
            assert 0 <= mark.start < mark.start + mark.length <= len(part)
            assert mark.count == mark.length
            errors |= dict.fromkeys(range(mark.start, mark.start + mark.length), mark.kind)
        found += [(byte, errors.get(place)) for place, byte in enumerate(part)]
        data += part
    assert data == bytes(byte for byte, _ in heard)
    assert found == heard


@given(heard=HEARD, cuts=CUTS)
def test_an_adapter_on_usb_says_only_in_which_read_an_error_was(
    heard: list[Heard], cuts: list[int]
) -> None:
    exact, wide = Unmarker(widen=False), Unmarker(widen=True)
    for piece in cut(escaped(heard), cuts):
        data, marks = exact.take(piece)
        same, regions = wide.take(piece)
        assert same == data
        assert {mark.kind for mark in regions} == {mark.kind for mark in marks}
        assert len({mark.kind for mark in regions}) == len(regions)
        for region in regions:
            assert (region.start, region.length) == (0, len(data))
            # an error of a packet stands on each of its bytes: a row of them is one
            assert region.count == sum(m.kind == region.kind for m in marks)


def test_one_framing_error_of_an_ftdi_packet_of_four_bytes_is_one() -> None:
    packet = [(byte, MarkKind.FRAMING) for byte in b"\x11\x12\xff\x13"]
    data, marks = Unmarker(widen=True).take(escaped([(1, None), *packet, (2, None)]))
    assert data == b"\x01\x11\x12\xff\x13\x02"
    assert marks == (Mark(MarkKind.FRAMING, 0, 6, 1),)
    again = [*packet, (3, None), *packet]
    assert Unmarker(widen=True).take(escaped(again))[1] == (Mark(MarkKind.FRAMING, 0, 9, 2),)


@given(raw=st.lists(BYTES, max_size=60).map(bytes), cuts=CUTS)
def test_what_no_kernel_writes_is_taken_alike_in_any_cut(raw: bytes, cuts: list[int]) -> None:
    whole, pieces = Unmarker(widen=False), Unmarker(widen=False)
    expected, _ = whole.take(raw)
    assert b"".join(pieces.take(piece)[0] for piece in cut(raw, cuts)) == expected


def test_a_read_without_ff_is_handed_on_as_it_is() -> None:
    raw = bytes(range(255))
    data, marks = Unmarker(widen=False).take(raw)
    assert data is raw
    assert marks == ()
