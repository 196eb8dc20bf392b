"""Spread a pass over the workers of a Dask cluster.

Dask decides which worker renders a window, and renders it elsewhere if the worker dies. What is decided here: how large
windows are, which workers may take part, and when a window that takes too long is given to another worker. A window's
result does not depend on who renders it, so whichever comes first counts.
"""

from __future__ import annotations

import dataclasses
import statistics
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from wrt._version import __version__
from wrt.distributed.windows import windows_of_pass
from wrt.distributed.worker import Job, Rendered, render_window
from wrt.errors import InputError, InputWarning
from wrt.scene.scene import Scene
from wrt.upload.camera import CropWindow

AHEAD = 2
"""Windows for each worker at a time: one that it renders, and one that waits for it."""

POLL_SECONDS, COUNT_SECONDS = 0.2, 1.0
"""Intervals at which late windows are looked for, and at which workers are counted."""

WITHOUT_WORKERS_SECONDS = 600.0
"""Time to wait for a worker when all have gone: those that died are started again, or others come."""

GATHER_SECONDS, SILENT_SECONDS = 10.0, 60.0
"""Time to wait for a result that a worker has. If it does not come, the machine may hang: the window is rendered
elsewhere, and the worker gets nothing for a minute."""

LATE_FACTOR, LATE_SECONDS = 4.0, 3.0
"""A window is late after this many times the median of the others, and this many seconds."""

Keep = Callable[[CropWindow, Rendered], object]
State = Callable[[CropWindow], "dict[str, NDArray[Any]] | None"]


@dataclass
class _Window:
    """A window that some worker renders.

    Attributes:
        window: the window.
        futures: of Dask, the first and those of workers that help out.
        since: when it was submitted.
    """

    window: CropWindow
    futures: list[Any] = field(default_factory=list)
    since: float = 0.0


