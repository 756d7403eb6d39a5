"""The order in which a controller makes its requests: what always follows what."""

from __future__ import annotations

import functools
import heapq
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.ledger.likes import Asking

if TYPE_CHECKING:
    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.ledger.damage import Damage
    from sniffer.ground.model import I64

RARELY: Final = 0.02
"""What follows a kind of request less often is not in the order."""

OFTEN: Final = 0.3
"""A kind that is said less often than so much of the busiest one is no part of the cycle."""

PEERS: Final = 2
"""Other servos of which a controller asks one thing behind the other."""

STRICT: Final = 0.9
"""Share of requests behind which the one comes that comes there most often, in a fixed order."""


class Order:
    """What follows each kind of request, and how fixed that is."""

    def __init__(self, case: Case) -> None:
        self._follows = f = case.ledger.exchanges.followers()
        self._kinds = case.ledger.exchanges.kinds
        totals: dict[int, int] = {}
        most: dict[int, int] = {}
        for kind, n in zip(f["kind"].tolist(), f["n"].tolist(), strict=True):
            totals[kind] = totals.get(kind, 0) + n
            most[kind] = max(most.get(kind, 0), n)
        self._totals = totals
        self.strictness = sum(most.values()) / max(sum(totals.values()), 1)
        self.usual: dict[int, set[int]] = {}
        """By kind: those that usually follow it."""
        for kind, after, n in zip(*(f[c].tolist() for c in ("kind", "next", "n")), strict=True):
            if n >= max(RARELY * totals[kind], 2):
                self.usual.setdefault(kind, set()).add(after)

    @property
    def is_strict(self) -> bool:
        """Whether the requests come in a fixed order, round and round."""
        return self.strictness >= STRICT

    def breaks(self) -> tuple[dict[str, I64], I64]:
        """Return all pairs, and the rows of those that leave requests of the cycle out."""
        n = self._kinds.n
        busy = n >= OFTEN * n.max(initial=0)
        f = self._follows
        if not self.is_strict or not len(f["kind"]):
            return f, np.empty(0, np.int64)
        rows = [
            i
            for i, (kind, after) in enumerate(
                zip(f["kind"].tolist(), f["next"].tolist(), strict=True)
            )
            if min(kind, after) >= 0
            and busy[kind]
            and busy[after]
            and after != kind
            and after not in self.usual.get(kind, ())
        ]
        return f, np.array(rows, np.int64)

    def leaves_out(self, kind: int, after: int) -> bool:
        """Tell whether requests are missing between two kinds."""
        known = self.usual.get(kind, set())
        return self.is_strict and bool(known) and after not in known

    def is_broken_at(self, d: Damage) -> bool:
        """Tell whether requests are missing between those before and behind a torn place."""
        kind, after = self._around(d)
        return min(kind, after) >= 0 and self.leaves_out(kind, after)

    def missing_bytes(self, d: Damage) -> int:
        """Return how many bytes the requests have at least that are missing at a torn place."""
        if not self.is_broken_at(d):
            return 0
        kind, after = self._around(d)
        sizes = [*map(len, self._kinds.example)]
        reached, nearest = {-1}, [(0, k) for k in self.usual[kind]]  # -1: no kind that is known
        while nearest:
            size, k = heapq.heappop(nearest)
            if k == after and size:
                return size
            if k not in reached:
                reached.add(k)
                for then in self.usual.get(k, ()):
                    heapq.heappush(nearest, (size + sizes[k], then))
        return 0

    def _around(self, d: Damage) -> tuple[int, int]:
        """Return the kinds of requests before and behind a torn place; -1: none, or a rare one."""
        if not d.asked_before or d.then is None:
            return -1, -1
        before, then = d.asked_before[0].asking, d.then
        return self._number.get(before, -1), self._number.get(then, -1)

    @functools.cached_property
    def _number(self) -> dict[Asking, int]:
        k = self._kinds
        every = enumerate(zip(k.servo_id, k.op, k.address, k.odd, strict=True))
        return {Asking(*asking): n for n, (*asking, odd) in every if not odd}

    def leaves_servo(self, kind: int, after: int) -> bool:
        """Tell whether another servo is asked behind a request, as never behind those to others.

        Whoever asks two servos and more first for this and then for that asks each of them so.
        """
        k = self._kinds
        form = k.op[kind], k.address[kind], k.odd[kind]
        peers = [
            peer
            for peer in self.usual
            if peer >= 0 and (k.op[peer], k.address[peer], k.odd[peer]) == form
            if k.servo_id[peer] != k.servo_id[kind]
        ]
        stays = all(
            then >= 0 and k.servo_id[then] == k.servo_id[peer]
            for peer in peers
            for then in self.usual[peer]
        )
        leaves = after >= 0 and k.servo_id[after] != k.servo_id[kind]
        return leaves and stays and len({k.servo_id[peer] for peer in peers}) >= PEERS

    def skips_one(self, kind: int, after: int) -> bool:
        """Tell whether just one request is missing between two kinds."""
        known = self.usual.get(kind, set())
        second = set[int]().union(*(self.usual.get(k, set()) for k in known))
        return after != kind and after in second - known
