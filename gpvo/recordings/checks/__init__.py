"""Checks of recordings: columns, time order, clocks, sensor size."""
