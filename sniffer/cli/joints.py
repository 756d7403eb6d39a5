"""``--ros2`` and ``--joints``: what ROS 2 understands, in the commands that write recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sniffer.cli.options import Command, gathered

if TYPE_CHECKING:
    from sniffer.mcapfile.joints import RosJoint

_ROS2 = (
    click.option(
        "--ros2", is_flag=True,
        help="An .mcap has /joint_states (sensor_msgs) and /diagnostics (diagnostic_msgs), too.",
    ),
    click.option(
        "--joints", "joints_file", type=click.Path(path_type=Path), metavar="FILE.toml",
        help="With --ros2: which servos are which joints, and how they become radians or metres.",
    ),
)  # fmt: skip


def with_ros2(command: Command) -> Command:
    """Add these options; ``joints`` is what they say, None without ``--ros2``."""
    return gathered(command, _ROS2, _joints)


def _joints(given: dict[str, Any]) -> dict[str, Any]:
    wanted, file = given.pop("ros2"), given.pop("joints_file")
    joints: tuple[RosJoint, ...] | None = () if wanted else None
    if file is not None:
        if not wanted:
            raise click.UsageError("--joints goes with --ros2")
        from sniffer.mcapfile.joints import read_joints

        joints = read_joints(file)
    return {**given, "joints": joints}
