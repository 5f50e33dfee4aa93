"""Formats that are not bags: HDF5 of several kinds, AEDAT4, Prophesee raw, text."""
