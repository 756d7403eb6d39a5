"""Samples of every form of input with harm done to them by chance: none does more than end early.

`make fuzz` runs a thousand of each form.
"""

from __future__ import annotations

import random
import struct
import sys
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.ground.model import Chunk
from tests import hostile, toollogs
from tests.hostile import ANSWER, ASK, Answer, Victim, decoded, frame, sound
from tests.lists import in_turn
from tests.pcaps import pcap, urb, written
from tests.recordings import START_NS

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="limits memory as POSIX does")

SEEDS: Final = Path(__file__).parent / "data" / "formats"
CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"


BIG: Final = tuple(
    str(n).encode() for n in (0, -1, 255, 2**31, 2**32, 2**62, 2**63 - 1, 2**63, 2**64, 10**30)
)


def mutated(seed: bytes, rng: random.Random) -> bytes:
    """Return a seed with some harm done to it."""
    out = bytearray(seed)
    for _ in range(rng.choice((1, 1, 2, 5))):
        a, b = sorted((rng.randrange(len(out) + 1), rng.randrange(len(out) + 1)))
        b = min(b, a + rng.choice((1, 8, 100, 5000)))
        kind = rng.randrange(8)
        if kind == 0:
            del out[a:b]
        elif kind == 1:
            out[a:a] = out[a:b] * rng.choice((1, 3, 200))
        elif kind == 2:
            out[a:b] = rng.randbytes(b - a)
        elif kind == 3 and a < len(out):
            out[a] ^= 1 << rng.randrange(8)
        elif kind == 4:
            out[a:b] = rng.choice(BIG)
        elif kind == 5:
            del out[rng.randrange(len(out) + 1) :]
        elif kind == 6:
            out[a:b] = rng.choice((b"*\n", b"\0" * 100, b"\xff" * 8, b"\n" * 50, b'"', b"\\ud800"))
        elif a + 8 <= len(out):
            struct.pack_into("<Q", out, a, rng.choice((0, 2**31, 2**62, 2**63 - 1, 2**64 - 1)))
        if not out:
            return b""
    return bytes(out)


def seeds() -> dict[str, list[bytes]]:
    """Return samples of every form of input by the name of the form."""
    named = {
        "bin": [CAPTURES / "lss_manual.bin", CAPTURES / "lss_damaged.log"],
        "hex": [CAPTURES / "mightyzap_manual.hex", CAPTURES / "wck_manual.hex"],
        "xxd": [SEEDS / "xxd.txt"],
        "hexdump": [SEEDS / "hexdump-C.txt"],
        "od": [SEEDS / "od-tx1.txt"],
        "candump": [CAPTURES / "rs30x_damaged.log", CAPTURES / "wck_damaged.log"],
    }
    out = {form: [path.read_bytes()[:6000] for path in paths] for form, paths in named.items()}
    out["decimal"] = [b" ".join(str(byte).encode() for byte in (ASK + ANSWER) * 20)]
    lines = [frame(t_ns=START_NS + n, offset=18 * n, clock="read") for n in range(20)]
    for name, write in toollogs.WRITERS.items():
        out.setdefault(toollogs.FORMAT[name], []).append(write(toollogs.conversation())[:6000])
    out["jsonl"] = ["".join(lines).encode()]
    told = [Chunk(ASK + ANSWER, START_NS + n) for n in range(20)]
    out["pcap"] = [written(told), pcap([urb("S", 2, ASK, START_NS)] * 20, 220)]
    return out


LESS: Final = settings(max_examples=max(settings().max_examples // 4, 10), deadline=None)
"""Each example runs a whole command: a quarter of the usual number, a thousand with `make fuzz`."""


@in_turn(2)
@pytest.mark.parametrize("form", seeds())
@pytest.mark.parametrize("named", [False, True], ids=["recognised", "named"])
@LESS
@given(st.integers(0, 2**32))
def test_an_input_that_was_harmed_is_read_as_far_as_it_goes(
    form: str, named: bool, victim: Victim, tmp_path_factory: pytest.TempPathFactory, number: int
) -> None:
    rng = random.Random(number)
    data = mutated(rng.choice(seeds()[form]), rng)
    path = tmp_path_factory.getbasetemp() / f"harmed-{form}-{named}.dat"
    told = ("--input-format", form) if named else ()
    decoded(victim, path, data, "--protocol", "mightyzap", *told)


@pytest.mark.parametrize("inside", [False, True], ids=["file", "messages"])
@LESS
@given(st.integers(0, 2**32))
def test_a_recording_that_was_harmed_is_read_as_far_as_it_goes(
    inside: bool,
    victim: Victim,
    base: bytes,
    tmp_path_factory: pytest.TempPathFactory,
    number: int,
) -> None:
    rng = random.Random(number)
    folder = tmp_path_factory.getbasetemp()
    path = folder / f"harmed-{inside}.mcap"
    if inside:  # without a checksum the messages are believed
        content = mutated(hostile.unpacked(base), rng)
        data = hostile.with_chunk(base, content, size=len(content))
    else:
        data = base[:8] + mutated(base[8:], rng)
    decoded(victim, path, data, "--protocol", "mightyzap")
    whole = victim.run("recover", path, "-o", folder / f"whole-{inside}.mcap", "--force")
    sound(Answer(whole.status, "", whole.err, whole.memory))
    again = victim.run("replay", path, "--redecode")
    sound(Answer(again.status, "", again.err, again.memory))
