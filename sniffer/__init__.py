"""Analyzer for robot-servo buses: decodes, checks, records and plots what is said on the wire."""

from __future__ import annotations

__version__ = "0.3.0"

TYPE_CHECKING = False  # of typing, which alone takes longer to load than all that is done here
if TYPE_CHECKING:
    from typing import Any, Final

    from sniffer.decoding.decoder import Decoder
    from sniffer.decoding.pipeline import Options
    from sniffer.decoding.rows import AnomalyRow, FrameRow, GapRow, SampleRow, TransactionRow
    from sniffer.doctor.examine import Examined, examine
    from sniffer.doctor.records import Level, Observation
    from sniffer.fleet.compact import CompactedFleet, compact_fleet
    from sniffer.fleet.delta import register_delta
    from sniffer.fleet.progress import FleetProgress
    from sniffer.fleet.run import FleetRun, decode_fleet
    from sniffer.ground.codes import Kind, Outcome, Provenance, Reply, Role
    from sniffer.ground.model import (
        Anomaly,
        Batch,
        Chunk,
        Clock,
        DamagedInputError,
        Direction,
        Frames,
        Gap,
        InputError,
        OutputError,
        Samples,
        Severity,
        SnifferError,
        Transactions,
    )
    from sniffer.jobs.api import Capture, decode, frames_table, records, samples_table
    from sniffer.jobs.batches import read_batches
    from sniffer.jobs.check import Checked, check
    from sniffer.jobs.convert import Converted, convert
    from sniffer.jobs.cut import cut
    from sniffer.jobs.diagnose import Diagnosed, diagnose
    from sniffer.jobs.diff import Compared, diff
    from sniffer.jobs.discover import Discovered, discover
    from sniffer.jobs.files import Files, Flight
    from sniffer.jobs.held import HeldRegisters, registers_held
    from sniffer.jobs.like import scenario_like
    from sniffer.jobs.merge import merge
    from sniffer.jobs.outputs import Contents, Wide
    from sniffer.jobs.playback import PlayedBack, PlayedPorts, PlayedRole, play_back
    from sniffer.jobs.query import Answer, query
    from sniffer.jobs.record import Recorded, Shown, record
    from sniffer.jobs.replay import replay
    from sniffer.jobs.report import Reported, report
    from sniffer.jobs.session import Ending
    from sniffer.jobs.split import SplitPiece, split
    from sniffer.jobs.stats import Tallied, stats
    from sniffer.mcapfile.joints import RosJoint
    from sniffer.protocols import PROTOCOLS
    from sniffer.selection.places import Window
    from sniffer.selection.selection import Selection
    from sniffer.simulation.play.run import Played, play
    from sniffer.simulation.play.scenario import Scenario
    from sniffer.tap.listen import Listening
    from sniffer.tap.stops import Stops
    from sniffer.tap.tap import PortSpec

__all__ = [
    "PROTOCOLS",
    "Anomaly",
    "AnomalyRow",
    "Answer",
    "Batch",
    "Capture",
    "Checked",
    "Chunk",
    "Clock",
    "CompactedFleet",
    "Compared",
    "Contents",
    "Converted",
    "DamagedInputError",
    "Decoder",
    "Diagnosed",
    "Direction",
    "Discovered",
    "Ending",
    "Examined",
    "Files",
    "FleetProgress",
    "FleetRun",
    "Flight",
    "FrameRow",
    "Frames",
    "Gap",
    "GapRow",
    "HeldRegisters",
    "InputError",
    "Kind",
    "Level",
    "Listening",
    "Observation",
    "Options",
    "Outcome",
    "OutputError",
    "Played",
    "PlayedBack",
    "PlayedPorts",
    "PlayedRole",
    "PortSpec",
    "Provenance",
    "Recorded",
    "Reply",
    "Reported",
    "Role",
    "RosJoint",
    "SampleRow",
    "Samples",
    "Scenario",
    "Selection",
    "Severity",
    "Shown",
    "SnifferError",
    "SplitPiece",
    "Stops",
    "Tallied",
    "TransactionRow",
    "Transactions",
    "Wide",
    "Window",
    "__version__",
    "check",
    "compact_fleet",
    "convert",
    "cut",
    "decode",
    "decode_fleet",
    "diagnose",
    "diff",
    "discover",
    "examine",
    "frames_table",
    "merge",
    "play",
    "play_back",
    "query",
    "read_batches",
    "record",
    "records",
    "register_delta",
    "registers_held",
    "replay",
    "report",
    "samples_table",
    "scenario_like",
    "split",
    "stats",
]

_ROOMS: Final = {
    "ground.codes": ("Kind", "Outcome", "Provenance", "Reply", "Role"),
    "fleet.compact": ("CompactedFleet", "compact_fleet"),
    "fleet.delta": ("register_delta",),
    "fleet.progress": ("FleetProgress",),
    "fleet.run": ("FleetRun", "decode_fleet"),
    "jobs.batches": ("read_batches",),
    "jobs.check": ("Checked", "check"),
    "jobs.convert": ("Converted", "convert"),
    "jobs.cut": ("cut",),
    "jobs.diff": ("Compared", "diff"),
    "jobs.merge": ("merge",),
    "jobs.outputs": ("Contents", "Wide"),
    "jobs.like": ("scenario_like",),
    "jobs.playback": ("PlayedBack", "PlayedPorts", "PlayedRole", "play_back"),
    "jobs.diagnose": ("Diagnosed", "diagnose"),
    "jobs.replay": ("replay",),
    "selection.places": ("Window",),
    "selection.selection": ("Selection",),
    "jobs.query": ("Answer", "query"),
    "jobs.discover": ("Discovered", "discover"),
    "jobs.held": ("HeldRegisters", "registers_held"),
    "jobs.report": ("Reported", "report"),
    "jobs.session": ("Ending",),
    "jobs.split": ("SplitPiece", "split"),
    "jobs.stats": ("Tallied", "stats"),
    "jobs.files": ("Files", "Flight"),
    "jobs.record": ("Recorded", "Shown", "record"),
    "doctor.examine": ("Examined", "examine"),
    "doctor.records": ("Observation", "Level"),
    "simulation.play.run": ("Played", "play"),
    "simulation.play.scenario": ("Scenario",),
    "tap.listen": ("Listening",),
    "tap.stops": ("Stops",),
    "tap.tap": ("PortSpec",),
    "jobs.api": ("Capture", "decode", "frames_table", "records", "samples_table"),
    "decoding.decoder": ("Decoder",),
    "decoding.pipeline": ("Options",),
    "mcapfile.joints": ("RosJoint",),
    "ground.model": (
        *("Anomaly", "Batch", "Chunk", "Clock", "DamagedInputError", "Direction", "Frames", "Gap"),
        *("InputError", "OutputError", "Samples", "Severity", "SnifferError", "Transactions"),
    ),
    "protocols": ("PROTOCOLS",),
    "decoding.rows": ("AnomalyRow", "FrameRow", "GapRow", "SampleRow", "TransactionRow"),
}
"""Where each public name is at home: it is loaded when it is first asked for, so that the command
line answers Ctrl-C from its first moment."""

_HOMES: Final = {name: room for room, names in _ROOMS.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load a public name."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import importlib

    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the names that are there, loaded or not."""
    return sorted({*globals(), *__all__})
