"""The figures of a capture as ``schemas/stats.schema.json`` has them.

A duration is an interval ``[at least, at most]`` in ns, a quantile that of the quantile: what
stamps cannot carry is never a number.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sniffer.ground.milli import MILLI
from sniffer.ground.model import NS, Clock
from sniffer.statistics.commands import wilson
from sniffer.statistics.figures import BYTES
from sniffer.statistics.load import profile

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.decoding.durations import Quantiles
    from sniffer.statistics.collector import LaneFigures
    from sniffer.statistics.commands import CommandFigures, Slowest
    from sniffer.statistics.cycles import Loop
    from sniffer.statistics.exceeding import ExceedingFigures
    from sniffer.statistics.figures import Extreme, PauseHeard, Presence, ServoFigures
    from sniffer.statistics.firstmotion import SlowestStart, StartFigures
    from sniffer.statistics.goalsteps import StepFigures, Unreached
    from sniffer.statistics.lags import Lag
    from sniffer.statistics.motion import ErrorFigures
    from sniffer.statistics.sink import LaneNumbers, Statistics, WireBytes
    from sniffer.statistics.slices import EverySlice
    from sniffer.statistics.troubles import TroubleFigures

SHARES: Final[Mapping[str, float]] = {
    "min": 0.0,
    "p50": 0.5,
    "p95": 0.95,
    "p99": 0.99,
    "max": 1.0,
}
"""The figures that are told of many numbers, and the share of all that stay below."""


OF_SERVOS: Final = ("commands", "servos", "anomalies", "alarms")
"""What a bus has that is a servo's."""


HAVING: Final = ("bytes", *OF_SERVOS)
"""What a bus has something of, if something of it is selected."""


def as_dict(told: Statistics, *, selected: bool = False) -> dict[str, Any]:
    """Return all figures, bus by bus.

    Args:
        told: the figures.
        selected: they are those of a selection: of several buses those have a place that have
            something of it, or all where none has.
    """
    buses = [_bus(told, bus) for bus in told.wires]
    if selected:
        buses = [bus for bus in buses if any(bus[name] for name in HAVING)] or buses
    for bus in buses if told.names else ():
        for key in OF_SERVOS:
            bus[key] = [told.names.beside(bus["bus"], row) for row in bus[key]]
    return {"buses": buses}


def _bus(told: Statistics, bus: str) -> dict[str, Any]:
    wire = told.wires[bus]
    clock = told.collector.wires[bus].clock if bus in told.collector.wires else Clock.NONE
    clocked = clock != Clock.NONE and wire.span_ns > 0
    lanes = {name: told.lanes[name] for name in told.collector.lanes_of(bus)}
    slices = told.slices[bus].slices() if clocked and bus in told.slices else None
    return {
        "bus": bus,
        "protocols": [lane.protocol.name for lane in lanes.values()],
        "clock": clock.name.lower(),
        "baud": wire.baud,
        "first_ns": wire.heard.first_ns,
        "last_ns": wire.heard.last_ns,
        "seconds": wire.span_ns / NS if clocked else None,
        # of two protocols each is silent while the other speaks
        "longest_silence": _pause(wire.silence.longest) if clocked and len(lanes) == 1 else None,
        "bytes": wire.bytes,
        "frames": wire.frames,
        "bytes_in_frames": wire.in_frames,
        "bytes_in_gaps": wire.in_gaps,
        "gaps": dict(sorted(wire.gaps.items())),
        "load": _load(told, bus, wire, slices) if clocked else None,
        **({} if slices is None else {"slices": _slices(slices)}),
        "commands": [
            _command(lane, c, wire, clocked=clocked, shared=not told.by_answer)
            for lane in lanes.values()
            for c in lane.commands.figures()
        ],
        "servos": [
            _servo(lane.protocol.name, servo, mine, told.collector.lanes[name])
            for name, lane in lanes.items()
            for servo, mine in sorted(told.collector.lanes[name].servos.items())
        ],
        "anomalies": [
            _trouble(lane, t, told, wire, clocked=clocked)
            for lane in lanes.values()
            for t in lane.troubles.figures()
        ],
        "alarms": [_alarm(e) for lane in lanes.values() for e in lane.exceedings.figures()],
    }


