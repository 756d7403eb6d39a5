"""Batches in a row joined to one: the same records, and the same diagnosis."""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

from sniffer.decoding.decoder import Decoder
from sniffer.decoding.joining import joined, runs
from sniffer.diagnosis import Diagnosis
from sniffer.testing.laws import anomalies
from sniffer.testing.records import gaps, records
from tests.lists import each_in_turn
from tests.recordings import talk

if TYPE_CHECKING:
    from sniffer.ground.model import Batch


def passes(protocol: str, seed: int) -> list[Batch]:
    """What is said on a bus with every kind of fault, in many small passes."""
    decoder = Decoder(protocol)
    out = [decoder.feed(chunk) for chunk in talk(protocol, 1.5, seed)]
    return [b for b in (*out, decoder.close()) if b.data or b.remarks or len(b.anomalies)]


@each_in_turn(4, "protocol", ["mightyzap", "lss", "rs30x", "wck"])
def test_joined_batches_have_the_records_of_all_and_the_same_diagnosis(protocol: str) -> None:
    rng = random.Random(3)
    apart = passes(protocol, 5)
    p = Decoder(protocol).protocol
    together: list[Batch] = []
    at = 0
    while at < len(apart):
        n = rng.randint(1, 40)
        together += [joined(run) for run in runs(apart[at : at + n])]
        at += n
    assert len(together) < len(apart) / 4
    assert records(together) == records(apart)
    assert gaps(together) == gaps(apart)
    assert anomalies(together) == anomalies(apart)
    assert [r for b in together for r in b.remarks] == [r for b in apart for r in b.remarks]
    told = []
    for some in (apart, together):
        diagnosis = Diagnosis()
        for batch in some:
            diagnosis.write("bus0", p, batch)
        told.append([incident.as_dict() for incident in diagnosis.incidents()])
    assert told[0] == told[1]
