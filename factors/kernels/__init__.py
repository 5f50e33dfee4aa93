"""Compiled kernels that all factors share."""
