"""Two protocols on one wire: each byte claimed once, and each one decoded as if it were alone."""

from __future__ import annotations

import itertools
import json
import operator
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, cast

import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.mixed import MixedDecoder
from sniffer.decoding.names import protocols_named
from sniffer.ground.model import Chunk, Clock, SnifferError
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS
from sniffer.simulation.buses import simulate
from tests import dynamixel
from tests.commands import sniffer
from tests.dynamixel import Dynamixel1, packet, said
from tests.lists import each_in_turn
from tests.records import gaps, records
from tests.streams import bursts, chunked, module, recut, stream

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.decoding.reference import Result
    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol

BAUD = 115200
BYTE_NS = byte_time_ns(BAUD)
KNOWN: dict[str, BusProtocol] = {**PROTOCOLS, "dynamixel1": cast("BusProtocol", Dynamixel1())}
PAIRS = [("mightyzap", "rs30x"), ("lss", "mightyzap"), ("mightyzap", "wck"), ("lss", "rs30x")]
WITHIN = ("dynamixel1", "mightyzap")
"""Each frame of the second one holds one of the first."""

EVERY = each_in_turn(2, "names", [*PAIRS, WITHIN], ids="+".join)
ONE_OF_TWO = each_in_turn(
    3, ("names", "alone"), [(pair, one) for pair in PAIRS for one in pair], ids=str
)

FIRST = operator.itemgetter(0)

SAMPLES = Path(__file__).parents[1] / "sample_captures"


def heard(name: str) -> bytes:
    """Return what a simulated bus says in a second."""
    return b"".join(frame.wire for frame in simulate(name, seed=3, duration_s=1))


def mixed(names: Iterable[str]) -> MixedDecoder:
    return MixedDecoder([KNOWN[name] for name in names], baud=BAUD)


def talk_of(name: str) -> st.SearchStrategy[bytes]:
    """Draw an exchange."""
    return dynamixel.TALK if name == "dynamixel1" else module(name).TALK


def wild(names: Sequence[str]) -> list[st.SearchStrategy[bytes]]:
    """Draw what goes wrong: damage, noise, several requests in flight."""
    own = [name for name in names if name in PROTOCOLS]
    return [*(stream(name) for name in own), *(bursts(name, 2) for name in own)]


def decoded(decoder: MixedDecoder, groups: Iterable[Sequence[Chunk]]) -> list[tuple[Batch, ...]]:
    return [*(decoder.feed(*group) for group in groups), decoder.close()]


def of_each(parts: Iterable[tuple[Batch, ...]]) -> list[Result]:
    """Return the records of each protocol."""
    return [records(batches) for batches in zip(*parts, strict=True)]


def found(batches: Iterable[Batch]) -> Counter[object]:
    return Counter(a for b in batches for a in b.anomalies)


@st.composite
def two(draw: st.DrawFn, names: Sequence[str]) -> bytes:
    """Draw what two protocols say on one wire, one exchange after the other."""
    talk = st.one_of(*(talk_of(name) for name in names))
    part = st.one_of(talk, talk, talk, *wild(names))
    return b"".join(draw(st.lists(part, max_size=6)))


@EVERY
@given(data=st.data())
def test_each_byte_is_claimed_once_by_one_of_them(
    names: tuple[str, str], data: st.DataObject
) -> None:
    s = data.draw(two(names))
    chunks = data.draw(chunked(s, BYTE_NS, 100_000_000))
    parts = decoded(mixed(names), [[c] for c in chunks])
    spans = [(b.base + start, n) for p in parts for b in p for start, n in _spans(b)]
    at = 0
    for start, length in sorted(spans):
        assert start == at
        assert length > 0
        at += length
    assert at == len(s)
    assert b"".join(p[0].data for p in parts) == s


def _spans(batch: Batch) -> list[tuple[int, int]]:
    f = batch.frames
    spans = list(zip(f.start.tolist(), f.length.tolist(), strict=True))
    return spans + [(g.start, g.length) for g in batch.gaps]


@EVERY
@given(data=st.data())
def test_any_recut_gives_equal_records_of_both(names: tuple[str, str], data: st.DataObject) -> None:
    s = data.draw(two(names))
    chunks = data.draw(chunked(s, BYTE_NS, 100_000_000))
    whole = decoded(mixed(names), [chunks])
    again = decoded(mixed(names), [[c] for c in recut(data, chunks, BYTE_NS)])
    assert of_each(again) == of_each(whole)
    for one, other in zip(zip(*again, strict=True), zip(*whole, strict=True), strict=True):
        assert gaps(one) == gaps(other)


