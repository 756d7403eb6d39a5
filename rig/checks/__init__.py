"""What is tried, in this order: ports that are silent, talk, are held, are pulled, and lie."""

from __future__ import annotations

from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from rig.checks.errors import errors
from rig.checks.hearing import every_byte, listed, stopped
from rig.checks.holding import held, permissions
from rig.checks.opening import echo, prepared, silence
from rig.checks.plugging import plugging, rule
from rig.checks.rates import rates
from rig.checks.unit import unit

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rig.machine import Machine
    from rig.report import Report

    Check = Callable[[Machine, Report], None]

CHECKS: Final[Mapping[str, Check]] = MappingProxyType(
    {
        "ports": listed,
        "echo": echo,
        "prepared": prepared,
        "silence": silence,
        "bytes": every_byte,
        "rates": rates,
        "held": held,
        "permissions": permissions,
        "rule": rule,
        "plugging": plugging,
        "errors": errors,
        "stopped": stopped,
    }
)
"""One boot serves all of them."""

UNDER_SYSTEMD: Final[Mapping[str, Check]] = MappingProxyType({"unit": unit})
"""Wants all of Debian: a boot of its own, and only if it is named."""
