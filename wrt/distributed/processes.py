"""A process for each device of this machine, which render a picture together."""

from __future__ import annotations

import atexit
import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures import TimeoutError as Timeout
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from wrt import child
from wrt.distributed.crew import ANSWER_SECONDS, NoAnswer
from wrt.errors import InputError

_SEVERAL = re.compile(r"cuda:(all|\d{1,3}(?:,\d{1,3})+)")


def devices_of(name: str) -> list[str] | None:
    """Return the devices of a name such as cuda:0,1 or cuda:all, None for the name of one device.

    Raises:
        InputError: if a GPU does not exist, or is named twice.
    """
    found = _SEVERAL.fullmatch(name)
    if not found:
        return None
    from wrt.backend import current_backend
    from wrt.backend.cuda.gpus import require_gpus

    backend = current_backend()
    count = backend.gpus()
    numbers = list(range(count)) if found[1] == "all" else [int(number) for number in found[1].split(",")]
    require_gpus(backend, name, numbers)
    if len(set(numbers)) < len(numbers):
        raise InputError(f"device {name!r}: a GPU is named twice")
    return [f"cuda:{number}" for number in numbers]


class Processes:
    """Processes of this machine, each with a device; a `Cluster`.

    They end with this one, whatever ends it.
    """

    def __init__(self, devices: Sequence[str]) -> None:
        """Start a process for each device; several may have the same."""
        context = multiprocessing.get_context("spawn")  # a fork could use neither CUDA nor running threads
        self.devices = {f"{number}:{device}": device for number, device in enumerate(devices)}
        with child.safe_path():
            self._pools = {
                address: ProcessPoolExecutor(1, mp_context=context, initializer=_begin) for address in self.devices
            }
        atexit.register(self.close)

    def close(self) -> None:
        """End the processes."""
        for pool in self._pools.values():
            pool.shutdown(wait=False, cancel_futures=True)
        self._pools.clear()
        atexit.unregister(self.close)

    def addresses(self) -> list[str]:
        """Return the addresses of the processes that live; raise OSError if none does."""
        if not self._pools:
            raise OSError("the processes that render have died, perhaps for lack of memory")
        return list(self._pools)

    def submit(self, address: str, ended: Callable[[], object], key: str, function: Any, *arguments: Any) -> Any:
        """Call a function in a process."""
        future: Future[Any]
        try:
            with child.safe_path():  # the first call starts the process
                future = self._pools[address].submit(function, *arguments)
        except (BrokenProcessPool, KeyError):
            self._pools.pop(address, None)
            future = Future()
            future.cancel()
        future.add_done_callback(lambda _: ended())
        return future

    def result(self, future: Any) -> Any:
        """Return the result of a call that is done, or raise its exception."""
        if future.cancelled():
            raise NoAnswer
        try:
            return future.result(timeout=ANSWER_SECONDS)
        except (Timeout, TimeoutError):
            raise NoAnswer from None
        except BrokenProcessPool:
            for address, pool in list(self._pools.items()):
                if pool._broken:
                    del self._pools[address]
            raise NoAnswer from None

    def cancel(self, futures: Sequence[Any]) -> None:
        """Cancel calls that have not begun."""
        for future in futures:
            future.cancel()


def _begin() -> None:
    """Ignore Ctrl-C, which a terminal sends to all its processes, and end with the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    def end_with_parent() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=end_with_parent, name="wrt-parent", daemon=True).start()
