"""Which servo is which joint of a robot, and how its values become radians or metres."""

from __future__ import annotations

import contextlib
import json
import math
import tomllib
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any, Final

from sniffer.ground.limits import IDS
from sniffer.ground.model import SnifferError
from sniffer.ground.toml import text_of
from sniffer.ground.wording import offered, short

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

SI: Final[Mapping[str, float]] = {"deg": math.pi / 180, "mm": 1e-3, "deg_per_s": math.pi / 180}
"""What a unit is in rad, m or rad/s (REP 103), by how it ends the name of a field."""

BUS: Final = "bus0"
"""The bus of a joint where none is named: that of captures with one bus."""


@dataclass(frozen=True, slots=True)
class RosJoint:
    """A joint: ``sign`` times value times ``scale``, plus ``offset``, is its place in rad or m.

    ``quantity`` is a field of a servo's state, such as ``position_mm``, empty for the position as
    it is measured. ``scale`` is rad or m a unit of it, None where the unit says that.
    """

    bus: str
    servo: int
    name: str
    quantity: str = ""
    scale: float | None = None
    offset: float = 0.0
    sign: int = 1


_PLAIN: Final[Mapping[str, Any]] = {f.name: f.default for f in fields(RosJoint)}
"""What is not said of a joint where it is so."""

FACT: Final = "joints"
"""The fact of a recording that has the topics of ROS 2: with which joints they were made."""

_KEYS: Final = tuple(_PLAIN)


def read_joints(path: Path) -> tuple[RosJoint, ...]:
    """Return what a file says: a table ``[[joint]]`` for each, with the fields of ``RosJoint``.

    Raises:
        SnifferError: it cannot be read, or says what cannot be meant.
    """
    try:
        told = tomllib.loads(text_of(path, "names of joints are"))
    except tomllib.TOMLDecodeError as error:
        raise SnifferError(f"{path} is no TOML: {error}") from None
    tables = told.pop("joint", None)
    if told or not isinstance(tables, list) or not all(isinstance(t, dict) for t in tables):
        raise SnifferError(f"{path}: write a table [[joint]] for each joint, and nothing else")
    joints = tuple(_joint(table, f"{path}: joint {n}") for n, table in enumerate(tables, 1))
    for n, joint in enumerate(joints):
        for other in joints[:n]:
            if (joint.bus, joint.servo) == (other.bus, other.servo):
                who = f"servo {joint.servo} of {joint.bus}"
                raise SnifferError(f"{path}: {who} is both {other.name} and {joint.name}")
            if joint.name == other.name:
                raise SnifferError(f"{path}: two joints are called {joint.name}")
    return joints


def _joint(table: dict[str, Any], place: str) -> RosJoint:
    for key in table:
        if key not in _KEYS:
            raise SnifferError(f"{place}: there is no key {short(key)!r}: {offered(key, _KEYS)}")
    for key in ("servo", "name"):
        if key not in table:
            raise SnifferError(f"{place} has no {key}")

    def text(key: str, otherwise: str = "") -> str:
        told = table.get(key, otherwise)
        if not isinstance(told, str) or (key in table and not told) or not told.isprintable():
            raise SnifferError(f"{place}: {key} = {told!r}: it must be a text")
        return told

    def number(key: str, otherwise: float) -> float:
        told = table.get(key, otherwise)
        if isinstance(told, bool) or not isinstance(told, int | float) or not math.isfinite(told):
            raise SnifferError(f"{place}: {key} = {told!r}: it must be a number")
        return float(told)

    servo, sign = table["servo"], table.get("sign", 1)
    if isinstance(servo, bool) or not isinstance(servo, int) or not 0 <= servo < IDS:
        raise SnifferError(f"{place}: servo = {servo!r}: it must be an id of 0..{IDS - 1}")
    if isinstance(sign, bool) or sign not in (1, -1):
        raise SnifferError(f"{place}: sign = {sign!r}: it must be 1 or -1")
    scale = number("scale", 1.0) if "scale" in table else None
    if scale == 0:
        raise SnifferError(f"{place}: scale = 0: every place would be the same")
    return RosJoint(
        text("bus", BUS),
        servo,
        text("name"),
        text("quantity"),
        scale,
        number("offset", 0.0),
        int(sign),
    )


def joint_facts(joints: Iterable[RosJoint]) -> dict[str, str]:
    """Return what a recording says of its joints, in JSON; of none where all servos may be some."""
    told = [{k: v for k, v in asdict(joint).items() if v != _PLAIN.get(k)} for joint in joints]
    return {FACT: json.dumps(told)}


def joints_in(facts: Mapping[str, str]) -> tuple[RosJoint, ...] | None:
    """Return the joints that a recording was made with; None: it has none of ROS 2, or nonsense."""
    with contextlib.suppress(ValueError, SnifferError):
        told = json.loads(facts.get(FACT, ""))
        if isinstance(told, list) and all(isinstance(one, dict) for one in told):
            return tuple(_joint(one, FACT) for one in told)
    return None
