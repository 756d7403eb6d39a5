"""Records that are many: a frozen dataclass of numpy arrays a kind, one row a record."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Final, Self

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

_DTYPES: Final[Mapping[str, type[np.generic]]] = {
    "I64": np.int64,
    "I16": np.int16,
    "U8": np.uint8,
    "F64": np.float64,
    "Mask": np.bool_,
}
"""Types of columns by the names that ``model`` has for them."""

_NAMES: Final[dict[Any, tuple[str, ...]]] = {}
_EMPTY: Final[dict[Any, Any]] = {}


def column_names(kind: type[Columns]) -> tuple[str, ...]:
    """Return the columns of a kind of record; asking the dataclass for them takes a while."""
    if kind not in _NAMES:
        _NAMES[kind] = tuple(f.name for f in fields(kind))
    return _NAMES[kind]


@dataclass(frozen=True, slots=True)
class Columns:
    """Base of the column records: rows are counted, taken and joined, nothing else."""

    def __len__(self) -> int:
        return len(getattr(self, column_names(type(self))[0]))

    def take(self, index: Any) -> Self:
        """Return the rows that ``index`` (a slice, a mask or row numbers) selects."""
        return type(self)(*[getattr(self, name)[index] for name in column_names(type(self))])

    def having(self, **columns: npt.NDArray[Any]) -> Self:
        """Return the rows with these columns in place of their own, each in its column's type."""
        kept = {name: getattr(self, name) for name in column_names(type(self))}
        cast = {name: a.astype(kept[name].dtype, copy=False) for name, a in columns.items()}
        return type(self)(**kept | cast)

    @classmethod
    def concat(cls, parts: Sequence[Self]) -> Self:
        """Join records of one kind; ``parts`` must not be empty."""
        return cls(
            *(np.concatenate([getattr(p, name) for p in parts]) for name in column_names(cls))
        )

    @classmethod
    def empty(cls) -> Self:
        """Return no rows, with every column of its own type."""
        if cls not in _EMPTY:  # there is nothing in it that could change
            _EMPTY[cls] = cls(*(np.empty(0, _DTYPES[str(f.type)]) for f in fields(cls)))
        none: Self = _EMPTY[cls]
        return none
