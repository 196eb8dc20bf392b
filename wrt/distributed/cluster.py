"""What all kinds of clusters can do: processes, each with an address, that call functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

ANSWER_SECONDS = 10.0
"""Time to wait for a result that a worker has. If it does not come, the machine may hang."""


DIED = "workers died {}, perhaps for lack of memory; see their logs"


class NoAnswer(Exception):
    """A worker has a result and does not send it, or its result was lost."""


class Cluster(Protocol):
    """Workers that call functions. No method waits for a worker, except `result`, for ANSWER_SECONDS at most."""

    devices: dict[str, str]
    """The devices of workers by address; a worker without one has the device that the renderer names."""

    def addresses(self) -> list[str]:
        """Return the addresses of the present workers; raise OSError if there can be none any more."""

    def submit(self, address: str, ended: Callable[[], object], key: str, function: Any, *arguments: Any) -> Any:
        """Call a function of a module on one worker, and return a future.

        Args:
            address: of the worker.
            ended: called here, in any thread, when the call has ended.
            key: a name that no other call has.
            function: the function.
            arguments: its arguments.
        """

    def result(self, future: Any) -> Any:
        """Return the result of a call that is done, or raise its exception; NoAnswer if it does not come."""

    def cancel(self, futures: Sequence[Any]) -> None:
        """Cancel calls that have not begun; running ones end by themselves."""
