"""Captures in which so much goes wrong that the diagnosis keeps only some of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.diagnosis.ledger import exchanges, silences
from sniffer.diagnosis.ledger.ledger import Ledger
from sniffer.ground.model import Chunk, Clock
from sniffer.protocols import PROTOCOLS
from tests.streams import mightyzap

if TYPE_CHECKING:
    from collections.abc import Callable

START_NS = 1_795_215_306_000_000_000
COUNT = 6000


def stretches() -> list[Chunk]:
    """Two servos that miss 1 to 4 requests in a row again and again; of one half is asked anew."""
    rng = np.random.default_rng(7)
    out: list[Chunk] = []
    t = START_NS
    while len(out) < 3 * COUNT:
        servo = int(rng.integers(1, 3))
        asked = mightyzap.packet(servo, 0xF1, b"")
        for _ in range(int(rng.integers(1, 5))):
            t += 20_000_000
            out.append(Chunk(asked, t, Clock.FILE))
        t += 1_000_000
        out.append(Chunk(mightyzap.packet(servo, 0x00, b""), t, Clock.FILE))
    return out


def ledger_of(chunks: list[Chunk], group: int) -> Ledger:
    protocol = PROTOCOLS["mightyzap"]
    decoder, ledger = Decoder(protocol), Ledger("bus0", protocol)
    for first in range(0, len(chunks), group):
        ledger.add(decoder.feed(*chunks[first : first + group]))
    ledger.add(decoder.close())
    return ledger


def test_of_many_silences_and_retries_the_same_are_kept_however_they_are_grouped() -> None:
    chunks = stretches()
    whole, pieces = ledger_of(chunks, len(chunks)), ledger_of(chunks, 50)
    for servo in (1, 2):
        a, b = whole.silences, pieces.silences
        assert a.lengths(servo) == b.lengths(servo)
        assert sum(a.lengths(servo)) > 2 * silences.KEPT
        assert [*a.runs(servo)] == [*b.runs(servo)]
        assert [*a.of(servo)] == [*b.of(servo)]
    assert len(whole.exchanges.runs) == exchanges.KEPT
    assert [*whole.exchanges.all_runs] == [*pieces.exchanges.all_runs]


@pytest.mark.parametrize(("where", "name"), [(silences, "_silence"), (exchanges, "Run")])
def test_no_more_silences_and_retries_are_put_together_than_are_kept(
    where: Any, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A million of them took ten seconds, to be thrown away."""
    made: Callable[..., Any] = getattr(where, name)
    count = 0

    def counted(*args: Any) -> Any:
        nonlocal count
        count += 1
        return made(*args)

    monkeypatch.setattr(where, name, counted)
    chunks = stretches()
    ledger_of(chunks, len(chunks))
    assert count < 5 * where.KEPT