def _load(told: Statistics, bus: str, wire: WireBytes, slices: EverySlice | None) -> dict[str, Any]:
    if slices is None:
        over = profile(told.collector.grid, told.collector.wires[bus].curves[BYTES])
        first_ns, width_ns, sums = over.first_ns, over.width_ns, over.sums
    else:
        first_ns, width_ns = slices.first_ns, slices.width_ns
        sums = slices.counts["bytes"].tolist()
    shares = np.round(np.array(sums) * wire.byte_ns / width_ns, 6)
    mean = wire.bytes * wire.byte_ns / wire.span_ns
    return {
        "mean": mean,
        # the slices at the edges lie outside of what was heard by some part: of a short one all
        "peak": max(mean, float(shares.max())),
        "first_ns": first_ns,
        "slice_ns": width_ns,
        "shares": shares.tolist(),
    }


def _slices(slices: EverySlice) -> dict[str, Any]:
    counts = {name: column.tolist() for name, column in slices.counts.items()}
    replies: dict[str, Any] = {"count": slices.answers.tolist()}
    for name, bounds in slices.replies.items():
        replies[name] = [None if one is None else list(one) for one in bounds]
    told = {"first_ns": slices.first_ns, "slice_ns": slices.width_ns}
    return {**told, **counts, "response_time_ns": replies}


def _command(
    lane: LaneNumbers, c: CommandFigures, wire: WireBytes, *, clocked: bool, shared: bool
) -> dict[str, Any]:
    return {
        "protocol": lane.protocol.name,
        "servo_id": c.servo_id if c.servo_id >= 0 else None,
        "op": lane.protocol.op_name(c.op),
        "requests": c.requests,
        "responses": c.responses,
        "bytes": c.bytes,
        "bytes_share": c.bytes / wire.bytes if wire.bytes else 0.0,
        "bus_time_share": c.bytes * wire.byte_ns / wire.span_ns if clocked else None,
        "rate_hz": c.requests * NS / wire.span_ns if clocked else None,
        "period_ns": quantiles(c.periods.period),
        "longest_period": _longest(c.loop),
        "jitter_ns": quantiles(c.periods.jitter),
        "loop": _loop(c.loop),
        "response_time_ns": quantiles(c.replies.times),
        "slowest": _slowest(c.replies.slowest),
        "asked": c.asked,
        "ok": c.ok,
        "missing": c.missing,
        "missing_share": c.missing_share if shared else None,
        "missing_interval": list(wilson(c.missing, c.asked)) if c.asked and shared else None,
        "damaged": c.damaged,
        "failed": c.failed,
        "unasked": c.unasked,
        "retries": c.retries,
    }


def _slowest(answer: Slowest | None) -> dict[str, Any] | None:
    if answer is None:
        return None
    return {"value": answer.ns, "t_ns": answer.t_ns, "offset": answer.offset}


def _longest(loop: Loop | None) -> dict[str, Any] | None:
    if loop is None:
        return None
    return {"value_ns": list(loop.longest.bounds), "t_ns": loop.longest.t_ns}


def _loop(loop: Loop | None) -> dict[str, Any] | None:
    if loop is None or loop.periods is None:
        return None
    return {
        "address": loop.address if loop.address >= 0 else None,
        "requests": loop.requests,
        "offset": loop.offset,
        "period_ns": quantiles(loop.periods.period),
        "jitter_ns": quantiles(loop.periods.jitter),
    }


def quantiles(q: Quantiles, per: int = 1) -> dict[str, Any] | None:
    """Return count and figures of many numbers, each an interval; None: there are none."""
    out: dict[str, Any] = {"count": q.count}
    for name, share in SHARES.items():
        bounds = q.figure(share)
        if bounds is None:
            return None
        out[name] = list(bounds) if per == 1 else [bound / per for bound in bounds]
    return out


def _servo(protocol: str, servo: int, mine: ServoFigures, lane: LaneFigures) -> dict[str, Any]:
    motion = lane.motion
    steps, starts = motion.steps.figures(), motion.starts.figures()
    return {
        "protocol": protocol,
        "servo_id": servo,
        "responses": mine.responses,
        **_presence(mine.presence),
        "goals": dict(sorted(mine.goals.items())),
        "values": [
            {
                "quantity": quantity,
                "unit": unit,
                "count": r.count,
                "min": _extreme(r.least),
                "max": _extreme(r.most),
            }
            for (quantity, unit), r in sorted(mine.values.items())
        ],
        "following_error": [
            _error(unit, e, motion.lags.of(servo, unit))
            for (who, unit), e in motion.errors.items()
            if who == servo
        ],
        "steps": [_steps(unit, s) for (who, unit), s in steps.items() if who == servo],
        "first_motion": [_start(unit, s) for (who, unit), s in starts.items() if who == servo],
    }


