"""What workers do: they keep built scenes, and render windows of them."""

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
"""Built scenes that a worker keeps: the one that it renders, and the one before."""

_renderers: OrderedDict[str, Renderer] = OrderedDict()
_rendering = threading.Lock()


@dataclass(frozen=True)
class Job:
    """What the windows of a picture have in common.

    Attributes:
        digest: of the scene without its camera, and of the picture's options.
        options: keyword arguments of `wrt.Renderer`. A worker need not build a scene again for another seed.
        camera: the camera, likewise.
        threads: CPU threads of a worker; by default those that Dask gives it.
    """

    digest: str
    options: dict[str, Any]
    camera: Camera
    threads: int | None


class Ready(NamedTuple):
    """What a worker answers to `prepare`.

    Attributes:
        kind: what its digits depend on, by name: versions, device, processor and libraries.
        digest: that of the job, if the worker has built the scene; else "".
    """

    kind: dict[str, str]
    digest: str


class Rendered(NamedTuple):
    """A window that a worker has rendered.

    Attributes:
        arrays: the arrays of a film for its pixels.
        rays: the rays that were traced.
        seconds: the time that it took; on a CPU without what other work on the machine took of it.
    """

    arrays: dict[str, NDArray[Any]]
    rays: int
    seconds: float


def prepare(job: Job, packed: Sequence[Any] | None) -> Ready:
    """Build a scene, unless it is built already; called on a worker.

    Args:
        job: what the windows have in common.
        packed: the scene by `wrt.distributed.cluster.pack`; None to ask whether it is built.
    """
    from wrt._version import __version__
    from wrt.backend.arithmetic import arithmetic_of
    from wrt.backend.device import Device

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
        job: what the windows have in common.
        window: the window, in pixels of the whole picture.
        state: arrays of a film for its pixels, to go on from.
        spp: samples per pixel in the end.
        seconds_left: time that the picture still takes: whether to load the wide kernel, or to have it compiled.

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
    # Its own film is not used, and has one pixel.
    threads = job.threads or _threads()
    _renderers[job.digest] = Renderer(scene, **{**job.options, "crop": (0, 0, 1, 1)}, threads=threads)


def _threads() -> int | None:
    """Return the threads that Dask gives this worker, None where there is no Dask."""
    if "distributed" not in sys.modules:
        return None
    from distributed import get_worker

    try:
        worker: Any = get_worker()
    except ValueError:
        return None
    return int(worker.state.nthreads)
