"""`render_views`: many pictures of one scene, which is built once."""

from __future__ import annotations

import collections
import dataclasses
import itertools
import operator
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt.errors import InputError
from wrt.scene.camera import Camera, require_camera
from wrt.slices import INTERRUPT_SECONDS, Threads

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer

TOGETHER = 2
"""Views rendered at once: threads that run out of work at the end of one continue with the other."""


@dataclasses.dataclass(frozen=True)
class View:
    """A picture of `render_views`.

    Attributes:
        index: number of the camera, from 0.
        camera: the camera.
        image: (H, W, 3) float32 linear radiance, or (H, W, 4) with coverage for a transparent picture.
        layers: the layers by name, see `wrt.Renderer.layers`.
        spp: samples per pixel.
    """

    index: int
    camera: Camera
    image: NDArray[np.float32]
    layers: dict[str, NDArray[Any]]
    spp: int


def render_views(
    source: Any,
    cameras: Iterable[Camera],
    *,
    spp: int | None = None,
    noise: float | None = None,
    layers: Sequence[str] | None = None,
    device: str = "cpu",
    seed: int = 0,
    threads: int | None = None,
    **options: Any,
) -> Iterator[View]:
    """Render a scene through many cameras, as for a dataset, and yield the pictures in the order of the cameras.

    The scene is built once, and two pictures are rendered at once, so that small ones keep all threads busy. Each has
    the bits of `wrt.render` with that camera. Leaving the loop ends rendering.

    Args:
        source: as for `wrt.load`.
        cameras: cameras of any types with the same shutter times, in the coordinates of the source; an iterable.
        spp: samples per pixel; by default from the scene's settings.
        noise: relative noise at which a picture is done, see `wrt.Renderer.passes`.
        layers: names of layers to render besides radiance, such as depth, normal and object.
        device: "cpu", "cuda" or "cuda:N".
        seed: of all pictures.
        threads: CPU threads; by default all cores.
        options: as for `wrt.render`, such as width, height, integrator, denoise and transparent.

    Raises:
        InputError: if an argument cannot be used.
    """
    from wrt.api import load_with_settings, split_settings
    from wrt.rendering.renderer import Renderer

    if isinstance(cameras, Camera) or not isinstance(cameras, Iterable):
        raise InputError(f"cameras must be several of wrt's cameras, not {type(cameras).__name__}")
    following, count = iter(cameras), operator.length_hint(cameras, 0)
    first = next(following, None)
    if first is None:
        return
    require_camera(first)
    settings, loading = split_settings({**options, "layers": layers})
    scene = load_with_settings(source, settings, **loading, camera=first)
    renderer = Renderer(scene, device=device, seed=seed, threads=threads)
    yield from _Views(renderer, {"spp": spp, "noise": noise}, count).render(itertools.chain([first], following))


class _Views:
    """Renders views by a few renderers of one scene on one device, each in its own thread."""

    def __init__(self, renderer: Renderer, limits: Mapping[str, Any], count: int) -> None:
        """Share a built scene between renderers; `count` is the number of views, or 0 if it is not known."""
        self._device, self._limits, self._count = renderer.device, limits, count
        # Bodies around the camera belong to the built scene, which all share; a GPU has no threads that could idle.
        is_alone = renderer._built.features.bodies or not renderer.device.is_cpu
        self._idle = [renderer, *(renderer.sharing() for _ in range(0 if is_alone else TOGETHER - 1))]
        self._together = len(self._idle)
        self._seconds_of_view = 0.0
        self._camera_lock = threading.Lock()
        self._ended = threading.Event()

    def render(self, cameras: Iterator[Camera]) -> Iterator[View]:
        """Yield the views of cameras in order."""
        begun: collections.deque[Future[View]] = collections.deque()
        pool = Threads(self._together, "wrt-view")
        try:
            for index, camera in enumerate(cameras):
                if len(begun) > self._together:  # one is queued, so that no thread waits
                    yield _result(begun.popleft())
                begun.append(pool.submit(self._render, index, camera))
            while begun:
                yield _result(begun.popleft())
        finally:
            self._ended.set()
            if begun:
                self._device.cancelled.set()
            pool.end()
            self._device.cancelled.clear()

    def _render(self, index: int, camera: Camera) -> View:
        from wrt.rendering.passes import LONGEST_PASS

        renderer = self._idle.pop()
        renderer.first_pass = self._first_pass(renderer)
        before = renderer.seconds_render
        try:
            with self._camera_lock:  # renderers that share a scene share its camera
                try:
                    renderer.set_camera(camera)
                except InputError as error:
                    raise InputError(f"camera {index}: {error}") from None
            # A single view is mostly too short to load or compile the wide kernel for. Without a count, as many views
            # are expected to follow as came before.
            views_left = max(self._count - index - 1, 0) if self._count else index
            renderer._kernel.seconds_after = views_left * self._seconds_of_view / self._together
            for _ in renderer.passes(**self._limits, pass_seconds=LONGEST_PASS):
                if self._ended.is_set():
                    break
            self._seconds_of_view = renderer.seconds_render - before
            return View(index, camera, renderer.finished(), renderer.layers(), renderer.spp)
        finally:
            self._idle.append(renderer)

    def _first_pass(self, renderer: Renderer) -> int:
        """Return the samples of a view's first pass: all, once a view is known to take no longer than a pass.

        That is faster than one sample, a multiple of sixteen and a remainder, since the wide kernel takes sixteen
        samples of a pixel at once. On a GPU passes stay short, because nothing interrupts them.
        """
        from wrt.rendering.passes import LONGEST_PASS
        from wrt.scene.scene import MAX_SPP

        has_noise = self._limits["noise"] is not None
        if self._limits["spp"] is None:
            has_noise = has_noise or renderer.settings.noise is not None
        is_known = 0.0 < self._seconds_of_view < LONGEST_PASS
        return MAX_SPP if is_known and renderer.device.is_cpu and not has_noise else 1


def _result(view: Future[View]) -> View:
    while True:  # an unlimited wait cannot be interrupted on every system
        try:
            return view.result(timeout=INTERRUPT_SECONDS)
        except TimeoutError:
            if view.done():
                raise
