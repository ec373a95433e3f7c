"""Work spread over processes by Dask, on this machine or on others; results come as they are done."""

from __future__ import annotations

import functools
import importlib.util
import logging
import os
import pickle
import platform
import queue
import signal
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.cores import cores, own_cores
from pbd_warp.errors import InputError, SimulationFailed
from pbd_warp.quiet import start_warp
from pbd_warp.version import __version__

BATCH_SECONDS = 0.2
"""What a worker is given at a time: long enough that what Dask takes for it (some ms) does not count."""

GROWTH = 8
"""A batch is at most so many times as long as the longest before it: the first items may be the cheap ones."""

DEATHS = 3
"""An item that has killed its worker so often is given up."""

PATIENCE = 30.0
"""For a scheduler to answer, and for the first worker to come [s]."""


@dataclass(frozen=True)
class Lost:
    """In place of the result of an item that has killed its worker DEATHS times."""

    deaths: int


class Pool(Protocol):
    """Runs a function on batches of items.

    dashboard: Address of a page that shows what goes on; empty for none.
    """

    dashboard: str

    def run(
        self, function: Callable[[list[Any]], list[Any]], items: Sequence[Any], tick: Callable[[], object]
    ) -> Iterator[tuple[int, Any]]:
        """The number of an item and its result, in whatever order they are done.

        Args:
            function: Of some items, gives the result of each. It and they are pickled, own code included.
            tick: Called several times a second; what it raises ends the run.
        """


class ThisProcess:
    """No workers: items one after the other, here."""

    dashboard = ""

    def run(
        self, function: Callable[[list[Any]], list[Any]], items: Sequence[Any], tick: Callable[[], object]
    ) -> Iterator[tuple[int, Any]]:
        for number, item in enumerate(items):
            tick()
            yield number, function([item])[0]


class DaskPool:
    """Workers of a Dask cluster.

    Args:
        client: A distributed.Client.
        allowed_failures: Deaths of workers after which its scheduler gives a task up.
        refill: Called where workers are missing: Dask gives up those that take long to come back.
    """

    def __init__(self, client: Any, allowed_failures: int, refill: Callable[[], object] = lambda: None):
        self._client = client
        self._deaths_each = allowed_failures + 1
        self._refill = refill
        self.dashboard: str = client.dashboard_link if _has_bokeh() else ""

    def run(
        self, function: Callable[[list[Any]], list[Any]], items: Sequence[Any], tick: Callable[[], object]
    ) -> Iterator[tuple[int, Any]]:
        import cloudpickle

        code = cloudpickle.dumps(function)
        todo, alone = deque(range(len(items))), deque[int]()
        deaths: Counter[int] = Counter()
        pending: dict[Any, list[int]] = {}
        done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        size, seconds_each, room, counted, trial = 1, 0.0, 0, -np.inf, False
        try:
            while todo or alone or pending:
                if time.monotonic() - counted > 2.0:  # clusters grow and shrink
                    room, counted = 2 * max(1, sum(self._client.nthreads().values())), time.monotonic()
                    self._refill()
                # Who is suspected runs with nothing before, beside or behind it: it alone is blamed then.
                while (todo or alone) and len(pending) < (1 if alone or trial else room):
                    trial = bool(alone)
                    share = max(1, len(todo) // room)
                    count = min(size, share, len(todo))
                    batch = [alone.popleft()] if alone else [todo.popleft() for _ in range(count)]
                    future = self._client.submit(_run, code, [items[number] for number in batch], pure=False)
                    pending[future] = batch
                    future.add_done_callback(done.put)
                tick()
                try:
                    future = done.get(timeout=0.2)
                except queue.Empty:
                    continue
                batch, trial = pending.pop(future), False
                results, seconds = self._result(future)
                if results is not None:
                    yield from zip(batch, results, strict=True)
                    seconds_each = max(seconds / len(batch), 1e-6)
                    size = int(np.clip(BATCH_SECONDS / seconds_each, 1, GROWTH * max(size, len(batch))))
                    continue
                for number in batch:
                    deaths[number] += self._deaths_each
                    if deaths[number] >= DEATHS:
                        yield number, Lost(deaths[number])
                    else:
                        alone.append(number)
        finally:
            for future in pending:
                future.cancel()

    def _result(self, future: Any) -> tuple[list[Any] | None, float]:
        """The results and seconds of a batch; None where it has killed its worker."""
        from distributed import KilledWorker

        try:
            results, seconds = future.result()
            return results, seconds
        except KilledWorker:
            return None, 0.0
        except ModuleNotFoundError as error:
            raise InputError(
                f"the workers cannot import {error.name}, which the work needs: install it there"
            ) from None
        except Exception as error:
            if type(error).__name__ in ("CancelledError", "FutureCancelledError", "CommClosedError"):
                raise SimulationFailed("the Dask scheduler was lost; what is done is kept") from None
            raise


@contextmanager
def open_pool(workers: int | None = None, scheduler: str | None = None) -> Iterator[Pool]:
    """Workers for the body.

    Args:
        workers: Processes on this machine; as many as it has cores unless given.
        scheduler: Address of a Dask scheduler, whose workers then do the work.

    Raises:
        InputError: Dask is not installed; the scheduler does not answer, has no workers, or they have other versions.
    """
    if workers is not None and scheduler is not None:
        raise InputError("--workers are processes of this machine, and --scheduler has its own: give one of the two")
    try:
        import dask
        import distributed
    except ImportError:
        raise InputError("more than one process needs Dask: pip install 'pbd-warp[scale]'") from None
    count = cores() if workers is None else check.whole("workers", workers, low=1)
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    # A task that kills a worker is heard of at once, and no other task waits at that worker.
    own = {"distributed.scheduler.allowed-failures": 0, "distributed.scheduler.worker-saturation": 1.0}
    if scheduler is None:
        with dask.config.set(own):
            cluster = distributed.LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                dashboard_address=":0" if _has_bokeh() else None,
                silence_logs=logging.CRITICAL,
            )
            try:
                with distributed.Client(cluster) as client:
                    client.register_plugin(_at_start(own_cores() if count <= cores() else None))
                    yield DaskPool(client, 0, lambda: cluster.scale(count))
            finally:
                with suppress(Exception):  # of a worker that is just being replaced; the work is done, or has failed
                    cluster.close()
        return
    try:
        client = distributed.Client(scheduler, timeout=PATIENCE / 3.0)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"there is no Dask scheduler at {scheduler}: {_first_line(error)}") from None
    with client:
        try:
            client.wait_for_workers(1, timeout=PATIENCE)
        except TimeoutError:
            raise InputError(
                f"the scheduler at {scheduler} has had no workers for {PATIENCE:g} s: start some"
            ) from None
        _check_versions(client)
        yield DaskPool(client, client.run_on_scheduler(lambda dask_scheduler: dask_scheduler.allowed_failures))


