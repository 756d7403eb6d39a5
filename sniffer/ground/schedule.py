"""When what was said once is due again."""

from __future__ import annotations

import math

from sniffer.ground.heard import is_set
from sniffer.ground.model import SnifferError
from sniffer.ground.moments import DAY_NS


def checked(speed: float) -> float:
    """Return a speed, in times real time.

    Raises:
        SnifferError: nothing can be played at it.
    """
    if not 0 <= speed < math.inf:
        raise SnifferError(f"a speed is 0 or more times real time, not {speed:g}")
    return speed


class Schedule:
    """Moments as far behind the first one as they were then, by the speed.

    They are absolute: what one is late does not delay the next, so nothing drifts. Where the clock
    was set meanwhile, or nothing was said for a day, they are counted anew.

    Args:
        speed: times real time; 0: nobody waits, so nothing is ever due.

    Raises:
        SnifferError: nothing can be played at it.
    """

    def __init__(self, speed: float) -> None:
        self._speed = checked(speed)
        self._began: int | None = None
        self._first = self._last = 0

    def due_ns(self, t_ns: int, now_ns: int) -> int:
        """Return when what was said at a time is due, on the clock of ``now_ns``."""
        if self._began is None or is_set(t_ns, self._last) or t_ns - self._last > DAY_NS:
            self._began, self._first = now_ns, t_ns
        self._last = t_ns
        return self._began + int((t_ns - self._first) / self._speed)
