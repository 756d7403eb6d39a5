"""``sniffer record`` killed in full flight: its file holds all but the last moment, and opens."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from bench.survives import ALLOWED_NS, KINDS, complaints, kill
from tests.terminals import LINUX_ONLY

if TYPE_CHECKING:
    from pathlib import Path

SEED: Final = 66
"""Killed after 0.2 to 1.1 s, the one of several files last."""

pytestmark = LINUX_ONLY


def test_killed_at_any_moment_it_loses_a_tenth_of_a_second_at_most_and_every_file_opens(
    tmp_path: Path,
) -> None:
    kinds = KINDS[1:2] + KINDS[4:7]  # named and found, waiting for the disk, several files
    found = kill(tmp_path, kinds, SEED)
    assert len(found) == 4
    for left in found:
        # what keeps the writer from running keeps the recorder from it, too
        assert complaints(left, ALLOWED_NS + 2 * left.held_up_ns) == [], left
        assert left.kept, left
    assert [len(left.files) > 1 for left in found] == [False, False, False, True]
