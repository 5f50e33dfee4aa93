"""Base of tables of arrays: events, features, measurements and states."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import Field
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

Table = TypeVar("Table", bound="ArrayTable")


class ArrayTable:
    """Base of dataclasses whose fields are arrays (N, ...) or tables of the same N, or None."""

    # By name; `dataclasses.fields` takes longer than a short array.
    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    def __len__(self) -> int:
        return len(getattr(self, next(iter(self.__dataclass_fields__))))

    def __getitem__(self: Table, index: slice | NDArray[Any]) -> Table:
        columns = (getattr(self, name) for name in self.__dataclass_fields__)
        return type(self)(*(None if column is None else column[index] for column in columns))

    @classmethod
    def concatenate(cls: type[Table], parts: Iterable[Table]) -> Table:
        """Join tables in the given order; at least one is needed."""
        tables, names = list(parts), cls.__dataclass_fields__
        return cls(*(_joined([getattr(table, name) for table in tables]) for name in names))


def _joined(columns: list[Any]) -> Any:
    """Join arrays, or tables."""
    first = columns[0]
    return first.concatenate(columns) if isinstance(first, ArrayTable) else np.concatenate(columns)
