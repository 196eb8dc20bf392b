"""Spread a pass over the workers of a cluster: how large windows are, and which worker renders each.

A window's result does not depend on its worker, so a window whose worker is lost is rendered again by another.
"""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from wrt.distributed.crew import DIED, MOST_DEATHS, Cluster, Crew, Member, NoAnswer
from wrt.distributed.worker import Job, Rendered, render_window
from wrt.errors import InputError, warn
from wrt.rendering.film import Film
from wrt.rendering.windows import grid_cell, pixels_of, read_windows, write_windows
from wrt.scene.scene import Scene
from wrt.upload.camera import CropWindow

POLL_SECONDS = 0.2
"""Interval of the checks for lost and new workers."""

WITHOUT_WORKERS_SECONDS = 600.0
"""Time to wait when no worker is left: Dask restarts workers that died, or others come."""

MENTIONED_SECONDS = 10.0
"""Time without workers until a warning; a restart takes less."""

SHARES = 2
"""A window is 1/SHARES of a worker's even share of the remaining pixels (Polychronopoulos and Kuck 1987)."""

ROWS_PER_WORKER = 8
"""Pictures with fewer rows for each worker are cut into columns, too."""

LONGEST_SECONDS, SHORTEST_SECONDS = 8.0, 0.3
"""Limits of the seconds of a window: it is lost with its worker, and each costs the head node, Dask and the worker some
ten milliseconds."""