@EVERY
@given(data=st.data())
def test_the_same_chunks_in_any_grouping_give_equal_anomalies(
    names: tuple[str, str], data: st.DataObject
) -> None:
    s = data.draw(two(names))
    chunks = data.draw(chunked(s, BYTE_NS, 100_000_000))
    whole = decoded(mixed(names), [chunks])
    again = decoded(mixed(names), [[c] for c in chunks])
    for one, other in zip(zip(*again, strict=True), zip(*whole, strict=True), strict=True):
        assert found(one) == found(other)


@ONE_OF_TWO
@given(data=st.data())
def test_a_stream_of_one_alone_decodes_as_it_does_alone(
    names: tuple[str, str], alone: str, data: st.DataObject
) -> None:
    s = b"".join(data.draw(st.lists(module(alone).TALK, max_size=10)))
    chunks = data.draw(chunked(s, BYTE_NS, PROTOCOLS[alone].tail_ns))
    decoder = Decoder(alone, baud=BAUD)
    want = [*(decoder.feed(c) for c in chunks), decoder.close()]
    parts = decoded(mixed(names), [[c] for c in chunks])
    mine = [p[names.index(alone)] for p in parts]
    other = [p[1 - names.index(alone)] for p in parts]
    taken = [range(start, start + size) for start, size, *_ in records(other).frames]
    left = {at for start, size, *_ in gaps(want) for at in range(start, start + size)}
    # What the one leaves over is the other's to claim, as a torn frame that holds one of its own.
    # By chance it begins a frame there that goes on over the one's: from there on that one wins.
    won = next((place for place in taken if not left.issuperset(place)), None)
    if won is not None:
        begins = {f[0]: f[1] for f in records(want).frames}
        assert won.start in left or begins.get(won.start, len(s)) < len(won)
        before = [f for f in records(want).frames if f[0] + f[1] <= won.start]
        assert [f for f in records(mine).frames if f[0] < won.start] == before
        return
    assert records(mine) == records(want)
    # Before the first frame nobody is known.
    if not taken and any(f[0] == 0 for f in records(want).frames):
        assert gaps(mine) == gaps(want)
        assert found(mine) == found(want)
        assert not any(len(b.frames) or b.gaps or b.anomalies for b in other)


def test_what_the_one_leaves_over_begins_a_frame_of_the_other_that_goes_on_over_its_own() -> None:
    """Noise before wCK's talk: by chance FF FF FF C9 10 ... is a mightyZAP frame that holds."""
    told = "FF000000 FF000000 FFFFFFC9105979 FFE0830D751B0D75 FFE0C90101290000"
    chunk = Chunk(bytes.fromhex(told), 1_700_000_000_000_000_000, Clock.READ)
    zap, wck = zip(*decoded(mixed(("mightyzap", "wck")), [[chunk]]), strict=True)
    assert [f[:2] for f in records(zap).frames] == [(8, 21)]
    assert [f[:2] for f in records(wck).frames] == [(0, 4), (4, 4)]
    assert [g[:2] for g in gaps([*zap, *wck])] == [(29, 2)]


def test_a_torn_frame_that_holds_one_of_the_other_leaves_it_to_that() -> None:
    """A silence cuts a mightyZAP answer: what is left of it reads as a wCK move and its reply."""
    told = "FFFFFF0004F210 08F1 FF", "FFFF020A0802242400000002009F"
    chunks = [
        Chunk(bytes.fromhex(data), 1_700_000_000_000_000_000 + ns, Clock.READ)
        for data, ns in zip(told, (2_000_000, 105_000_000), strict=True)
    ]
    zap, wck = zip(*decoded(mixed(("mightyzap", "wck")), [chunks]), strict=True)
    assert [f[:2] for f in records(zap).frames] == [(0, 9)]
    assert [f[:2] for f in records(wck).frames] == [(11, 4), (15, 2)]
    assert sorted(g[:2] for g in gaps([*zap, *wck])) == [(9, 1), (10, 1), (17, 7)]


@EVERY
@given(data=st.data())
def test_declaring_a_silence_changes_nothing_that_the_chunks_do_not_say(
    names: tuple[str, str], data: st.DataObject
) -> None:
    s = data.draw(two(names))
    chunks = data.draw(chunked(s, BYTE_NS, 100_000_000))
    replayed = decoded(mixed(names), [chunks])
    decoder, live = mixed(names), []
    for c in chunks:
        assert c.t_ns is not None
        live += [decoder.idle(c.t_ns - len(c.data) * BYTE_NS), decoder.feed(c)]
    live.append(decoder.close())
    assert of_each(live) == of_each(replayed)


