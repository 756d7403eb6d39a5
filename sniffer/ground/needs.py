"""Libraries for plots, tables, queries, a look inside: what a tap lacks is said."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Final

from sniffer.ground.arrow import leave_pandas_out
from sniffer.ground.model import OutputError

_RERUN: Final = {
    "rerun": ("RecordingStream", "SeriesLines", "SeriesPoints", "StateChange", "TimeColumn"),
    "rerun.blueprint": ("Blueprint", "StateTimelineView", "TimeAxis", "TimeSeriesView"),
}
"""What is drawn with, of what came last or moved: Rerun's API changes with every minor version."""

KNOWN_RERUN: Final = "0.41"
"""The version of Rerun that was tried."""


def need_rerun() -> None:
    """Do nothing where the Rerun SDK can draw.

    Raises:
        OutputError: it is not installed, or not as known here.
    """
    try:
        modules = {name: importlib.import_module(name) for name in _RERUN}
        leave_pandas_out()
    except ImportError as error:
        raise _missing("plots need the Rerun SDK", "rerun-sdk", error) from None
    gone = [f"{m}.{n}" for m, names in _RERUN.items() for n in names if not hasattr(modules[m], n)]
    if gone:
        version = getattr(modules["rerun"], "__version__", "?")
        raise OutputError(
            f"the Rerun SDK {version} has no {gone[0]}: {KNOWN_RERUN} is known to do; "
            f"`pip install 'rerun-sdk=={KNOWN_RERUN}.*'`"
        )


def need_pyarrow() -> None:
    """Load pyarrow where tables can be made.

    Raises:
        OutputError: pyarrow is not installed.
    """
    try:
        leave_pandas_out()
    except ImportError as error:
        raise _missing("tables (.parquet, .csv) need pyarrow", "pyarrow", error) from None


def need_textual() -> None:
    """Do nothing where a capture can be looked into on a terminal.

    Raises:
        OutputError: Textual is not installed.
    """
    try:
        found = importlib.util.find_spec("textual")  # loading it takes a while
        if found is None:
            raise ModuleNotFoundError("No module named 'textual'")
    except ImportError as error:
        raise _missing("looking inside needs Textual", "textual", error) from None


def need_duckdb() -> None:
    """Do nothing where SQL can be answered.

    Raises:
        OutputError: DuckDB is not installed.
    """
    try:
        importlib.import_module("duckdb")
    except ImportError as error:
        raise _missing("queries need DuckDB", "'servo-sniffer[query]'", error) from None


def need_dask() -> None:
    """Do nothing where captures can be decoded on a Dask cluster.

    Raises:
        OutputError: Dask's scheduler is not installed.
    """
    try:
        importlib.import_module("distributed")
    except ImportError as error:
        raise _missing("fleets on Dask need distributed", "'servo-sniffer[fleet]'", error) from None


def need_ray() -> None:
    """Do nothing where captures can be decoded on a Ray cluster.

    Raises:
        OutputError: Ray is not installed.
    """
    try:
        importlib.import_module("ray")
    except ImportError as error:
        raise _missing("fleets on Ray need ray", "'servo-sniffer[ray]'", error) from None


def need_deltalake() -> None:
    """Do nothing where Delta tables can be written.

    Raises:
        OutputError: it is not installed.
    """
    try:
        importlib.import_module("deltalake")
    except ImportError as error:
        raise _missing("Delta tables need deltalake", "'servo-sniffer[delta]'", error) from None


def need_foxglove() -> None:
    """Do nothing where a recording can be shown in Foxglove; another process loads the library.

    Raises:
        OutputError: the Foxglove SDK is not installed.
    """
    if importlib.util.find_spec("foxglove") is None:
        error = ModuleNotFoundError("No module named 'foxglove'")
        raise _missing("Foxglove live needs its SDK", "'servo-sniffer[foxglove]'", error)


def _missing(what: str, package: str, error: ImportError) -> OutputError:
    return OutputError(f"{what}, which cannot be loaded ({error}): `pip install {package}`")