class Spread:
    """Renders windows on the workers of a Dask client.

    Attributes:
        kind: what the digits of the picture depend on, by name, as the first worker has it.
        refused: workers of another kind, which render nothing.
    """

    def __init__(self, client: Any, scene: Scene) -> None:
        """Prepare to render a scene on the workers of a `distributed.Client`."""
        self.kind: dict[str, str] = {"wrt": __version__}
        self.refused: set[str] = set()
        settings = dataclasses.replace(scene.settings, denoise=False)  # the head node's task
        self._client, self._scene = client, dataclasses.replace(scene, settings=settings)
        self._on_workers: Any = None
        self._late: dict[Any, str] = {}  # windows that workers still render in vain, and these workers
        self._silent: dict[str, float] = {}  # workers that do not answer, and until when they get nothing
        self._ended = threading.Event()
        self._seconds: deque[float] = deque(maxlen=32)  # of the latest windows, from submission on
        self._seconds_of_sample = 0.0
        self._submitted = 0
        self._workers: list[str] = []
        self._counted = 0.0

    def workers(self) -> list[str]:
        """Return the addresses of the workers that may render."""
        if time.monotonic() - self._counted > (COUNT_SECONDS if self._workers else POLL_SECONDS):
            self._workers = list(self._client.scheduler_info(n_workers=-1)["workers"])
            self._counted = time.monotonic()
        for future in [each for each in self._late if each.done()]:
            del self._late[future]
        now = time.monotonic()
        away = {*self._late.values(), *(worker for worker, until in self._silent.items() if until > now)}
        usable = [each for each in self._workers if each not in self.refused]
        return [each for each in usable if each not in away] or usable

    def run(self, job: Job, crop: CropWindow, samples: int, spp: int, state: State, keep: Keep) -> None:
        """Bring every pixel of `crop` to `spp` samples.

        Args:
            job: what the windows have in common.
            crop: the picture.
            samples: how many samples a pixel lacks at most.
            spp: samples per pixel in the end.
            state: returns the arrays of the film for a window, None where it is empty.
            keep: called with each window and what became of it.

        Raises:
            InputError: where a worker cannot render the scene.
            OSError: where workers died of a window.
        """
        coming = windows_of_pass(crop, lambda: len(self.workers()), lambda: self._seconds_of_sample * max(samples, 1))
        going: list[_Window] = []
        try:
            while True:
                self._submit_more(job, coming, going, spp, state)
                if not going:
                    return
                self._wait()
                for each in [each for each in going if any(future.done() for future in each.futures)]:
                    rendered = self._result(each)
                    if rendered is None:  # once more
                        self._submit(job, each, spp, state)
                        continue
                    going.remove(each)
                    self._leave(each)
                    keep(each.window, rendered)
                    self._seconds.append(time.monotonic() - each.since)
                    self._measure(each.window, rendered, samples)
                self._help_late(job, going, spp, state)
        finally:
            self._client.cancel([future for each in going for future in each.futures])

    def _submit_more(
        self, job: Job, coming: Iterator[CropWindow], going: list[_Window], spp: int, state: State
    ) -> None:
        while len(going) < AHEAD * max(len(self.workers()), 1):
            window = next(coming, None)
            if window is None:
                return
            going.append(_Window(window))
            self._submit(job, going[-1], spp, state)

    def _submit(self, job: Job, each: _Window, spp: int, state: State, *, without: str | None = None) -> None:
        if self._on_workers is None:
            # A copy on every worker, so that it is not lost with one.
            self._on_workers = self._client.scatter(self._scene, broadcast=True, hash=False)
        allowed = [worker for worker in self.workers() if worker != without]
        restricted = self.refused or self._late or self._silent or without
        self._submitted += 1
        x0, y0, x1, y1 = each.window
        future = self._client.submit(
            render_window,
            job,
            self._on_workers,
            each.window,
            state(each.window),
            spp,
            key=f"wrt-{job.digest[:8]}-{x0},{y0},{x1},{y1}-to-{spp}-{self._submitted}",
            workers=allowed if restricted and allowed else None,
            pure=False,
        )
        future.add_done_callback(lambda _: self._ended.set())
        each.futures.append(future)
        each.since = time.monotonic()

    def _wait(self) -> None:
        """Wait until a window has been rendered, or for POLL_SECONDS; and for a worker, if there are none."""
        self._ended.wait(POLL_SECONDS)
        self._ended.clear()
        since = time.monotonic()
        while not self.workers():
            if time.monotonic() - since > WITHOUT_WORKERS_SECONDS:
                raise OSError(f"the scheduler has had no worker for {WITHOUT_WORKERS_SECONDS:.0f} s")
            time.sleep(POLL_SECONDS)

    def _result(self, each: _Window) -> Rendered | None:
        """Return what became of a window, None if it must be rendered again."""
        from distributed import KilledWorker

        done = next(future for future in each.futures if future.done())
        each.futures.remove(done)
        if done.status == "cancelled":  # the scene was lost with the workers that had it
            self._on_workers = None
            return None
        try:
            rendered: Rendered = done.result(timeout=GATHER_SECONDS)
        except TimeoutError:
            for worker in self._client.who_has([done]).get(done.key, ()):
                self._silent[worker] = time.monotonic() + SILENT_SECONDS
            return None
        except KilledWorker:
            raise OSError("workers died of a part of the picture, perhaps for lack of memory; see their logs") from None
        except (ImportError, AttributeError, TypeError) as error:
            if self._refuse_strangers():
                return None
            raise InputError(f"the workers cannot render this scene: {error}") from error
        return rendered if self._is_of_kind(rendered.worker, rendered.kind) else None

    def _is_of_kind(self, worker: str, kind: dict[str, str]) -> bool:
        """Return whether a worker computes the digits of the others; if not, refuse it."""
        differences = [
            f"{name} ({kind.get(name)} there, {value} here)"
            for name, value in self.kind.items()
            if kind.get(name) != value
        ]
        if not differences:
            self.kind = kind
            return True
        self._refuse(worker, f"these differ: {', '.join(differences)}")
        return False

    def _refuse(self, worker: str, why: str) -> None:
        if worker not in self.refused:
            warnings.warn(f"worker {worker} renders nothing, {why}", InputWarning, stacklevel=2)
        self.refused.add(worker)
        if self._workers and not set(self._workers) - self.refused:
            raise InputError(f"no worker can render this picture: {worker}, {why}")

    def _refuse_strangers(self) -> bool:
        """Refuse workers that cannot say which version of wrt they have; return whether there were any."""
        found = self._client.run(_version, workers=self.workers(), on_error="return")
        strangers = {worker: version for worker, version in found.items() if version != __version__}
        for worker, version in strangers.items():
            shown = version if isinstance(version, str) else "no wrt"
            self._refuse(worker, f"these differ: wrt ({shown} there, {__version__} here)")
        return bool(strangers)

    def _help_late(self, job: Job, going: list[_Window], spp: int, state: State) -> None:
        """Give windows that take too long to another worker, and nothing more to the one before.

        The second may be late as well: one that is new waits for the scene from a worker that hangs.
        """
        now, workers = time.monotonic(), self.workers()
        limit = float("inf")
        if self._seconds:
            limit = max(LATE_FACTOR * statistics.median(self._seconds), LATE_SECONDS)
        late = [each for each in going if len(each.futures) < len(self._workers) and now - each.since > limit]
        if not late or len(workers) < 2:
            return
        processing = self._client.processing()
        for each in late:
            newest = each.futures[-1]
            worker = next((name for name, keys in processing.items() if newest.key in keys), None)
            if worker is not None and set(workers) - {worker}:
                self._late[newest] = worker
                self._submit(job, each, spp, state, without=worker)

    def _leave(self, each: _Window) -> None:
        """Cancel what another worker still does for a window that is complete."""
        self._client.cancel([future for future in each.futures if future not in self._late])

    def _measure(self, window: CropWindow, rendered: Rendered, samples: int) -> None:
        pixels = (window[2] - window[0]) * (window[3] - window[1])
        now = rendered.seconds / (pixels * max(samples, 1))
        self._seconds_of_sample = now if not self._seconds_of_sample else 0.8 * self._seconds_of_sample + 0.2 * now


def _version() -> str:
    from wrt._version import __version__

    return __version__
