"""The workers of a Dask cluster, and the client that reaches them."""

from __future__ import annotations

import contextlib
import logging
import re
import signal
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from wrt.distributed.crew import ANSWER_SECONDS, DIED, NoAnswer
from wrt.errors import InputError, one_line
from wrt.slices import available_threads

CONNECT_SECONDS = 10
"""Time to wait for a scheduler."""

WORKER_SECONDS = 60
"""Time to wait for the first worker."""

QUIET = {
    "distributed.admin.tick.interval": "1 s",
    "distributed.admin.system-monitor.interval": "10 s",
    "distributed.worker.memory.monitor-interval": "1 s",
    "distributed.worker.profile.enabled": False,
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.scheduler.work-stealing": False,
}
"""Settings of Dask for workers that wrt starts: by default monitoring takes 3 % of a core of each."""

_LOCAL = re.compile(r"local(?::([1-9]\d{0,3}))?")


def client_of(where: Any) -> Any:
    """Return a client, connected to a scheduler that has a worker.

    Args:
        where: a `distributed.Client`; the address of a scheduler; or "local" or "local:N" for N worker processes of one
            thread on this machine, by default one for each core.

    Raises:
        InputError: without the extra wrt[dask], a scheduler, or a worker.
    """
    try:
        import dask
        import distributed
    except ImportError:
        raise InputError("rendering on a cluster needs Dask: pip install 'wrt[dask]'") from None

    if isinstance(where, distributed.Client):
        return where
    try:
        local = _LOCAL.fullmatch(str(where))
        if local:
            with _without_interrupts(), dask.config.set(QUIET):
                return distributed.Client(
                    n_workers=int(local[1] or available_threads()),
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address=":0",  # None takes the usual port, with a warning if it is in use
                    silence_logs=logging.CRITICAL,
                )
        client = distributed.Client(str(where), timeout=CONNECT_SECONDS)
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"{where}: there is no scheduler of Dask ({one_line(str(error))})") from None
    try:
        client.wait_for_workers(1, timeout=WORKER_SECONDS)
    except TimeoutError:
        raise InputError(f"{where}: the scheduler has no workers; start some by dask worker {where}") from None
    return client


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Within the context, start processes that ignore Ctrl-C, which a terminal sends to them as well."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


class DaskCluster:
    """The workers of a `distributed.Client`; a `Cluster`.

    Data go with calls, from the head node by the scheduler to the one worker that is called. Dask could keep them on
    workers, and fetch them from one for another; then a worker that hangs makes others wait for minutes.
    """

    def __init__(self, client: Any) -> None:
        """Use the workers of a client."""
        self.devices: dict[str, str] = {}
        self._client = client
        self._addresses: list[str] = []

    def addresses(self) -> list[str]:
        """Return the workers' addresses; while Dask reconnects to a lost scheduler, those of before."""
        # `scheduler_info` is unreliable: Dask replaces the field that it reads by one without workers now and then.
        with self._connected(), contextlib.suppress(OSError):
            self._addresses = list(self._client.nthreads())
        return list(self._addresses)

    @contextlib.contextmanager
    def _connected(self) -> Iterator[None]:
        """Within the context, turn any error of a client that has closed, such as AttributeError, into OSError."""
        try:
            yield
        finally:
            if self._client.status in ("closing", "closed"):
                raise OSError("the connection to the scheduler of Dask is lost")

    def submit(self, address: str, ended: Callable[[], object], key: str, function: Any, *arguments: Any) -> Any:
        """Call a function on a worker."""
        with warnings.catch_warnings():
            # Dask warns from 10 MB on, and counts what was sent elsewhere.
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
            with self._connected():
                future = self._client.submit(function, *arguments, key=key, workers=[address], pure=False)
        future.add_done_callback(lambda _: ended())
        return future

    def result(self, future: Any) -> Any:
        """Return the result of a call that is done, or raise its exception."""
        from distributed import CancelledError, KilledWorker
        from distributed import TimeoutError as DaskTimeoutError

        if future.status == "cancelled":
            raise NoAnswer
        try:
            with self._connected():
                return future.result(timeout=ANSWER_SECONDS)
        except (TimeoutError, DaskTimeoutError, CancelledError):
            raise NoAnswer from None
        except KilledWorker:
            raise OSError(DIED.format("of a part of the picture")) from None

    def cancel(self, futures: Sequence[Any]) -> None:
        """Cancel calls that have not begun."""
        if futures:
            with contextlib.suppress(OSError), self._connected():  # without a scheduler they end, too
                self._client.cancel(list(futures))