def _presence(mine: Presence | None) -> dict[str, Any]:
    if mine is None:
        return dict.fromkeys(("first_answer", "last_answer", "longest_pause"))
    ends = {"first_answer": mine.first, "last_answer": mine.last}
    return {
        **{name: {"t_ns": end.t_ns, "offset": end.offset} for name, end in ends.items()},
        "longest_pause": _pause(mine.pause),
    }


def _pause(pause: PauseHeard | None) -> dict[str, Any] | None:
    if pause is None:
        return None
    behind = pause.behind
    return {"value_ns": list(pause.bounds), "t_ns": behind.t_ns, "offset": behind.offset}


def _extreme(end: Extreme | None) -> dict[str, Any] | None:
    if end is None:
        return None
    return {"value": round(end.value, 9), "t_ns": end.t_ns, "offset": end.offset}


def _error(unit: str, e: ErrorFigures, lag: Lag | None) -> dict[str, Any]:
    return {
        "unit": unit,
        "size": quantiles(e.size, MILLI),
        "worst": _extreme(e.worst),
        "lag": _lag(lag),
    }


def _lag(lag: Lag | None) -> dict[str, Any] | None:
    if lag is None:
        return None
    return {
        "ns": [lag.low_ns, lag.high_ns],
        "count": lag.count,
        "rms": round(lag.rms, 6),
        "rms_unshifted": round(lag.rms_unshifted, 6),
    }


def _steps(unit: str, s: StepFigures) -> dict[str, Any]:
    return {
        "unit": unit,
        "count": s.steps,
        "fates": dict(sorted(s.fates.items())),
        "settle_ns": quantiles(s.settle),
        "overshoot_percent": quantiles(s.overshoot, MILLI),
        "worst_overshoot": _extreme(s.worst),
        "unreached": s.unreached_count,
        "unreached_goals": [_unreached(goal) for goal in s.unreached],
    }


def _unreached(goal: Unreached) -> dict[str, Any]:
    return {
        "goal": _extreme(goal.goal),
        "start": round(goal.start, 9),
        "left": _extreme(goal.left),
        "stands": goal.stands,
        "held_ns": goal.held_ns,
        "ended": goal.ended,
    }


def _start(unit: str, s: StartFigures) -> dict[str, Any]:
    return {
        "unit": unit,
        "told": s.told,
        "moved": s.moved,
        "recalled": s.recalled,
        "ns": quantiles(s.times),
        "slowest": _slowest_start(s.slowest),
    }


def _slowest_start(start: SlowestStart | None) -> dict[str, Any] | None:
    if start is None:
        return None
    return {"value_ns": list(start.bounds), "t_ns": start.t_ns, "offset": start.offset}


def _trouble(
    lane: LaneNumbers, t: TroubleFigures, told: Statistics, wire: WireBytes, *, clocked: bool
) -> dict[str, Any]:
    over = profile(told.collector.grid, t.curve)
    return {
        "protocol": lane.protocol.name,
        "code": t.code,
        "severity": t.severity.name.lower(),
        "servo_id": t.servo_id if t.servo_id >= 0 else None,
        "count": t.count,
        "rate_hz": t.count * NS / wire.span_ns if clocked else None,
        "first_ns": t.first_ns,
        "last_ns": t.last_ns,
        "t_ns": t.times,
        "offsets": t.offsets,
        "over_time": {
            "first_ns": over.first_ns,
            "slice_ns": over.width_ns,
            "counts": [round(n) for n in over.sums],
        },
    }


def _alarm(e: ExceedingFigures) -> dict[str, Any]:
    return {
        "rule": e.rule,
        "servo_id": e.servo_id,
        "unit": e.unit,
        "values": e.count,
        "met": e.met,
        "times": e.spans,
        "met_ns": [e.least_ns, e.most_ns],
        "heard_ns": e.heard_ns,
        "first": _extreme(e.first),
        "last": _extreme(e.last),
        "worst": _extreme(e.worst),
    }
