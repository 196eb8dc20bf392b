"""`render_views`: many pictures of one scene, which is built once."""

from __future__ import annotations

import collections
import dataclasses
import operator
import threading
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from wrt.backend.slices import INTERRUPT_SECONDS, Threads
from wrt.errors import InputError
from wrt.scene.camera import Camera, require_camera

if TYPE_CHECKING:
    from wrt.rendering.renderer import Renderer

TOGETHER = 2
"""Views that are rendered at once: while threads run out of work at the end of one, they take that of the other."""


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
    width: int | None = None,
    height: int | None = None,
    spp: int | None = None,
    noise: float | None = None,
    denoise: bool | None = None,
    layers: Sequence[str] | None = None,
    device: str = "cpu",
    seed: int = 0,
    threads: int | None = None,
    max_depth: int | None = None,
    sampler: str | None = None,
    integrator: str | None = None,
    transparent: bool = False,
) -> Iterator[View]:
    """Render a scene through many cameras, as for a dataset, and yield the pictures in their order.

    The scene is built once, and two pictures are rendered at once, so that small ones keep all threads busy. Each has
    the bits of `wrt.render` with that camera. Leaving the loop ends rendering.

    Args:
        source: as for `wrt.load`.
        cameras: the cameras, of any of wrt's types, all with the same shutter times; they may come from a generator.
        width: pixels, as for `wrt.Renderer`; so are the arguments that are not named here.
        height: pixels.
        spp: samples per pixel; by default those of the scene's settings.
        noise: relative noise at which a picture is done, see `wrt.Renderer.passes`.
        denoise: whether to remove noise, see `wrt.Renderer.denoised`.
        layers: names of layers to render besides radiance, such as depth, normal and object.
        device: "cpu", "cuda" or "cuda:N".
        seed: of all pictures.
        threads: CPU threads; by default all cores.
        max_depth: most segments in a path.
        sampler: source of random numbers.
        integrator: see `wrt.scene.scene.INTEGRATORS`.
        transparent: whether pictures have coverage, see `wrt.load`.

    Raises:
        InputError: if an argument cannot be used.
    """
    from wrt.api import load
    from wrt.rendering.renderer import Renderer

    if isinstance(cameras, Camera) or not isinstance(cameras, Iterable):
        raise InputError(f"cameras must be several of wrt's cameras, not {type(cameras).__name__}")
    coming, count = iter(cameras), operator.length_hint(cameras, 0)
    first = next(coming, None)
    if first is None:
        return
    require_camera(first)
    aspect = width / height if width and height else None
    scene = dataclasses.replace(load(source, transparent=transparent, aspect=aspect), camera=first)
    renderer = Renderer(
        scene,
        width=width,
        height=height,
        device=device,
        seed=seed,
        threads=threads,
        max_depth=max_depth,
        sampler=sampler,
        integrator=integrator,
        layers=layers,
    )
    views = _Views(renderer, {"spp": spp, "noise": noise}, renderer.settings.denoise if denoise is None else denoise)
    yield from views.all(_joined(first, coming), count)


def _joined(first: Camera, rest: Iterator[Camera]) -> Iterator[Camera]:
    yield first
    yield from rest


class _Views:
    """Renders views by a few renderers of one scene on one device, each in a thread of its own."""

    def __init__(self, renderer: Renderer, limits: dict[str, Any], denoise: bool) -> None:
        self._device, self._limits, self._denoise = renderer.device, limits, denoise
        # Bodies around the camera belong to the built scene, which all share; a GPU has no threads that could idle.
        alone = renderer.built_features.bodies or not renderer.device.is_cpu
        self._idle = [renderer, *(renderer.sharing() for _ in range(0 if alone else TOGETHER - 1))]
        self._count, self._seconds_of_view = 0, 0.0
        self._together = len(self._idle)
        self._setting = threading.Lock()
        self._ended = threading.Event()

    def all(self, cameras: Iterator[Camera], count: int) -> Iterator[View]:
        """Yield the views of cameras in order; there are `count`, or 0 if that is not known."""
        self._count = count
        begun: collections.deque[Future[View]] = collections.deque()
        together = self._together
        pool = Threads(together, "wrt-view")
        try:
            for index, camera in enumerate(cameras):
                if len(begun) > together:  # one waits, so that no thread does
                    yield self._wait(begun.popleft())
                begun.append(pool.submit(self._render, index, camera))
            while begun:
                yield self._wait(begun.popleft())
        finally:
            self._ended.set()
            if begun:
                self._device.cancelled.set()
            pool.end()
            self._device.cancelled.clear()

    def _wait(self, view: Future[View]) -> View:
        while True:  # an unlimited wait cannot be interrupted on every system
            try:
                return view.result(timeout=INTERRUPT_SECONDS)
            except TimeoutError:
                if view.done():
                    raise

    def _render(self, index: int, camera: Camera) -> View:
        from wrt.rendering.passes import LONGEST_PASS

        renderer = self._idle.pop()
        renderer.first_pass = self._first_pass(renderer)
        before = renderer.seconds_render
        try:
            with self._setting:  # renderers that share a scene share its camera
                try:
                    renderer.set_camera(camera)
                except InputError as error:
                    raise InputError(f"camera {index}: {error}") from None
            renderer._kernel.seconds_after = self._seconds_after(index)
            for _ in renderer.passes(**self._limits, pass_seconds=LONGEST_PASS):
                if self._ended.is_set():
                    break
            self._seconds_of_view = renderer.seconds_render - before
            image = renderer.denoised() if self._denoise else renderer.image()
            alpha = renderer.alpha()
            whole = image if alpha is None else np.dstack([image, alpha])
            return View(index, camera, whole, renderer.layers(), renderer.spp)
        finally:
            self._idle.append(renderer)

    def _first_pass(self, renderer: Renderer) -> int:
        """Return the samples of a view's first pass: all, once a view is known to take no longer than a pass.

        That costs less than one sample, a multiple of sixteen and a remainder, since the wide kernel takes sixteen
        samples of a pixel at once. On a GPU passes stay short, as nothing interrupts them.
        """
        from wrt.rendering.passes import LONGEST_PASS
        from wrt.scene.scene import MAX_SPP

        has_noise = self._limits["noise"] is not None
        if self._limits["spp"] is None:
            has_noise = has_noise or renderer.settings.noise is not None
        is_known = 0.0 < self._seconds_of_view < LONGEST_PASS
        return MAX_SPP if is_known and renderer.device.is_cpu and not has_noise else 1

    def _seconds_after(self, index: int) -> float:
        """Return how long the views after this one will take, at least as many as before while they are not counted.

        A view alone is mostly too short to load or to compile the wide kernel.
        """
        views = self._count - index - 1 if self._count else index
        return max(views, 0) * self._seconds_of_view / self._together
