"""Processes that render a picture together, each with an address, which call functions: what all kinds can do."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np

ANSWER_SECONDS = 10.0
"""Time to wait for a result that a worker has. If it does not come, the machine may hang."""


class NoAnswer(Exception):
    """A worker has a result and does not send it, or its result was lost."""


class Future(Protocol):
    """A call on a worker."""

    def done(self) -> bool:
        """Return whether it has ended, also by an exception or by being cancelled."""


class Cluster(Protocol):
    """Workers that call functions. No method waits for a worker, except `result`, for ANSWER_SECONDS at most."""

    @property
    def devices(self) -> Mapping[str, str]:
        """The devices of workers by address; a worker without one has the device that the renderer names."""

    def addresses(self) -> list[str]:
        """Return the addresses of the present workers; raise OSError if there can be none any more."""

    def submit(self, address: str, ended: Callable[[], object], key: str, function: Any, *arguments: Any) -> Future:
        """Call a function on a worker, and `ended` here, in any thread, when it has ended.

        Args:
            address: of the worker; no other calls it.
            ended: called without arguments.
            key: a name that no other call has.
            function: the function, from a module.
            arguments: its arguments.
        """

    def result(self, future: Any) -> Any:
        """Return the result of a call that is done, or raise its exception; NoAnswer if it does not come."""

    def cancel(self, futures: Sequence[Any]) -> None:
        """Cancel calls that have not begun; running ones end by themselves."""

    def dumps(self, value: object, buffer_callback: Callable[[Any], object]) -> bytes:
        """Pickle a value for the workers; see `pickle.dumps`."""


def pack(cluster: Cluster, value: object) -> list[Any]:
    """Return a value as bytes and arrays of bytes, which a scheduler passes on without copying or reading them."""
    buffers: list[pickle.PickleBuffer] = []
    head = cluster.dumps(value, buffers.append)
    return [head, *(np.frombuffer(buffer.raw(), np.uint8) for buffer in buffers)]


def unpack(packed: Sequence[Any]) -> Any:
    """Return the value of `pack`."""
    head, *buffers = packed
    return pickle.loads(head, buffers=buffers)  # from the head node, which workers trust
