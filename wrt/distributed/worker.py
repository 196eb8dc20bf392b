"""What workers do: they keep built scenes, and render windows of them."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import NDArray

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer
    from wrt.scene.camera import Camera
    from wrt.scene.scene import Scene
    from wrt.upload.camera import CropWindow

KEPT = 2
"""Built scenes that a worker keeps: the one that it renders, and the one before."""

_renderers: OrderedDict[str, Renderer] = OrderedDict()
_rendering = threading.Lock()


@dataclass(frozen=True)
class Job:
    """What the windows of a picture have in common.

    Attributes:
        digest: of the scene without its camera, and of the options.
        options: keyword arguments of `wrt.Renderer`.
        camera: the camera, since a worker need not build a scene again for another one.
        threads: CPU threads of a window; by default those of the Dask worker.
    """

    digest: str
    options: dict[str, Any]
    camera: Camera
    threads: int | None


class Rendered(NamedTuple):
    """A window that a worker has rendered.

    Attributes:
        arrays: the arrays of a film for its pixels.
        rays: the rays that were traced.
        seconds: the time that it took, without building the scene.
        worker: the worker's address.
        kind: what the digits depend on, by name: versions, device, processor and libraries.
    """

    arrays: dict[str, NDArray[Any]]
    rays: int
    seconds: float
    worker: str
    kind: dict[str, str]


def render_window(
    job: Job, scene: Scene, window: CropWindow, state: dict[str, NDArray[Any]] | None, spp: int
) -> Rendered:
    """Bring the pixels of a window to `spp` samples each; called on a worker, one window at a time.

    Args:
        job: what the windows have in common.
        scene: the scene, as the worker keeps it.
        window: the window, in pixels of the whole picture.
        state: arrays of a film for its pixels, to go on from.
        spp: samples per pixel in the end.
    """
    from distributed import get_worker

    from wrt._version import __version__
    from wrt.backend.arithmetic import arithmetic_of
    from wrt.parts.render import render_windows

    worker: Any = get_worker()
    with _rendering:
        renderer = _renderer(job, scene, job.threads or worker.state.nthreads)
        if renderer.scene.camera != job.camera:
            renderer.set_camera(job.camera)
        arrays, seconds, rays = render_windows(renderer, (window,), spp, state=state)
        device = renderer.device
        kind = {"wrt": __version__, "warp": device.backend.version, **arithmetic_of(device)}
    return Rendered(arrays, rays, seconds, worker.address, kind)


def _renderer(job: Job, scene: Scene, threads: int) -> Renderer:
    """Return the renderer that this worker keeps for a job, or build it."""
    from wrt.rendering.renderer import Renderer

    if job.digest not in _renderers:
        while len(_renderers) >= KEPT:
            _renderers.popitem(last=False)
        # Its own film is not used, and has one pixel.
        _renderers[job.digest] = Renderer(scene, **{**job.options, "crop": (0, 0, 1, 1)}, threads=threads)
    _renderers.move_to_end(job.digest)
    return _renderers[job.digest]
