"""Whole conversations with each model there is, decoded without being told which it is."""

from __future__ import annotations

import pytest

from sniffer.decoding.decoder import Decoder
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import BUSES, simulate
from tests.lists import in_turn

SIBLINGS = [(name, model) for name, bus in BUSES.items() for model in bus.tables]
SEEDS, SECONDS = range(3), 3
DECIDED = {
    *(m.model for p in ("mightyzap", "lss") for m in PROTOCOLS[p].models),
    *(m.model for m in PROTOCOLS["rs30x"].models if m.identity is not None),
}
"""Those that say who they are, or are told by what is said to them."""


def verdicts(name: str, model: str, seed: int, *, begun: bool) -> dict[str, int]:
    """Return as what the servos are read in the end, and how many; "" for the mere default."""
    said = [f.wire for f in simulate(name, seed=seed, duration_s=SECONDS, models={None: model})]
    said = said[len(said) // 2 :] if begun else said
    decoder = Decoder(name)
    batches = decoder.feed(b"".join(said)), decoder.close()
    assert not [a for b in batches for a in b.anomalies if a.code == "value-out-of-range"]
    found = {servo: told for b in batches for servo, told in b.models.items()}
    counts = dict.fromkeys([m for m, _ in found.values()], 0)
    for servo in BUSES[name].servo_ids:
        who = found.get(servo, ("", 0))[0]
        counts[who] = counts.get(who, 0) + 1
    return counts


@in_turn(2)
@pytest.mark.parametrize(("name", "model"), SIBLINGS)
def test_a_conversation_with_a_sibling_tells_it_and_never_another(name: str, model: str) -> None:
    for seed in SEEDS:
        found = verdicts(name, model, seed, begun=False)
        if len(PROTOCOLS[name].models) > 1 and model in DECIDED:
            assert set(found) == {model}
        else:
            assert set(found) <= {model, ""}


@in_turn(3)
@pytest.mark.parametrize(("name", "model"), SIBLINGS)
def test_half_a_conversation_with_a_sibling_never_tells_another(name: str, model: str) -> None:
    for seed in SEEDS:
        assert set(verdicts(name, model, seed, begun=True)) <= {model, ""}