@contextmanager
def open_some(workers: int | None = None, scheduler: str | None = None) -> Iterator[Pool]:
    """As `open_pool`, for work that may as well be done in this process: where one is asked for, or Dask not there."""
    unasked = workers is None and (cores() == 1 or importlib.util.find_spec("distributed") is None)
    if scheduler is None and (workers == 1 or unasked):
        yield ThisProcess()
        return
    with open_pool(workers, scheduler) as pool:
        yield pool


def versions() -> dict[str, str]:
    """What rows depend on."""
    return {
        "pbd-warp": __version__,
        "warp": wp.config.version,
        "numpy": np.__version__,
        "python": platform.python_version(),
    }


def _check_versions(client: Any) -> None:
    here = versions()
    try:
        answers = client.run(versions)
    except Exception as error:
        raise InputError(
            f"the workers cannot run pbd-warp {__version__}: {_first_line(error)}; install the same there"
        ) from None
    for worker, there in answers.items():
        for name, version in here.items():
            if there[name] != version:
                raise InputError(
                    f"worker {worker} has {name} {there[name]}, and here it is {version}: install the same"
                )


def _run(code: bytes, items: list[Any]) -> tuple[list[Any], float]:
    """On a worker."""
    start = time.perf_counter()
    results = _function(code)(items)
    return results, time.perf_counter() - start


@functools.lru_cache(maxsize=4)
def _function(code: bytes) -> Any:
    """Unpickled once a worker, with what it keeps."""
    return pickle.loads(code)


def _at_start(kept_on: list[int] | None) -> Any:
    """What every worker does first.

    Args:
        kept_on: Keep each on one of these, so that the times of runs are of a core that no other worker uses.
    """
    from distributed import WorkerPlugin

    class AtStart(WorkerPlugin):
        name = "pbd-warp"

        def setup(self, worker: Any) -> None:
            # Ctrl-C in a terminal reaches all its processes, and only the first of them has to do with it.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            if kept_on:
                os.sched_setaffinity(0, {kept_on[worker.name]})
            start_warp([])

    return AtStart()


def _has_bokeh() -> bool:
    try:
        import bokeh  # noqa: F401
    except ImportError:
        return False
    return True


def _first_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]