@EVERY
@given(data=st.data())
def test_talk_of_both_is_told_apart(names: tuple[str, str], data: st.DataObject) -> None:
    """What each says, decoded with the other's exchanges left out, is what it says beside them."""
    one = st.sampled_from(range(2)).flatmap(lambda k: st.tuples(st.just(k), talk_of(names[k])))
    talk = data.draw(st.lists(one, max_size=10))
    got = of_each(decoded(mixed(names), [[Chunk(b"".join(s for _, s in talk))]]))
    if sum(f[1] for one in got for f in one.frames) == sum(len(s) for _, s in talk):
        for k, name in enumerate(names):
            turns = [
                b"".join(s for _, s in g) for who, g in itertools.groupby(talk, FIRST) if who == k
            ]
            # An answer of wCK has no header: it stands right behind its request, or is none.
            parts = turns if name == "wck" else [b"".join(turns)]
            want = [f[1:6] for part in parts for f in said_alone(name, part).frames]
            assert [f[1:6] for f in got[k].frames] == want


def said_alone(name: str, data: bytes) -> Result:
    decoder = Decoder(KNOWN[name], baud=BAUD)
    return records([decoder.feed(data), decoder.close()])


def test_what_has_the_form_of_an_answer_is_a_request_behind_the_turn_of_the_other() -> None:
    ask = "FFFF AA55 AA55 37BA 12 00 00 00 00 00 00"
    unanswered = "FFFF AA55 AA55 37BA 12 00 00 00 00 06 FF C8 FF FF FF FF 37"
    ping = "FFFFFF00 04 F3 03 00 05"
    talk = [(k, bytes.fromhex(data)) for k, data in ((1, unanswered), (0, ping), (1, ask))]
    names = "mightyzap", "wck"
    got = of_each(decoded(mixed(names), [[Chunk(b"".join(s for _, s in talk))]]))
    assert [f[2] for f in got[1].frames] == [0, 0]
    assert [f[2] for f in said_alone("wck", bytes.fromhex(unanswered + ask)).frames] == [0, 1]


@pytest.mark.parametrize("order", [("mightyzap", "rs30x"), ("rs30x", "mightyzap")])
def test_the_order_in_which_they_are_named_does_not_matter(order: tuple[str, str]) -> None:
    assert [p.name for p in protocols_named("+".join(order))] == ["mightyzap", "rs30x"]
    assert mixed(order).name == "mightyzap+rs30x"


@pytest.mark.parametrize(
    ("name", "why"),
    [("lss+lss", "twice"), ("lss+abc", "no protocol 'abc'"), ("+", "no protocol ''")],
)
def test_names_that_cannot_be_are_refused(name: str, why: str) -> None:
    with pytest.raises(SnifferError, match=why):
        protocols_named(name)


PING = b"\xff\xff\xff\x01\x02\xf1\x0b"


class TestAFrameWithinAFrame:
    def test_belongs_to_the_one_that_contains_it(self) -> None:
        decoder = mixed(WITHIN)
        inner, outer = of_each([decoder.feed(PING + PING), decoder.close()])
        assert [f[:2] for f in outer.frames] == [(0, 7), (7, 7)]
        assert not inner.frames

    def test_is_its_own_where_it_stands_alone(self) -> None:
        decoder = mixed(WITHIN)
        first, last = decoder.feed(PING + said(2) + PING), decoder.close()
        inner, outer = of_each([first, last])
        assert [f[0] for f in inner.frames] == [7, 15, 23, 31]
        assert [f[0] for f in outer.frames] == [0, 39]
        assert [t[2] for t in inner.transactions] == [0, 0]

    @given(data=st.data())
    def test_a_stream_of_either_alone_decodes_as_it_does_alone(self, data: st.DataObject) -> None:
        alone = data.draw(st.sampled_from(WITHIN))
        s = b"".join(data.draw(st.lists(talk_of(alone), max_size=10)))
        decoder = Decoder(KNOWN[alone], baud=BAUD)
        want = records([decoder.feed(s), decoder.close()])
        if sum(f[1] for f in want.frames) == len(s):
            beside = mixed(WITHIN)
            got = of_each([beside.feed(s), beside.close()])
            assert got[WITHIN.index(alone)] == want
            assert not got[1 - WITHIN.index(alone)].frames


