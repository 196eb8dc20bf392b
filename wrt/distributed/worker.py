"""Functions that workers call: they build scenes, keep them, and render windows."""

from __future__ import annotations

import pickle
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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
        options: keyword arguments of `wrt.Renderer`.
        camera: the camera; another one does not need another build of the scene.
    """

    digest: str
    options: dict[str, Any]
    camera: Camera


class Rendered(NamedTuple):
    """The arrays of a film for the pixels of a window, the rays that were traced for them, and the seconds it took."""

    arrays: dict[str, NDArray[Any]]
    rays: int
    seconds: float


def pack(value: object) -> list[Any]:
    """Return a value as bytes and arrays of bytes, which a scheduler passes on without copying or reading them."""
    dumps: Any = pickle.dumps
    if "distributed" in sys.modules:  # its pickles have the classes of the main program
        from distributed.protocol import pickle as of_dask

        dumps = of_dask.dumps
    buffers: list[pickle.PickleBuffer] = []
    head = dumps(value, protocol=5, buffer_callback=buffers.append)
    return [head, *(np.frombuffer(buffer.raw(), np.uint8) for buffer in buffers)]


def prepare(job: Job, packed: Sequence[Any] | None) -> tuple[dict[str, str], str]:
    """Build a scene, unless it is built already; called on a worker.

    Args:
        job: the values that all windows share.
        packed: the scene by `pack`; None to ask whether it is built.

    Returns:
        What the digits of the worker's pixels depend on, by name: versions, device, processor and libraries; and the
        job's digest if the worker has built the scene, else "".
    """
    from wrt._version import __version__
    from wrt.backend.device import Device
    from wrt.backend.processor import arithmetic_of

    device = Device(job.options["device"])
    kind = {"wrt": __version__, "warp": device.backend.version, **arithmetic_of(device)}
    if packed is not None:
        with _rendering:
            if job.digest not in _renderers:
                head, *buffers = packed
                _build(job, pickle.loads(head, buffers=buffers))  # from the head node, which workers trust
    return kind, job.digest if job.digest in _renderers else ""


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
    with _rendering:
        built = _renderers.get(job.digest)
        if built is None:
            return None
        _renderers.move_to_end(job.digest)
        if built.scene.camera != job.camera:
            built.set_camera(job.camera)
        renderer = built.of_window(window)
        if state is not None:
            renderer.film.restore(state)
        began = time.process_time()
        seconds, _ = renderer._trace(spp, seconds_left)
        if renderer.device.is_cpu:  # by the clock it would count other work on the machine
            seconds = (time.process_time() - began) / renderer.threads
        return Rendered(renderer.film.arrays(), renderer.rays, seconds)


def _build(job: Job, scene: Scene) -> None:
    from wrt.errors import muted
    from wrt.rendering.renderer import Renderer

    while len(_renderers) >= KEPT:
        _renderers.popitem(last=False)
    options = {**job.options, "threads": job.options["threads"] or _threads()}
    options["crop"] = (0, 0, 1, 1)  # its own film is not used
    with muted():  # the head node shows the warnings of a scene
        _renderers[job.digest] = Renderer(scene, **options)


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
