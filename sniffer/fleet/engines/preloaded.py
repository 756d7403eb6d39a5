"""What workers of this machine find loaded; loaded by the process that they are forked from."""

from __future__ import annotations

from sniffer.ground.arrow import leave_pandas_out, process_is_ours

process_is_ours()
leave_pandas_out()

# each of these gives pyarrow something
import pyarrow.parquet  # noqa: E402, F401

import sniffer.fleet.task  # noqa: E402, F401
