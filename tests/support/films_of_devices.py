"""The same film by two devices: how far they agree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import wrt
from support.digests import Case, cases
from support.wide_scenes import CAMERAS, noise, with_uvs
from wrt.scene.layers import LAYERS

FILMS = (
    "built-in-cornell-box",
    "built-in-still-life",
    "panes-perspective",
    "moving-moving",
    "plain-disk",
    "models-fisheye",
    "distributions-panorama",
    "principled-perspective",
    "textures-moving",
    "bodies-moving",
    "clouds-perspective",
    "deforming-moving",
    "lamps-with-holes",
    "caustics-orthographic",
)
"""Names in `film_cases()`: together, every feature of a render kernel. From the fifth on they compile for long."""

OPTIONS: dict[str, dict[str, Any]] = {
    "plain-disk": {"layers": tuple(LAYERS), "clamp_indirect": 2.0, "regularization": 0.2},
    "textures-moving": {},
    "clouds-perspective": {"sampler": "stratified", "layers": ("light_groups",)},
}
"""Options that replace those of a case: NVRTC takes three times as long for one kernel of all these features as for two
kernels."""

AGREE = 1e-3
"""Relative difference of a pixel's colour: rough and specular surfaces multiply rounding errors by up to a thousand."""

MAY_DIFFER = {"models-fisheye": 0.02, "bodies-moving": 0.001, "caustics-orthographic": 0.001}
"""Share of pixels that may disagree, by film. Of many lights another is chosen where a random number is at a boundary:
on the CPU, too, a lamp that is moved by 1e-7 changes 1.3 % of the pixels of the first scene. In the second, paths are
long, and of 22,000 one was measured that multiplies rounding errors by 10^4. In the third one pixel differs, of 1,395:
photons choose at random, too."""


def lamps_with_holes() -> wrt.Scene:
    """Return lamps with holes above surfaces with holes: triangles and exact shapes, most of them moving.

    Shadow rays to a hole are traced to nowhere on a GPU (`Features.gpu`), through both levels of the tree.
    """
    mask = wrt.Diffuse(0.7, opacity=wrt.ImageTexture(noise(13), channel="r", cutoff=0.5, filter="nearest"))
    veil = wrt.Diffuse((0.8, 0.4, 0.2), opacity=wrt.ImageTexture(noise(14), channel="g"))
    rise = wrt.Motion.translation((0.1, 0.2, -0.1))
    turn = wrt.Motion.rotation((0.2, 1.0, 0.3), 50.0, offset=(0.0, 0.1, 0.0))
    scene = wrt.Scene(camera=CAMERAS["moving"])
    scene.add(wrt.quad((-4, 0, 4), (8, 0, 0), (0, 0, -8)), material=wrt.Diffuse(0.6))
    lamps: tuple[tuple[wrt.Mesh, wrt.Diffuse, wrt.Motion | None], ...] = (
        (wrt.quad((-2.0, 2.2, -0.5), (0.9, 0, 0), (0, 0, 0.9)), mask, None),
        (wrt.sphere((-0.6, 1.6, 0.2), 0.3, exact=True), mask, turn),
        (wrt.disk((0.4, 2.0, 0.0), (0.1, -1.0, 0.2), 0.5), mask, rise),
        (wrt.cylinder((1.1, 1.2, 0.3), (1.5, 1.7, 0.0), 0.2), veil, turn),
        (wrt.disk((1.9, 1.5, 0.5), (-1.0, -0.4, 0.1), 0.4), veil, None),
    )
    for mesh, material, motion in lamps:
        scene.add(mesh, material=material, emission=(7.0, 6.0, 4.0), two_sided_emission=True, transform=motion)
    scene.add(wrt.sphere((-0.5, 0.6, 0.5), 0.35, exact=True), material=mask, transform=rise)
    scene.add(with_uvs(wrt.sphere((0.4, 0.5, 0.6), 0.35, subdivisions=2)), material=veil, transform=rise)
    scene.add(wrt.cylinder((1.0, 0.1, 0.8), (1.3, 0.8, 0.6), 0.2), material=wrt.Diffuse(0.5), transform=turn)
    return scene


def film_cases() -> dict[str, Case]:
    """Return the films by name: those of `digests.cases`, and one for what GPUs do differently."""
    return {**cases(), "lamps-with-holes": Case(lamps_with_holes, {"width": 24, "height": 16, "light_choice": "power"})}


@dataclass(frozen=True)
class Films:
    """A film by the CPU and by another device.

    Attributes:
        name: the case.
        rays: of the CPU, and of the device.
        counts_agree: whether every pixel has as many samples, and as many that were rejected.
        agreeing: by layer, the share of pixels that differ by no more than AGREE.
    """

    name: str
    rays: tuple[int, int]
    counts_agree: bool
    agreeing: dict[str, float]

    @property
    def problems(self) -> list[str]:
        """What does not agree."""
        least = 1.0 - MAY_DIFFER.get(self.name, 0.0)
        found = [f"{layer}: {share:.2%} of pixels" for layer, share in self.agreeing.items() if share < least]
        if self.rays[0] != self.rays[1]:
            found.append(f"{self.rays[1]} rays instead of {self.rays[0]}")
        return found if self.counts_agree else [*found, "numbers of samples"]


def films_of(name: str, case: Case, device: str) -> Films:
    """Render a case of `film_cases` on the CPU and on a device."""
    options = OPTIONS.get(name, case.options)
    cpu, gpu = (_rendered(case, options, each) for each in ("cpu", device))
    counts = bool((cpu.film.counts == gpu.film.counts).all()) and cpu.film.rejected == gpu.film.rejected
    layers = gpu.layers()
    pairs = {"radiance": (cpu.image(), gpu.image())} if cpu.renders_light else {}
    pairs |= {layer: (values, layers[layer]) for layer, values in cpu.layers().items()}
    agreeing = {layer: float((relative_difference(*pair) <= AGREE).mean()) for layer, pair in pairs.items()}
    return Films(name, (cpu.rays, gpu.rays), counts, agreeing)


def _rendered(case: Case, options: dict[str, Any], device: str) -> wrt.Renderer:
    renderer = wrt.Renderer(case.make(), **{"width": 45, "height": 31, "device": device, **options})
    for target in (1, 4):  # a pass of one sample, and one of several
        renderer._trace(target, 0.0)
    assert not renderer.renders_light or renderer.image().std() > 0.0
    return renderer


def relative_difference(a: NDArray, b: NDArray) -> NDArray:
    """Return each pixel's largest difference, relative to its brightest channel or to a thousandth of the mean."""
    a, b = np.atleast_3d(a).astype(np.float64), np.atleast_3d(b).astype(np.float64)
    finite = np.isfinite(a)
    if (finite != np.isfinite(b)).any():
        return np.full(a.shape[:2], np.inf)
    a, b = np.where(finite, a, 0.0), np.where(finite, b, 0.0)
    size = np.maximum(np.abs(a), np.abs(b))
    difference: NDArray = np.abs(a - b).max(axis=2) / np.maximum(size.max(axis=2), 1e-3 * size.mean() + 1e-30)
    return difference
