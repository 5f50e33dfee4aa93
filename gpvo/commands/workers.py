"""Work spread over processes of this machine, or over the workers of a Dask cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from multiprocessing import get_context
from typing import Any, TypeVar

from gpvo.errors import InputError

T = TypeVar("T")


def processes(jobs: int) -> Executor:
    """Make an executor of processes that begin with nothing of this one."""
    return ProcessPoolExecutor(jobs, get_context("spawn"))


def in_order(
    call: Callable[..., T],
    tasks: Sequence[tuple[Any, ...]],
    jobs: int,
    scheduler: str | None,
    pool: Callable[[int], Executor] = processes,
) -> Iterator[T]:
    """Yield call(*task) of each task, in their order, as soon as it is known.

    Up to `jobs` are made at once, or those that the cluster of the scheduler has workers for; one
    job without a scheduler is made here. A task whose worker dies is made again by another one.

    Raises
    ------
    InputError
        If the cluster cannot be reached.
    """
    if jobs == 1 and scheduler is None:
        yield from (call(*task) for task in tasks)
        return
    with _executor(jobs, scheduler, pool) as executor:
        futures = [executor.submit(call, *task) for task in tasks]
        try:
            for future in futures:
                yield future.result()
        finally:
            for future in futures:
                future.cancel()


@contextmanager
def _executor(
    jobs: int, scheduler: str | None, pool: Callable[[int], Executor]
) -> Iterator[Executor]:
    if scheduler is None:
        with pool(jobs) as executor:
            yield executor
        return
    with _client(scheduler) as client, client.get_executor(pure=False) as executor:
        yield executor


def _client(scheduler: str) -> AbstractContextManager[Any]:
    """Connect to a Dask scheduler."""
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError('--scheduler needs Dask: pip install "gpvo[distributed]"') from error
    try:
        client: AbstractContextManager[Any] = Client(scheduler, timeout=10)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {scheduler}: cannot be reached ({error})") from error
    return client
