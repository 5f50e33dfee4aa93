"""Compiling before it is needed, and in two processes at once: numba compiles one at a time."""

from gpvo.warm_up.beside import CompileBeside
from gpvo.warm_up.whole import warm_up

__all__ = ["CompileBeside", "warm_up"]
