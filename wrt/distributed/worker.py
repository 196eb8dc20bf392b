"""Functions that workers call: they build scenes, keep them, and render windows."""

from __future__ import annotations

import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import NDArray

from wrt.distributed.cluster import unpack

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer
    from wrt.scene.camera import Camera
    from wrt.scene.scene import Scene
    from wrt.upload.camera import CropWindow

KEPT = 2
"""Built scenes that a worker keeps: the present one and the previous one."""

_renderers: OrderedDict[str, Renderer] = OrderedDict()
_rendering = threading.Lock()


@dataclass(frozen=True)
class Job:
    """The values that all windows of a picture share.

    Attributes:
        digest: a digest of the scene without its camera, and of the picture's options.
        options: keyword arguments of `wrt.Renderer`. Another seed does not need another build of the scene.
        camera: the camera; another one does not either.
        threads: CPU threads of a worker, by default as many as Dask gives it.
    """

    digest: str
    options: dict[str, Any]
    camera: Camera
    threads: int | None


class Ready(NamedTuple):
    """The reply of a worker to `prepare`.

    Attributes:
        kind: what its digits depend on, by name: versions, device, processor and libraries.
        digest: the job's digest if the worker has built the scene, else "".
    """

    kind: dict[str, str]
    digest: str


class Rendered(NamedTuple):
    """A window that a worker has rendered.

    Attributes:
        arrays: the arrays of a film for its pixels.
        rays: the number of traced rays.
        seconds: the time of rendering; on a CPU, without the share of other work on the machine.
    """

    arrays: dict[str, NDArray[Any]]
    rays: int
    seconds: float


def prepare(job: Job, packed: Sequence[Any] | None) -> Ready:
    """Build a scene, unless it is built already; called on a worker.

    Args:
        job: the values that all windows share.
        packed: the scene by `wrt.distributed.cluster.pack`; None to ask whether it is built.
    """
    from wrt._version import __version__
    from wrt.backend.device import Device
    from wrt.backend.processor import arithmetic_of

    device = Device(job.options["device"])
    kind = {"wrt": __version__, "warp": device.backend.version, **arithmetic_of(device)}
    if packed is not None:
        with _rendering:
            if job.digest not in _renderers:
                _build(job, unpack(packed))
    return Ready(kind, job.digest if job.digest in _renderers else "")


def render_window(
    job: Job, window: CropWindow, state: dict[str, NDArray[Any]] | None, spp: int, seconds_left: float
) -> Rendered | None:
    """Bring the pixels of a window to `spp` samples each; called on a worker, which renders one window at a time.

    Args:
        job: the values that all windows share.
        window: the window, in pixels of the whole picture.
        state: arrays of a film for its pixels, to go on from.
        spp: samples per pixel in the end.
        seconds_left: estimated time until the picture is finished, which decides whether the wide kernel pays.

    Returns:
        The window, or None if the worker has not built the scene.
    """
    from wrt.parts.render import render_windows

    with _rendering:
        renderer = _renderers.get(job.digest)
        if renderer is None:
            return None
        _renderers.move_to_end(job.digest)
        renderer.seed = job.options["seed"]
        if renderer.scene.camera != job.camera:
            renderer.set_camera(job.camera)
        began = time.process_time()
        arrays, seconds, rays = render_windows(renderer, (window,), spp, state=state, seconds_left=seconds_left)
        if renderer.device.is_cpu:
            seconds = (time.process_time() - began) / renderer.threads
    return Rendered(arrays, rays, seconds)


def _build(job: Job, scene: Scene) -> None:
    from wrt.rendering.renderer import Renderer

    while len(_renderers) >= KEPT:
        _renderers.popitem(last=False)
    threads = job.threads or _threads()  # its own film is not used, and has one pixel
    _renderers[job.digest] = Renderer(scene, **{**job.options, "crop": (0, 0, 1, 1)}, threads=threads)


def _threads() -> int | None:
    """Return the threads that Dask gives this worker, None without Dask."""
    if "distributed" not in sys.modules:
        return None
    from distributed import get_worker

    try:
        worker: Any = get_worker()
    except ValueError:
        return None
    return int(worker.state.nthreads)
