"""Compiling before it is needed, and in two processes at once: numba compiles one at a time."""
