"""A renderer whose film is on the head node while the workers of a cluster render."""

from __future__ import annotations

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
from wrt.rendering.catchers import Caught
from wrt.rendering.checkpoint import SETTINGS_OF_PICTURE, identity_of
from wrt.rendering.renderer import Renderer
from wrt.scene.camera import Camera, require_camera
from wrt.scene.scene import Scene


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

    longest_pass = 30.0
    """Longer than on one machine: towards its end windows are small and cost the head node and a worker some 20 ms
    each, and workers wait for the last."""

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
        self._workers = {"device": device, "threads": threads}
        super().__init__(scene, **options)

    def _build(self, like: Any = None) -> None:
        self.device.compile(current_backend().kernels("wrt.kernels.film.film").film_noise)
        self._local: Renderer | None = None
        self.spread = Spread(self._cluster, self.scene)
        self._kernel, self._guides, self._photons = _Remote(), None, None  # type: ignore[assignment]
        options = {name: getattr(self.settings, name) for name in SETTINGS_OF_PICTURE}
        self._options = {**options, "strategy": self.strategy, "light_choice": self.light_choice, "seed": self.seed}
        identity = identity_of(self)
        identity["scene"].pop("camera")
        text = json.dumps([identity, self._workers])
        self._digest = hashlib.blake2b(text.encode(), digest_size=16).hexdigest()

    def set_camera(self, camera: Camera) -> None:
        """Look at the scene through another camera and restart the picture; see `wrt.Renderer.set_camera`."""
        require_camera(camera)
        self.scene.camera = camera
        if self._catchers is not None:
            self._catchers.look_from(camera)
        self._clear()

    def update_vertices(self, *_: Any, **__: Any) -> None:
        """Raise InputError: each frame of a simulation is a scene of its own here."""
        raise InputError("vertices cannot be updated on a cluster; make a renderer of the next frame's scene")

    def set_parameters(self, *_: Any, **__: Any) -> None:
        """Raise InputError: workers keep the scene as it was."""
        raise InputError("parameters cannot be set on a cluster; make a renderer of the changed scene")

    def gradients(self, *_: Any, **__: Any) -> Any:
        """Raise InputError: derivatives are of one process."""
        raise InputError("a cluster has no gradients; use wrt.Renderer")

    def part(self, *_: Any, **__: Any) -> Any:
        """Raise InputError: the cluster renders the whole picture."""
        raise InputError("a part is rendered by one process; use wrt.Renderer")

    def denoised(self) -> NDArray[np.float32]:
        """Return `image` without most of its noise, see `wrt.Renderer.denoised`; the scene is built here for it."""
        return self._with_scene().denoised()

    def _caught(self, *, denoised: bool = False) -> Caught | None:
        return self._with_scene()._caught(denoised=True) if denoised else super()._caught()

    def _with_scene(self) -> Renderer:
        """Return a renderer on this machine with this film."""
        if self._local is None:
            self._local = Renderer(self.scene, **self._options)
        if self._local.camera != self.camera:
            self._local.set_camera(self.camera)
        self._local.film.restore(self.film.state())
        return self._local

    def _launch(self, target: int, seconds_left: float) -> None:
        job = Job(self._digest, {**self._options, **self._workers}, self.camera)
        samples = max(target - self.film.tally().least, 1)
        try:
            self.spread.run(Pass(self.film, self.window, job, target, seconds_left, samples))
        except Exception as error:  # of wrt, of Dask, or of a worker
            if isinstance(error, InputError) and not self.film.tally().samples:
                raise
            has_message = isinstance(error, (InputError, OSError)) and str(error)
            raise ClusterError(str(error) if has_message else f"a worker failed: {error!r}", self) from error


class _Remote:
    """Takes the place of a RenderKernel and of its wide kernel: workers compile and load what they need."""

    is_being_compiled, seconds, lanes = False, 0.0, 1

    def __init__(self) -> None:
        self.wide = self

    def expect(self, seconds: float) -> None:
        """Do nothing."""

    def wait(self) -> None:
        """Do nothing."""
