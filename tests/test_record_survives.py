"""``sniffer record`` killed in full flight: its file holds all but the last moment, and opens."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Final

from bench.survives import KINDS, Victim, complaints, kill, raw
from sniffer.ground.model import InputError
from tests.terminals import LINUX_ONLY, PATIENCE_S

if TYPE_CHECKING:
    from pathlib import Path

NOT_ASKED_NS: Final = 1 << 62

SEED: Final = 66
"""Killed after 0.2 to 1.1 s, the one of several files last."""

pytestmark = LINUX_ONLY


def ready(victim: Victim) -> bool:
    """Tell whether it has recorded something, of several files in the second one."""
    files = 2 if "--rotate" in victim.kind.options else 1
    with contextlib.suppress(InputError):  # a file that has only just been made
        return len(victim.files) >= files and all(map(raw, victim.files))
    return False


def test_killed_at_any_moment_it_keeps_the_beginning_and_every_file_opens(
    tmp_path: Path,
) -> None:
    kinds = KINDS[1:2] + KINDS[6:7]  # named, and several files
    found = kill(tmp_path, kinds, SEED, ready, PATIENCE_S)
    assert len(found) == 2
    for left in found:
        # how much may be missing at the end is a figure: bench.survives, where nothing else runs
        assert complaints(left, allowed_ns=NOT_ASKED_NS) == [], left
        assert left.kept, left
    assert [len(left.files) > 1 for left in found] == [False, True]
