"""The benchmark of the factors, its cheapest part."""

from __future__ import annotations

from rich.table import Table

from benchmarks.factors import first_order


def test_first_order_derivatives_are_compared_with_exact_ones() -> None:
    table = Table("measured", "here", "wanted")
    first_order(table)
    assert table.row_count == 6
