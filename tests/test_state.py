"""What a decoder knows, stated and taken up elsewhere: nothing of it is missing."""

from __future__ import annotations

import ast
import inspect
import itertools
import pickle
import textwrap
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.anomalies.alarms import alarm_in
from sniffer.decoding.mixed import decoder_of, parts_of
from sniffer.decoding.names import protocols_named
from sniffer.ground.memory import Remembering, plain
from sniffer.ground.model import Chunk, Mark, MarkKind, SnifferError
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import PROTOCOLS
from sniffer.simulation.buses import simulate
from tests.lists import in_turn
from tests.records import gaps, records
from tests.streams import bursts, chunked, stream

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.decoder import Decoder
    from sniffer.decoding.mixed import MixedDecoder
    from sniffer.decoding.state import DecoderState
    from sniffer.ground.model import Batch

NAMES: Final = [*PROTOCOLS, "mightyzap+rs30x"]
FEW: Final = settings(max_examples=max(settings().max_examples // 7, 2))
EVERY = pytest.mark.parametrize("name", NAMES)

TRANSIENT: Final = frozenset(
    {
        # of one pass: set before they are used in the next one
        *("_seconds", "_proofs", "_singles", "_before", "_held", "turns"),
        "_names",  # words, looked up once
        *("_keys", "_known"),  # of evidence: stated as ``_counted``, in whatever order
    }
)
"""Attributes that change and are not remembered."""

CHANGING: Final = frozenset(
    {
        *("append", "extend", "insert", "add", "update", "setdefault"),
        *("remove", "discard", "pop", "popleft", "clear"),
    }
)
"""Methods that change what they are called of."""


RULES: Final = (alarm_in("position > 10"), alarm_in("position_error > 1 for 1s"))


def new(name: str, rules: Sequence[Alarm] = RULES, **how: Any) -> Decoder | MixedDecoder:
    return decoder_of(protocols_named(name), alarms=rules, baud=115200, **how)


def told(decoder: Decoder | MixedDecoder, groups: Sequence[Sequence[Chunk]]) -> list[list[Batch]]:
    """Return the batches of each protocol."""
    passes = [decoder.feed(*group) for group in groups]
    each = [[batch for _, batch in parts_of(decoder, one)] for one in passes]
    return [*map(list, zip(*each, strict=True))] if each else [[] for _ in decoder.protocols]


def ended(decoder: Decoder | MixedDecoder) -> list[list[Batch]]:
    return [[batch] for _, batch in parts_of(decoder, decoder.close())]


def joined(*parts: list[list[Batch]]) -> list[object]:
    """Return all that is told in parts of a stream."""
    out: list[object] = []
    for batches in ([b for one in each for b in one] for each in zip(*parts, strict=True)):
        out += [records(batches), gaps(batches), [a for b in batches for a in b.anomalies]]
        out += [[r for b in batches for r in b.remarks], [b.cut for b in batches if b.cut]]
        models: dict[int, object] = {}
        for batch in batches:
            models.update(batch.models)
        out.append(models)
    return out


@st.composite
def heard(draw: st.DrawFn, name: str) -> list[Chunk]:
    """Draw chunks, with or without times, and now and then a mark."""
    each = name.split("+")
    some = st.one_of(*(s for one in each for s in (stream(one), stream(one), bursts(one, 2))))
    raw = b"".join(draw(st.lists(some, min_size=1, max_size=4)))
    chunks = draw(chunked(raw, byte_time_ns(115200), PROTOCOLS[each[0]].tail_ns))
    if draw(st.booleans()):
        return [Chunk(chunk.data) for chunk in chunks]
    kinds = st.sampled_from([MarkKind.FRAMING, MarkKind.HELD, MarkKind.LOST, MarkKind.SILENT])
    for i, chunk in enumerate(chunks):
        if not draw(st.integers(0, 5)):
            mark = Mark(draw(kinds), 0, 1, draw(st.sampled_from([1, 80_000_000])))
            chunks[i] = Chunk(chunk.data, chunk.t_ns, chunk.clock, marks=(mark,))
    return chunks


@in_turn(2)
@EVERY
@FEW
@given(data=st.data())
def test_a_decoder_that_goes_on_with_a_state_says_what_the_one_it_is_of_would_have_said(
    name: str, data: st.DataObject
) -> None:
    chunks = data.draw(heard(name))
    cuts = st.lists(st.integers(0, len(chunks)), min_size=1, max_size=4).map(sorted)
    edges = [0, *data.draw(cuts), len(chunks)]
    groups = [chunks[a:b] for a, b in itertools.pairwise(edges)]
    seam = data.draw(st.integers(1, len(groups) - 1))
    first, whole = new(name), new(name)
    begun = told(first, groups[:seam])
    state: DecoderState = pickle.loads(pickle.dumps(first.state()))
    second = new(name, state=state)
    assert second.state().observable() == state.observable()
    parts = begun, told(second, groups[seam:])
    assert joined(*parts, ended(second)) == joined(told(whole, groups), ended(whole))
    assert second.state().observable() == whole.state().observable()


@in_turn(2)
@EVERY
@FEW
@given(data=st.data())
def test_what_begins_elsewhere_and_states_the_same_at_a_place_says_the_same_from_there_on(
    name: str, data: st.DataObject
) -> None:
    chunks = data.draw(heard(name))
    seam = data.draw(st.integers(0, len(chunks)))
    begin, head = (data.draw(st.integers(0, seam)) for _ in range(2))
    knows = new(name)
    told(knows, [chunks[:head]])
    late = new(name, state=knows.state().elsewhere(), base=sum(len(c.data) for c in chunks[:begin]))
    whole = new(name)
    told(whole, [chunks[:seam]])
    told(late, [chunks[begin:seam]])
    if late.state().observable() != whole.state().observable():
        return
    parts = [joined(told(d, [chunks[seam:]]), ended(d)) for d in (late, whole)]
    assert parts[0] == parts[1]


@in_turn(2)
@EVERY
def test_what_begins_in_the_middle_of_a_simulated_bus_soon_states_what_the_whole_one_does(
    name: str,
) -> None:
    one = name.split("+")[0]
    raw = b"".join(frame.wire for frame in simulate(one, seed=5, duration_s=4))
    head, begin, seam = (share * len(raw) // 8 for share in (4, 5, 6))
    whole = new(name, ())
    told(whole, [[Chunk(raw[:head])]])
    late = new(name, (), state=whole.state().elsewhere(), base=begin)
    told(whole, [[Chunk(raw[head:seam])]])
    told(late, [[Chunk(raw[begin:seam])]])
    assert late.state().observable() == whole.state().observable()


@EVERY
def test_nothing_that_changes_while_a_bus_is_decoded_is_left_out_of_the_state(name: str) -> None:
    raw = b"".join(
        frame.wire for one in name.split("+") for frame in simulate(one, seed=5, duration_s=2)
    )
    raw += raw[:200] * 2 + bytes(range(256)) + raw[301:900]
    whole, rest = new(name), [Chunk(raw[-400:])]
    told(whole, [[Chunk(raw[:-400])]])
    other = new(name, state=whole.state())
    told(whole, [rest])
    told(other, [rest])
    mine, its = (dict(_attributes(decoder, name)) for decoder in (whole, other))
    assert mine.keys() == its.keys()
    assert [key for key in mine if mine[key] != its[key]] == []


def _attributes(thing: object, path: str) -> Iterator[tuple[str, object]]:
    """Yield every attribute of a decoder, and of what it is made of, in plain values."""
    for key, value in vars(thing).items():
        where = f"{path}.{key}"
        if key in TRANSIENT or any(value is p for p in PROTOCOLS.values()):
            continue
        parts = value if isinstance(value, list) else [value]
        if parts and all(hasattr(p, "__dict__") and _is_ours(p) for p in parts):
            for i, part in enumerate(parts):
                yield from _attributes(part, f"{where}[{i}]")
        elif isinstance(value, int | float | bytes | str | np.ndarray | dict | set | list):
            shown = repr(plain(value))
            if " object at " not in shown:  # what holds parts is walked by another name
                yield where, shown


def _is_ours(value: object) -> bool:
    return type(value).__module__.startswith(("sniffer.decoding", "sniffer.anomalies")) or (
        isinstance(value, Remembering)
    )


def _kinds(kind: type[Remembering]) -> Iterator[type[Remembering]]:
    for one in kind.__subclasses__():
        yield one
        yield from _kinds(one)


def _name(kind: type[Remembering]) -> str:
    return kind.__name__


KINDS: Final[list[type[Remembering]]] = sorted({*_kinds(Remembering)}, key=_name)


@pytest.mark.parametrize("kind", KINDS, ids=_name)
def test_what_a_method_sets_is_named_among_what_is_remembered(kind: Any) -> None:
    named = {*kind.LASTING, *kind.PASSING, *kind.PARTS} | TRANSIENT
    source = ast.parse(textwrap.dedent(inspect.getsource(kind)))
    methods = [m for m in ast.walk(source) if isinstance(m, ast.FunctionDef)]
    changed = {name for m in methods if m.name != "__init__" for name in _set_by(m)}
    assert changed <= named, f"{kind.__name__} changes what its state does not tell"


def _set_by(method: ast.FunctionDef) -> Iterator[str]:
    """Yield the attributes of ``self`` that a method sets, in whole or in part."""
    targets: list[ast.expr] = []
    for node in ast.walk(method):
        if isinstance(node, ast.Assign):
            targets += node.targets
        elif isinstance(node, ast.AugAssign | ast.AnnAssign):
            targets.append(node.target)
        elif isinstance(node, ast.Delete):
            targets += node.targets
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            targets += [node.func.value] if node.func.attr in CHANGING else []
    while targets:
        target = targets.pop()
        if isinstance(target, ast.Tuple | ast.List):
            targets += target.elts
        elif isinstance(target, ast.Subscript | ast.Starred):
            targets.append(target.value)
        elif (
            isinstance(target, ast.Attribute)
            and isinstance(target.value, ast.Name)
            and target.value.id == "self"
        ):
            yield target.attr


def test_a_state_is_of_its_own_protocol_and_a_guess_is_of_no_place() -> None:
    state = new("wck").state()
    with pytest.raises(SnifferError, match="a state of wck is none of lss"):
        new("lss", state=state)
    with pytest.raises(SnifferError, match="of no place"):
        state.elsewhere().observable()
