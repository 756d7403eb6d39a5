"""JSON lines made of pieces are, byte for byte, the rows of the library one by one as JSON.

So it is with the words of the table: those of many frames at once are those of each.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from construct import Byte, Bytes, GreedyRange, Struct, Terminated, this
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.fields import value_ranges
from sniffer.decoding.mixed import MixedDecoder, parts_of
from sniffer.decoding.rows import as_dict, rows_of
from sniffer.ground.model import Chunk, Clock, Direction
from sniffer.ground.registers import RegisterMap
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS
from sniffer.protocols.mightyzap.grammar import FAMILY
from sniffer.protocols.packets import NEVER, Command, Member
from sniffer.sinks import kept, pieced, words
from sniffer.sinks.lines import lines
from sniffer.sinks.pieced import LineTexts
from sniffer.sinks.words import FrameWords, values_in_words
from sniffer.sources import open_source
from tests.lists import each_in_turn
from tests.streams import chunked, damaged, stream
from tests.streams.members import NAMES, example
from tests.streams.members import stream as example_stream
from tests.streams.mightyzap import packet
from tests.talks import herkulex, lx16a

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.sink import Part
    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol
    from sniffer.testing import Talk

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"

ODD: Final = """
model = "odd"
protocol = "mightyzap"
title = "Its registers are called as the fields are"
source = "none"
"""

CALLED: Final = ("error", "address", "länge", "", "data", 'servo "0"', "targets", "present")
"""What registers from 0x84 on are called in it; "" has none."""


class Untold:
    """A protocol that has only what the interface asks for: nothing tells what may be kept."""

    def __init__(self, protocol: Any) -> None:
        self._protocol = protocol

    def __getattr__(self, name: str) -> Any:
        if name == "telling_bytes":
            raise AttributeError(name)
        return getattr(self._protocol, name)


def odd() -> Any:
    """Return mightyZAP with a table of names that meet those of fields."""
    at = 0x84
    text = ODD
    for name in CALLED * 2:
        twice = "" if at < 0x84 + 2 * len(CALLED) else " again"
        if name:
            called = f"name = '{name}{twice}'\naddress = {at}\ntype = 'u16le'\nunit = '°'\n"
            text += f"[[register]]\n{called}scale = -0.1\n"
        at += 2
    return Member(replace(FAMILY, models=(RegisterMap.from_text(text, "odd.toml"),)))


@st.composite
def talked(draw: st.DrawFn, talk: Talk) -> bytes:
    """Draw of a labelled talk, some of it damaged."""
    each = [one.request + b"".join(one.replies or ()) for one in talk.exchanges]
    said = draw(st.lists(st.sampled_from(each), max_size=12).map(b"".join))
    return draw(damaged(said))


KNOWN: Final[dict[str, tuple[Any, st.SearchStrategy[bytes]]]] = {
    **{name: (protocol, stream(name)) for name, protocol in PROTOCOLS.items()},
    **{name: (example(name).PROTOCOL, example_stream(name)) for name in NAMES},
    "lx16a": (example("lx16a").PROTOCOL, talked(lx16a.TALK)),
    "herkulex": (example("herkulex").PROTOCOL, talked(herkulex.TALK)),
    "untold": (Untold(PROTOCOLS["mightyzap"]), stream("mightyzap")),
    "odd": (odd(), stream("mightyzap")),
}

PAIRS: Final = [("mightyzap", "wck"), ("dynamixel1", "mightyzap")]


def one_by_one(bus: str, parts: Sequence[Part]) -> str:
    """Return the lines of the rows, each made anew."""
    return "".join(
        json.dumps(as_dict(row), separators=(",", ":"), ensure_ascii=False) + "\n"
        for row in rows_of(parts, bus)
    )


def some_of(batch: Batch, seed: int) -> Batch:
    """Return a batch of which some rows are shown, as a selection shows them."""
    rng = np.random.default_rng(seed)
    sizes = {
        "frames": len(batch.frames),
        "gaps": len(batch.gaps),
        "transactions": len(batch.transactions),
        "samples": len(batch.values),
        "anomalies": len(batch.anomalies),
    }
    shown = {table: rng.random(size) < 0.6 for table, size in sizes.items()}
    return replace(batch, chosen=shown.__getitem__)


def hold(decoder: Decoder | MixedDecoder, chunks: Sequence[Chunk], seed: int) -> None:
    """Compare the lines of each pass, and of a selection of them; and its frames in words."""
    passes = [decoder.feed(c) for c in chunks]
    for told in [*passes, decoder.close()]:
        parts = parts_of(decoder, told)
        some = [(protocol, some_of(batch, seed)) for protocol, batch in parts]
        for these in (parts, some):
            assert lines("bus ü", these) == one_by_one("bus ü", these)
        for protocol, batch in parts:
            edges = value_ranges(batch.values, len(batch.frames))
            rows = range(len(batch.frames))
            each = [
                values_in_words(protocol, batch, i, range(edges[i], edges[i + 1])) for i in rows
            ]
            assert list(FrameWords.of(protocol).told(batch, rows)) == each


def test_frames_that_state_nothing_are_put_in_words_once(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[int] = []

    def counted(protocol: BusProtocol, batch: Batch, i: int, values: range) -> str:
        made.append(i)
        return values_in_words(protocol, batch, i, values)

    monkeypatch.setattr(words, "values_in_words", counted)
    protocol = PROTOCOLS["lss"]
    decoder = Decoder(protocol)
    decoder.feed(Chunk(b"#5QD\r" * 50))
    batch = decoder.close()
    told = FrameWords(protocol).told(batch, range(len(batch.frames)))
    assert list(told) == [""] * len(batch.frames)
    assert len(batch.frames) > 40
    assert len(made) == 1


@each_in_turn(2, "name", KNOWN)
@given(data=st.data())
def test_the_lines_of_a_protocol_are_its_rows(name: str, data: st.DataObject) -> None:
    protocol, talk = KNOWN[name]
    drawn = chunked(data.draw(talk), byte_time_ns(protocol.baud), protocol.tail_ns)
    clock, wire = data.draw(st.sampled_from(Clock)), data.draw(st.sampled_from(Direction))
    chunks = [replace(c, clock=clock, direction=wire) for c in data.draw(drawn)]
    hold(Decoder(protocol), chunks, data.draw(st.integers(0, 9)))


@pytest.mark.parametrize("names", PAIRS, ids="+".join)
@given(data=st.data())
def test_the_lines_of_two_protocols_on_one_wire_are_their_rows(
    names: tuple[str, str], data: st.DataObject
) -> None:
    protocols = [KNOWN[name][0] for name in names]
    talk = st.one_of([KNOWN[name][1] for name in names])
    said = b"".join(data.draw(st.lists(talk, max_size=3)))
    chunks = data.draw(chunked(said, byte_time_ns(115200), 100_000_000))
    hold(MixedDecoder(protocols, baud=115200), chunks, data.draw(st.integers(0, 9)))


@each_in_turn(2, "name", PROTOCOLS)
def test_what_is_kept_of_lines_is_forgotten_and_made_anew(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept, "MOST", 5000)
    monkeypatch.setattr(pieced, "SHAPES_MOST", 3)
    monkeypatch.setattr(LineTexts, "_of", {})
    (path,) = CAPTURES.glob(f"{name}_damaged.*")
    hold(Decoder(name), [c for group in open_source(path) for c in group][:150], seed=1)
    texts = LineTexts.of(PROTOCOLS[name])
    assert sum(len(head.before) for head in texts.heads.known.values()) < 5000


def test_a_write_of_no_bytes_to_several_states_whom_it_names() -> None:
    one = Struct("servo_id" / Byte, "data" / Bytes(this._.length))
    several = Struct("address" / Byte, "length" / Byte, "targets" / GreedyRange(one), Terminated)
    commands = {**FAMILY.commands, 0x73: Command("symmetric_store", several, NEVER)}
    decoder = Decoder(Member(replace(FAMILY, commands=commands)))
    for names in ([1, 2], [3, 4]):
        data = packet(0xFE, 0x73, bytes([0x86, 0, *names]))
        said, *_ = lines("bus0", [(decoder.protocol, decoder.feed(Chunk(data)))]).splitlines()
        assert json.loads(said)["fields"]["servo_ids"] == names
