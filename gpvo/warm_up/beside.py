"""A second process that compiles the estimator while this one compiles the front end."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from factors.structureless.states_between_kernels import state_rows_kernel


class CompileBeside:
    """Compiles the estimator in a second process, unless it is compiled already.

    Both processes keep what they compiled in numba's cache, and each takes from there what the
    other one has compiled before. It changes no result, and is left out on a single processor.

    >>> with CompileBeside() as beside:
    ...     beside.start()
    """

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Begin, unless it was begun."""
        if self._process is None and (os.cpu_count() or 1) > 1 and not _is_compiled():
            self._process = subprocess.Popen(
                [sys.executable, "-m", "gpvo.warm_up"],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )

    def __enter__(self) -> CompileBeside:
        return self

    def __exit__(self, *error: object) -> None:
        """End it: nobody needs what is not compiled by now."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()


def _is_compiled() -> bool:
    """Whether numba's cache has one of the estimator's last kernels."""
    kernel = state_rows_kernel
    module = kernel.py_func.__module__.rpartition(".")[2]
    name = f"{module}.{kernel.py_func.__qualname__}"
    return any(Path(kernel.stats.cache_path).glob(f"{name}-*.nbi"))
