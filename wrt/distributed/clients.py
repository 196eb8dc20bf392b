"""Clients of Dask by the address of their scheduler."""

from __future__ import annotations

import contextlib
import logging
import re
import signal
import threading
from collections.abc import Iterator
from typing import Any

from wrt.backend.slices import available_threads
from wrt.errors import InputError, one_line

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
"""Settings of Dask for a cluster of our own: what it observes by default takes 3 % of a core of each worker."""

_LOCAL = re.compile(r"local(?::([1-9]\d{0,3}))?")


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Within the context, start processes that ignore Ctrl-C, which a terminal sends to them as well."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


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
                    dashboard_address=":0",  # None is for the usual port, with a warning where that is in use
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
