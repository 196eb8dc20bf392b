"""Spread a pass over the workers of a cluster.

What is decided here: how large windows are, which worker renders each, and when a window that takes too long is given
to another worker. A window's result does not depend on who renders it, so whichever comes first counts.
"""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from wrt.distributed.cluster import Cluster, NoAnswer
from wrt.distributed.crew import MOST_DEATHS, Crew, Member, Try
from wrt.distributed.windows import windows_of_pass
from wrt.distributed.worker import Job, Rendered, render_window
from wrt.errors import InputError, warn
from wrt.parts.cut import pixels_of
from wrt.scene.scene import Scene
from wrt.upload.camera import CropWindow

POLL_SECONDS = 0.2
"""Interval at which late windows and new workers are looked for."""

WITHOUT_WORKERS_SECONDS = 600.0
"""Time to wait for a worker when all have gone: those that died are started again, or others come."""

MENTIONED_SECONDS = 10.0
"""Time without workers after which a person is told why nothing happens; workers that are started again take less."""

Keep = Callable[[CropWindow, Rendered], object]
State = Callable[[CropWindow], "dict[str, NDArray[Any]] | None"]


@dataclass(frozen=True)
class Pass:
    """What is to be rendered.

    Attributes:
        job: what the windows have in common.
        crop: the picture.
        samples: how many samples a pixel lacks at most.
        spp: samples per pixel in the end.
        seconds_left: time that the picture still takes, of which this pass is a share.
        state: returns the arrays of the film for a window, None where it is empty.
    """

    job: Job
    crop: CropWindow
    samples: int
    spp: int
    seconds_left: float
    state: State

    @property
    def seed(self) -> int:
        """The seed of its samples."""
        return int(self.job.options["seed"])


@dataclass(eq=False)
class _Window:
    """A window that is to be rendered.

    Attributes:
        window: the window.
        tries: the workers that have it.
        deaths: workers that died while they rendered it.
    """

    window: CropWindow
    tries: list[Try] = field(default_factory=list)
    deaths: int = 0


class Spread:
    """Renders windows on the workers of a cluster.

    Attributes:
        crew: the workers.
    """

    def __init__(self, cluster: Cluster, scene: Scene) -> None:
        """Prepare to render a scene on the workers of a cluster."""
        settings = dataclasses.replace(scene.settings, denoise=False)  # the head node's task
        self._cluster = cluster
        self._ended = threading.Event()
        self.crew = Crew(cluster, dataclasses.replace(scene, settings=settings), self._ended.set)
        self._seconds_of_sample: dict[int, float] = {}  # by the seed, since a pilot has a sample in few of its pixels

    def run(self, do: Pass, keep: Keep) -> None:
        """Render a pass; `keep` is called with each window and what became of it.

        Raises:
            InputError: where a worker cannot render the scene.
            OSError: where workers died of a window.
        """
        coming = windows_of_pass(do.crop, lambda: len(self.crew.members), lambda: self._seconds_of_pixel(do))
        going: list[_Window] = []
        left = pixels_of((do.crop,))
        try:
            while left:
                self.crew.update(do.job)
                self._submit(do, coming, going)
                self._wait(do.job)
                for each in list(going):
                    rendered = self._rendered(each)
                    if rendered is not None:
                        going.remove(each)
                        self._leave(each)
                        keep(each.window, rendered)
                        left -= pixels_of((each.window,))
                        self._measure(do, each.window, rendered)
        finally:
            self._cluster.cancel([one.future for each in going for one in each.tries])
            for each in going:
                for one in each.tries:
                    one.member.tries.remove(one)

    def _submit(self, do: Pass, coming: Iterator[CropWindow], going: list[_Window]) -> None:
        """Give windows to workers that can take them, late ones first."""
        for each in going:
            if all(self.crew.is_late(one.member) for one in each.tries):
                having = {one.member for one in each.tries}
                member = next((member for member in self.crew.free(do.job) if member not in having), None)
                if member is not None:
                    self._give(do, each, member)
        while free := self.crew.free(do.job):
            window = next(coming, None)
            if window is None:
                return
            going.append(_Window(window))
            self._give(do, going[-1], free[0])

    def _give(self, do: Pass, each: _Window, member: Member) -> None:
        x0, y0, x1, y1 = each.window
        name = f"wrt-{do.job.digest[:8]}-{x0},{y0},{x1},{y1}-to-{do.spp}"
        job, state = self.crew.job_of(member, do.job), do.state(each.window)
        future = self.crew.call(member, name, render_window, job, each.window, state, do.spp, do.seconds_left)
        paths = pixels_of((each.window,)) * max(do.samples, 1)
        each.tries.append(Try(member, future, time.monotonic(), paths, do.seed))
        member.tries.append(each.tries[-1])

    def _wait(self, job: Job) -> None:
        """Wait until a worker has ended something, or for POLL_SECONDS; and for a worker, if there are none."""
        self._ended.wait(POLL_SECONDS)
        self._ended.clear()
        since, is_said = time.monotonic(), False
        while not self.crew.members:
            if time.monotonic() - since > WITHOUT_WORKERS_SECONDS:
                raise OSError(f"the scheduler has had no worker for {WITHOUT_WORKERS_SECONDS:.0f} s")
            if time.monotonic() - since > MENTIONED_SECONDS and not is_said:
                is_said = True
                warn(f"the scheduler has no worker; waiting for one, at most {WITHOUT_WORKERS_SECONDS:.0f} s")
            time.sleep(POLL_SECONDS)
            self.crew.update(job)

    def _rendered(self, each: _Window) -> Rendered | None:
        """Return what became of a window, None while it is not done."""
        for one in list(each.tries):
            if not self.crew.is_there(one.member):
                each.deaths += one is one.member.tries[0]
                self._forget(each, one)
                self._cluster.cancel([one.future])
                if each.deaths > MOST_DEATHS:
                    raise OSError("workers died of a part of the picture, perhaps for lack of memory; see their logs")
            elif one.future.done():
                self._forget(each, one)
                try:
                    rendered: Rendered | None = self._cluster.result(one.future)
                except NoAnswer:
                    self.crew.has_not_answered(one.member)
                    continue
                except (ImportError, AttributeError, TypeError) as error:
                    raise InputError(f"the workers cannot render this scene: {error}") from error
                self.crew.answered(one, has_rendered=rendered is not None)
                if rendered is not None:
                    return rendered
                one.member.digest = ""  # it has begun anew, or rendered something else
        return None

    def _forget(self, each: _Window, one: Try) -> None:
        each.tries.remove(one)
        one.member.tries.remove(one)

    def _leave(self, each: _Window) -> None:
        """Cancel a window on the other workers that have it; what a worker renders already it renders in vain."""
        waiting = [one for one in each.tries if one is not one.member.tries[0]]
        self._cluster.cancel([one.future for one in waiting])
        for one in waiting:
            self._forget(each, one)
        for one in each.tries:
            one.in_vain = True

    def _seconds_of_pixel(self, do: Pass) -> float:
        return self._seconds_of_sample.get(do.seed, 0.0) * max(do.samples, 1)

    def _measure(self, do: Pass, window: CropWindow, rendered: Rendered) -> None:
        now = rendered.seconds / (pixels_of((window,)) * max(do.samples, 1))
        before = self._seconds_of_sample.get(do.seed)
        self._seconds_of_sample[do.seed] = now if not before else 0.8 * before + 0.2 * now
