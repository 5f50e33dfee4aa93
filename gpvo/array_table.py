"""Base of tables of arrays: events, features, measurements and states."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Table = TypeVar("Table", bound="ArrayTable")


class ArrayTable:
    """Base of dataclasses whose fields are arrays (N, ...) of the same N, or None."""

    def __len__(self) -> int:
        return len(getattr(self, fields(self)[0].name))  # type: ignore[arg-type]

    def __getitem__(self: Table, index: slice | NDArray[Any]) -> Table:
        columns = (getattr(self, field.name) for field in fields(self))  # type: ignore[arg-type]
        return type(self)(*(None if column is None else column[index] for column in columns))

    @classmethod
    def concatenate(cls: type[Table], parts: Iterable[Table]) -> Table:
        """Join tables in the given order; at least one is needed."""
        tables = list(parts)
        names = [field.name for field in fields(cls)]  # type: ignore[arg-type]
        return cls(*(np.concatenate([getattr(table, name) for table in tables]) for name in names))