def windows_of_pass(
    crop: CropWindow, workers: Callable[[], int], seconds_of_pixel: Callable[[], float]
) -> Iterator[CropWindow]:
    """Yield windows that cover `crop` once: large ones first, and smaller ones towards the end.

    Args:
        crop: the picture.
        workers: returns the present number of workers.
        seconds_of_pixel: returns the seconds that a pixel takes in this pass, 0 while they are unknown.
    """
    rows = crop[3] - crop[1]
    columns = min(-(-ROWS_PER_WORKER * max(workers(), 1) // rows), crop[2] - crop[0])
    remaining = pixels_of((crop,))
    for column in range(columns):
        x0, y, x1, y1 = grid_cell(crop, columns, 1, column)
        width = x1 - x0
        while y < y1:
            pixels = remaining / (SHARES * max(workers(), 1))
            if seconds := seconds_of_pixel():
                pixels = min(max(pixels, SHORTEST_SECONDS / seconds), LONGEST_SECONDS / seconds)
            end = min(y + max(int(pixels / width), 1), y1)
            yield x0, y, x1, end
            remaining -= width * (end - y)
            y = end


@dataclass(frozen=True)
class Pass:
    """A pass over a film.

    Attributes:
        film: the film of the picture, which gets the samples.
        crop: the window of the whole picture that the film has.
        job: the values that all windows share.
        spp: samples per pixel at the end.
        seconds_left: estimated time until the picture is finished, including this pass.
        samples: the most samples that a pixel still needs.
    """

    film: Film
    crop: CropWindow
    job: Job
    spp: int
    seconds_left: float
    samples: int

    def state(self, window: CropWindow) -> dict[str, NDArray[Any]] | None:
        """Return the film's arrays for a window, None if it has no samples there."""
        arrays = {name: read_windows(array, self.crop, (window,)) for name, array in self.film.arrays().items()}
        return arrays if arrays["count"].any() else None

    def keep(self, window: CropWindow, rendered: Rendered) -> None:
        """Put a rendered window into the film."""
        for name, array in self.film.arrays().items():
            write_windows(array, self.crop, (window,), rendered.arrays[name])
        first = (window[1] - self.crop[1]) * self.film.width + window[0] - self.crop[0]
        self.film.data.rays.numpy()[first] += rendered.rays  # a statistic of the whole picture


@dataclass(eq=False)
class _Window:
    """A window that a worker renders, or that must be rendered again.

    Attributes:
        window: the window.
        member: the worker.
        future: the call.
        deaths: workers that died while they rendered it.
    """

    window: CropWindow
    member: Member = field(default_factory=lambda: Member(""))
    future: Any = None
    deaths: int = 0


class Spread:
    """Renders passes on the workers of a cluster.

    Attributes:
        crew: the workers.
    """

    def __init__(self, cluster: Cluster, scene: Scene) -> None:
        """Prepare to render a scene on the workers of a cluster."""
        settings = dataclasses.replace(scene.settings, denoise=False)  # the head node denoises
        self._cluster = cluster
        self._ended = threading.Event()
        self._seconds_of_sample = 0.0
        self.crew = Crew(cluster, dataclasses.replace(scene, settings=settings), self._ended.set)

    def run(self, a_pass: Pass) -> None:
        """Render a pass into its film.

        Raises:
            InputError: if a worker cannot render the scene.
            OSError: if workers die of a window, or there is none for long.
        """
        windows = windows_of_pass(
            a_pass.crop, lambda: len(self.crew.members), lambda: self._seconds_of_sample * a_pass.samples
        )
        coming = map(_Window, windows)
        running: list[_Window] = []
        unfinished: list[_Window] = []
        remaining = pixels_of((a_pass.crop,))
        try:
            while remaining:
                self.crew.update(a_pass.job)
                while free := self.crew.free(a_pass.job):
                    each = unfinished.pop() if unfinished else next(coming, None)
                    if each is None:
                        break
                    self._give(a_pass, each, free[0])
                    running.append(each)
                self._wait(a_pass.job)
                for each in list(running):
                    is_lost = self.crew.members.get(each.member.address) is not each.member
                    if is_lost or each.future.done():
                        running.remove(each)
                        rendered = self._rendered(each, is_lost=is_lost)
                        if rendered is None:
                            unfinished.append(each)
                            continue
                        a_pass.keep(each.window, rendered)
                        remaining -= pixels_of((each.window,))
                        seconds = rendered.seconds / (pixels_of((each.window,)) * a_pass.samples)
                        average = self._seconds_of_sample
                        self._seconds_of_sample = 0.8 * average + 0.2 * seconds if average else seconds
        finally:
            self._cluster.cancel([each.future for each in running])
            for each in running:
                each.member.calls.remove(each.future)

    def _give(self, a_pass: Pass, each: _Window, member: Member) -> None:
        """Have a worker render a window."""
        each.member, state = member, a_pass.state(each.window)
        arguments = each.window, state, a_pass.spp, a_pass.seconds_left
        name = f"{','.join(map(str, each.window))}-to-{a_pass.spp}"
        each.future = self.crew.call(member, name, render_window, a_pass.job, *arguments)
        member.calls.append(each.future)

    def _wait(self, job: Job) -> None:
        """Wait until a worker has ended something, or for POLL_SECONDS; and for a worker, if there is none."""
        self._ended.wait(POLL_SECONDS)
        self._ended.clear()
        start, has_warned = time.monotonic(), False
        while not self.crew.members:
            if time.monotonic() - start > WITHOUT_WORKERS_SECONDS:
                raise OSError(f"the scheduler has had no worker for {WITHOUT_WORKERS_SECONDS:.0f} s")
            if time.monotonic() - start > MENTIONED_SECONDS and not has_warned:
                has_warned = True
                warn(f"the scheduler has no worker; waiting for one, at most {WITHOUT_WORKERS_SECONDS:.0f} s")
            time.sleep(POLL_SECONDS)
            self.crew.update(job)

    def _rendered(self, each: _Window, *, is_lost: bool) -> Rendered | None:
        """Return the result of a window whose call has ended or whose worker is lost; None if it has none."""
        was_first = each.member.calls[0] is each.future
        each.member.calls.remove(each.future)
        if is_lost:
            each.deaths += was_first
            self._cluster.cancel([each.future])
            if each.deaths > MOST_DEATHS:
                raise OSError(DIED.format("of a part of the picture"))
            return None
        try:
            rendered: Rendered | None = self.crew.result(each.member, each.future)
        except NoAnswer:
            return None
        except (ImportError, AttributeError, TypeError) as error:
            raise InputError(f"the workers cannot render this scene: {error}") from error
        if rendered is None:
            each.member.digest = ""  # it has restarted, or rendered another scene
        return rendered
