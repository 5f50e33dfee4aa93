"""One thread for the small matrices of the linear algebra library."""

from __future__ import annotations

from functools import cache

from threadpoolctl import ThreadpoolController

from gpvo.process_setting import ProcessSetting


@cache
def _controller() -> ThreadpoolController:
    """Made once numpy and scipy have loaded their libraries; looking for them takes a while."""
    return ThreadpoolController()


one_blas_thread = ProcessSetting(lambda: _controller().limit(limits=1, user_api="blas"))
"""Keep BLAS on one thread: the matrices are small, and several threads wait for each other."""
