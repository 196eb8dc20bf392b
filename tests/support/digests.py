"""Films of many small scenes as digests, so that a change that should leave every picture alone can show that it does.

The scenes use every feature of a kernel: those of `wide_scenes`, the pictures of the documentation, the built-in
scenes, and every integrator. What floating-point arithmetic gives depends on the processor and the C library a little;
`arithmetic` tells machines apart on which films may differ.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pictures
import warp as wp
from pictures.picture import Sheet

import wrt
from support.wide_scenes import CAMERAS, SCENES, wide_kernel

BUILT_IN = ("cornell-box", "many-triangles", "still-life", "teapot")

SIZES: dict[str, dict[str, Any]] = {
    "one-pixel": {"width": 1, "height": 1},
    "narrow": {"width": 3, "height": 33, "max_depth": 3},
    "light-only": {"crop": (16, 20, 45, 21), "strategy": "light"},
    "bsdf-only": {"filter": "box", "max_depth": 2, "strategy": "bsdf"},
    "largest-seed": {"seed": 2**32 - 1},
    "gaussian": {"filter": "gaussian"},
}
"""Settings that need no kernel of their own."""


@dataclass(frozen=True)
class Case:
    """A film: its scene, and the options of the renderer."""

    make: Callable[[], wrt.Scene]
    options: dict[str, Any] = field(default_factory=dict)
    passes: tuple[int, ...] = (3, 22)

    def renderer(self) -> wrt.Renderer:
        return wrt.Renderer(self.make(), **{"width": 45, "height": 31, "threads": 1, **self.options})


def cases() -> dict[str, Case]:
    return dict(_cases())


def _cases() -> Iterator[tuple[str, Case]]:
    for name, (make, options, cameras) in SCENES.items():
        for camera in cameras:
            yield f"{name}-{camera}", Case(lambda make=make, camera=camera: _seen_by(make(), camera), options)
    plain = SCENES["plain"][0]
    for name, options in SIZES.items():
        yield name, Case(lambda: _seen_by(plain(), "disk"), options)
    for group in pictures.GROUPS.values():
        for name, drawing in group.items():
            # tutorial-light with other numbers of samples; balls of a conductor or glass with other constants.
            if name not in ("tutorial-noise", "presets"):
                yield from _pictures(f"picture-{name}", drawing)
    for name in BUILT_IN:
        yield f"built-in-{name}", Case(lambda name=name: wrt.load(name), {"width": 24, "height": 20}, (2,))


def _pictures(name: str, drawing: Any) -> Iterator[tuple[str, Case]]:
    if isinstance(drawing, Sheet):
        for tile, (picture, _) in drawing.tiles().items():
            yield from _pictures(f"{name}-{tile}", picture)
        return
    picture = getattr(drawing, "picture", drawing)
    if not hasattr(picture, "make"):  # what a program writes
        return
    height = max(1, 24 * picture.height // picture.width)
    yield name, Case(picture.make, {**picture.options, "width": 24, "height": height}, (2,))


def _seen_by(scene: wrt.Scene, camera: str) -> wrt.Scene:
    scene.camera = CAMERAS[camera]
    return scene


def film_digest(renderer: wrt.Renderer) -> str:
    """Return a digest of all that a film holds."""
    digest = hashlib.blake2b(digest_size=12)
    for name, array in sorted({**renderer.film.state(), "rays": renderer.film.data.rays.numpy()}.items()):
        digest.update(name.encode() + str(array.dtype).encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@wp.kernel(module="unique", enable_backward=False)
def _probe(values: wp.array(dtype=float), results_out: wp.array2d(dtype=float)):
    i = wp.tid()
    x = values[i]
    results_out[i, 0] = wp.sin(x)
    results_out[i, 1] = wp.cos(x)
    results_out[i, 2] = wp.exp(-wp.abs(x))
    results_out[i, 3] = wp.log(1.0 + wp.abs(x))
    results_out[i, 4] = wp.pow(wp.abs(x), 0.37)
    results_out[i, 5] = wp.atan2(x, 0.7)
    results_out[i, 6] = wp.sqrt(wp.abs(x)) * x + 0.3
    results_out[i, 7] = wp.acos(wp.clamp(x * 0.1, -1.0, 1.0))
    results_out[i, 8] = wp.tan(x * 0.1)


def arithmetic() -> str:
    """Return a digest of functions of many numbers, by Warp's compiler and by NumPy."""
    x = np.linspace(-9.0, 9.0, 4096)
    out = wp.zeros((len(x), 9), dtype=float, device="cpu")
    wp.launch(_probe, dim=len(x), inputs=[wp.array(x, dtype=float, device="cpu"), out], device="cpu")
    digest = hashlib.blake2b(out.numpy().tobytes(), digest_size=12)
    for kind in (np.float32, np.float64):
        y = x.astype(kind)
        for function in (np.sin, np.cos, np.exp, np.arctan, np.tan):
            digest.update(function(y).tobytes())
        digest.update(np.power(np.abs(y), kind(0.37)).tobytes())
    return digest.hexdigest()


def scalar_film(case: Case) -> str:
    """Render a case by the kernel of one thread a pixel, and return the film's digest."""
    return film_digest(rendered(case))


def rendered(case: Case) -> wrt.Renderer:
    """Return the renderer of a case after its passes by the kernel of one thread a pixel."""
    renderer = case.renderer()
    _render(case, renderer, renderer._kernel.scalar, renderer.film.pixels)
    return renderer


def wide_film(case: Case, lanes: int) -> str | None:
    """Render a case by the wide kernel of some lanes, and return the film's digest; None if there is no such kernel."""
    renderer = case.renderer()
    if renderer.integrator not in ("path", "volpath") or renderer.settings.caustics:
        return None
    kernel, threads = wide_kernel(renderer, lanes)
    _render(case, renderer, kernel, threads)
    return film_digest(renderer)


def _render(case: Case, renderer: wrt.Renderer, kernel: Any, threads: int) -> None:
    for target in case.passes:
        if renderer.settings.caustics:  # each sample has photons of its own
            renderer._launch(target, 0.0)
            continue
        renderer.device.launch(kernel, threads, [target, *renderer._inputs])
