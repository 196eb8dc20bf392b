"""The workers of a cluster: what all kinds of clusters can do, and which workers have built the scene or are busy."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

from wrt._version import __version__
from wrt.distributed.worker import Job, pack, prepare
from wrt.errors import InputError, InputWarning
from wrt.scene.scene import Scene

ANSWER_SECONDS = 10.0
"""Time to wait for a result that a worker has. If it does not come, the machine may hang."""


DIED = "workers died {}, perhaps for lack of memory; see their logs"

AHEAD = 2
"""Windows that a worker has at a time: the one that it renders, and the next."""

COUNT_SECONDS, COUNT_AGAIN_SECONDS = 1.0, 0.2
"""Intervals at which workers are counted, with and without workers."""

SILENT_SECONDS = 60.0
"""Time without work for a worker that has not sent a result."""

MOST_DEATHS = 3
"""Workers that may die while they render the same window, and for each worker while they build the scene."""


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


@dataclass(eq=False)
class Member:
    """A worker.

    Attributes:
        address: its address.
        digest: the digest of the scene that it has built.
        preparing: the call that builds a scene.
        calls: the calls that render its windows, the running one first.
        silent_until: when it gets work again after a result has not come.
    """

    address: str
    digest: str = ""
    preparing: Any = None
    calls: list[Any] = field(default_factory=list)
    silent_until: float = 0.0


class Crew:
    """The workers of a cluster.

    A worker gets the scene by a call, and windows after it has built the scene, so none waits for data of another.

    Attributes:
        kind: what the digits of the picture depend on, by name, as on the first worker.
        refused: workers of another kind, which render nothing.
        members: the other workers by address.
    """

    def __init__(self, cluster: Cluster, scene: Scene, ended: Callable[[], object]) -> None:
        """Prepare to render a scene; `ended` is called when a worker has ended something."""
        self.kind: dict[str, str] = {"wrt": __version__}
        self.refused: dict[str, str] = {}
        self.members: dict[str, Member] = {}
        self._cluster, self._scene, self._ended = cluster, scene, ended
        self._packed: list[Any] | None = None
        self._counted, self._calls, self._deaths = 0.0, 0, 0

    def update(self, job: Job) -> None:
        """Count the workers, and give them the scene.

        Raises:
            InputError: if the scene cannot be rendered, or by no worker.
            OSError: if workers die of it.
        """
        if time.monotonic() - self._counted > (COUNT_SECONDS if self.members else COUNT_AGAIN_SECONDS):
            self._count()
        for member in list(self.members.values()):
            if member.digest != job.digest:
                self._prepare(member, job)

    def _count(self) -> None:
        addresses = set(self._cluster.addresses())
        for address in set(self.members) - addresses:
            self._deaths += self.members.pop(address).preparing is not None
        for address in addresses - set(self.members) - set(self.refused):
            self.members[address] = Member(address)
        self._counted = time.monotonic()
        if self._deaths > MOST_DEATHS * max(len(self.members), 1):
            raise OSError(DIED.format("while they built the scene"))

    def _prepare(self, member: Member, job: Job) -> None:
        """Ask a worker whether it has built the scene, handle the reply, and send the scene if it has not."""
        if member.preparing is None:
            if member.silent_until <= time.monotonic():
                member.preparing = self.call(member, "hello", prepare, job, None)
            return
        if not member.preparing.done():
            return
        future, member.preparing = member.preparing, None
        try:
            kind, digest = self.result(member, future)
        except NoAnswer:
            return
        except (ImportError, AttributeError) as error:
            self._refuse(member, f"it has another wrt, or none: {error}")
            return
        except TypeError as error:
            raise InputError(f"the workers cannot render this scene: {error}") from error
        differences = [
            f"{name} ({kind.get(name)} there, {value} here)"
            for name, value in self.kind.items()
            if kind.get(name) != value
        ]
        if differences:
            self._refuse(member, f"these differ: {', '.join(differences)}")
            return
        self.kind = kind
        if digest:
            member.digest, self._deaths = digest, 0
            return
        if self._packed is None:
            self._packed = pack(self._scene)
        member.preparing = self.call(member, "scene", prepare, job, self._packed)

    def _refuse(self, member: Member, reason: str) -> None:
        warnings.warn(f"worker {member.address} renders nothing, {reason}", InputWarning, stacklevel=2)
        self.refused[member.address] = reason
        del self.members[member.address]
        if not self.members:
            raise InputError(f"no worker can render this picture: {member.address}, {reason}")

    def call(self, member: Member, name: str, function: Any, job: Job, *arguments: Any) -> Any:
        """Call a function on a worker, with a job for its device; `name` shows what it does."""
        self._calls += 1
        key = f"wrt-{job.digest[:8]}-{name}-{self._calls}"
        if device := self._cluster.devices.get(member.address):
            job = replace(job, options={**job.options, "device": device})
        return self._cluster.submit(member.address, self._ended, key, function, job, *arguments)

    def result(self, member: Member, future: Any) -> Any:
        """Return the result of a call that is done, or raise its exception; NoAnswer if the worker does not send it."""
        try:
            found = self._cluster.result(future)
        except NoAnswer:
            member.silent_until = time.monotonic() + SILENT_SECONDS
            raise
        member.silent_until = 0.0
        return found

    def free(self, job: Job) -> list[Member]:
        """Return the workers that can take a window, those with the fewest first."""
        usable = [
            member
            for member in self.members.values()
            if member.digest == job.digest and len(member.calls) < AHEAD and member.silent_until <= time.monotonic()
        ]
        return sorted(usable, key=lambda member: len(member.calls))
