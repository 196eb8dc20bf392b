"""Render a scene of wrt with Mitsuba 3 (scripts/peers/mitsuba_scene.py), with its error."""

from __future__ import annotations

import dataclasses
import tempfile
from typing import Any

import numpy as np
from numpy.typing import NDArray
from peers.mitsuba_scene import VARIANT, load_mitsuba, to_mitsuba

import wrt
from support.small_scenes import image_of
from support.statistics import ImageTest, image_z_test

__all__ = ["VARIANT", "Reference", "load_mitsuba", "reference_of", "render_reference", "to_mitsuba"]


@dataclasses.dataclass(frozen=True)
class Reference:
    """What Mitsuba rendered.

    Attributes:
        mean: (H, W, 3) float64 linear radiance.
        variance: (H, W, 3) float64 variance of that mean.
        runs: independent renderings behind the variance.
    """

    mean: NDArray[np.float64]
    variance: NDArray[np.float64]
    runs: int

    def compared(self, renderer: wrt.Renderer, spp: int) -> ImageTest:
        """Render as many samples per pixel, and return how that picture compares with this one."""
        image = image_of(renderer, spp)
        return image_z_test(image, renderer.variance(), self.mean, self.variance, n_a=spp, n_b=self.runs)


def render_reference(
    scene: wrt.Scene,
    *,
    width: int,
    height: int,
    max_depth: int,
    spp: int,
    runs: int = 32,
    seed: int = 0,
    integrator: str = "",
) -> Reference:
    """Render `scene` several times in Mitsuba, each with its own random numbers.

    Args:
        scene: with a camera.
        width: pixels.
        height: pixels.
        max_depth: most segments in a path, as in wrt: 1 sees emission only.
        spp: samples per pixel of all runs together.
        runs: independent runs, at least 2; the variance is that between them.
        seed: of the first run.
        integrator: its type, by default a path tracer.
    """
    mi = load_mitsuba()
    with tempfile.TemporaryDirectory() as folder:
        description = to_mitsuba(scene, folder, width=width, height=height, max_depth=max_depth)
        if integrator:
            description["integrator"]["type"] = integrator
        loaded = mi.load_dict(description)
        return reference_of(loaded, spp=spp, runs=runs, seed=seed)


def reference_of(loaded: Any, *, spp: int, runs: int, seed: int) -> Reference:
    """Render a scene that Mitsuba has loaded, several times, each with its own random numbers and its variant."""
    import mitsuba as mi

    # Mitsuba gives run n of a film the seeds n·(its blocks) and up: far apart, they do not overlap.
    seeds = [1_000_003 * (seed + run) for run in range(runs)]
    images = [np.array(mi.render(loaded, spp=max(1, spp // runs), seed=k), np.float64)[..., :3] for k in seeds]
    return Reference(np.mean(images, axis=0), np.var(images, axis=0, ddof=1) / runs, runs)
