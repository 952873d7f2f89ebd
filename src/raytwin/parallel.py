"""Apply one function to many things: here, in local processes, or on a Dask cluster."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, TypeVar

from raytwin.errors import InputError, MachineError

T = TypeVar("T")

TRIES = 3
"""A thing is given up once its process has been killed this many times."""
CONNECT = 5
"""Seconds for a scheduler to answer."""


@dataclass(frozen=True)
class Workers:
    """`jobs` local processes (1: this one), or the Dask scheduler at `dask`."""

    jobs: int = 1
    dask: str = ""


class Done(NamedTuple):
    """`thing` and what the function gave, or the error that came of it."""

    thing: Any
    result: Any = None
    error: Exception | None = None


def parse_workers(jobs: int, dask: str) -> Workers:
    """
    >>> parse_workers(4, "")
    Workers(jobs=4, dask='')
    """
    if jobs < 1:
        raise InputError("--jobs", "a number of processes >= 1", jobs)
    if dask and jobs > 1:
        raise InputError("--dask", "a cluster or local processes (--jobs), not both", f"--jobs {jobs}")
    return Workers(jobs, dask)


def map_parallel(function: Callable[[T], Any], things: Sequence[T], workers: Workers) -> Iterator[Done]:
    """What the function gives for each thing, as it is done. An error costs its own thing only.

    Function and things are pickled where other processes take them.
    """
    if workers.dask:
        yield from _on_cluster(function, things, workers.dask)
    elif workers.jobs == 1 or len(things) < 2:
        yield from (_here(function, thing) for thing in things)
    else:
        yield from _in_processes(function, things, workers.jobs)


def _here(function: Callable[[T], Any], thing: T) -> Done:
    try:
        return Done(thing, function(thing))
    except Exception as error:
        return Done(thing, error=error)


def _in_processes(function: Callable[[T], Any], things: Sequence[T], jobs: int) -> Iterator[Done]:
    """Run in a pool of processes. A killed one breaks the pool: what is left is run again, each in its own process."""
    lost = []
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        running = {pool.submit(function, thing): thing for thing in things}
        for future in as_completed(running):
            if isinstance(future.exception(), BrokenProcessPool):
                lost.append(running[future])
            else:
                yield _outcome(running[future], future)
    with ThreadPoolExecutor(jobs) as threads:
        yield from threads.map(partial(_alone, function), lost)


def _alone(function: Callable[[T], Any], thing: T) -> Done:
    """Run one thing in a process of its own: if that is killed `TRIES` times, the thing itself is the cause."""
    for _ in range(TRIES):
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            found = _outcome(thing, pool.submit(function, thing))
            if not isinstance(found.error, BrokenProcessPool):
                return found
    return Done(thing, error=MachineError(thing, "a process that lives", "one that is killed"))


def _outcome(thing: Any, future: "Future[Any]") -> Done:
    error = future.exception()
    return Done(thing, error=error) if isinstance(error, Exception) else Done(thing, future.result())


def _on_cluster(function: Callable[[T], Any], things: Sequence[T], address: str) -> Iterator[Done]:
    """Dask begins again elsewhere what a worker was doing that is lost, `TRIES` times."""
    try:
        from distributed import Client
        from distributed import as_completed as completed
    except ModuleNotFoundError:
        raise MachineError("--dask", "dask.distributed (pip install 'raytwin[cluster]')", "none") from None
    try:
        client = Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise MachineError("--dask", "the address of a Dask scheduler", f"{address} ({error})") from None
    with client:
        # One thing a worker's thread; the result is the caller's to write.
        futures = {client.submit(function, thing, pure=False): thing for thing in things}
        for future in completed(list(futures), loop=client.loop, raise_errors=False):
            wrong = future.exception() if future.status == "error" else None
            if isinstance(wrong, Exception):
                yield Done(futures[future], error=wrong)
            else:
                yield Done(futures[future], future.result())
