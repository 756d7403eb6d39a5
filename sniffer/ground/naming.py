"""What the command line calls the arguments of library calls: sentences are written once.

The rows of a data set say it so, too: whoever reads them has no call before him.
"""

from __future__ import annotations

from typing import Final

from sniffer.ground.wording import spelled

_OPTIONS: Final = {
    "around_ns": "--around",
    "buses": "--bus",
    "channels": "--channel NAME",
    "codes": "--code",
    "dataset": "-o",
    "every_ns": "--every",
    "faults": "--fault",
    "joints": "--ros2",
    "kinds": "--kind",
    "links": "--link",
    "latency_ns": "--latency",
    "models": "--model",
    "offsets": "--offset",
    "ops": "--op",
    "overwrite": "--force",
    "recording": "-o",
    "rate_hz": "--rate",
    "role": "--as",
    "rotate_bytes": "--rotate",
    "rotate_ns": "--rotate",
    "seconds": "--duration",
    "servos": "--servo",
    "start": "--from",
    "start_b": "--from-b",
    "stop": "--to",
    "stop_b": "--to-b",
    "tables": "--registers",
    "tap=False": "--no-tap",
    "transmit": "--yes-transmit",
    "view=connect": "--rerun-connect URL",
    "view=web": "--web",
    "view=window": "--rerun",
}
"""Options whose name is not that of the argument they become, alone or with one value."""

_FLAGS: Final = ("True", "")
"""What an option is set to that only stands there."""


def worded(told: object) -> str:
    """Return what a library call says, a text or an error: options where it has arguments."""
    return spelled(told, _option)


def _option(names: tuple[str, ...], value: str) -> str:
    options = dict.fromkeys(_named(name, value) for name in names)
    return " or ".join(options)


def _named(name: str, value: str) -> str:
    if (whole := _OPTIONS.get(f"{name}={value}")) is not None:
        return whole
    option = _OPTIONS.get(name, "--" + name.replace("_", "-"))
    return option if value in _FLAGS else f"{option} {value}"
