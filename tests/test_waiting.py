"""A reader that was woken and not scheduled says so."""

from __future__ import annotations

import os
import threading
from typing import TYPE_CHECKING

from sniffer.tap import waiting
from sniffer.tap.waiting import Account
from tests.terminals import LINUX_ONLY

if TYPE_CHECKING:
    import pytest


def burn(stop: threading.Event, rounds: list[int]) -> None:
    while not stop.is_set():
        rounds[0] += sum(range(1000))


@LINUX_ONLY
def test_a_thread_that_shares_one_processor_with_others_is_told_that_it_waited() -> None:
    """Processes that never rest, all on one processor: whoever wants to run there has to wait."""
    core = min(os.sched_getaffinity(0))
    others = []
    for _ in range(3):
        pid = os.fork()
        if not pid:
            os.sched_setaffinity(0, {core})
            while os.getppid() != 1:
                pass
            os._exit(0)
        others.append(pid)
    found: list[int] = []

    def work() -> None:
        os.sched_setaffinity(0, {core})  # of this thread only
        with Account() as account:
            while sum(found) < 5_000_000 and len(found) < 100_000:
                sum(range(10_000))
                found.append(account.since())

    try:
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
    finally:
        for pid in others:
            os.kill(pid, 9)
            os.waitpid(pid, 0)
    assert sum(found) >= 5_000_000
    assert max(found) > 1_000_000  # a whole turn of another one, between two looks


def test_where_the_kernel_keeps_no_account_nothing_is_claimed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(waiting, "_PROC", "/nonexistent")
    with Account() as account:
        assert account.since() == 0
