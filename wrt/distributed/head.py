"""A renderer whose film is on the head node while the workers of a cluster render."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend import current_backend
from wrt.distributed.dask_cluster import DaskCluster, client_of
from wrt.distributed.processes import Processes
from wrt.distributed.spread import Pass, Spread
from wrt.distributed.worker import Job
from wrt.errors import InputError
from wrt.rendering.checkpoint import SETTINGS_OF_PICTURE, identity_of
from wrt.rendering.film import Film
from wrt.rendering.renderer import Renderer
from wrt.scene.camera import Camera, require_camera
from wrt.scene.scene import Scene

LONGEST_CLUSTER_PASS = 30.0
"""Most seconds of a pass, longer than on one machine: towards its end windows are small and cost the head node and a
worker some 20 ms each, and workers wait for the last."""


class ClusterError(OSError):
    """The cluster cannot go on with a picture: its scheduler or its workers are lost, or a worker failed.

    Attributes:
        renderer: the renderer with the samples so far; it can show and save the picture, and its checkpoint.
    """

    def __init__(self, message: str, renderer: DistributedRenderer) -> None:
        super().__init__(message)
        self.renderer = renderer


class DistributedRenderer(Renderer):
    """A `wrt.Renderer` whose passes are rendered by the workers of a Dask cluster, with the same bits.

    Passes, limits, noise, checkpoints and pictures are those of a Renderer. The scene goes to each worker once; windows
    of the film go to and fro. Nothing is built on the head node, which needs memory for the film.

    Attributes:
        spread: spreads passes over the workers.
    """

    longest_pass = LONGEST_CLUSTER_PASS

    def __init__(
        self, scene: Scene, *, client: Any, device: str = "cpu", threads: int | None = None, **options: Any
    ) -> None:
        """Prepare to render a scene.

        Args:
            scene: the scene; later changes to it have no effect.
            client: as for `client_of`, or the `Processes` of several GPUs.
            device: of the workers: "cpu", or "cuda"; processes have their own.
            threads: CPU threads of a worker process, by default as many as Dask gives it; it renders one window at a
                time.
            options: as for `wrt.Renderer`.

        Raises:
            InputError: on unusable values, an empty scene, or without workers.
        """
        self._cluster = client if isinstance(client, Processes) else DaskCluster(client_of(client))
        self._device_of_workers, self._threads_of_workers = device, threads
        self._local: Renderer | None = None
        super().__init__(scene, **options)

    def _build(self) -> None:
        film = current_backend().kernels("wrt.kernels.film.film")
        with self.device.compiling() as compile:
            compile(film.film_noise)
        self.spread = Spread(self._cluster, self.scene)
        self._kernel = _Remote(self)  # type: ignore[assignment]
        options = {name: getattr(self.settings, name) for name in SETTINGS_OF_PICTURE}
        self._options = {**options, "seed": self.seed, "strategy": self.strategy, "light_choice": self.light_choice}
        identity = identity_of(self)
        identity["scene"].pop("camera")
        text = json.dumps([identity, self._device_of_workers, self._threads_of_workers])
        self._digest = hashlib.blake2b(text.encode(), digest_size=16).hexdigest()
        self._inputs, self._guides = [], None

    @property
    def job(self) -> Job:
        """The values that all windows of a pass share."""
        assert self.scene.camera is not None
        options = {**self._options, "device": self._device_of_workers}
        return Job(self._digest, options, self.scene.camera, self._threads_of_workers)

    def set_camera(self, camera: Camera) -> None:
        """Look at the scene through another camera and restart the picture; see `wrt.Renderer.set_camera`."""
        require_camera(camera)
        self.scene.camera = camera
        self._clear()

    def update_vertices(self, *_: Any, **__: Any) -> None:
        """Raise InputError: each frame of a simulation is a scene of its own here."""
        raise InputError("vertices cannot be updated on a cluster; make a renderer of the next frame's scene")

    def part(self, *_: Any, **__: Any) -> Any:
        """Raise InputError: the cluster renders the whole picture."""
        raise InputError("a part is rendered by one process; use wrt.Renderer")

    def compile(self) -> float:
        """Do nothing: workers compile what they need."""
        return 0.0

    def denoised(self) -> NDArray[np.float32]:
        """Return `image` without most of its noise, see `wrt.Renderer.denoised`; the scene is built here for it."""
        if self._local is None:
            self._local = Renderer(self.scene, **self._options)
        if self._local.scene.camera != self.scene.camera:
            assert self.scene.camera is not None
            self._local.set_camera(self.scene.camera)
        self._local.film.restore(self.film.state())
        return self._local.denoised()

    def trace_film(self, film: Film, target: int, seed: int) -> None:
        """Bring every pixel of another film of this picture's size to `target` samples, with another seed."""
        job = self.job
        self._bring(film, dataclasses.replace(job, options={**job.options, "seed": seed}), target, 0.0)

    def _bring(self, film: Film, job: Job, spp: int, seconds_left: float) -> None:
        samples = max(spp - int(film.counts.min()), 1)
        try:
            self.spread.run(Pass(film, self.crop, job, spp, seconds_left, samples))
        except Exception as error:  # of wrt, of Dask, or of a worker
            if isinstance(error, InputError) and not self.film.counts.any():
                raise
            has_message = isinstance(error, (InputError, OSError)) and str(error)
            raise ClusterError(str(error) if has_message else f"a worker failed: {error!r}", self) from error


class _Remote:
    """Takes the place of a RenderKernel."""

    is_being_compiled, seconds_beside, lanes = False, 0.0, 1

    def __init__(self, renderer: DistributedRenderer) -> None:
        self._renderer = renderer

    def expect(self, seconds: float) -> None:
        """Do nothing: workers load what they need."""

    def launch(self, inputs: list[Any], seconds_left: float) -> None:
        """Bring every pixel to the number of samples that is the first of the inputs."""
        renderer, (spp,) = self._renderer, inputs
        renderer._bring(renderer.film, renderer.job, spp, seconds_left)


def render(
    source: Any,
    *,
    client: Any,
    spp: int | None = None,
    time: float | None = None,
    noise: float | None = None,
    adaptive: bool | str | None = None,
    **options: Any,
) -> NDArray[np.float32]:
    """Render `source` on the workers of a Dask cluster; return what `wrt.render` does, with the same bits.

    Args:
        source: as for `wrt.load`.
        client: as for `DistributedRenderer`, like `options`.
        spp: as for `wrt.Renderer.passes`, like `time`, `noise` and `adaptive`.
        time: seconds of rendering.
        noise: relative noise of the picture.
        adaptive: whether tiles stop once they are good enough.
        options: see `client`.

    Raises:
        InputError: if an argument cannot be used, or no worker can render the scene.
        ClusterError: if the scheduler or the workers are lost; its `renderer` has the picture so far.
    """
    from wrt.api import finished_image, load

    width, height = options.get("width"), options.get("height")
    scene = load(source, aspect=width / height if width and height else None)
    renderer = DistributedRenderer(scene, client=client, **options)
    for _ in renderer.passes(spp=spp, time=time, noise=noise, adaptive=adaptive, pass_seconds=renderer.longest_pass):
        pass
    return finished_image(renderer)
