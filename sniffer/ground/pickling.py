"""Records on their way to a file, or to another process: pickled, with the views that they hold."""

from __future__ import annotations

import pickle
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from typing import BinaryIO


def write_pickle(value: object, file: BinaryIO) -> None:
    """Pickle a value to a file; mappings that nobody can change are pickled, too."""
    _RecordPickler(file, pickle.HIGHEST_PROTOCOL).dump(value)


class _RecordPickler(pickle.Pickler):
    def reducer_override(self, value: object) -> Any:
        if isinstance(value, MappingProxyType):
            return _unchanging, (dict(value),)
        return NotImplemented


def _unchanging(value: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(value)
