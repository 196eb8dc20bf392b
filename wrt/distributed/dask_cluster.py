"""The workers of a Dask cluster."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from wrt.distributed.cluster import ANSWER_SECONDS, NoAnswer


class DaskCluster:
    """The workers of a `distributed.Client`.

    Data go with calls, from the head node by the scheduler to the one worker that is called. Dask could keep them on
    workers, and fetch them from one for another; then a worker that hangs makes others wait for minutes.
    """

    def __init__(self, client: Any) -> None:
        """Use the workers of a client."""
        self._client = client
        self._known: list[str] = []

    def addresses(self) -> list[str]:
        """Return the addresses that the scheduler knows, or knew, while the connection to it is lost.

        Raises:
            OSError: once Dask has given up connecting again.
        """
        # Not `scheduler_info`: it reads a field of the client that Dask sets beside, to one without workers.
        with self._connected(), contextlib.suppress(OSError):
            self._known = list(self._client.nthreads())
        return list(self._known)

    @contextlib.contextmanager
    def _connected(self) -> Iterator[None]:
        """Within the context, turn what a client raises that has closed, such as AttributeError, into OSError."""
        try:
            yield
        except Exception:
            self._require_connection()
            raise
        self._require_connection()

    def _require_connection(self) -> None:
        if self._client.status in ("closing", "closed"):
            raise OSError("the connection to the scheduler of Dask is lost")

    def submit(self, address: str, ended: Callable[[], object], key: str, function: Any, *arguments: Any) -> Any:
        """Call a function on a worker; see `Cluster.submit`."""
        with warnings.catch_warnings():
            # Of Dask, from 10 MB on, and of what was sent elsewhere.
            warnings.filterwarnings("ignore", "Sending large graph", UserWarning)
            with self._connected():
                future = self._client.submit(function, *arguments, key=key, workers=[address], pure=False)
        future.add_done_callback(lambda _: ended())
        return future

    def result(self, future: Any) -> Any:
        """Return the result of a call that is done, or raise its exception; see `Cluster.result`."""
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
            raise OSError("workers died of a part of the picture, perhaps for lack of memory; see their logs") from None

    def cancel(self, futures: Sequence[Any]) -> None:
        """Let calls not begin."""
        if futures:
            with contextlib.suppress(OSError), self._connected():  # without a scheduler they end, too
                self._client.cancel(list(futures))

    def device_of(self, address: str) -> str | None:
        """Return None: all workers have the device that was asked for."""
        return None

    def dumps(self, value: object, buffer_callback: Callable[[Any], object]) -> bytes:
        """Pickle a value, with classes of the main program."""
        from distributed.protocol import pickle

        pickled: bytes = pickle.dumps(value, buffer_callback=buffer_callback)
        return pickled
