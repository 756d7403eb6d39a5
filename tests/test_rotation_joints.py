"""Joint states of a recording in several files: as if it were one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import sniffer
from sniffer.ground.model import Chunk, Clock
from sniffer.mcapfile.ros2 import JOINTS
from tests.recordings import START_NS
from tests.test_ros2 import read_by_others, stamped
from tests.test_rotation import BUSES, ROUND_NS, ask, record, spoken

if TYPE_CHECKING:
    from pathlib import Path


def test_stamps_of_joints_do_not_go_back_where_a_file_begins(tmp_path: Path) -> None:
    """Bytes that were read late, and all at once, are timed back over those before them."""
    late = []
    for number, group in enumerate(spoken()):
        read = START_NS + number * ROUND_NS // 9
        said = {bus: b"".join(c.data for c in group if c.bus == bus) for bus in BUSES}
        late.append([Chunk(data, read, Clock.READ, bus) for bus, data in said.items() if data])
    file = record(tmp_path / "run.mcap", late, ask, joints=())
    assert len(file.files) >= 3
    again = tmp_path / "again.mcap"
    sniffer.convert(file.files, [again], contents=sniffer.Contents(None, []))
    states = {path: read_by_others(path, JOINTS)[JOINTS] for path in (*file.files, again)}
    found = [one for path in file.files for one in states[path]]
    assert len(found) > 40
    assert sorted(map(repr, found)) == sorted(map(repr, states[again]))
    for name in {state.name[0] for state in found}:
        times = [time for time, _ in stamped(found, name)]
        assert times == sorted(times), name