def test_an_answer_of_one_is_no_answer_to_the_other() -> None:
    """Both ask servo 1, and only one of them is answered."""
    asked = PING + packet(1, 1)
    decoder = mixed(WITHIN)
    inner, outer = of_each([decoder.feed(asked + packet(1, 0)), decoder.close()])
    assert [t[:3] for t in inner.transactions] == [(7, 13, 0)]
    assert [t[:3] for t in outer.transactions] == [(0, -1, 1)]


def test_a_file_may_stand_in_whichever_place_of_a_name() -> None:
    root = Path(__file__).parents[1]
    file = root / "examples" / "protocols" / "lx16a" / "sniffer_lx16a.py"
    capture = root / "sample_captures" / "mightyzap_manual.hex"
    for name in (f"mightyzap+{file}", f"{file}+mightyzap"):
        ran = sniffer("decode", capture, "--protocol", name, "--summary")
        assert ran.out.startswith("bus0: lx16a+mightyzap, ")


def test_whose_bytes_nobody_claims_is_who_makes_most_of_them() -> None:
    torn = bytearray(PING)
    torn[-1] ^= 1
    decoder = mixed(WITHIN)
    parts = [decoder.feed(said(1) + PING + torn + said(1)), decoder.close()]
    inner, outer = zip(*parts, strict=True)
    assert not gaps(inner)
    assert [(at, n, why) for at, n, why, _ in gaps(outer)] == [(23, 7, "damaged")]


def test_a_capture_of_two_is_found_decoded_and_written_as_such(tmp_path: Path) -> None:
    """From the bytes to every output: the same frames, each with its protocol, in wire order."""
    zap, futaba = heard("mightyzap"), heard("rs30x")
    path = tmp_path / "two.bin"
    path.write_bytes(zap + futaba + zap)
    out = {suffix: tmp_path / f"two{suffix}" for suffix in (".jsonl", ".mcap", ".parquet")}
    ran = sniffer("decode", path, *(x for p in out.values() for x in ("-o", p)))
    assert ran.status == 0
    assert "mightyzap+rs30x (sure: explain" in ran.err
    rows = [json.loads(line) for line in out[".jsonl"].read_text().splitlines()]
    *told, summary = rows
    size = len(zap) * 2 + len(futaba)
    assert sum(r["length"] for r in told if r["type"] in ("frame", "gap")) == size
    assert [r["offset"] for r in told if r["type"] in ("frame", "gap")] == sorted(
        r["offset"] for r in told if r["type"] in ("frame", "gap")
    )
    assert {r["protocol"] for r in told} == {"mightyzap", "rs30x"}
    bus = summary["buses"]["bus0"]
    assert bus["protocol"] == "mightyzap+rs30x"
    assert bus["bytes"] == size == sum(p["bytes"] for p in bus["protocols"].values())
    again = sniffer("decode", out[".mcap"], "--format", "jsonl")
    assert [json.loads(line) for line in again.out.splitlines()][:-1] == told
    named = sniffer("decode", path, "--protocol", "rs30x+mightyzap", "--format", "jsonl")
    assert [json.loads(line) for line in named.out.splitlines()][:-1] == told
    assert "the same as recorded" in sniffer("replay", "--redecode", out[".mcap"]).out
    spoken = pq.read_table(out[".parquet"], columns=["protocol"]).column(0).to_pylist()
    assert Counter(spoken) == Counter(r["protocol"] for r in told if r["type"] == "sample")


def test_rows_tell_their_protocol_only_where_there_are_two() -> None:
    ran = sniffer("decode", SAMPLES / "mightyzap_manual.hex", "--format", "jsonl")
    for line in ran.out.splitlines()[:-1]:
        row = json.loads(line)
        assert ("protocol" in row) == (row["type"] == "frame")


def test_bytes_that_another_protocol_holds_up_before_a_silence_may_be_a_torn_answer() -> None:
    """An FF behind the answers, which may begin a wCK command, and only then the silence."""
    asked = "FFFFFF0104F3030202 FFFFFF0104F2920175 FFFFFF0104F28C02"
    behind = "7A FFFFFF020200FB FF", "FF64"
    stamps = (307_549_065, 309_111_555, 769_705_723)
    chunks = [
        Chunk(bytes.fromhex(data), 1_700_000_000_000_000_000 + ns, Clock.READ)
        for data, ns in zip((asked, *behind), stamps, strict=True)
    ]
    bytewise = [
        [Chunk(c.data[i : i + 1], (c.t_ns or 0) - (len(c.data) - i - 1) * BYTE_NS, c.clock)]
        for c in chunks
        for i in range(len(c.data))
    ]
    names = ("mightyzap", "wck")
    whole, again = (of_each(decoded(mixed(names), cut)) for cut in ([chunks], bytewise))
    assert again == whole
